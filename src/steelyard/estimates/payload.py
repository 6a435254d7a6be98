"""What was added between two estimates: the body by which they differ."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from steelyard.arrays import Array, complex_step_jacobian
from steelyard.errors import WrongValueError
from steelyard.estimates.comparison_notes import BOUND_NOTE, INDEPENDENT_NOTE, JOINT_NOTE, doubts
from steelyard.estimates.comparison_settings import SETTINGS, ComparisonSettings
from steelyard.estimates.estimate import Estimate, judge, unassessed
from steelyard.estimates.named_estimate import NamedEstimate, same_source, shared_covariance
from steelyard.inertia import BODY_PARAMETERS, symmetric


@dataclass(frozen=True, eq=False)
class Payload:
    """What was added to the body between two estimates."""

    before: NamedEstimate
    after: NamedEstimate
    estimate: Estimate
    """Of the payload, in the platform frame; NaN where it is not identifiable, with the reason in
    its verdict."""
    possible: bool | None
    """Whether a body that can exist lies within the significant number of sigmas; None: not
    known."""
    settings: ComparisonSettings = SETTINGS
    """Levels that it was made with."""

    def __repr__(self) -> str:
        return f"added between {self.before.name} and {self.after.name}, by {self.estimate!r}"

    def to_dict(self) -> dict[str, Any]:
        """Plain values; the payload in the shape of an estimate of the contract."""
        return {
            "before": self.before.to_dict(),
            "after": self.after.to_dict(),
            "payload": {**self.estimate.to_dict(), "possible": self.possible},
        }


def payload(
    before: NamedEstimate | Estimate,
    after: NamedEstimate | Estimate,
    *,
    settings: ComparisonSettings = SETTINGS,
) -> Payload:
    """The body that was added between two estimates.

    Mass, first moment and inertia about the platform origin of bodies that are fixed to each other
    add up; their difference is turned back to centre of gravity and inertia about it. The
    covariance is that of independent estimates, of two loads of one fit the joint one, to first
    order.

    Args:
        before: Without the payload; an estimate without a name is of recordings of its own.
        after: With it; likewise.
        settings: Levels and tolerances.
    """
    for name, given in (("before", before), ("after", after)):
        if not isinstance(given, NamedEstimate | Estimate):
            raise WrongValueError(
                f"{name}: expected an estimate, found {type(given).__name__}; read_estimates makes"
                " them of a file"
            )
    before = before if isinstance(before, NamedEstimate) else NamedEstimate("before", before)
    after = after if isinstance(after, NamedEstimate) else NamedEstimate("after", after)
    a, b = before.estimate, after.estimate
    shared = shared_covariance(before, after)
    spread = _independent(a, b) if shared is None else shared
    mass = float(b.value[0] - a.value[0])
    variance = float(spread[0, 0] + spread[10, 10] - 2 * spread[0, 10])
    nothing = _no_mass(a, b, variance, settings)
    value, covariance = np.full(10, np.nan), np.full((10, 10), np.nan)
    physical: tuple[str, ...] = ()
    reasons = []
    if nothing is not None:
        value[0], covariance[0, 0] = mass, variance
        reasons.append(nothing)
    else:
        if np.isfinite(mass):
            value, covariance = _difference_body(a, b, spread)
        physical = judge(value).reasons
        if mass < 0:
            reasons.append(
                "mass was taken off, not added; name the estimates in the other order to see what"
            )
    basis = BOUND_NOTE if same_source(before, after) else INDEPENDENT_NOTE
    notes = [basis if shared is None else JOINT_NOTE, *doubts((before, after))]
    possible = None if reasons else _possible(value, covariance, settings.significant)
    if possible:
        within = f"but within {settings.significant:g} sigmas there is a body that can exist"
        notes += [f"{text}, {within}" for text in physical]
    else:
        reasons += physical
    lacking = [name for name, v in zip(BODY_PARAMETERS, value, strict=True) if np.isnan(v)]
    if lacking and len(lacking) < 10 and not reasons:
        names = ", ".join(lacking)
        notes.append(f"not identifiable, since one of the estimates lacks what it takes: {names}")
    for array in (value, covariance):
        array.setflags(write=False)
    verdict = replace(judge(value), accepted=not reasons, reasons=tuple(reasons))
    if None in (a.verdict.accepted, b.verdict.accepted):
        # What was not tested of one was not tested of the difference.
        verdict = unassessed(verdict)
    estimate = Estimate("difference", value, covariance, verdict, notes=tuple(notes))
    return Payload(before, after, estimate, possible, settings)


def _independent(a: Estimate, b: Estimate) -> Array:
    """Covariance of both, shape (20, 20)."""
    spread = np.zeros((20, 20))
    spread[:10, :10], spread[10:, 10:] = a.covariance, b.covariance
    return spread


def _no_mass(a: Estimate, b: Estimate, variance: float, settings: ComparisonSettings) -> str | None:
    """Why nothing but its mass can be said about what b is more than a; None: its mass differs from
    zero, or is not known.
    """
    mass = float(b.value[0] - a.value[0])
    largest = max(abs(a.value[0]), abs(b.value[0]))
    if np.isnan(mass):
        return None
    if np.isnan(variance):
        found = "its uncertainty is not known"
    elif (
        abs(mass) < settings.significant * np.sqrt(variance) or abs(mass) <= settings.same * largest
    ):
        found = f"less than {settings.significant:g} sigmas"
    else:
        return None
    return (
        f"the mass differs by {mass:.3g} kg, {found}: centre of gravity and inertia of such a"
        " payload are not identifiable"
    )


def _difference_body(a: Estimate, b: Estimate, spread: Array) -> tuple[Array, Array]:
    """Body parameters of what b is more than a, with exact derivatives.

    The masses differ.

    Args:
        a: Without it.
        b: With it.
        spread: Covariance of both, shape (20, 20).

    Returns:
        Body parameters, shape (10,), and their covariance, shape (10, 10); NaN where they need what
        is not known.
    """

    def body(x: Any) -> Any:
        linear = _linear(x[10:]) - _linear(x[:10])
        mass, c = linear[0], linear[1:4] / linear[0]
        return np.concatenate([[mass], c, linear[4:] - _moments(mass, c)])

    both = np.concatenate([a.value, b.value])
    value = body(both)
    jacobian = complex_step_jacobian(body, both)
    finite = np.isfinite(value)
    value[~finite] = np.nan
    jacobian[~finite] = 0.0
    needed = jacobian != 0
    known = finite & ~needed[:, np.isnan(np.diag(spread))].any(axis=1)
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


def _possible(value: Array, covariance: Array, significant: float) -> bool | None:
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
    return bool(moments[0] > 0 or moments[0] > -significant * sigma)
