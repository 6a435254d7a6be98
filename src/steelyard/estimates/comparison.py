"""Estimates side by side: whether they agree within their uncertainty."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Literal

import numpy as np

from steelyard.arrays import Array
from steelyard.digits import LABELS, ten_numbers
from steelyard.display import Display
from steelyard.errors import InputError, WrongValueError
from steelyard.estimates.chi_square import ChiSquareTest, agreement
from steelyard.estimates.comparison_notes import (
    BOUND_NOTE,
    INDEPENDENT_NOTE,
    JOINT_NOTE,
    NESTED_NOTE,
    SINGULAR_NOTE,
    doubts,
)
from steelyard.estimates.comparison_settings import SETTINGS, ComparisonSettings
from steelyard.estimates.estimate import BEST_FIRST, Estimate, plain
from steelyard.estimates.named_estimate import NamedEstimate, same_source, shared_covariance
from steelyard.inertia import BODY_PARAMETERS

FORMAT = "steelyard-comparison/1"

Basis = Literal["independent", "joint", "nested", "bound"]
"""Where the covariance of a difference comes from.

``independent``: different recordings, the sum of both. ``joint``: two loads of one fit, by their
joint covariance. ``nested``: the same recordings, the worse
method's minus the better's: the covariance of an efficient estimate and its difference from another
one is zero [Hausman1978]_. ``bound``: the same recordings where that is no covariance; the sum of
both, more than the true one as far as both err alike.
"""


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
    agreement: ChiSquareTest

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
        return {
            "first": self.first,
            "second": self.second,
            "basis": self.basis,
            "difference": _by_name(self.difference),
            "standard_deviation": _by_name(self.standard_deviation),
            "sigmas": _by_name(self.z),
            "covariance": {"parameters": list(BODY_PARAMETERS), "matrix": plain(self.covariance)},
            "agreement": self.agreement.to_dict(),
        }


def _by_name(ten: Array) -> dict[str, float | None]:
    return dict(zip(BODY_PARAMETERS, plain(ten), strict=True))


@dataclass(frozen=True, eq=False)
class Comparison:
    """Estimates and their differences."""

    estimates: tuple[NamedEstimate, ...]
    pairs: tuple[Pair, ...]
    """Every two, in the order of the estimates."""
    whole: ChiSquareTest | None
    """Cochran's Q of three or more estimates of different recordings; None: there are not so
    many."""
    whole_of: tuple[str, ...]
    """Names of those estimates: of the same recordings only the best method."""
    notes: tuple[str, ...]
    """What the numbers rest on."""

    def __repr__(self) -> str:
        return "\n".join(_display(pair).text() for pair in self.pairs)

    def _repr_html_(self) -> str:
        return "".join(_display(pair).html() for pair in self.pairs)

    def exceeding(self, sigmas: float) -> tuple[str, ...]:
        """What differs by more: single parameters, pairs as a whole, all as a whole; what cannot be
        compared is named too.
        """
        found: list[str] = []
        for pair in self.pairs:
            found += _exceeding(pair, sigmas)
        if self.whole is not None and self.whole.sigmas > sigmas:
            found.append(
                f"{', '.join(self.whole_of)}: differ as a whole by {self.whole.sigmas:.1f} sigmas"
            )
        return tuple(found)

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        whole = None
        if self.whole is not None:
            whole = {"estimates": list(self.whole_of), **self.whole.to_dict()}
        return {
            "format": FORMAT,
            "estimates": [each.to_dict() for each in self.estimates],
            "pairs": [pair.to_dict() for pair in self.pairs],
            "whole": whole,
            "notes": list(self.notes),
        }


def _display(pair: Pair) -> Display:
    """Two estimates in a session or a notebook."""
    differences = ten_numbers(pair.difference, pair.standard_deviation, sign=True)
    sigmas = ["-" if np.isnan(z) else f"{z:+.1f}" for z in pair.z]
    rows = [
        (name, unit, difference, z)
        for (name, unit, _), difference, z in zip(LABELS, differences, sigmas, strict=True)
    ]
    return Display(
        f"{pair.second}, compared with {pair.first}",
        tuple(rows),
        head=("", "", "difference", "in sigmas"),
        sentences=(str(pair.agreement),),
    )


def _exceeding(pair: Pair, sigmas: float) -> Iterator[str]:
    """By what two estimates differ more, each parameter and as a whole."""
    names = f"{pair.first} and {pair.second}"
    for parameter, z in zip(BODY_PARAMETERS, pair.z, strict=True):
        if abs(z) > sigmas:
            yield f"{names}: {parameter} differs by {abs(z):.1f} sigmas"
    if np.isnan(pair.agreement.p_value):
        yield f"{names}: no parameter is known to both, so that nothing can be compared"
    elif pair.agreement.sigmas > sigmas:
        yield f"{names}: differ as a whole by {pair.agreement.sigmas:.1f} sigmas"


def compare(
    estimates: Sequence[NamedEstimate] | Mapping[str, Estimate],
    *,
    settings: ComparisonSettings = SETTINGS,
) -> Comparison:
    """Differences of every two estimates, and whether all agree.

    Estimates of different recordings are taken as independent. See :data:`Basis` for those of the
    same.

    Args:
        estimates: At least two, of names that differ; or name -> estimate, all of different
            recordings.
        settings: Levels and tolerances.

    Raises:
        InputError: They are less than two.
    """
    if isinstance(estimates, Mapping):
        estimates = [NamedEstimate(name, each) for name, each in estimates.items()]
    for each in [estimates] if isinstance(estimates, str | bytes) else estimates:
        if not (isinstance(each, NamedEstimate) and isinstance(each.estimate, Estimate)):
            raise WrongValueError(
                "estimates: expected named estimates, or a mapping of names to estimates, found"
                f" {type(each).__name__}; read_estimates makes them of a file"
            )
    if len(estimates) < 2:
        raise InputError(
            f"compare: expected at least two estimates, found {len(estimates)}; name another, or"
            " ':all' behind the file for all its methods"
        )
    pairs = tuple(_pair(a, b, settings) for a, b in combinations(estimates, 2))
    independent = _one_of_each_source(estimates)
    whole = None
    if len(independent) > 2:
        whole = agreement(
            [each.estimate.value for each in independent],
            [each.estimate.covariance for each in independent],
            settings=settings,
        )
    return Comparison(
        estimates=tuple(estimates),
        pairs=pairs,
        whole=whole,
        whole_of=tuple(each.name for each in independent) if whole else (),
        notes=tuple(_notes(estimates, pairs, whole)),
    )


def _pair(first: NamedEstimate, second: NamedEstimate, settings: ComparisonSettings) -> Pair:
    """The difference of two estimates and whether it is significant."""
    a, b = first.estimate, second.estimate
    covariance, basis = _of_difference(first, second, settings)
    return Pair(
        first=first.name,
        second=second.name,
        difference=b.value - a.value,
        covariance=covariance,
        basis=basis,
        agreement=agreement(
            [a.value, b.value],
            [a.covariance, b.covariance],
            difference=covariance,
            settings=settings,
        ),
    )


def _of_difference(
    first: NamedEstimate, second: NamedEstimate, settings: ComparisonSettings
) -> tuple[Array, Basis]:
    """Covariance of a difference, shape (10, 10); see :data:`Basis`."""
    a, b = first.estimate, second.estimate
    total = a.covariance + b.covariance
    shared = shared_covariance(first, second)
    if shared is not None:
        crossed = shared[:10, 10:]
        return total - crossed - crossed.T, "joint"
    if not same_source(first, second):
        return total, "independent"
    if a.method == b.method or not {a.method, b.method} <= set(BEST_FIRST):
        return total, "bound"
    better, worse = sorted((a, b), key=lambda e: BEST_FIRST.index(e.method))
    nested = worse.covariance - better.covariance
    known = np.diag(total) > 0
    if not known.any():
        # Both exact: nothing to subtract.
        return total, "bound"
    sigma = np.sqrt(np.diag(total)[known])
    scaled = nested[np.ix_(known, known)] / np.outer(sigma, sigma)
    if np.linalg.eigvalsh(scaled)[0] < settings.nested:
        return total, "bound"
    return nested, "nested"


def _one_of_each_source(estimates: Sequence[NamedEstimate]) -> list[NamedEstimate]:
    """Of the same recordings the best method: the others would count the same data again."""
    best: dict[str, NamedEstimate] = {}
    for i, each in enumerate(estimates):
        first = next((k for k, other in enumerate(estimates[:i]) if same_source(other, each)), i)
        source = estimates[first].source or f"\0{first}"
        if source not in best or _rank(each) < _rank(best[source]):
            best[source] = each
    return list(best.values())


def _rank(each: NamedEstimate) -> int:
    """Place of its method among all, the best one first."""
    method = each.estimate.method
    return BEST_FIRST.index(method) if method in BEST_FIRST else len(BEST_FIRST)


def _notes(
    estimates: Sequence[NamedEstimate], pairs: Sequence[Pair], whole: ChiSquareTest | None
) -> list[str]:
    """What the numbers rest on."""
    notes = []
    if any(pair.basis == "independent" for pair in pairs):
        notes.append(INDEPENDENT_NOTE)
    for basis, text in (("joint", JOINT_NOTE), ("nested", NESTED_NOTE), ("bound", BOUND_NOTE)):
        which = [f"{pair.first} and {pair.second}" for pair in pairs if pair.basis == basis]
        if which:
            notes.append(f"{'; '.join(which)}: {text}")
    notes += doubts(estimates)
    tests = [pair.agreement for pair in pairs]
    if whole is not None:
        tests.append(whole)
    if any(each.dropped for each in tests):
        notes.append(SINGULAR_NOTE)
    return notes
