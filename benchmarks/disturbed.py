"""Maximum likelihood with spikes in the forces and a hole in the tracker's stream, against the same
recordings without.

`python benchmarks/disturbed.py [COUNT]`.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from recorder import Recorder
from recordings import chi_square

from steelyard.arrays import Array
from steelyard.estimates.estimate import Estimate, no_estimate
from steelyard.experiment.model import Experiment
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.solve.beginning.begin import NoBalanceError
from steelyard.identification.solve.joint_motion import fit_jointly
from steelyard.identification.solve.posterior import Posterior
from steelyard.inertia import BODY_PARAMETERS
from steelyard.simulation.edits import with_values

UNITS = np.array([1, 1e3, 1e3, 1e3, 1, 1, 1, 1, 1, 1])
"""From SI to [kg], [mm], [kg m^2]."""
FIRST_SEED = 300_000
"""Apart from the seeds of every test and of the other benchmarks."""
SPIKES = 150.0, 600.0
"""[N]"""
HOLE = 1.7
"""[s]"""


def spiked(
    experiment: Experiment, rng: np.random.Generator, *, every_reading: bool
) -> tuple[Experiment, Array]:
    """The recording with spikes in 1 % of the samples (in one cable of each) or of all readings;
    and where, shape (n, m)."""
    shape = experiment.runs[0].streams["cables"].values["tension"].shape
    where = rng.random(shape) < 0.01
    if not every_reading:
        where = np.zeros(shape, dtype=bool)
        hit = np.flatnonzero(rng.random(shape[0]) < 0.01)
        where[hit, rng.integers(shape[1], size=len(hit))] = True
    spikes = rng.uniform(*SPIKES, shape) * rng.choice([-1.0, 1.0], shape) * where
    return (
        with_values(experiment, "cables", lambda values: {"tension": values["tension"] + spikes}),
        where,
    )


def with_hole(experiment: Experiment, rng: np.random.Generator) -> Experiment:
    """The recording without the tracker during a stretch somewhere."""
    run = experiment.runs[0]
    stream = run.streams["tracker"]
    start = rng.uniform(stream.time[0] + 0.5, stream.time[-1] - HOLE - 0.5)
    use = (stream.time < start) | (stream.time > start + HOLE)
    tracked = replace(
        stream, time=stream.time[use], values={k: v[use] for k, v in stream.values.items()}
    )
    return replace(experiment, runs=(replace(run, streams={**run.streams, "tracker": tracked}),))


def estimated(experiment: Experiment) -> tuple[Estimate, Posterior | None]:
    """Estimate, and the fit it stands on where there is one."""
    try:
        joint = fit_jointly(experiment)
    except NoBalanceError as error:
        return no_estimate(MaximumLikelihood.name, str(error)), None
    return MaximumLikelihood().of(joint), joint


def left_out(experiment: Experiment, joint: Posterior | None) -> NDArray[np.bool_]:
    """Which force readings were left out, shape (n, m)."""
    run = experiment.runs[0]
    time = experiment.common_time(run, "cables", 0.0)
    found = np.zeros((len(time), experiment.robot.m), dtype=bool)
    for force_samples in joint.force_samples if joint else ():
        found[np.searchsorted(time, force_samples.time)] |= force_samples.left_out
    return found


def robust(count: int = 12) -> None:
    """Errors with spikes and a hole in the tracker's stream, beside those of the same recordings
    without."""
    recorder = Recorder()
    truth = recorder.robot.platform.body_parameters
    # Whether every reading may spike, or one a sample; None: as recorded.
    kinds = {"clean": None, "one cable in 1 % of the samples": False, "1 % of all readings": True}
    found: dict[str, list[Estimate]] = {kind: [] for kind in kinds}
    counts: dict[str, list[Array]] = {kind: [] for kind in kinds}
    reasons: list[str] = []
    for seed in range(FIRST_SEED, FIRST_SEED + count):
        sound = recorder(seed)
        for kind, every_reading in kinds.items():
            experiment, where = (
                sound,
                np.zeros((len(sound.runs[0].streams["cables"]), sound.robot.m), dtype=bool),
            )
            if every_reading is not None:
                rng = np.random.default_rng([seed, every_reading])
                experiment, where = spiked(sound, rng, every_reading=every_reading)
                experiment = with_hole(experiment, rng)
            estimate, joint = estimated(experiment)
            found[kind].append(estimate)
            out = left_out(experiment, joint)
            counts[kind].append(
                np.array([where.sum(), (where & out).sum(), (~where).sum(), (out & ~where).sum()])
            )
            if not estimate.verdict.accepted:
                reasons.append(
                    f"  rejected: seed {seed}, {kind}: {estimate.verdict.reasons[0][:150]}"
                )
    print(
        f"{count} recordings: CoGiRo, 20 s, sensors of the paper; spikes of {SPIKES[0]:.0f} to"
        f" {SPIKES[1]:.0f} N, hole of {HOLE} s; [kg], [mm], [kg m^2]"
    )
    print(f"{'':40}" + "".join(f"{name:>9}" for name in BODY_PARAMETERS) + "   pooled")
    errors = {kind: np.array([e.value - truth for e in each]) for kind, each in found.items()}
    known = np.all([np.isfinite(each).all(axis=1) for each in errors.values()], axis=0)
    rmse = {kind: np.sqrt(np.mean(each[known] ** 2, axis=0)) for kind, each in errors.items()}
    for kind, each in found.items():
        ratio = rmse[kind] / rmse["clean"]
        chi = [chi_square(e, truth) / 10 for e in each]
        spikes, caught, sound_readings, lost = np.sum(counts[kind], axis=0)
        print(f"{kind + ': rmse':40}" + "".join(f"{v:9.3f}" for v in rmse[kind] * UNITS))
        pooled = np.sqrt(np.mean(ratio**2))
        print(
            f"{'  over that of clean':40}" + "".join(f"{v:9.3f}" for v in ratio) + f"{pooled:9.3f}"
        )
        print(
            f"  accepted {sum(bool(e.verdict.accepted) for e in each)} of {count}, chi-square of the ten"
            f" per degree of freedom {np.mean(chi):.2f}; left out {caught} of {spikes} spiked and"
            f" {lost} of {sound_readings} other readings",
            flush=True,
        )
    if not known.all():
        print(f"  {np.sum(~known)} recordings with a number unknown are in none of the ratios")
    print(*reasons, sep="\n")


if __name__ == "__main__":
    robust(*(int(each) for each in sys.argv[1:2]))
