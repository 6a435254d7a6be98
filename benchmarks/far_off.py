"""Maximum likelihood from descriptions that are far off, beside the right ones.

`python benchmarks/far_off.py`.
"""

from __future__ import annotations

import sys
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from recordings import chi_square, recordings
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.estimates.estimate import Estimate, no_estimate
from steelyard.experiment.model import Experiment
from steelyard.experiment.read import read_experiment
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.inertia import Inertia

FIRST_SEED = 300_000
"""Apart from the seeds of every test and of the other benchmarks."""
WRONG = 29.6
"""Chi-square of the ten that one sound estimate in a thousand exceeds."""
SAME = 0.1
"""Difference in 1-sigma up to which two answers are the same."""
FAR_OFF = {"mass": 9, "sync": 12, "axes": 12, "no nominal body": 3, "combined": 14}
"""Kind of mistake -> how many."""


def wrong_mass(experiment: Experiment, rng: np.random.Generator) -> tuple[Experiment, str]:
    factor = float(rng.choice([3.0, 1 / 3]))
    body = experiment.robot.platform
    heavier = Inertia(body.mass * factor, body.center_of_gravity, body.inertia)
    return (
        replace(experiment, robot=replace(experiment.robot, platform=heavier)),
        f"mass x {factor:.2f}",
    )


def wrong_sync(experiment: Experiment, rng: np.random.Generator) -> tuple[Experiment, str]:
    late = float(rng.uniform(-0.3, 0.3))
    runs = tuple(
        replace(run, sync={**run.sync, "tracker": run.sync["tracker"] + late})
        for run in experiment.runs
    )
    return replace(experiment, runs=runs), f"sync {late:+.3f} s"


def wrong_axes(experiment: Experiment, rng: np.random.Generator) -> tuple[Experiment, str]:
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    imu = experiment.instruments["imu"]
    as_stated = Rotation.from_euler("ZYX", np.array(imu.rpy_deg)[::-1], degrees=True)
    turned = Rotation.from_rotvec(np.radians(20) * axis) * as_stated
    rpy = tuple(float(each) for each in turned.as_euler("ZYX", degrees=True)[::-1])
    instruments = {**experiment.instruments, "imu": imu.model_copy(update={"rpy_deg": rpy})}
    return replace(experiment, instruments=instruments), f"IMU 20 deg about {np.round(axis, 2)}"


def no_nominal(experiment: Experiment, rng: np.random.Generator) -> tuple[Experiment, str]:
    return replace(experiment, robot=replace(experiment.robot, platform=None)), "no nominal body"


def combined(experiment: Experiment, rng: np.random.Generator) -> tuple[Experiment, str]:
    """Two or three mistakes at once."""
    body = wrong_mass if rng.random() < 0.7 else no_nominal
    mistakes = [body, wrong_sync, wrong_axes]
    if rng.random() < 0.6:
        del mistakes[rng.integers(3)]
    words = []
    for mistake in mistakes:
        experiment, word = mistake(experiment, rng)
        words.append(word)
    return experiment, ", ".join(words)


MISTAKES: dict[str, Callable[[Experiment, np.random.Generator], tuple[Experiment, str]]] = {
    "mass": wrong_mass,
    "sync": wrong_sync,
    "axes": wrong_axes,
    "no nominal body": no_nominal,
    "combined": combined,
}
OUTCOMES = (
    "same, accepted",
    "same, rejected",
    "other, rejected",
    "other, accepted",
    "accepted WRONG",
    "crashed",
)


def starts() -> None:
    """Descriptions that are far off, beside the right one."""
    right: dict[str, tuple[Experiment, Array, Estimate]] = {}
    for name, path, truth in recordings():
        if name.startswith("points-"):
            read = read_experiment(path)
            # The files name no nominal body: the right description is that with the true one.
            experiment = replace(read, robot=replace(read.robot, platform=truth))
            estimate = MaximumLikelihood()(experiment)
            right[name] = experiment, truth.body_parameters, estimate
            print(
                f"{name}, right description:"
                f" {'accepted' if estimate.verdict.accepted else 'rejected'}, chi-square of the ten"
                f" against the truth {chi_square(estimate, truth.body_parameters):.1f}"
            )
    outcomes: dict[str, Counter[str]] = {kind: Counter() for kind in MISTAKES}
    print(
        f"\n{'':9} {'recording':11}{'outcome':17}{'off [sigma]':>12}{'chi2':>8}  mistake; first"
        " reason"
    )
    for i, kind in enumerate(kind for kind, count in FAR_OFF.items() for _ in range(count)):
        name = sorted(right)[i % len(right)]
        experiment, truth, reference = right[name]
        far_off, words = MISTAKES[kind](experiment, np.random.default_rng(FIRST_SEED + i))
        try:
            found = MaximumLikelihood()(far_off)
        except InputError as error:
            found = no_estimate(MaximumLikelihood.name, str(error))
        except Exception:
            traceback.print_exc(file=sys.stdout)
            outcomes[kind]["crashed"] += 1
            continue
        off = float(np.max(np.abs(found.value - reference.value) / reference.standard_deviation))
        chi, same = chi_square(found, truth), off < SAME
        outcome = (
            f"{'same' if same else 'other'}, {'accepted' if found.verdict.accepted else 'rejected'}"
        )
        if found.verdict.accepted and not same and chi > WRONG:
            outcome = "accepted WRONG"
        outcomes[kind][outcome] += 1
        reason = next(iter(found.verdict.reasons), "")[:90]
        print(
            f"{i:9} {name:11}{outcome:17}{off:12.3g}{chi:8.3g} "
            f" {words}{'; ' + reason if reason else ''}",
            flush=True,
        )
    print(f"\n{'mistake':18}" + "".join(f"{outcome:>17}" for outcome in OUTCOMES))
    for kind, own in outcomes.items():
        print(f"{kind:18}" + "".join(f"{own[outcome]:17}" for outcome in OUTCOMES))
    total = sum(outcomes.values(), Counter())
    print(f"{'all':18}" + "".join(f"{total[outcome]:17}" for outcome in OUTCOMES))
    print(f"accepted wrong: {total['accepted WRONG']} of {total.total()}   wanted 0")


if __name__ == "__main__":
    starts()
