"""What was added between two estimates: the body by which they differ."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from steelyard.arrays import Array, complex_step_jacobian
from steelyard.estimates.comparison import (
    BOUND_NOTE,
    INDEPENDENT_NOTE,
    SAME,
    SIGNIFICANT,
    described,
    doubts,
    same_source,
)
from steelyard.estimates.estimate import Estimate, judge
from steelyard.estimates.estimate_file import NamedEstimate
from steelyard.inertia import BODY_PARAMETERS, symmetric


@dataclass(frozen=True, eq=False)
class Payload:
    """What was added to the body between two estimates."""

    before: NamedEstimate
    after: NamedEstimate
    estimate: Estimate
    """Of the payload, in the platform frame; NaN where it cannot be told, with the reason in its
    verdict."""
    possible: bool | None
    """Whether a body that can exist lies within :data:`SIGNIFICANT` sigmas; None: not known."""

    def __repr__(self) -> str:
        return f"added between {self.before.name} and {self.after.name}, by {self.estimate!r}"

    def to_dict(self) -> dict[str, Any]:
        """Plain values; the payload in the shape of an estimate of the contract."""
        return {
            "before": described(self.before),
            "after": described(self.after),
            "payload": {**self.estimate.to_dict(), "possible": self.possible},
        }


def payload(before: NamedEstimate | Estimate, after: NamedEstimate | Estimate) -> Payload:
    """The body that was added between two estimates.

    Mass, first moment and inertia about the platform origin of bodies that are fixed to each other
    add up; their difference is turned back to centre of gravity and inertia about it. The
    covariance is that of independent estimates, to first order.

    Args:
        before: Without the payload; an estimate without a name is of recordings of its own.
        after: With it; likewise.
    """
    before = before if isinstance(before, NamedEstimate) else NamedEstimate("before", before)
    after = after if isinstance(after, NamedEstimate) else NamedEstimate("after", after)
    a, b = before.estimate, after.estimate
    value, covariance = np.full(10, np.nan), np.full((10, 10), np.nan)
    reasons, notes = (
        [],
        [
            BOUND_NOTE if same_source(before, after) else INDEPENDENT_NOTE,
            *doubts((before, after)),
        ],
    )
    mass, variance = float(b.value[0] - a.value[0]), float(a.covariance[0, 0] + b.covariance[0, 0])
    nothing = _no_mass(mass, variance, largest=max(abs(a.value[0]), abs(b.value[0])))
    physical: tuple[str, ...] = ()
    if nothing is not None:
        value[0], covariance[0, 0] = mass, variance
        reasons.append(nothing)
    else:
        if np.isfinite(mass):
            value, covariance = _difference_body(a, b)
        physical = judge(value).reasons
    if mass < 0 and nothing is None:
        reasons.append(
            "mass was taken off, not added; name the estimates in the other order to see what"
        )
    possible = _possible(value, covariance) if not reasons else None
    if possible:
        notes += [
            f"{text}, but within {SIGNIFICANT:g} sigmas there is a body that can exist"
            for text in physical
        ]
    else:
        reasons += physical
    untold = [name for name, v in zip(BODY_PARAMETERS, value, strict=True) if np.isnan(v)]
    if untold and len(untold) < 10 and not reasons:
        notes.append(
            f"not told, since one of the estimates lacks what it takes: {', '.join(untold)}"
        )
    for array in (value, covariance):
        array.setflags(write=False)
    verdict = replace(judge(value), accepted=not reasons, reasons=tuple(reasons))
    return Payload(
        before,
        after,
        Estimate("difference", value, covariance, verdict, notes=tuple(notes)),
        possible,
    )


def _no_mass(mass: float, variance: float, *, largest: float) -> str | None:
    """Why nothing but its mass can be said about a payload of this mass [kg]; None: it is told from
    nothing, or not known.
    """
    if np.isnan(mass):
        return None
    if np.isnan(variance):
        found = "its uncertainty is not known"
    elif abs(mass) < SIGNIFICANT * np.sqrt(variance) or abs(mass) <= SAME * largest:
        found = f"less than {SIGNIFICANT:g} sigmas"
    else:
        return None
    return (
        f"the mass differs by {mass:.3g} kg, {found}: where such a payload sits and how it resists"
        " turning cannot be told"
    )


def _difference_body(a: Estimate, b: Estimate) -> tuple[Array, Array]:
    """Body parameters of what b is more than a, with exact derivatives.

    The masses differ.

    Returns:
        Body parameters, shape (10,), and their covariance, shape (10, 10); NaN where they need what
        is not known.
    """

    def body(x: Any) -> Any:
        linear = _linear(x[10:]) - _linear(x[:10])
        mass, c = linear[0], linear[1:4] / linear[0]
        return np.concatenate([[mass], c, linear[4:] - _moments(mass, c)])

    both = np.concatenate([a.value, b.value])
    spread = np.zeros((20, 20))
    spread[:10, :10], spread[10:, 10:] = a.covariance, b.covariance
    value = body(both)
    jacobian = complex_step_jacobian(body, both)
    told = np.isfinite(value)
    value[~told] = np.nan
    jacobian[~told] = 0.0
    needed = jacobian != 0
    known = told & ~needed[:, np.isnan(np.diag(spread))].any(axis=1)
    covariance = jacobian @ np.nan_to_num(spread) @ jacobian.T
    return value, np.where(np.outer(known, known), covariance, np.nan)


def _linear(body: Any) -> Any:
    """The ten of :data:`steelyard.inertia.LINEAR_PARAMETERS` of ten body parameters."""
    mass, c = body[0], body[1:4]
    return np.concatenate([[mass], mass * c, body[4:] + _moments(mass, c)])


def _moments(mass: Any, c: Any) -> Any:
    """Moments xx, yy, zz, yz, xz, xy of a point mass, each from the coordinates it needs: others
    may be unknown.
    """
    x, y, z = c
    return mass * np.array([y * y + z * z, x * x + z * z, x * x + y * y, -y * z, -x * z, -x * y])


def _possible(value: Array, covariance: Array) -> bool | None:
    """Whether the least second moment of the mass about its centre, tr(J) / 2 - J, may be positive.

    For a positive mass that is what a body needs to exist [Wensing2018]_; to first order about the
    direction of the least.
    """
    if not np.isfinite(value).all() or not np.isfinite(np.diag(covariance)).all():
        return None
    J = symmetric(value[4:])
    moments, directions = np.linalg.eigh(np.trace(J) / 2 * np.eye(3) - J)
    v = directions[:, 0]
    slope = np.array([np.trace(E) / 2 - v @ E @ v for E in (symmetric(e) for e in np.eye(6))])
    sigma = float(np.sqrt(max(0.0, slope @ covariance[4:, 4:] @ slope)))
    return bool(moments[0] > 0 or moments[0] > -SIGNIFICANT * sigma)
