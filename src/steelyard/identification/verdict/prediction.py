"""Forces of runs that an estimate has not seen: the check that a user of a controller trusts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.estimates.estimate import plain
from steelyard.experiment.model import Experiment
from steelyard.identification.model.force_residuals import balance_of
from steelyard.identification.solve.beginning import NoBalanceError
from steelyard.identification.solve.held_motion import fit_with_held_motion
from steelyard.identification.solve.posterior import Progress

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

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return {
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
        return f"run '{self.run}', held out: rmse of the predicted wrench " + ", ".join(parts)


def predict_held_out(
    experiment: Experiment, names: frozenset[str], progress: Progress = None
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
    if all(run.name in names for run in experiment.runs):
        raise InputError(
            "--holdout: expected at least one run to estimate from, found all of them held out;"
            " hold out fewer"
        )
    try:
        found = fit_with_held_motion(experiment, progress, held_out=names)
    except NoBalanceError as error:
        raise InputError(f"--holdout: {error}") from error
    state = found.fit.state
    predictions = []
    for run in experiment.runs:
        if run.name not in names:
            continue
        parts = [
            (segment, forces)
            for segment, forces in zip(state.segments, found.force_samples, strict=True)
            if segment.run == run.name
        ]
        balances = [
            balance_of(
                experiment, segment, forces, state.calibration, found.parameters, state.factors
            )
            for segment, forces in parts
        ]
        noise = [
            at.by_reading * forces.sigmas(segment, state.factors)[:, None, :]
            for at, (segment, forces) in zip(balances, parts, strict=True)
        ]
        predictions.append(
            Prediction(
                run=run.name,
                error=_rms([at.left_over for at in balances]),
                noise=_rms([np.sqrt(np.sum(each**2, axis=2)) for each in noise]),
                spread=np.std(np.concatenate([at.wrench for at in balances]), axis=0),
            )
        )
    return tuple(predictions)


def _rms(parts: list[Array]) -> Array:
    """Root mean square over all samples, shape (6,)."""
    return np.asarray(np.sqrt(np.mean(np.concatenate(parts) ** 2, axis=0)))
