"""Estimates while data arrive: their errors and 1-sigma at several instants, against what could be
known then, and what a chunk costs."""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from multiprocessing import get_context

import numpy as np
from recorder import FIRST_SEED, Recorder

from steelyard.arrays import Array
from steelyard.identification.recursive.follow import Following, follow
from steelyard.identification.solve.joint_motion import fit_jointly

INSTANTS = (8.0, 10.0, 15.0, 20.0)
"""[s]"""
BOUNDS = 4
"""Experiments whose bound is looked at at every instant: it hardly depends on the noise."""

_recorder: Recorder | None = None


def draw(seed: int) -> tuple[Array, Array, Array, list[float]]:
    """Errors and covariances at the instants, what could be known there and milliseconds of
    every chunk."""
    global _recorder
    _recorder = _recorder or Recorder()
    experiment = _recorder(seed)
    truth = _recorder.robot.platform.body_parameters
    states, spent, last = list[Following](), list[float](), time.process_time()
    for found in follow(experiment):
        now = time.process_time()
        spent.append(1e3 * (now - last))
        last = now
        states = [found]
    (found,) = states
    times = np.array([each.time for each in found.instants])
    at = [found.instants[int(np.searchsorted(times, t + 0.4)) - 1] for t in INSTANTS]
    errors = np.array([each.value - truth for each in at])
    bounds = np.full(errors.shape, np.nan)
    if seed < FIRST_SEED + BOUNDS:
        for i, each in enumerate(at):
            run = replace(experiment.runs[0], window=(0.0, each.time))
            bounds[i] = fit_jointly(replace(experiment, runs=(run,))).bound.standard_deviation
    # The first is that of the beginning, the last one judges nothing more.
    return errors, np.array([each.covariance for each in at]), bounds, spent[1:-1]


def main(count: int, processes: int) -> None:
    with get_context("spawn").Pool(processes) as pool:
        drawn = list(pool.imap(draw, range(FIRST_SEED, FIRST_SEED + count)))
    errors = np.array([each[0] for each in drawn])
    covariances = np.array([each[1] for each in drawn])
    bounds = np.nanmean([each[2] ** 2 for each in drawn], axis=0) ** 0.5
    print(f"{count} experiments: CoGiRo, 20 s on six axes, sensors of the paper, method recursive")
    print("   at   chi2/10   95 % cover   rmse / bound   1-sigma / bound")
    for i, instant in enumerate(INSTANTS):
        sigma = np.sqrt(np.diagonal(covariances[:, i], axis1=1, axis2=2))
        chi = [
            e @ np.linalg.solve(C, e) for e, C in zip(errors[:, i], covariances[:, i], strict=True)
        ]
        cover = np.mean(np.abs(errors[:, i]) < 1.96 * sigma)
        rmse = np.sqrt(np.mean(errors[:, i] ** 2, axis=0))
        ratio = np.exp(np.mean(np.log(rmse / bounds[i])))
        stated = np.exp(np.mean(np.log(np.sqrt(np.mean(sigma**2, axis=0)) / bounds[i])))
        print(
            f"{instant:4.0f} s {np.mean(chi) / 10:8.2f} {100 * cover:10.1f} % {ratio:12.3f}"
            f" {stated:15.3f}"
        )
    spent = np.concatenate([each[3] for each in drawn])
    print(
        f"a chunk takes {np.median(spent):.0f} ms of CPU in the median, {np.quantile(spent, 0.99):.0f}"
        " ms in one of a hundred"
    )


if __name__ == "__main__":
    count, processes = (int(each) for each in (sys.argv[1:3] or ("60", "2")))
    main(count, processes)
