"""Swings on locked cables that MuJoCo has simulated: errors of what is told of the body in stated
1-sigma, and natural frequencies that are predicted for poses which no recording had."""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.estimates.per_mass import PerMass
from steelyard.experiment.unread import with_constant_lengths
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.inertia import Inertia
from steelyard.natural_frequencies.frequencies import Mode, frequencies

sys.path.insert(0, str(Path(__file__).parent.parent / "examples" / "free-swinging"))
from mujoco_swings import swinging_robot, swings

FIRST_SEED = 200_000
"""Apart from the seeds of every test."""
CABLES = (4, 3, 2)
HELD_OUT = 6
"""Poses of which frequencies are predicted."""


class Drawn(NamedTuple):
    """One body on one robot."""

    m: int
    z: Array
    """Of centre of gravity and inertia per mass, shape (9,)."""
    chi_square: float
    """Of these."""
    off: Array
    """Centre of gravity [m] and relative moments per mass, shape (6,)."""
    accepted: bool | None
    reasons: tuple[str, ...]
    seconds: float
    """Of one core."""
    predicted: Array
    """Relative error, and that in 1-sigma, of predicted frequencies, shape (2, k)."""


def body_of(rng: np.random.Generator) -> Inertia:
    """A platform of some kilograms with what it carries."""
    sizes = np.array([0.6, 0.45, 0.2]) * rng.uniform(0.7, 1.3, 3)
    mass = rng.uniform(5, 15)
    moments = mass / 6 * (np.sum(sizes**2) - sizes**2) * rng.uniform(0.7, 1.3)
    turned = Rotation.from_rotvec(0.2 * rng.normal(size=3)).as_matrix()
    centre = rng.uniform(-1, 1, 3) * [0.04, 0.04, 0.05]
    return Inertia(mass, centre, turned @ np.diag(moments) @ turned.T)


def _compared(true: Mode, predicted: Mode) -> tuple[float, float]:
    """Relative error of a frequency, and its error in 1-sigma."""
    off = predicted.frequency - true.frequency
    return off / true.frequency, off / (predicted.standard_deviation or np.nan)


def draw(case: tuple[int, int, int, float, float, bool]) -> Drawn:
    m, number, runs, geometry, length_noise, misplaced = case
    rng = np.random.default_rng([FIRST_SEED, m, number])
    body = body_of(rng)
    seed = [FIRST_SEED, m, number, 1]
    recorded = swings(m, runs, seed, body=body, geometry=geometry, misplaced=misplaced)
    experiment = recorded.experiment
    if length_noise:
        experiment = with_constant_lengths(replace(experiment, length_noise=length_noise))
    begun = time.process_time()
    found = MaximumLikelihood()(experiment)
    seconds = time.process_time() - begun
    truth = PerMass.of(body.body_parameters, np.zeros((10, 10))).value
    told = found.per_mass
    assert told is not None
    off, sigma = told.value - truth, told.standard_deviation
    z = off / sigma
    use = np.isfinite(z)
    chi = z[use] @ np.linalg.solve(
        (told.covariance / np.outer(sigma, sigma))[np.ix_(use, use)], z[use]
    )
    predicted = []
    while len(predicted) < HELD_OUT:
        place = np.array([rng.uniform(-0.6, 0.6), rng.uniform(-0.4, 0.4), rng.uniform(0.8, 1.6)])
        reach = np.linalg.norm(recorded.true.anchors - place - recorded.true.attachments, axis=1)
        true = frequencies(recorded.true, body, lengths=reach)
        # As motion capture sees it hang there.
        ours = frequencies(swinging_robot(m), found, pose=true.pose)
        # Near a pose in which a cable is hardly taut, the other geometry has it slack.
        if len(true.modes) == len(ours.modes) == 6 - m:
            predicted.append(
                [_compared(*modes) for modes in zip(true.modes, ours.modes, strict=True)]
            )
    relative = np.concatenate([off[:3], off[3:6] / truth[3:6]])
    return Drawn(
        m,
        z,
        float(chi) / use.sum(),
        relative,
        found.verdict.accepted,
        tuple(found.verdict.reasons),
        seconds,
        np.concatenate(predicted).T,
    )


def main(
    bodies: float = 5,
    runs: float = 12,
    processes: float = 2,
    geometry: float = 2,
    length_noise: float = 0,
    misplaced: float = 0,
) -> None:
    """Errors of anchors and attachments in millimetres, 1-sigma, and of lengths that are constant; 0:
    that is not used; and whether motion capture is misplaced by what is stated of it.
    """
    bodies, runs, processes = round(bodies), round(runs), round(processes)
    cases = [
        (m, i, runs, 1e-3 * geometry, 1e-3 * length_noise, bool(misplaced))
        for m, i in product(CABLES, range(bodies))
    ]
    found = []

    print(
        f"{runs} swings of 10 s each, motion capture .3 mm and .5 mrad, geometry {geometry:g} mm"
        + (f", lengths constant to {length_noise:g} mm" if length_noise else "")
        + (", motion capture misplaced" if misplaced else "")
    )
    print(
        "cables  chi-square/9  centre [mm]  moments [%]  frequencies [%] median, largest, z  CPU [s]"
    )
    with get_context("spawn").Pool(processes) as pool:
        for each in pool.imap(draw, cases):
            found.append(each)
            relative, z = each.predicted
            print(
                f"{each.m:6} {each.chi_square:13.2f} {1e3 * np.abs(each.off[:3]).max():12.2f}"
                f" {100 * np.abs(each.off[3:]).max():12.2f} {100 * np.median(np.abs(relative)):12.3f}"
                f" {100 * np.abs(relative).max():7.3f} {np.sqrt(np.mean(z**2)):6.2f} {each.seconds:8.1f}  "
                + ("accepted" if each.accepted else "; ".join(each.reasons)[:120]),
                flush=True,
            )
    for m in CABLES:
        own = [each for each in found if each.m == m]
        z = np.concatenate([each.z[np.isfinite(each.z)] for each in own])
        relative, scores = np.hstack([each.predicted for each in own])
        print(
            f"{m} cables: chi-square {np.mean([each.chi_square for each in own]):.2f},"
            f" 95 % intervals cover {np.mean(np.abs(z) < 1.96):.1%},"
            f" accepted {sum(bool(each.accepted) for each in own)} of {len(own)};"
            f" frequencies median {100 * np.median(np.abs(relative)):.3f} %, z {scores.std():.2f},"
            f" {np.median([each.seconds for each in own]):.0f} s"
        )


if __name__ == "__main__":
    main(*map(float, sys.argv[1:7]))
