"""Estimates side by side: whether they agree within their uncertainty, and what was added between two of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, Literal

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.identification.estimate import BEST_FIRST, Estimate, judge, plain
from steelyard.identification.estimate_file import NamedEstimate
from steelyard.inertia import BODY_PARAMETERS, symmetric

Basis = Literal["independent", "nested", "bound"]
"""Where the covariance of a difference comes from.

``independent``: different recordings, the sum of both. ``nested``: the same recordings, the worse method's minus the better's:
the covariance of an efficient estimate and its difference from another one is zero [Hausman1978]_. ``bound``: the same recordings
where that is no covariance; the sum of both, more than the true one as far as both err alike.
"""

SIGNIFICANT = 3.0
"""Sigmas: a payload of less mass is not told from nothing, and a body that can exist further away is no explanation."""

_NO_DIRECTION = 1e-12
"""Variance of a combination of parameters, in units of their sigmas, below which it is rounding."""
_NESTED = 1e-6
"""The same for a difference of covariances, which are approximations themselves."""
_SAME = 1e-9
"""Part by which two exact numbers may differ."""
_STEP = 1e-200


@dataclass(frozen=True, eq=False)
class Agreement:
    """Whether differences are within their uncertainty as a whole."""

    chi_square: float
    """Infinite where numbers that are given as exact differ."""
    freedom: int
    """Independent differences that were compared."""
    p_value: float
    """Chance of such differences or larger ones where nothing but the stated uncertainty is behind them; NaN: nothing was compared."""
    sigmas: float
    """The same as sigmas of one normal difference of either sign."""
    parameters: tuple[str, ...]
    """Body parameters that all know."""
    contradicted: tuple[str, ...] = ()
    """Those that are exact in both of two estimates, yet differ."""
    dropped: int = 0
    """Combinations of parameters without any stated uncertainty, which were left out."""

    def to_dict(self) -> dict[str, Any]:
        """Plain values; an infinite chi-square is None with a p-value of 0."""
        return {name: plain(getattr(self, name)) for name in self.__dataclass_fields__}


@dataclass(frozen=True, eq=False)
class Pair:
    """The difference of two estimates, second minus first."""

    first: str
    second: str
    difference: Array
    """Of the ten body parameters, NaN where one does not know it, shape (10,)."""
    covariance: Array
    """Of the difference, shape (10, 10)."""
    basis: Basis
    agreement: Agreement

    @property
    def standard_deviation(self) -> Array:
        """1-sigma of the difference, shape (10,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def z(self) -> Array:
        """Difference in units of its 1-sigma; infinite where exact numbers differ; shape (10,)."""
        sigma = self.standard_deviation
        exact = sigma == 0
        z: Array = np.divide(self.difference, sigma, out=np.full(10, np.nan), where=~exact)
        differ = np.isin(BODY_PARAMETERS, self.agreement.contradicted)
        z[exact] = np.where(differ, np.copysign(np.inf, self.difference), 0.0)[exact]
        return z

    def to_dict(self) -> dict[str, Any]:
        """Plain values, the ten by name."""
        z, sigma = plain(self.z), plain(self.standard_deviation)
        return {
            "first": self.first,
            "second": self.second,
            "basis": self.basis,
            "difference": dict(zip(BODY_PARAMETERS, plain(self.difference), strict=True)),
            "standard_deviation": dict(zip(BODY_PARAMETERS, sigma, strict=True)),
            "sigmas": dict(zip(BODY_PARAMETERS, z, strict=True)),
            "covariance": {"parameters": list(BODY_PARAMETERS), "matrix": plain(self.covariance)},
            "agreement": self.agreement.to_dict(),
        }


@dataclass(frozen=True, eq=False)
class Comparison:
    """Estimates and their differences."""

    estimates: tuple[NamedEstimate, ...]
    pairs: tuple[Pair, ...]
    """Every two, in the order of the estimates."""
    whole: Agreement | None
    """Cochran's Q of three or more estimates of different recordings; None: there are not so many."""
    whole_of: tuple[str, ...]
    """Names of those estimates: of the same recordings only the best method."""
    notes: tuple[str, ...]
    """What the numbers rest on."""

    def exceeding(self, sigmas: float) -> tuple[str, ...]:
        """What differs by more: single parameters, pairs as a whole, all as a whole; what cannot be compared is named too."""
        found = []
        for pair in self.pairs:
            names = f"{pair.first} and {pair.second}"
            z = pair.z
            found += [
                f"{names}: {parameter} differs by {abs(value):.1f} sigmas"
                for parameter, value in zip(BODY_PARAMETERS, z, strict=True)
                if abs(value) > sigmas
            ]
            if np.isnan(pair.agreement.p_value):
                found.append(f"{names}: nothing that both know can be compared")
            elif pair.agreement.sigmas > sigmas:
                found.append(f"{names}: differ as a whole by {pair.agreement.sigmas:.1f} sigmas")
        if self.whole is not None and self.whole.sigmas > sigmas:
            found.append(f"{', '.join(self.whole_of)}: differ as a whole by {self.whole.sigmas:.1f} sigmas")
        return tuple(found)

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "estimates": [_named(each) for each in self.estimates],
            "pairs": [pair.to_dict() for pair in self.pairs],
            "whole": None if self.whole is None else {"estimates": list(self.whole_of), **self.whole.to_dict()},
            "notes": list(self.notes),
        }


