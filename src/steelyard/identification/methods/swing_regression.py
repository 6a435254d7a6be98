"""Regression of a swinging body on what its cables cannot carry, without the moments at which a
cable may hang slack: these show once there is a body, in what the others would have to pull.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.dynamics import platform_regressor
from steelyard.estimates.estimate import plausible_radius
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.identification.methods.linear import LinearFit, block_sums, covariance_of, solve
from steelyard.identification.methods.settings import TWO_STEP, TwoStepSettings
from steelyard.identification.samples.preparation import prepare
from steelyard.identification.samples.prepared import Samples
from steelyard.identification.solve.misfits.slack_cables import SlackCables, around, below

_BLOCK = 1.0
"""Stretches that are taken as independent of each other [s]: about a swing."""


@dataclass(frozen=True, eq=False)
class SwingRegression:
    """First moment and inertia about the origin, for the mass that is known or assumed."""

    value: Array
    """Shape (9,)."""
    covariance: Array
    """Shape (9, 9)."""
    unknown: Array
    """Directions that the data do not tell, shape (9, k)."""
    slack: tuple[SlackCables, ...]
    """Of the runs that have such cables."""


@dataclass(frozen=True, eq=False)
class _SwingRows:
    """One run, n samples."""

    samples: Samples
    across: Array
    """Regressor of the body across what the cables can carry, shape (n, 6 - m, 10)."""
    pulled: Array
    """That of the tensions which carry the rest, shape (n, m, 10)."""
    noise: Array
    """Mean square that noise of the angular acceleration leaves in each column of the former,
    summed over its rows, shape (n, 10)."""

    @property
    def block(self) -> int:
        """Samples of a stretch."""
        time = self.samples.time
        step = float(np.median(np.diff(time))) if len(time) > 1 else _BLOCK
        return max(1, round(_BLOCK / step))

    def slack(self, linear: Array) -> NDArray[np.bool_]:
        """Whether each cable may be slack if the body is this one, shape (n, m)."""
        return below(self.pulled @ linear)

    def kept(self, slack: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Which samples are sure, shape (n,)."""
        time = self.samples.time
        kept = np.ones(len(time), dtype=bool)
        for start, end in around(time, slack):
            kept[(time >= start) & (time <= end)] = False
        return kept


def swing_regression(
    experiment: Experiment,
    begun: Callable[[Run, float], None] = lambda run, part: None,
    settings: TwoStepSettings = TWO_STEP,
) -> SwingRegression:
    """Fit the body to what no cable can take up.

    Args:
        experiment: On fewer than six cables, whose runs have locked winches and no forces.
        begun: Is called with each run and the part that is done.
        settings: Of filter and fit.

    Raises:
        InputError: A run lacks what the method needs.
    """
    mass, size = experiment.known["mass"][0], plausible_radius(experiment.robot)
    swings = []
    for i, run in enumerate(experiment.runs):
        begun(run, i / len(experiment.runs))
        samples = prepare(experiment, run, straight=True, settings=settings.preparation)
        swings.append(_swing(samples, size))
    slack = [np.zeros(each.pulled.shape[:2], dtype=bool) for each in swings]
    kept = [np.ones(len(each.samples), dtype=bool) for each in swings]
    found = _fitted(swings, kept, mass, size, settings)
    for _ in range(settings.slack_turns):
        linear = np.concatenate([[mass], found.value])
        slack = [each.slack(linear) for each in swings]
        now = [each.kept(own) for each, own in zip(swings, slack, strict=True)]
        if all(map(np.array_equal, now, kept)):
            break
        kept = now
        found = _fitted(swings, kept, mass, size, settings)
    return SwingRegression(
        found.value,
        _covariance(swings, kept, found),
        found.unknown,
        tuple(
            SlackCables(each.samples.run, own.mean(axis=0), float(1 - sure.mean()))
            for each, own, sure in zip(swings, slack, kept, strict=True)
            if own.any()
        ),
    )


def _fitted(
    swings: list[_SwingRows],
    kept: list[NDArray[np.bool_]],
    mass: float,
    size: float,
    settings: TwoStepSettings,
) -> LinearFit:
    """First moment and inertia by the samples that are sure."""
    rows, noise = (
        np.concatenate([part[sure] for part, sure in zip(parts, kept, strict=True)])
        for parts in ([each.across for each in swings], [each.noise for each in swings])
    )
    scale = mass * np.array([*[size] * 3, *[size**2] * 6])
    noise = noise.mean(axis=0)[1:] if len(noise) else np.zeros(9)
    return solve(rows[:, :, 1:], -mass * rows[:, :, 0], scale, noise, settings)


def _covariance(swings: list[_SwingRows], kept: list[NDArray[np.bool_]], found: LinearFit) -> Array:
    """Of the nine, by stretches that are as good as independent."""
    parts = np.split(found.influence, np.cumsum([sure.sum() for sure in kept])[:-1])
    sums = [
        block_sums(part, each.block) for each, part in zip(swings, parts, strict=True) if len(part)
    ]
    return covariance_of(np.concatenate(sums)) if sums else np.zeros((9, 9))


def _swing(samples: Samples, size: float) -> _SwingRows:
    """Of one run.

    Args:
        samples: Of the run.
        size: Torques over it are comparable with forces [m].
    """
    assert samples.structure is not None
    scale = np.array([1.0] * 3 + [1 / size] * 3)
    m = samples.structure.shape[2]
    Y = scale[:, None] * platform_regressor(samples.specific_force, samples.omega, samples.alpha)
    Q, R = np.linalg.qr(scale[:, None] * samples.structure, mode="complete")
    rotated = np.einsum("nij,nip->njp", Q, Y)
    # Where cables coincide, what each of them pulls is not told: the least tensions stand for it.
    pulled = np.linalg.pinv(R[:, :m]) @ rotated[:, :m]
    still = np.zeros((len(samples), 3))
    noise = np.zeros((len(samples), 10))
    for axis in samples.alpha_noise * np.eye(3):
        jitter = scale[:, None] * platform_regressor(still, still, still + axis)
        noise += np.sum((Q[:, :, m:].swapaxes(1, 2) @ jitter) ** 2, axis=1)
    return _SwingRows(samples, rotated[:, m:], pulled, noise)
