"""Ten body parameters before those that the data do not tell are struck out: from two steps, over
several runs, to an estimate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array, complex_step_jacobian
from steelyard.estimates.estimate import Estimate, identifiable_parameters, judge, unassessed
from steelyard.inertia import point_inertia, six


@dataclass(frozen=True, eq=False)
class BodyFit:
    """Body parameters with huge sigmas where nothing is known."""

    value: Array
    """The ten of :data:`steelyard.inertia.BODY_PARAMETERS`, shape (10,)."""
    covariance: Array
    """Shape (10, 10)."""
    offset: Array
    """Constant offset of the wrench [N], [N m], shape (6,)."""
    offset_covariance: Array
    """Shape (6, 6)."""
    residual: Array
    """Root mean square of force and torque [N], [N m], shape (6,)."""
    condition: tuple[float, float]
    """Of the scaled regressors of both steps."""


def from_two_steps(
    joint: Array, covariance: Array, *, residual: Array, condition: tuple[float, float]
) -> BodyFit:
    """From the unknowns of the two steps to a body, with exact derivatives.

    Args:
        joint: 1/m, c, force offset over m, J_P (xx, yy, zz, yz, xz, xy), torque offset, shape
            (16,).
        covariance: Shape (16, 16).
        residual: See :class:`BodyFit`.
        condition: See :class:`BodyFit`.
    """

    def body(x: Array) -> Array:
        mass, c = 1 / x[0], x[1:4]
        return np.concatenate(
            [[mass], c, x[7:13] - six(point_inertia(mass, c)), x[4:7] * mass, x[13:16]]
        )

    jacobian = complex_step_jacobian(body, joint)
    value, covariance = body(joint), jacobian @ covariance @ jacobian.T
    return BodyFit(
        value[:10], covariance[:10, :10], value[10:], covariance[10:, 10:], residual, condition
    )


def median(fits: Sequence[BodyFit], size: float) -> BodyFit | None:
    """Median of the estimates of single runs, each parameter over the runs that tell it (Table III
    of [Tempel2017]_).

    Its covariance is that of a median of independent estimates, (pi / 2) / R of their mean, and is
    enlarged where the runs scatter more than they should.
    """
    if len(fits) < 2:
        return fits[0] if fits else None
    values = np.array([f.value for f in fits])
    variances = np.array([np.diag(f.covariance) for f in fits])
    all_told = np.array([told(f, size) for f in fits])
    value, variance = np.empty(10), np.empty(10)
    for j in range(10):
        known = all_told[:, j]
        use = known if known.any() else ~known
        count = int(use.sum())
        value[j] = np.median(values[use, j])
        within = float(np.mean(variances[use, j]))
        between = float(np.var(values[use, j], ddof=1)) if count > 1 else 0.0
        share = (np.pi / 2 if count > 2 else 1.0) / count
        variance[j] = share * max(within, between) if known.any() else within
    mean = np.mean([f.covariance for f in fits], axis=0)
    stretch = np.sqrt(variance / np.diag(mean))
    return BodyFit(
        value=value,
        covariance=mean * np.outer(stretch, stretch),
        offset=np.median([f.offset for f in fits], axis=0),
        offset_covariance=np.mean([f.offset_covariance for f in fits], axis=0) / len(fits),
        residual=np.sqrt(np.mean([f.residual**2 for f in fits], axis=0)),
        condition=(max(f.condition[0] for f in fits), max(f.condition[1] for f in fits)),
    )


def merge(alone: BodyFit | None, informed: BodyFit | None, at_rest: BodyFit | None) -> BodyFit:
    """Motion and poses at rest are two measurements: mass and centre of gravity from the one that
    knows each better.

    Args:
        alone: From the runs in motion without the poses.
        informed: From the runs in motion with the centre of gravity of the poses where that is
            better; gives the inertia.
        at_rest: From the poses.

    Raises:
        ValueError: There is neither motion nor poses.
    """
    if alone is None or informed is None:
        if at_rest is None:
            raise ValueError("expected motion or poses, found neither")
        return at_rest
    if at_rest is None:
        return alone
    first = np.arange(10) < 4
    resting = first & (np.diag(at_rest.covariance) < np.diag(alone.covariance))
    value = np.where(resting, at_rest.value, np.where(first, alone.value, informed.value))
    covariance = np.zeros((10, 10))
    for part, fit in ((resting, at_rest), (first & ~resting, alone), (~first, informed)):
        block = np.ix_(part, part)
        covariance[block] = fit.covariance[block]
    # Poses hold the offset better than any motion: they turn further against gravity.
    return replace(
        informed,
        value=value,
        covariance=covariance,
        offset=at_rest.offset,
        offset_covariance=at_rest.offset_covariance,
    )


def told(fit: BodyFit, size: float) -> NDArray[np.bool_]:
    """Which of the ten the data tell: those known better than half of their plausible size.

    Args:
        fit: Values with their covariance.
        size: Plausible radius of the body [m].

    Returns:
        Shape (10,).
    """
    return identifiable_parameters(float(fit.value[0]), fit.covariance, size)


def finish(fit: BodyFit, size: float, method: str) -> Estimate:
    """Strike out what the data do not tell, and judge the rest."""
    known = told(fit, size)
    value = np.where(known, fit.value, np.nan)
    return Estimate(
        method=method,
        value=value,
        covariance=np.where(np.outer(known, known), fit.covariance, np.nan),
        verdict=unassessed(judge(value)),
        residuals={"force": fit.residual[:3], "torque": fit.residual[3:]},
        details={"condition": list(fit.condition)},
    )
