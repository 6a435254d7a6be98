"""Estimates side by side: whether they agree within their uncertainty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Literal

import numpy as np

from steelyard.arrays import Array
from steelyard.digits import LABELS, ten_numbers
from steelyard.display import Display
from steelyard.errors import InputError
from steelyard.estimates.estimate import BEST_FIRST, Estimate, plain
from steelyard.estimates.estimate_file import NamedEstimate
from steelyard.inertia import BODY_PARAMETERS

Basis = Literal["independent", "nested", "bound"]
"""Where the covariance of a difference comes from.

``independent``: different recordings, the sum of both. ``nested``: the same recordings, the worse
method's minus the better's: the covariance of an efficient estimate and its difference from another
one is zero [Hausman1978]_. ``bound``: the same recordings where that is no covariance; the sum of
both, more than the true one as far as both err alike.
"""

SIGNIFICANT = 3.0
"""Sigmas: a payload of less mass is not told from nothing, and a body that can exist further away
is no explanation."""
USUAL = 2.0
"""Sigmas that chance exceeds once in twenty times."""
_LEAST_P = 1e-99
"""Smaller ones say nothing more."""
_NO_DIRECTION = 1e-12
"""Variance of a combination of parameters, in units of their sigmas, below which it is rounding."""
_NESTED = 1e-6
"""The same for a difference of covariances, which are approximations themselves."""
SAME = 1e-9
"""Part by which two exact numbers may differ."""


@dataclass(frozen=True, eq=False)
class Agreement:
    """Whether differences are within their uncertainty as a whole."""

    chi_square: float
    """Infinite where numbers that are given as exact differ."""
    freedom: int
    """Independent differences that were compared."""
    p_value: float
    """Chance of such differences or larger ones where nothing but the stated uncertainty is behind
    them; NaN: nothing was compared."""
    sigmas: float
    """The same as sigmas of one normal difference of either sign."""
    parameters: tuple[str, ...]
    """Body parameters that all know."""
    contradicted: tuple[str, ...] = ()
    """Those that are exact in both of two estimates, yet differ."""
    dropped: int = 0
    """Combinations of parameters without any stated uncertainty, which were left out."""

    def __str__(self) -> str:
        if np.isnan(self.p_value):
            return "nothing that they all know can be compared"
        if self.contradicted:
            return (
                f"disagree: {', '.join(self.contradicted)} given as exact by both, but with"
                " different values"
            )
        words = (
            "agree within their uncertainty"
            if self.sigmas <= USUAL
            else "differ more than is usual"
            if self.sigmas <= SIGNIFICANT
            else "disagree"
        )
        if not self.freedom:
            return f"{words}: the same exact values"
        rare = f", as rare as {self.sigmas:.1f} sigmas" if self.sigmas > USUAL else ""
        part = (
            ""
            if len(self.parameters) == len(BODY_PARAMETERS)
            else f" ({', '.join(self.parameters)})"
        )
        p_value = f"p = {self.p_value:.2g}" if self.p_value > _LEAST_P else f"p < {_LEAST_P:g}"
        return f"{words}: chi-square {self.chi_square:.1f} on {self.freedom}, {p_value}{rare}{part}"

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
    """Cochran's Q of three or more estimates of different recordings; None: there are not so
    many."""
    whole_of: tuple[str, ...]
    """Names of those estimates: of the same recordings only the best method."""
    notes: tuple[str, ...]
    """What the numbers rest on."""

    def __repr__(self) -> str:
        return "\n".join(each.text() for each in self._displays())

    def _repr_html_(self) -> str:
        return "".join(each.html() for each in self._displays())

    def _displays(self) -> list[Display]:
        """Every two of the estimates."""
        return [
            Display(
                f"{pair.second}, compared with {pair.first}",
                tuple(
                    (name, unit, difference, "-" if np.isnan(z) else f"{z:+.1f}")
                    for (name, unit, _), difference, z in zip(
                        LABELS,
                        ten_numbers(pair.difference, pair.standard_deviation, sign=True),
                        pair.z,
                        strict=True,
                    )
                ),
                head=("", "", "difference", "in sigmas"),
                sentences=(str(pair.agreement),),
            )
            for pair in self.pairs
        ]

    def exceeding(self, sigmas: float) -> tuple[str, ...]:
        """What differs by more: single parameters, pairs as a whole, all as a whole; what cannot be
        compared is named too.
        """
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
            found.append(
                f"{', '.join(self.whole_of)}: differ as a whole by {self.whole.sigmas:.1f} sigmas"
            )
        return tuple(found)

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "estimates": [described(each) for each in self.estimates],
            "pairs": [pair.to_dict() for pair in self.pairs],
            "whole": (
                None
                if self.whole is None
                else {"estimates": list(self.whole_of), **self.whole.to_dict()}
            ),
            "notes": list(self.notes),
        }


def described(each: NamedEstimate) -> dict[str, Any]:
    """Plain values of one of the estimates that are put side by side."""
    estimate = each.estimate.to_dict()
    values = {
        key: estimate[key] for key in ("mass", "center_of_gravity", "inertia", "standard_deviation")
    }
    names = {
        "name": each.name,
        "experiment": each.experiment,
        "method": each.estimate.method,
        "file": each.source,
    }
    return {**names, **values, "accepted": each.estimate.verdict.accepted}


def compare(estimates: Sequence[NamedEstimate] | Mapping[str, Estimate]) -> Comparison:
    """Differences of every two estimates, and whether all agree.

    Estimates of different recordings are taken as independent. See :data:`Basis` for those of the
    same.

    Args:
        estimates: At least two, of names that differ; or name -> estimate, all of different
            recordings.

    Raises:
        InputError: They are less than two.
    """
    if isinstance(estimates, Mapping):
        estimates = [NamedEstimate(name, each) for name, each in estimates.items()]
    if len(estimates) < 2:
        raise InputError(
            f"compare: expected at least two estimates, found {len(estimates)}; name another, or"
            " ':all' behind the file for all its methods"
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


def agreement(
    values: Sequence[Array], covariances: Sequence[Array], *, difference: Array | None = None
) -> Agreement:
    r"""Chi-square of the differences of estimates over the parameters that all know.

    With :math:`d` the differences from the first, stacked, and :math:`\Sigma` their covariance it
    is
    :math:`d^T \Sigma^+ d`. For independent estimates that is Cochran's :math:`\sum (x_i - \bar x)^T
    C_i^{-1} (x_i - \bar x)` about the weighted mean [Cochran1954]_, also where a :math:`C_i` is
    singular.

    Args:
        values: Body parameters of k estimates, each of shape (10,).
        covariances: Each of shape (10, 10).
        difference: Covariance of the difference of two, shape (10, 10); None: they are independent.
    """
    k = len(values)
    known = np.all(
        [
            np.isfinite(x) & np.isfinite(np.diag(C))
            for x, C in zip(values, covariances, strict=True)
        ],
        axis=0,
    )
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
    differ = exact & (np.abs(d) > SAME * largest)
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
    """Of correlated differences: its value, the degrees of freedom, and the directions that were
    dropped.
    """
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
        # The expansion of the incomplete gamma function for large x, DLMF 8.11.2: its logarithm
        # lives on where p underflows.
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
        agreement=agreement(
            [a.value, b.value], [a.covariance, b.covariance], difference=covariance
        ),
    )


def _of_difference(first: NamedEstimate, second: NamedEstimate) -> tuple[Array, Basis]:
    """Covariance of a difference; see :data:`Basis`."""
    a, b = first.estimate, second.estimate
    total = a.covariance + b.covariance
    if not same_source(first, second):
        return total, "independent"
    if a.method == b.method or not {a.method, b.method} <= set(BEST_FIRST):
        return total, "bound"
    better, worse = sorted((a, b), key=lambda e: BEST_FIRST.index(e.method))
    nested = worse.covariance - better.covariance
    # Both exact: nothing to subtract.
    known = np.diag(total) > 0
    sigma = np.sqrt(np.diag(total)[known])
    if (
        not known.any()
        or np.linalg.eigvalsh(nested[np.ix_(known, known)] / np.outer(sigma, sigma))[0] < _NESTED
    ):
        return total, "bound"
    return nested, "nested"


def same_source(first: NamedEstimate, second: NamedEstimate) -> bool:
    """Whether two estimates stand on the same recordings."""
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
    return (
        BEST_FIRST.index(each.estimate.method)
        if each.estimate.method in BEST_FIRST
        else len(BEST_FIRST)
    )


def _notes(
    estimates: Sequence[NamedEstimate], pairs: Sequence[Pair], whole: Agreement | None
) -> list[str]:
    """What the numbers rest on."""
    notes = []
    if any(pair.basis == "independent" for pair in pairs):
        notes.append(INDEPENDENT_NOTE)
    for basis, text in (("nested", _NESTED_NOTE), ("bound", BOUND_NOTE)):
        which = [f"{pair.first} and {pair.second}" for pair in pairs if pair.basis == basis]
        if which:
            notes.append(f"{'; '.join(which)}: {text}")
    notes += doubts(estimates)
    judged = [*(p.agreement for p in pairs), *([whole] if whole else [])]
    if any(each.dropped for each in judged):
        notes.append(_SINGULAR_NOTE)
    return notes


INDEPENDENT_NOTE = (
    "estimates of different recordings are taken as independent: errors that they share (force"
    " gain, robot file, places of the sensors) cancel in part, so that sigmas which contain them"
    " are too large here; errors that the sigmas do not contain are missing"
)
_NESTED_NOTE = (
    "the same recordings; the uncertainty of the difference is the worse method's covariance less"
    " the better's, which holds if the better one makes the best of the data"
)
BOUND_NOTE = (
    "the same recordings, so they err alike in part; the uncertainty of the difference is that of"
    " independent estimates, an upper bound, and differences in sigmas may be larger than shown"
)


def doubts(estimates: Sequence[NamedEstimate]) -> list[str]:
    """What about single estimates makes a comparison less sure."""
    about: dict[str, list[str]] = {}
    for a, b in combinations(estimates, 2):
        names = f"{a.name} and {b.name}"
        if (
            a.experiment
            and a.experiment == b.experiment
            and a.source
            and b.source
            and not same_source(a, b)
        ):
            about.setdefault(_ONE_NAME_NOTE.format(a.experiment), []).append(names)
        shared = [
            name
            for name in BODY_PARAMETERS
            if a.estimate.verdict.parameters.get(name)
            == b.estimate.verdict.parameters.get(name)
            == "prior"
        ]
        if shared:
            about.setdefault(_PRIOR_NOTE.format(", ".join(shared)), []).append(names)
    for each in estimates:
        for note in ((_DIAGONAL_NOTE,) if not each.correlated else ()) + each.estimate.notes:
            about.setdefault(note, []).append(each.name)
    return [f"{'; '.join(names)}: {note}" for note, names in about.items()]


_ONE_NAME_NOTE = (
    "experiments of one name ('{}'), taken as independent; if they are the same recordings, the"
    " uncertainty of the difference is an upper bound"
)
_PRIOR_NOTE = "{} were known beforehand, so that their agreement says nothing about the data"
_DIAGONAL_NOTE = (
    "the file has no covariance; parameters are taken as uncorrelated, so that the chi-square is"
    " approximate"
)
_SINGULAR_NOTE = (
    "combinations of parameters to which the estimates give no uncertainty are left out of a"
    " chi-square; where their covariance comes from few pieces of data, the rest of it is too small"
    " as well and the chi-square too large"
)