@dataclass(frozen=True, eq=False)
class Payload:
    """What was added to the body between two estimates."""

    before: NamedEstimate
    after: NamedEstimate
    estimate: Estimate
    """Of the payload, in the platform frame; NaN where it cannot be told, with the reason in its verdict."""
    possible: bool | None
    """Whether a body that can exist lies within :data:`SIGNIFICANT` sigmas; None: not known."""

    def to_dict(self) -> dict[str, Any]:
        """Plain values; the payload in the shape of an estimate of the contract."""
        return {
            "before": _named(self.before),
            "after": _named(self.after),
            "payload": {**self.estimate.to_dict(), "possible": self.possible},
        }


def _named(each: NamedEstimate) -> dict[str, Any]:
    estimate = each.estimate.to_dict()
    values = {key: estimate[key] for key in ("mass", "center_of_gravity", "inertia", "standard_deviation")}
    names = {"name": each.name, "experiment": each.experiment, "method": each.estimate.method, "file": each.source}
    return {**names, **values, "accepted": each.estimate.verdict.accepted}


def compare(estimates: Sequence[NamedEstimate]) -> Comparison:
    """Differences of every two estimates, and whether all agree.

    Estimates of different recordings are taken as independent. See :data:`Basis` for those of the same.

    Args:
        estimates: At least two, of names that differ.

    Raises:
        InputError: They are less than two.
    """
    if len(estimates) < 2:
        raise InputError(
            f"compare: expected at least two estimates, found {len(estimates)}; name another, or ':all' behind the file for all its methods"
        )
    pairs = tuple(_pair(a, b) for a, b in combinations(estimates, 2))
    apart = _one_of_each_source(estimates)
    whole = None
    if len(apart) > 2:
        whole = agreement([e.estimate.value for e in apart], [e.estimate.covariance for e in apart])
    return Comparison(
        estimates=tuple(estimates),
        pairs=pairs,
        whole=whole,
        whole_of=tuple(e.name for e in apart) if whole else (),
        notes=tuple(_notes(estimates, pairs, whole)),
    )


