"""Forces of runs that an estimate has not seen: the check that a user of a controller trusts."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from steelyard.arrays import Array, binned_means
from steelyard.dynamics import wrench_about
from steelyard.errors import InputError
from steelyard.estimates.estimate import plain
from steelyard.experiment.equivalent.platform_frame import near
from steelyard.experiment.given import GivenExperiment, experiment_of
from steelyard.experiment.model import Experiment
from steelyard.identification.model.balance import Forces, balance_of
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.solve.beginning.begin import NoBalanceError
from steelyard.identification.solve.held_motion import fit_with_held_motion
from steelyard.identification.solve.posterior import Posterior, Progress

AXES = ("force x", "force y", "force z", "torque x", "torque y", "torque z")


@dataclass(frozen=True, eq=False)
class Prediction:
    """Predicted against measured wrench of one run that was held out."""

    run: str
    error: Array
    """Root mean square of measured minus predicted [N], [N m], shape (6,)."""
    noise: Array
    """What the noise of the force sensors alone would leave of it [N], [N m], shape (6,)."""
    spread: Array
    """Standard deviation of the measured wrench [N], [N m], shape (6,)."""
    interval: float = 0.0
    """All are of means over so long, the spacing of the knots [s]: what changes faster is not in
    the fitted motion; 0: of single samples."""

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "means_over_s": self.interval,
            "rmse": dict(zip(AXES, plain(self.error), strict=True)),
            "noise": dict(zip(AXES, plain(self.noise), strict=True)),
            "spread_of_measured": dict(zip(AXES, plain(self.spread), strict=True)),
            "rmse_over_noise": dict(zip(AXES, plain(self.error / self.noise), strict=True)),
            "rmse_over_spread": dict(
                zip(AXES, plain(self.error / np.maximum(self.spread, 1e-300)), strict=True)
            ),
        }

    def __str__(self) -> str:
        parts = [
            f"{axis} {e:.2g} {'N' if i < 3 else 'N m'} ({e / n:.1f} x noise,"
            f" {e / max(s, 1e-300):.1%} of spread)"
            for i, (axis, e, n, s) in enumerate(
                zip(AXES, self.error, self.noise, self.spread, strict=True)
            )
        ]
        what = f" (means over {1e3 * self.interval:.0f} ms)" if self.interval else ""
        return f"run '{self.run}', held out: rmse of the predicted wrench{what}: {', '.join(parts)}"


def predict_held_out(
    experiment: GivenExperiment, names: str | Collection[str], progress: Progress = None
) -> tuple[Prediction, ...]:
    """Fit all other runs by least squares and predict the wrench of the named ones from their
    motion.

    The clocks of a held-out run come from its motion instruments alone; its forces are only
    compared with.

    Args:
        experiment: With at least one run beside those held out.
        names: Of the runs to hold out.
        progress: Is told what is being done and the fraction that is done.

    Raises:
        InputError: Nothing is left to estimate from, or a run lacks what the method needs.
    """
    experiment = near(experiment_of(experiment))
    names = frozenset([names] if isinstance(names, str) else names)
    for name in names:
        experiment.run(name)
    if all(run.name in names for run in experiment.runs):
        raise InputError(
            "--holdout: expected at least one run to estimate from, found all of them held out;"
            " hold out fewer"
        )
    try:
        found = fit_with_held_motion(experiment, progress, held_out=names)
    except NoBalanceError as error:
        raise InputError(f"--holdout: {error}") from error
    predictions = []
    for run in experiment.runs:
        if run.name not in names:
            continue
        parts = [
            (segment, forces)
            for segment, forces in zip(found.fit.state.segments, found.force_samples, strict=True)
            if segment.run == run.name
        ]
        compared = [_compared(experiment, found, *part) for part in parts]
        predictions.append(
            Prediction(
                run=run.name,
                error=_rms([each.error for each in compared]),
                noise=_rms([each.noise for each in compared]),
                spread=np.std(np.concatenate([each.wrench for each in compared]), axis=0),
                interval=max(each.interval for each in compared),
            )
        )
    return tuple(predictions)


class _Compared(NamedTuple):
    """Measured and predicted wrench of a segment."""

    wrench: Array
    """Measured [N], [N m], shape (n, 6)."""
    error: Array
    """Measured minus predicted [N], [N m], shape (n, 6)."""
    noise: Array
    """1-sigma by the noise of the force sensors [N], [N m], shape (n, 6)."""
    interval: float
    """Over which they are means [s]."""


def _compared(
    experiment: Experiment, found: Posterior, segment: Segment, forces: Forces
) -> _Compared:
    """Means between neighbouring knots: what changes faster is not in the fitted motion."""
    state = found.fit.state
    at = balance_of(experiment, segment, forces, state.calibration, found.parameters, state.factors)
    by_reading = at.by_reading * forces.sigmas(segment, state.factors)[:, None, :]
    measured, left_over, by_noise = (
        wrench_about(each, experiment.origin) for each in (at.wrench, at.left_over, by_reading)
    )
    variance = np.sum(by_noise**2, axis=2)
    if segment.static:
        return _Compared(measured, left_over, np.sqrt(variance), 0.0)
    knots = np.searchsorted(segment.knots, at.time)
    means, count = binned_means(knots, np.hstack([measured, left_over, variance]))
    wrench, left_over, variance = np.split(means[count > 0], 3, axis=1)
    return _Compared(
        wrench,
        left_over,
        np.sqrt(variance / count[count > 0, None]),
        segment.spacing,
    )


def _rms(parts: list[Array]) -> Array:
    """Root mean square over all segments, shape (6,)."""
    return np.asarray(np.sqrt(np.mean(np.concatenate(parts) ** 2, axis=0)))
