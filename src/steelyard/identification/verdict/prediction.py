"""Forces of runs that an estimate has not seen: the check that a user of a controller trusts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.dynamics import platform_wrench
from steelyard.errors import InputError
from steelyard.estimates.estimate import plain
from steelyard.experiment.model import Experiment
from steelyard.identification.model.balance import wrench_noise
from steelyard.identification.solve.classical import NoBalanceError, study
from steelyard.identification.solve.study import Progress

AXES = ("force x", "force y", "force z", "torque x", "torque y", "torque z")


@dataclass(frozen=True, eq=False)
class Prediction:
    """Predicted against measured wrench of one run that was held out."""

    run: str
    error: Array
    """Root mean square of measured minus predicted [N], [N m], shape (6,)."""
    noise: Array
    """What the noise of the force sensors alone would leave of it after the same filter [N], [N m],
    shape (6,)."""
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
        found = study(experiment, progress, held_out=names)
    except NoBalanceError as error:
        raise InputError(f"--holdout: {error}") from error
    predictions = []
    for run, samples in zip(experiment.runs, found.samples, strict=True):
        if run.name not in names:
            continue
        predicted = platform_wrench(
            found.parameters, samples.specific_force, samples.omega, samples.alpha
        )
        predictions.append(
            Prediction(
                run=run.name,
                error=np.sqrt(np.mean((samples.wrench - predicted) ** 2, axis=0)),
                noise=wrench_noise(
                    experiment, run, samples, found.calibration, found.sigma[run.name]
                ),
                spread=np.std(samples.wrench, axis=0),
            )
        )
    return tuple(predictions)