def agreement(values: Sequence[Array], covariances: Sequence[Array], *, difference: Array | None = None) -> Agreement:
    r"""Chi-square of the differences of estimates over the parameters that all know.

    With :math:`d` the differences from the first, stacked, and :math:`\Sigma` their covariance it is
    :math:`d^T \Sigma^+ d`. For independent estimates that is Cochran's :math:`\sum (x_i - \bar x)^T C_i^{-1} (x_i - \bar x)`
    about the weighted mean [Cochran1954]_, also where a :math:`C_i` is singular.

    Args:
        values: Body parameters of k estimates, each of shape (10,).
        covariances: Each of shape (10, 10).
        difference: Covariance of the difference of two, shape (10, 10); None: they are independent.
    """
    k = len(values)
    known = np.all([np.isfinite(x) & np.isfinite(np.diag(C)) for x, C in zip(values, covariances, strict=True)], axis=0)
    block = np.ix_(known, known)
    d = np.concatenate([x[known] - values[0][known] for x in values[1:]])
    if difference is not None:
        sigma = difference[block]
    else:
        sigma = np.kron(np.ones((k - 1, k - 1)), covariances[0][block])
        p = int(known.sum())
        for i, covariance in enumerate(covariances[1:]):
            sigma[i * p : (i + 1) * p, i * p : (i + 1) * p] += covariance[block]
    names = tuple(name for name, told in zip(BODY_PARAMETERS, known, strict=True) if told)
    largest = np.tile(np.max(np.abs([x[known] for x in values]), axis=0), k - 1)
    exact = np.diag(sigma) == 0
    differ = exact & (np.abs(d) > _SAME * largest)
    contradicted = tuple(dict.fromkeys(np.array(names * (k - 1))[differ].tolist()))
    chi_square, freedom, dropped = _chi_square(d[~exact], sigma[np.ix_(~exact, ~exact)])
    if contradicted:
        return Agreement(np.inf, freedom, 0.0, np.inf, names, contradicted, dropped)
    if freedom == 0:
        # Equal exact numbers agree; of no numbers nothing can be said.
        p_value = 1.0 if exact.any() else np.nan
        return Agreement(0.0, 0, p_value, 0.0 if exact.any() else np.nan, names, (), dropped)
    return Agreement(chi_square, freedom, *_tail(chi_square, freedom), names, (), dropped)


def _chi_square(d: Array, covariance: Array) -> tuple[float, int, int]:
    """Of correlated differences: its value, the degrees of freedom, and the directions that were dropped."""
    sigma = np.sqrt(np.diag(covariance))
    variances, directions = np.linalg.eigh(covariance / np.outer(sigma, sigma))
    keep = variances > _NO_DIRECTION
    along = directions[:, keep].T @ (d / sigma)
    return float(np.sum(along**2 / variances[keep])), int(keep.sum()), int((~keep).sum())


def _tail(chi_square: float, freedom: int) -> tuple[float, float]:
    """Probability beyond, and the sigmas of one normal number that is as improbable."""
    from scipy.special import chdtrc, gammaln, ndtri_exp

    if not np.isfinite(chi_square):
        return 0.0, np.inf
    p_value = float(chdtrc(freedom, chi_square))
    if p_value > 1e-290:
        log_p = np.log(p_value)
    else:
        # The expansion of the incomplete gamma function for large x, DLMF 8.11.2: its logarithm lives on where p underflows.
        a, x = freedom / 2, chi_square / 2
        series = 1 + np.cumprod((a - np.arange(1, np.ceil(a))) / x).sum()
        log_p = -x + (a - 1) * np.log(x) + np.log(series) - gammaln(a)
    return p_value, float(max(0.0, -ndtri_exp(log_p - np.log(2))))


def _pair(first: NamedEstimate, second: NamedEstimate) -> Pair:
    a, b = first.estimate, second.estimate
    covariance, basis = _of_difference(first, second)
    return Pair(
        first=first.name,
        second=second.name,
        difference=b.value - a.value,
        covariance=covariance,
        basis=basis,
        agreement=agreement([a.value, b.value], [a.covariance, b.covariance], difference=covariance),
    )


def _of_difference(first: NamedEstimate, second: NamedEstimate) -> tuple[Array, Basis]:
    """Covariance of a difference; see :data:`Basis`."""
    a, b = first.estimate, second.estimate
    total = a.covariance + b.covariance
    if not _same_source(first, second):
        return total, "independent"
    if a.method == b.method or not {a.method, b.method} <= set(BEST_FIRST):
        return total, "bound"
    better, worse = sorted((a, b), key=lambda e: BEST_FIRST.index(e.method))
    nested = worse.covariance - better.covariance
    # Both exact: nothing to subtract.
    known = np.diag(total) > 0
    sigma = np.sqrt(np.diag(total)[known])
    if not known.any() or np.linalg.eigvalsh(nested[np.ix_(known, known)] / np.outer(sigma, sigma))[0] < _NESTED:
        return total, "bound"
    return nested, "nested"


