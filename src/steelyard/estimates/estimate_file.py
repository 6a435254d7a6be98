"""Estimates read back from what `identify` writes."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field

from steelyard.arrays import Array
from steelyard.display import printable
from steelyard.errors import InputError
from steelyard.estimates.estimate import FORMAT, Estimate, Label, Verdict
from steelyard.inertia import BODY_PARAMETERS, Inertia, six
from steelyard.json_file import read_json
from steelyard.yaml_file import FileModel, YamlDocument, require_file, validate

FILE_NAME = "estimate.json"
"""What `identify` writes into its folder."""
ALL = "all"
"""Stands for every method of a file."""

_MOST_VALUES = 100_000  # beside what is passed over; an estimate has some two hundred
_DEEPEST = 16
_LONGEST_NAME = 60
_LEAST_VARIANCE = 1e-40  # of any parameter, SI
_ROUNDED = 1e-6
"""Part of the sigmas by which a matrix may fail to be symmetric or semidefinite: others may write
fewer digits."""

Number = float | None
Triple = tuple[Number, Number, Number]


@dataclass(frozen=True, eq=False)
class NamedEstimate:
    """An estimate among others."""

    name: str
    """Short and unlike the others'."""
    estimate: Estimate
    experiment: str = ""
    """Name of the experiment; empty: not known."""
    source: str = ""
    """Estimates of equal sources are made from the same recordings: the path of their file; empty:
    of its own."""
    correlated: bool = True
    """Whether the covariance is known, and not the 1-sigmas alone."""


@dataclass(frozen=True, eq=False)
class EstimateFile:
    """What an estimate file holds."""

    path: Path
    experiment: str
    nominal: Inertia | None
    result: str
    """Name of the best method."""
    estimates: Mapping[str, NamedEstimate]
    """By the name of their method; without calibration, residuals and single runs."""

    def chosen(self, method: str | None = None) -> tuple[NamedEstimate, ...]:
        """The estimate of a method.

        Args:
            method: Its name; None: the result; ``all``: every one.

        Raises:
            InputError: There is none of that name.
        """
        if method == ALL:
            return tuple(self.estimates.values())
        if method is not None and method not in self.estimates:
            raise InputError(
                f"{self.path}: expected an estimate of method '{method}', found"
                f" {', '.join(self.estimates)}; choose one of these"
            )
        return (self.estimates[method or self.result],)


class _Form(FileModel):
    """The contract lets a file hold more than is read here."""

    model_config = ConfigDict(extra="ignore")


class _Body(_Form):
    mass: Number
    center_of_gravity: Triple
    inertia: tuple[Triple, Triple, Triple]


class _Nominal(_Form):
    mass: float
    center_of_gravity: tuple[float, float, float]
    inertia: tuple[
        tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]
    ]


class _Covariance(_Form):
    parameters: tuple[str, ...]
    matrix: tuple[tuple[Number, ...], ...]


class _Verdict(_Form):
    accepted: bool
    reasons: tuple[str, ...] = ()
    parameters: dict[Literal[BODY_PARAMETERS], Label] = Field(default_factory=dict)  # type: ignore[valid-type]


class _Entry(_Body):
    standard_deviation: _Body
    covariance: _Covariance | None = None
    verdict: _Verdict
    notes: tuple[str, ...] = ()


class _File(_Form):
    experiment: str
    nominal: _Nominal | None = None
    result: str
    estimates: dict[str, _Entry]


def read_estimate_file(path: Path) -> EstimateFile:
    """Read what `identify` wrote.

    Args:
        path: An estimate file, or a folder with one.

    Raises:
        InputError: It is not there, too large, no JSON, or not of the form of the contract.
    """
    path = path / FILE_NAME if path.is_dir() else path
    require_file(path, "file that identify wrote, or its folder")
    document = YamlDocument(path, read_json(path), {})
    if not isinstance(document.data, dict):
        raise document.error(
            (),
            f"expected an estimate that identify wrote, found {_kind(document.data)}; check the"
            " path",
        )
    if document.data.get("format") != FORMAT:
        found = (
            json.dumps(document.data["format"])[:_LONGEST_NAME]
            if "format" in document.data
            else "no such key"
        )
        raise document.error(
            ("format",), f"expected '{FORMAT}', found {found}; name a file that identify wrote"
        )
    values = _wanted(document.data)
    _check_extent(document, values)
    form = validate(_File, document, values)
    if form.result not in form.estimates:
        raise document.error(
            ("result",),
            "expected the name of one of the estimates"
            f" ({', '.join(form.estimates) or 'there is none'}), found '{form.result}'; let"
            " identify write the file again",
        )
    source, experiment = str(path.resolve()), printable(form.experiment)
    estimates = {
        name: NamedEstimate(
            name, _estimate(document, name, entry), experiment, source, entry.covariance is not None
        )
        for name, entry in ((printable(name), entry) for name, entry in form.estimates.items())
    }
    return EstimateFile(
        path, experiment, _nominal(document, form.nominal), printable(form.result), estimates
    )


