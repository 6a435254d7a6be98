"""Estimates read back from what `identify` writes."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import ConfigDict, Field

from steelyard.arrays import Array
from steelyard.display import printable
from steelyard.errors import InputError
from steelyard.estimates.covariance_check import ROUNDED, covariance_problem
from steelyard.estimates.estimate import FORMAT, Estimate, Label, Verdict
from steelyard.estimates.geometry import FoundGeometry
from steelyard.estimates.joint_covariance import JointCovariance
from steelyard.estimates.named_estimate import (
    FILE_NAME,
    LONGEST_NAME,
    NamedEstimate,
    short_names,
    shortened,
)
from steelyard.estimates.per_mass import PER_MASS_PARAMETERS, PerMass
from steelyard.files.document import YamlDocument
from steelyard.files.file_model import FileModel, validate
from steelyard.files.regular_file import require_file
from steelyard.inertia import BODY_PARAMETERS, Inertia, six
from steelyard.json_file import read_json
from steelyard.output import settle

ALL = "all"
"""Stands for every method of a file."""

_MOST_VALUES = 100_000
"""Beside what is passed over; an estimate has some two hundred."""
_DEEPEST = 16
"""Lists in each other; a covariance has five."""

Number = float | None
Triple = tuple[Number, Number, Number]
_Known = tuple[float, float, float]


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
    loads: Mapping[str, Mapping[str, NamedEstimate]] = field(default_factory=dict)
    """The same of every load, by method and load, where there are several."""

    def chosen(
        self, method: str | None = None, load: str | None = None
    ) -> tuple[NamedEstimate, ...]:
        """The estimate of a method.

        Args:
            method: Its name; None: the result; ``all``: every one.
            load: Name of a load; None: the first, or there is one.

        Raises:
            InputError: There is none of that name.
        """
        if load is not None:
            return tuple(self._of_load(each.estimate.method, load) for each in self.chosen(method))
        if method == ALL:
            return tuple(self.estimates.values())
        if method is not None and method not in self.estimates:
            raise InputError(
                f"{self.path}: expected an estimate of method '{method}', found"
                f" {', '.join(self.estimates)}; choose one of these"
            )
        return (self.estimates[method or self.result],)

    def _of_load(self, method: str, load: str) -> NamedEstimate:
        """The estimate of a load by a method."""
        loads = self.loads.get(method, {})
        if load not in loads:
            found = ", ".join(loads) or "an estimate of one body"
            raise InputError(
                f"{self.path}: expected a load '{load}' under {method}, found {found}; choose one of"
                " its loads, or leave '#' out"
            )
        return loads[load]


class _LenientForm(FileModel):
    """The contract lets a file hold more than is read here."""

    model_config = ConfigDict(extra="ignore")


class _BodyForm(_LenientForm):
    mass: Number
    center_of_gravity: Triple
    inertia: tuple[Triple, Triple, Triple]


class _NominalForm(_LenientForm):
    mass: float
    center_of_gravity: _Known
    inertia: tuple[_Known, _Known, _Known]


class _CovarianceForm(_LenientForm):
    parameters: tuple[str, ...]
    matrix: tuple[tuple[Number, ...], ...]


class _PointsForm(_LenientForm):
    anchors: tuple[_Known, ...]
    attachments: tuple[_Known, ...]


class _GeometryForm(_PointsForm):
    nominal: _PointsForm
    covariance: _CovarianceForm


class _VerdictForm(_LenientForm):
    accepted: bool | None
    reasons: tuple[str, ...] = ()
    disagreement: str = ""
    parameters: dict[Literal[BODY_PARAMETERS], Label] = Field(default_factory=dict)  # type: ignore[valid-type]


class _EntryForm(_BodyForm):
    standard_deviation: _BodyForm
    covariance: _CovarianceForm | None = None
    inertia_per_mass: tuple[Triple, Triple, Triple] | None = None
    covariance_per_mass: _CovarianceForm | None = None
    geometry: _GeometryForm | None = None
    verdict: _VerdictForm
    notes: tuple[str, ...] = ()


class _JointForm(_LenientForm):
    loads: tuple[str, ...]
    matrix: tuple[tuple[Number, ...], ...]


class _LoadsForm(_EntryForm):
    loads: dict[str, _EntryForm] | None = None
    joint: _JointForm | None = None


class _FileForm(_LenientForm):
    experiment: str
    nominal: _NominalForm | None = None
    result: str
    estimates: dict[str, _LoadsForm]
    recordings: dict[str, str] | None = None


def read_estimate_file(path: Path) -> EstimateFile:
    """Read what `identify` wrote.

    Args:
        path: An estimate file, or a folder with one.

    Raises:
        InputError: It is not there, too large, no JSON, or not of the form of the contract.
    """
    path = path / FILE_NAME if path.is_dir() else path
    # Of a process that was killed while it replaced results.
    settle(path.parent)
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
            json.dumps(document.data["format"])[:LONGEST_NAME]
            if "format" in document.data
            else "no such key"
        )
        raise document.error(
            ("format",), f"expected '{FORMAT}', found {found}; name a file that identify wrote"
        )
    values = _wanted(document.data)
    _check_extent(document, values)
    form = validate(_FileForm, document, values)
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
            name,
            _estimate(document, ("estimates", name), entry),
            experiment,
            source,
            entry.covariance is not None,
            recordings=frozenset((form.recordings or {}).values()),
        )
        for name, entry in ((printable(name), entry) for name, entry in form.estimates.items())
    }
    loads = {
        printable(name): _loads(document, name, entry, estimates[printable(name)])
        for name, entry in form.estimates.items()
        if entry.loads
    }
    nominal = _nominal(document, form.nominal)
    return EstimateFile(path, experiment, nominal, printable(form.result), estimates, loads)


def _loads(
    document: YamlDocument, method: str, entry: _LoadsForm, first: NamedEstimate
) -> dict[str, NamedEstimate]:
    """Estimates of all loads by a method, with what they share."""
    key = ("estimates", method)
    joint = None
    names = tuple(entry.loads or ())
    if entry.joint is not None:
        matrix = np.array(entry.joint.matrix, dtype=np.float64)
        size = 10 * len(names)
        if entry.joint.loads != names or matrix.shape != (size, size):
            raise document.error(
                (*key, "joint"),
                f"expected a matrix of {size} rows over {', '.join(names)}, found one of shape"
                f" {matrix.shape} over {', '.join(entry.joint.loads)}; let identify write the file"
                " again",
            )
        known = np.flatnonzero(np.isfinite(np.diag(matrix)))
        labels = [f"{name} {each}" for name in names for each in BODY_PARAMETERS]
        problem = covariance_problem(matrix[np.ix_(known, known)], [labels[i] for i in known])
        if problem is not None:
            raise document.error((*key, "joint", "matrix"), f"{problem}; correct it")
        joint = JointCovariance(tuple(map(printable, names)), (matrix + matrix.T) / 2)
    return {
        printable(name): replace(
            first,
            estimate=replace(
                _estimate(document, (*key, "loads", name), each), method=first.estimate.method
            ),
            load=printable(name),
            joint=joint,
        )
        for name, each in (entry.loads or {}).items()
    }


def read_estimates(places: Sequence[str], method: str | None = None) -> tuple[NamedEstimate, ...]:
    """Read estimates and give them short names that differ.

    Args:
        places: Estimate files or folders with one, each with ``:METHOD`` behind it where not the
            default is meant, and ``#LOAD`` behind that for another load than the first.
        method: Of those without; None: the result of the file; ``all``: every one.

    Raises:
        InputError: See :func:`read_estimate_file`, :meth:`EstimateFile.chosen`.
    """
    found: list[NamedEstimate] = []
    for place in places:
        path, own, load = _split(place)
        found += read_estimate_file(path).chosen(own or method, load)
    return tuple(
        replace(each, name=name) for each, name in zip(found, short_names(found), strict=True)
    )


def _split(place: str) -> tuple[Path, str | None, str | None]:
    """Path, method and load; a path that is there is a path, whatever colons it has."""
    before, _, load = place.rpartition("#")
    if before and load and not _exists(place):
        path, method, _ = _split(before)
        return path, method, load
    path_text, _, method_text = place.rpartition(":")
    if path_text and method_text and not _exists(place):
        return Path(path_text), method_text, None
    return Path(place), None, None


def _exists(place: str) -> bool:
    try:
        return Path(place).exists()
    except (OSError, ValueError):
        return False


def _wanted(data: dict[str, Any]) -> dict[str, Any]:
    """The keys that are read."""
    values: dict[str, Any] = _some(data, _FileForm)
    entries = values.get("estimates")
    if isinstance(entries, dict):
        values["estimates"] = {name: _some(entry, _LoadsForm) for name, entry in entries.items()}
        for entry in values["estimates"].values():
            if isinstance(entry, dict) and isinstance(entry.get("loads"), dict):
                loads = entry["loads"].items()
                entry["loads"] = {name: _some(each, _EntryForm) for name, each in loads}
    return values


def _some(entry: Any, form: type[FileModel]) -> Any:
    """The keys of a mapping that a form has; anything else as it is."""
    if not isinstance(entry, dict):
        return entry
    return {key: entry[key] for key in form.model_fields if key in entry}


def _check_extent(document: YamlDocument, values: dict[str, Any]) -> None:
    """Refuse what would take long to check."""
    level: list[Any] = [values]
    count = depth = 0
    while level:
        count += len(level)
        depth += 1
        if count > _MOST_VALUES:
            what = f"{_MOST_VALUES} values"
        elif depth > _DEEPEST:
            what = f"{_DEEPEST} lists in each other"
        else:
            level = [inner for each in level for inner in _inner(each)]
            continue
        raise document.error(
            (), f"expected at most {what}, found more; let identify write the file again"
        )


def _inner(value: Any) -> Iterable[Any]:
    """What a list or a mapping holds."""
    if isinstance(value, dict):
        return value.values()
    return value if isinstance(value, list) else ()


def _kind(value: Any) -> str:
    return "a list" if isinstance(value, list) else "nothing" if value is None else "a single value"


def _nominal(document: YamlDocument, form: _NominalForm | None) -> Inertia | None:
    if form is None:
        return None
    try:
        return Inertia(form.mass, np.array(form.center_of_gravity), np.array(form.inertia))
    except ValueError as error:
        raise document.error(("nominal",), f"{error}; correct it") from None


def _estimate(document: YamlDocument, key: tuple[str, ...], entry: _EntryForm) -> Estimate:
    """An estimate of the file, refused where its numbers are no estimate.

    Args:
        document: The file.
        key: Where it stands, under the name of its method.
        entry: What stands there.
    """
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
    problem = covariance_problem(covariance[block], [BODY_PARAMETERS[j] for j in known])
    if problem is not None:
        raise document.error(
            (*key, "covariance", "matrix") if entry.covariance else key, f"{problem}; correct it"
        )
    covariance[block] = (covariance[block] + covariance[block].T) / 2
    unknown = np.isnan(value) | np.isnan(np.diag(covariance))
    covariance[unknown, :] = np.nan
    covariance[:, unknown] = np.nan
    for array in (value, covariance):
        array.setflags(write=False)
    return Estimate(
        method=key[1],
        value=value,
        covariance=covariance,
        verdict=Verdict(
            accepted=entry.verdict.accepted,
            reasons=tuple(printable(reason) for reason in entry.verdict.reasons),
            parameters=entry.verdict.parameters,
            disagreement=printable(entry.verdict.disagreement),
        ),
        notes=tuple(printable(note) for note in entry.notes),
        per_mass=_per_mass(document, key, entry),
        geometry=_geometry(document, key, entry.geometry),
    )


def _per_mass(document: YamlDocument, key: tuple[str, ...], entry: _EntryForm) -> PerMass | None:
    """Centre of gravity and inertia over mass, where they are there."""
    if entry.inertia_per_mass is None or entry.covariance_per_mass is None:
        return None
    given = entry.covariance_per_mass
    matrix = np.array(given.matrix, dtype=np.float64)
    count = len(PER_MASS_PARAMETERS)
    if given.parameters != PER_MASS_PARAMETERS or matrix.shape != (count, count):
        raise document.error(
            (*key, "covariance_per_mass"),
            f"expected a matrix over {', '.join(PER_MASS_PARAMETERS)}, found one of shape"
            f" {matrix.shape}; let identify write the file again",
        )
    inertia = np.array(entry.inertia_per_mass, dtype=np.float64)
    value = np.concatenate([np.array(entry.center_of_gravity, dtype=np.float64), six(inertia)])
    known = np.flatnonzero(np.isfinite(value) & np.isfinite(np.diag(matrix)))
    block = np.ix_(known, known)
    problem = covariance_problem(matrix[block], [PER_MASS_PARAMETERS[i] for i in known])
    if problem is not None:
        raise document.error((*key, "covariance_per_mass", "matrix"), f"{problem}; correct it")
    return PerMass(value, (matrix + matrix.T) / 2)


def _geometry(
    document: YamlDocument, key: tuple[str, ...], form: _GeometryForm | None
) -> FoundGeometry | None:
    """Anchors and attachments as they were found, where they are there."""
    if form is None:
        return None
    counts = [len(each) for of in (form, form.nominal) for each in (of.anchors, of.attachments)]
    if len(set(counts)) > 1:
        raise document.error(
            (*key, "geometry"),
            "expected as many anchors as attachments, found"
            f" {', '.join(str(each) for each in counts)}; let identify write the file again",
        )
    points, nominal = (
        np.array([of.anchors, of.attachments], dtype=np.float64) for of in (form, form.nominal)
    )
    matrix = np.array(form.covariance.matrix, dtype=np.float64)
    found = FoundGeometry(nominal, points, matrix)
    if form.covariance.parameters != found.names() or matrix.shape != (len(found.names()),) * 2:
        raise document.error(
            (*key, "geometry", "covariance"),
            f"expected a matrix over {', '.join(found.names()[:10])}, …, found one of shape"
            f" {matrix.shape}; let identify write the file again",
        )
    problem = covariance_problem(matrix, list(found.names()))
    if problem is not None:
        raise document.error((*key, "geometry", "covariance", "matrix"), f"{problem}; correct it")
    return found


def _ten(document: YamlDocument, key: tuple[str, ...], body: _BodyForm) -> Array:
    """The ten of :data:`BODY_PARAMETERS`, NaN for null."""
    inertia = np.array(body.inertia, dtype=np.float64)
    largest = np.max(np.abs(inertia), initial=0.0, where=np.isfinite(inertia))
    if not np.allclose(inertia, inertia.T, rtol=0, atol=ROUNDED * largest, equal_nan=True):
        raise document.error(
            (*key, "inertia"), f"expected a symmetric matrix, found {_rows(inertia)}; correct it"
        )
    return np.array([body.mass, *body.center_of_gravity, *six(inertia)], dtype=np.float64)


def _matrix(document: YamlDocument, key: tuple[str, ...], form: _CovarianceForm) -> Array:
    """The numbers of a covariance, NaN for null."""
    if form.parameters != BODY_PARAMETERS:
        raise document.error(
            (*key, "covariance", "parameters"),
            f"expected {', '.join(BODY_PARAMETERS)}, found"
            f" {shortened(', '.join(form.parameters)) or 'none'}; put them in this order",
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


def _rows(matrix: Array) -> str:
    return str([[None if np.isnan(v) else float(f"{v:.4g}") for v in row] for row in matrix])