def _same_source(first: NamedEstimate, second: NamedEstimate) -> bool:
    return bool(first.source) and first.source == second.source


def _one_of_each_source(estimates: Sequence[NamedEstimate]) -> list[NamedEstimate]:
    """Of the same recordings the best method: the others would count the same data again."""
    best: dict[str, NamedEstimate] = {}
    for i, each in enumerate(estimates):
        source = each.source or f"\0{i}"
        if source not in best or _rank(each) < _rank(best[source]):
            best[source] = each
    return list(best.values())


def _rank(each: NamedEstimate) -> int:
    return BEST_FIRST.index(each.estimate.method) if each.estimate.method in BEST_FIRST else len(BEST_FIRST)


def _notes(estimates: Sequence[NamedEstimate], pairs: Sequence[Pair], whole: Agreement | None) -> list[str]:
    """What the numbers rest on."""
    notes = []
    if any(pair.basis == "independent" for pair in pairs):
        notes.append(_INDEPENDENT_NOTE)
    for basis, text in (("nested", _NESTED_NOTE), ("bound", _BOUND_NOTE)):
        which = [f"{pair.first} and {pair.second}" for pair in pairs if pair.basis == basis]
        if which:
            notes.append(f"{'; '.join(which)}: {text}")
    notes += _doubts(estimates)
    judged = [*(p.agreement for p in pairs), *([whole] if whole else [])]
    if any(each.dropped for each in judged):
        notes.append(_SINGULAR_NOTE)
    return notes


_INDEPENDENT_NOTE = (
    "estimates of different recordings are taken as independent: errors that they share (force gain, robot file, places of the "
    "sensors) cancel in part, so that sigmas which contain them are too large here; errors that the sigmas do not contain are missing"
)
_NESTED_NOTE = (
    "the same recordings; the uncertainty of the difference is the worse method's covariance less the better's, which holds "
    "if the better one makes the best of the data"
)
_BOUND_NOTE = (
    "the same recordings, so they err alike in part; the uncertainty of the difference is that of independent estimates, an upper bound, "
    "and differences in sigmas may be larger than shown"
)


def _doubts(estimates: Sequence[NamedEstimate]) -> list[str]:
    """What about single estimates makes a comparison less sure."""
    about: dict[str, list[str]] = {}
    for a, b in combinations(estimates, 2):
        names = f"{a.name} and {b.name}"
        if a.experiment and a.experiment == b.experiment and a.source and b.source and not _same_source(a, b):
            about.setdefault(_ONE_NAME_NOTE.format(a.experiment), []).append(names)
        shared = [
            name
            for name in BODY_PARAMETERS
            if a.estimate.verdict.parameters.get(name) == b.estimate.verdict.parameters.get(name) == "prior"
        ]
        if shared:
            about.setdefault(_PRIOR_NOTE.format(", ".join(shared)), []).append(names)
    for each in estimates:
        for note in ((_DIAGONAL_NOTE,) if not each.correlated else ()) + each.estimate.notes:
            about.setdefault(note, []).append(each.name)
    return [f"{'; '.join(names)}: {note}" for note, names in about.items()]


_ONE_NAME_NOTE = (
    "experiments of one name ('{}'), taken as independent; if they are the same recordings, the uncertainty of the difference is an "
    "upper bound"
)
_PRIOR_NOTE = "{} were known beforehand, so that their agreement says nothing about the data"
_DIAGONAL_NOTE = (
    "the file has no covariance; parameters are taken as uncorrelated, so that the chi-square is approximate"
)
_SINGULAR_NOTE = (
    "combinations of parameters to which the estimates give no uncertainty are left out of a chi-square; where their covariance comes from "
    "few pieces of data, the rest of it is too small as well and the chi-square too large"
)


