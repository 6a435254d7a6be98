"""Swings without force sensors and swings with them, of one body on one robot, simulated by MuJoCo:
whether both kinds of data agree, and whether they tell more together than either does.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

import numpy as np

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parent.parent / "examples" / "free-swinging"))
from free_swings import CABLES, body_of
from mujoco_swings import swings

FIRST_SEED = 210_000
"""Apart from the seeds of every test and benchmark."""
WEIGHED = 1e-3
"""1-sigma of the mass from a scale, as a part of it."""
AIR = 0.02
"""Rate at which air slows the platform [1/s]."""
KINDS = ("forces", "swings", "together")
CENTRE, MOMENTS = slice(1, 4), slice(4, 7)


class Told(NamedTuple):
    """What one kind of data tells of a body."""

    value: Array
    """The ten, shape (10,)."""
    covariance: Array
    accepted: bool | None
    seconds: float
    """Of one core."""

    @property
    def sigma(self) -> Array:
        return np.sqrt(np.diag(self.covariance))


def chi_square(off: Array, covariance: Array) -> float:
    """Per number."""
    return float(off @ np.linalg.solve(covariance, off)) / len(off)


def parts_of(experiment: Experiment, mass: tuple[float, float]) -> dict[str, Experiment]:
    """The runs with forces, those without, whose body has been weighed, and all."""
    weighed = tuple(run for run in experiment.runs if "cables" in run.streams)
    swung = tuple(run for run in experiment.runs if "cables" not in run.streams)

    def of(runs: tuple, known: Mapping) -> Experiment:
        used = {name for run in runs for name in run.streams}
        instruments = {n: each for n, each in experiment.instruments.items() if n in used}
        return replace(experiment, runs=runs, instruments=instruments, known=known)

    known = {"mass": mass}
    kinds = (of(weighed, known), of(swung, known), of((*weighed, *swung), known))
    return dict(zip(KINDS, kinds, strict=True))


def draw(case: tuple[int, int, int, float]) -> tuple[int, Array, dict[str, Told]]:
    """Number of cables, the true ten, and what each kind of data tells."""
    m, number, runs, geometry = case
    rng = np.random.default_rng([FIRST_SEED, m, number])
    body = body_of(rng)
    seed = [FIRST_SEED, m, number, 1]
    recorded = swings(m, 2 * runs, seed, body=body, geometry=geometry, misplaced=True, weighed=runs)
    mass = body.mass * (1 + WEIGHED * rng.normal()), WEIGHED * body.mass
    told = {}
    for kind, experiment in parts_of(recorded.experiment, mass).items():
        begun = time.process_time()
        found = MaximumLikelihood()(experiment)
        seconds = time.process_time() - begun
        told[kind] = Told(found.value, found.covariance, found.verdict.accepted, seconds)
    return m, body.body_parameters, told


def main(bodies: float = 5, runs: float = 6, processes: float = 2, geometry: float = 1) -> None:
    """Bodies on each number of cables; runs of each kind; errors of anchors and attachments in
    millimetres, 1-sigma.
    """
    cases = [(m, i, round(runs), 1e-3 * geometry) for m, i in product(CABLES, range(round(bodies)))]
    print(
        f"{runs:g} swings of 10 s with force sensors and {runs:g} without, motion capture .3 mm and"
        f" .5 mrad, misplaced; gains 1 %, offsets 1 N, geometry {geometry:g} mm; mass known to .1 %"
    )
    print(
        "chi-square per number against the truth; forces - swings; largest 1-sigma over the least"
    )
    print("cables   forces  swings  together  agree  1-sigma  CPU [s]   accepted")
    found = []
    with get_context("spawn").Pool(round(processes)) as pool:
        for m, truth, told in pool.imap(draw, cases):
            found.append((m, truth, told))
            forces, swung, both = (told[kind] for kind in KINDS)
            apart = forces.value - swung.value
            # Both have the same mass from the scale and the same geometry: less apart than this.
            agree = chi_square(apart, forces.covariance + swung.covariance)
            least = np.minimum(forces.sigma, swung.sigma)
            print(
                f"{m:6} "
                + "".join(
                    f"{chi_square(each.value - truth, each.covariance):8.2f}"
                    for each in told.values()
                )
                + f"{agree:9.2f} {(both.sigma / least).max():8.2f}   "
                + " ".join(f"{each.seconds:.0f}" for each in told.values())
                + "   "
                + " ".join(str(each.accepted) for each in told.values()),
                flush=True,
            )
    print("rms of errors and of stated 1-sigma: centre of gravity [mm], moments [%]; 95 % cover")
    for m in CABLES:
        own = [(truth, told) for each, truth, told in found if each == m]
        for kind in KINDS:
            off = np.array([told[kind].value - truth for truth, told in own])
            sigma = np.array([told[kind].sigma for _, told in own])
            size = np.array([truth[MOMENTS] for truth, _ in own])
            print(
                f"{m} cables, {kind:8}: {_rms(1e3 * off[:, CENTRE])} {_rms(1e3 * sigma[:, CENTRE])}"
                f"  {_rms(100 * off[:, MOMENTS] / size)} {_rms(100 * sigma[:, MOMENTS] / size)}"
                f"  {np.mean(np.abs(off / sigma) < 1.96):.0%}"
            )


def _rms(values: Array) -> str:
    return f"{np.sqrt(np.mean(values**2)):6.3f}"


if __name__ == "__main__":
    main(*map(float, sys.argv[1:5]))