def read_estimates(places: Sequence[str], method: str | None = None) -> tuple[NamedEstimate, ...]:
    """Read estimates and give them short names that differ.

    Args:
        places: Estimate files or folders with one, each with ``:METHOD`` behind it where not the
            default is meant.
        method: Of those without; None: the result of the file; ``all``: every one.

    Raises:
        InputError: See :func:`read_estimate_file`, :meth:`EstimateFile.chosen`.
    """
    found: list[NamedEstimate] = []
    for place in places:
        path, own = _split(place)
        found += read_estimate_file(path).chosen(own or method)
    return tuple(
        replace(each, name=name) for each, name in zip(found, _short_names(found), strict=True)
    )


def _split(place: str) -> tuple[Path, str | None]:
    """Path and method; a path that is there is a path, whatever colons it has."""
    path, colon, method = place.rpartition(":")
    return (
        (Path(path), method)
        if colon and path and method and not _exists(place)
        else (Path(place), None)
    )


def _exists(place: str) -> bool:
    try:
        return Path(place).exists()
    except (OSError, ValueError):
        return False


def _short_names(found: Sequence[NamedEstimate]) -> list[str]:
    """What tells the estimates apart: method, experiment, both, and where that is not enough the
    file.
    """
    methods, experiments = [e.estimate.method for e in found], [e.experiment for e in found]
    places = [_place(e.source) for e in found]
    forms = (
        methods if len(set(experiments)) == 1 else [],
        experiments if len(set(methods)) == 1 else [],
        [f"{e}, {m}" for e, m in zip(experiments, methods, strict=True)],
        places if len(set(methods)) == 1 else [],
        [f"{p}, {m}" for p, m in zip(places, methods, strict=True)],
    )
    for form in forms:
        names = [_cut(name) for name in form]
        if names and all(names) and len(set(names)) == len(names):
            return names
    again = Counter(names)
    return [f"{n} #{names[: i + 1].count(n)}" if again[n] > 1 else n for i, n in enumerate(names)]


def _place(source: str) -> str:
    path = Path(source)
    return printable(path.parent.name if path.name == FILE_NAME and path.parent.name else path.stem)


def _cut(name: str) -> str:
    return name if len(name) <= _LONGEST_NAME else f"{name[:_LONGEST_NAME]}…"


def _wanted(data: dict[str, Any]) -> dict[str, Any]:
    """The keys that are read."""
    values = {key: data[key] for key in _File.model_fields if key in data}
    entries = values.get("estimates")
    if isinstance(entries, dict):
        values["estimates"] = {
            name: (
                {key: entry[key] for key in _Entry.model_fields if key in entry}
                if isinstance(entry, dict)
                else entry
            )
            for name, entry in entries.items()
        }
    return values


def _check_extent(document: YamlDocument, values: dict[str, Any]) -> None:
    """Refuse what would take long to check."""
    level: list[Any] = [values]
    count = depth = 0
    while level:
        count, depth = count + len(level), depth + 1
        if count > _MOST_VALUES or depth > _DEEPEST:
            what = (
                f"{_MOST_VALUES} values"
                if count > _MOST_VALUES
                else f"{_DEEPEST} lists in each other"
            )
            raise document.error(
                (), f"expected at most {what}, found more; let identify write the file again"
            )
        level = [
            inner
            for each in level
            if isinstance(each, dict | list)
            for inner in (each.values() if isinstance(each, dict) else each)
        ]


def _kind(value: Any) -> str:
    return "a list" if isinstance(value, list) else "nothing" if value is None else "a single value"


def _nominal(document: YamlDocument, form: _Nominal | None) -> Inertia | None:
    if form is None:
        return None
    try:
        return Inertia(form.mass, np.array(form.center_of_gravity), np.array(form.inertia))
    except ValueError as error:
        raise document.error(("nominal",), f"{error}; correct it") from None