def payload(before: NamedEstimate, after: NamedEstimate) -> Payload:
    """The body that was added between two estimates.

    Mass, first moment and inertia about the platform origin of bodies that are fixed to each other add up; their difference is
    turned back to centre of gravity and inertia about it. The covariance is that of independent estimates, to first order.

    Args:
        before: Without the payload.
        after: With it.
    """
    a, b = before.estimate, after.estimate
    value, covariance = np.full(10, np.nan), np.full((10, 10), np.nan)
    reasons, notes = [], [_BOUND_NOTE if _same_source(before, after) else _INDEPENDENT_NOTE, *_doubts((before, after))]
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
        reasons.append("mass was taken off, not added; name the estimates in the other order to see what")
    possible = _possible(value, covariance) if not reasons else None
    if possible:
        notes += [f"{text}, but within {SIGNIFICANT:g} sigmas there is a body that can exist" for text in physical]
    else:
        reasons += physical
    untold = [name for name, v in zip(BODY_PARAMETERS, value, strict=True) if np.isnan(v)]
    if untold and len(untold) < 10 and not reasons:
        notes.append(f"not told, since one of the estimates lacks what it takes: {', '.join(untold)}")
    for array in (value, covariance):
        array.setflags(write=False)
    verdict = replace(judge(value), accepted=not reasons, reasons=tuple(reasons))
    return Payload(before, after, Estimate("difference", value, covariance, verdict, notes=tuple(notes)), possible)


def _no_mass(mass: float, variance: float, *, largest: float) -> str | None:
    """Why nothing but its mass can be said about a payload of this mass [kg]; None: it is told from nothing, or not known."""
    if np.isnan(mass):
        return None
    if np.isnan(variance):
        found = "its uncertainty is not known"
    elif abs(mass) < SIGNIFICANT * np.sqrt(variance) or abs(mass) <= _SAME * largest:
        found = f"less than {SIGNIFICANT:g} sigmas"
    else:
        return None
    return f"the mass differs by {mass:.3g} kg, {found}: where such a payload sits and how it resists turning cannot be told"


def _difference_body(a: Estimate, b: Estimate) -> tuple[Array, Array]:
    """Body parameters of what b is more than a, with exact derivatives.

    The masses differ.

    Returns:
        Body parameters, shape (10,), and their covariance, shape (10, 10); NaN where they need what is not known.
    """

    def body(x: Any) -> Any:
        linear = _linear(x[10:]) - _linear(x[:10])
        mass, c = linear[0], linear[1:4] / linear[0]
        return np.concatenate([[mass], c, linear[4:] - _moments(mass, c)])

    both = np.concatenate([a.value, b.value])
    spread = np.zeros((20, 20))
    spread[:10, :10], spread[10:, 10:] = a.covariance, b.covariance
    value = body(both)
    jacobian = np.column_stack([body(both + 1j * _STEP * e).imag / _STEP for e in np.eye(20)])
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
    """Moments xx, yy, zz, yz, xz, xy of a point mass, each from the coordinates it needs: others may be unknown."""
    x, y, z = c
    return mass * np.array([y * y + z * z, x * x + z * z, x * x + y * y, -y * z, -x * z, -x * y])


def _possible(value: Array, covariance: Array) -> bool | None:
    """Whether the least second moment of the mass about its centre, tr(J) / 2 - J, may be positive.

    For a positive mass that is what a body needs to exist [Wensing2018]_; to first order about the direction of the least.
    """
    if not np.isfinite(value).all() or not np.isfinite(np.diag(covariance)).all():
        return None
    J = symmetric(value[4:])
    moments, directions = np.linalg.eigh(np.trace(J) / 2 * np.eye(3) - J)
    v = directions[:, 0]
    slope = np.array([np.trace(E) / 2 - v @ E @ v for E in (symmetric(e) for e in np.eye(6))])
    sigma = float(np.sqrt(max(0.0, slope @ covariance[4:, 4:] @ slope)))
    return bool(moments[0] > 0 or moments[0] > -SIGNIFICANT * sigma)
