"""Payloads that are picked up and set down while the platform moves: which changes are found, how soon,
how exactly, and what is found where nothing changes."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, replace
from multiprocessing import get_context
from typing import NamedTuple

import numpy as np
from recorder import FIRST_SEED, Recorder

from steelyard.arrays import Array
from steelyard.dynamics import platform_regressor
from steelyard.identification.recursive.follow import follow
from steelyard.motion.state import State
from steelyard.robot.kinematics import cables_at
from steelyard.robot.model import Robot
from steelyard.simulation.response import Response

SECONDS = 60.0
CHANGES = 10
"""In a recording: a payload is picked up and set down in turn."""
MASSES = (3.2, 5.0, 16.0)
"""Of payloads [kg]; the platform weighs 161 kg."""

_recorder: Recorder | None = None


class Seen(NamedTuple):
    """What was found of one recording."""

    late: list[float]
    """When each change was found, after it happened [s]."""
    off: list[float]
    """Errors of the times that were stated [s]."""
    chi: list[float]
    """Of what was picked up, over its ten, at the end."""
    sigma: list[float]
    """1-sigma of its mass at the end [kg]."""
    missed: int
    further: int
    """Events where nothing happened."""
    spent: float
    """CPU time over recorded time."""


def payload(mass: float) -> Array:
    """The ten linear parameters of a small thing at a corner of the platform."""
    c = np.array([0.3, -0.2, -0.1])
    cross = np.array([[0, -c[2], c[1]], [c[2], 0, -c[0]], [-c[1], c[0], 0]])
    J = -mass * cross @ cross
    return np.concatenate([[mass], mass * c, J[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]]])


@dataclass(frozen=True, eq=False)
class Carrying:
    """The same motion with a thing on the platform that the cables feel: there after the first of some
    instants, gone after the second, and so on."""

    robot: Robot
    empty: Response
    parameters: Array
    when: Array

    @property
    def duration(self) -> float:
        return self.empty.duration

    def at(self, times: Array) -> State:
        state = self.empty.at(times)
        there = np.searchsorted(self.when, times, side="right") % 2
        Y = platform_regressor(state.specific_force, state.omega, state.alpha)
        needed = (Y @ self.parameters) * there[:, None]
        W = cables_at(self.robot, state.position, state.rotation, state.tension).structure
        return replace(
            state, tension=state.tension + np.einsum("nmk,nk->nm", np.linalg.pinv(W), needed)
        )


def draw(job: tuple[int, float]) -> Seen:
    """One recording with a payload, or without any."""
    global _recorder
    seed, mass = job
    _recorder = _recorder or Recorder(SECONDS)
    rng = np.random.default_rng(seed)
    each = (SECONDS - 8.0) / CHANGES
    when = 7.0 + each * np.arange(CHANGES) + rng.uniform(0.0, each - 3.0, CHANGES)
    when = when if mass else np.zeros(0)
    loaded = Carrying(_recorder.robot, _recorder.response, payload(mass), when)
    experiment = _recorder(seed, loaded if mass else None)
    found, begun = [], time.process_time()
    for last in follow(experiment):
        found += [(last.instants[-1].time, e) for e in last.events[len(found) :]]
    spent = (time.process_time() - begun) / SECONDS
    late, off, chi, sigma, used = [], [], [], [], set()
    state, solution = last.recursion.state, last.recursion.solution
    for i, at in enumerate(when):
        own = [(j, t, e) for j, (t, e) in enumerate(found) if abs(e.time - at) < 1.5]
        if not own:
            continue
        j, t, event = own[0]
        used.add(j)
        late.append(t - at)
        off.append(event.time - at)
        place = state.calibration.calibration_parameters.place_of_load(event.run)
        if i % 2 == 0 and place is not None and not used - set(range(len(when))):
            columns = np.searchsorted(last.recursion.use, 10 + np.arange(place.start, place.stop))
            error = state.calibration.values[place] - payload(mass)
            covariance = solution.covariance[np.ix_(columns, columns)]
            chi.append(float(error @ np.linalg.solve(covariance, error)) / 10)
            sigma.append(float(np.sqrt(covariance[0, 0])))
    return Seen(late, off, chi, sigma, len(when) - len(used), len(found) - len(used), spent)


def main(count: int, processes: int) -> None:
    print(f"CoGiRo, {SECONDS:.0f} s on six axes, sensors of the paper, {count} recordings each")
    print(
        "payload   changes   missed   further   found after (largest)   time off by (largest)"
        "   chi2/10   1-sigma of its mass"
    )
    jobs = [(FIRST_SEED + i, mass) for mass in (0.0, *MASSES) for i in range(count)]
    with get_context("spawn").Pool(processes) as pool:
        every = list(pool.imap(draw, jobs))
    for mass in (0.0, *MASSES):
        own = [each for each, job in zip(every, jobs, strict=True) if job[1] == mass]
        missed, further = sum(e.missed for e in own), sum(e.further for e in own)
        line = f"{mass:5.1f} kg {CHANGES * count if mass else 0:9d} {missed:8d} {further:9d}"
        late = np.array([t for e in own for t in e.late])
        if len(late):
            off = np.abs([t for e in own for t in e.off])
            chi = np.mean([c for e in own for c in e.chi])
            sigma = np.mean([s for e in own for s in e.sigma])
            line += (
                f" {np.median(late):11.2f} s ({late.max():.2f} s) {np.median(off):13.2f} s"
                f" ({off.max():.2f} s) {chi:9.2f} {sigma:12.3f} kg"
            )
        print(line)
    spent = np.median([e.spent for e in every])
    print(f"{spent:.2f} s of CPU time for a second of recording, in the median")


if __name__ == "__main__":
    count, processes = (int(each) for each in (sys.argv[1:3] or ("6", "2")))
    main(count, processes)
