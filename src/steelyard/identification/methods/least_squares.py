"""All ten parameters at once, weighted by what the noise of each sensor does to the balance of
wrenches.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from steelyard.arrays import Array
from steelyard.estimates.estimate import Estimate, judge, nothing_told
from steelyard.experiment.model import Experiment
from steelyard.identification.model.calibration_parameters import as_tree
from steelyard.identification.solve.classical import NoBalanceError, study
from steelyard.identification.solve.normal_equations import TEN
from steelyard.identification.solve.study import Progress, Study
from steelyard.identification.verdict.assessment import (
    directed_tests,
    label_mask,
    priors_share,
    reasons,
)
from steelyard.inertia import BODY_PARAMETERS, Inertia


@dataclass(frozen=True)
class LeastSquares:
    """Weighted least squares with priors on every systematic error, corrected for noise in the
    regressor.
    """

    name: ClassVar[str] = "least-squares"

    def __call__(self, experiment: Experiment, progress: Progress = None) -> Estimate:
        """Estimate.

        Raises:
            InputError: A run lacks what the method needs.
        """
        try:
            return self.of(study(experiment, progress))
        except NoBalanceError as error:
            return nothing_told(self.name, str(error))

    def of(self, found: Study) -> Estimate:
        """Estimate from a study that is there already."""
        return finished(found, self.name)


def finished(
    found: Study,
    method: str,
    *,
    value: Array | None = None,
    covariance: Array | None = None,
    further: Sequence[str] = (),
    details: Mapping[str, Any] | None = None,
    notes: Sequence[str] = (),
) -> Estimate:
    """What a linear method returns: what the data do not tell struck out, the rest judged.

    Args:
        found: What it stands on.
        method: Its name.
        value: The ten body parameters, where they are not those of the study, shape (10,).
        covariance: Theirs, shape (10, 10).
        further: Reasons against it that the study does not know.
        details: How it was made, beyond what all share.
        notes: What a reader should know, beyond what all share.
    """
    solution, calibration_parameters = found.solution, found.calibration.calibration_parameters
    value = Inertia.from_parameters(found.parameters).body_parameters if value is None else value
    covariance = found.body_covariance if covariance is None else covariance
    told = found.told
    value = np.where(told, value, np.nan)
    deviations = np.sqrt(np.maximum(np.diag(solution.covariance)[TEN:], 0.0))
    tests = directed_tests(found)
    return Estimate(
        method=method,
        value=value,
        covariance=np.where(np.outer(told, told), covariance, np.nan),
        verdict=judge(
            value,
            reasons=[*further, *reasons(found, tests)],
            by_prior=[bool(p) for p in label_mask(found)],
        ),
        calibration=as_tree(
            found.experiment, calibration_parameters, found.calibration.values, deviations
        ),
        residuals=_residuals(found),
        details={
            "noise_ratio": float(np.sqrt(max(solution.ratio, 0.0))),
            "covariance_enlarged_by": dict(solution.inflation),
            "share_of_priors": dict(zip(BODY_PARAMETERS, priors_share(found), strict=True)),
            "filter": {s.run: {"knot_spacing": s.spacing} for s in found.samples if not s.static},
            "samples": {s.run: len(s) for s in found.samples},
            "independent_samples": {run: each.freedom for run, each in found.sums.items()},
            "directed_tests": {
                "count": len(tests),
                "largest": [
                    {"name": t.name, "z": t.z, "size": t.size, "unit": t.unit} for t in tests[:5]
                ],
            },
            **(details or {}),
        },
        notes=(*found.notes, *_notes(found), *notes),
    )


def _residuals(found: Study) -> dict[str, Any]:
    """Root mean square of the balance per axis, and of each motion instrument in units of its
    noise.
    """
    residual = np.concatenate(
        [found.left_over(s) for s in found.samples if s.run not in found.held_out]
    )
    rms = np.sqrt(np.mean(residual**2, axis=0))
    motion: dict[str, dict[str, float]] = {}
    for (name, quantity), ratio in found.kinematics.ratios.items():
        motion.setdefault(name, {})[quantity] = ratio
    return {"force": rms[:3], "torque": rms[3:], "in_units_of_noise": motion}


def _notes(found: Study) -> list[str]:
    notes = []
    untold = [name for name, told in zip(BODY_PARAMETERS, found.told, strict=True) if not told]
    if untold:
        notes.append(f"not told by these data: {', '.join(untold)} ({_motion(found)})")
    for name, factor in found.solution.inflation.items():
        notes.append(
            f"1-sigma enlarged by {np.sqrt(factor):.2f} for what the {name} show beyond noise"
        )
    return notes


def _motion(found: Study) -> str:
    moving = [s for s in found.samples if not s.static]
    if not moving:
        return (
            "poses at rest say nothing about the inertia, and each says where the centre of gravity"
            " is only across gravity"
        )
    rates = np.sqrt(np.mean(np.concatenate([s.alpha**2 for s in moving]), axis=0))
    return (
        "angular acceleration about x, y, z was "
        + ", ".join(f"{r:.2g}" for r in rates)
        + " rad/s^2 rms"
    )