def _estimate(document: YamlDocument, name: str, entry: _Entry) -> Estimate:
    key = ("estimates", name)
    value = _ten(document, key, entry)
    deviation = _ten(document, (*key, "standard_deviation"), entry.standard_deviation)
    if (deviation < 0).any():
        raise document.error(
            (*key, "standard_deviation"),
            f"expected no 1-sigma below 0, found {np.nanmin(deviation):g}; correct it",
        )
    covariance = (
        np.diag(deviation**2)
        if entry.covariance is None
        else _matrix(document, key, entry.covariance)
    )
    known = np.flatnonzero(np.isfinite(np.diag(covariance)))
    block = np.ix_(known, known)
    problem = _no_covariance(covariance[block], [BODY_PARAMETERS[j] for j in known])
    if problem is not None:
        raise document.error(
            (*key, "covariance", "matrix") if entry.covariance else key, f"{problem}; correct it"
        )
    covariance[block] = (covariance[block] + covariance[block].T) / 2
    untold = np.isnan(value) | np.isnan(np.diag(covariance))
    covariance[untold, :] = covariance[:, untold] = np.nan
    for array in (value, covariance):
        array.setflags(write=False)
    return Estimate(
        method=name,
        value=value,
        covariance=covariance,
        verdict=Verdict(
            accepted=entry.verdict.accepted,
            reasons=tuple(printable(reason) for reason in entry.verdict.reasons),
            parameters=entry.verdict.parameters,
        ),
        notes=tuple(printable(note) for note in entry.notes),
    )


def _ten(document: YamlDocument, key: tuple[str, ...], body: _Body) -> Array:
    """The ten of :data:`BODY_PARAMETERS`, NaN for null."""
    inertia = np.array(body.inertia, dtype=np.float64)
    if not np.allclose(
        inertia, inertia.T, rtol=0, atol=_ROUNDED * _largest(inertia), equal_nan=True
    ):
        raise document.error(
            (*key, "inertia"), f"expected a symmetric matrix, found {_rows(inertia)}; correct it"
        )
    return np.array([body.mass, *body.center_of_gravity, *six(inertia)], dtype=np.float64)


def _matrix(document: YamlDocument, key: tuple[str, ...], form: _Covariance) -> Array:
    """The numbers of a covariance, NaN for null."""
    if form.parameters != BODY_PARAMETERS:
        raise document.error(
            (*key, "covariance", "parameters"),
            f"expected {', '.join(BODY_PARAMETERS)}, found"
            f" {_cut(', '.join(form.parameters)) or 'none'}; put them in this order",
        )
    key = (*key, "covariance", "matrix")
    lengths = {len(row) for row in form.matrix} or {0}
    if len(form.matrix) != 10 or lengths != {10}:
        raise document.error(
            key,
            f"expected 10 rows of 10, found {len(form.matrix)} of"
            f" {max(lengths - {10}, default=10)}; correct it",
        )
    return np.array(form.matrix, dtype=np.float64)


def _no_covariance(matrix: Array, names: Sequence[str]) -> str | None:
    """Why a matrix of shape (n, n) with numbers on its diagonal is not the covariance of n
    parameters; None: it is one.
    """

    def first(wrong: NDArray[np.bool_]) -> str:
        return " and ".join(names[j] for j in np.argwhere(wrong)[0])

    variance = np.diag(matrix)
    if (variance < 0).any():
        return (
            f"expected no variance below 0, found {variance.min():g} of"
            f" {names[int(variance.argmin())]}"
        )
    tiny = (variance > 0) & (variance < _LEAST_VARIANCE)
    if tiny.any():
        return (
            f"expected variances of 0 or of a possible size, found {variance[tiny][0]:.3g} of"
            f" {names[int(tiny.argmax())]}"
        )
    if np.isnan(matrix).any():
        return (
            f"expected a number for {first(np.isnan(matrix))}, which both have a variance, found"
            " null"
        )
    # By magnitude first: where one is exact, nothing is left to divide by.
    product = np.outer(np.sqrt(variance), np.sqrt(variance))
    beyond = np.abs(matrix) > (1 + _ROUNDED) * product
    if beyond.any():
        return f"expected correlations from -1 to 1, found one beyond between {first(beyond)}"
    scaled = np.divide(matrix, product, out=np.eye(len(names)), where=product > 0)
    skew = np.abs(scaled - scaled.T) > _ROUNDED
    if skew.any():
        return f"expected a symmetric matrix, found two different numbers for {first(skew)}"
    lowest = float(np.linalg.eigvalsh((scaled + scaled.T) / 2).min(initial=1.0))
    if lowest < -_ROUNDED * len(names):
        return (
            f"expected a matrix without negative eigenvalues, found {lowest:.3g} in units of the"
            " 1-sigmas"
        )
    return None


def _largest(matrix: Array) -> float:
    return float(np.max(np.abs(matrix), initial=0.0, where=np.isfinite(matrix)))


def _rows(matrix: Array) -> str:
    return str([[None if np.isnan(v) else float(f"{v:.4g}") for v in row] for row in matrix])
