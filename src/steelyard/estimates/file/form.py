"""The form of `estimate.json`: which of its keys are read, and how much of them there may be."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal

from pydantic import ConfigDict, Field

from steelyard.estimates.estimate import FORMAT, Label
from steelyard.estimates.named_estimate import LONGEST_NAME
from steelyard.files.document import YamlDocument
from steelyard.files.file_model import FileModel, validate
from steelyard.files.json_file import read_json
from steelyard.files.regular_file import require_file
from steelyard.inertia import BODY_PARAMETERS

_MOST_VALUES = 100_000
"""Beside what is passed over; an estimate has some two hundred."""
_DEEPEST = 16
"""Lists in each other; a covariance has five."""

Number = float | None
Triple = tuple[Number, Number, Number]
_Known = tuple[float, float, float]


class LenientForm(FileModel):
    """The contract lets a file hold more than is read here."""

    model_config = ConfigDict(extra="ignore")


class BodyForm(LenientForm):
    """Mass, centre of gravity and inertia; null where nothing is told."""

    mass: Number
    center_of_gravity: Triple
    inertia: tuple[Triple, Triple, Triple]


class NominalForm(LenientForm):
    """The body as it was drawn."""

    mass: float
    center_of_gravity: _Known
    inertia: tuple[_Known, _Known, _Known]


class CovarianceForm(LenientForm):
    """A matrix, and the parameters of its rows."""

    parameters: tuple[str, ...]
    matrix: tuple[tuple[Number, ...], ...]


class PointsForm(LenientForm):
    """Where the cables are fixed [m]."""

    anchors: tuple[_Known, ...]
    attachments: tuple[_Known, ...]


class GeometryForm(PointsForm):
    """Points as they were found, beside those that were drawn."""

    nominal: PointsForm
    covariance: CovarianceForm


class VerdictForm(LenientForm):
    """Whether to rely on it, and why not."""

    accepted: bool | None
    reasons: tuple[str, ...] = ()
    disagreement: str = ""
    parameters: dict[Literal[BODY_PARAMETERS], Label] = Field(default_factory=dict)  # type: ignore[valid-type]


class EntryForm(BodyForm):
    """One estimate."""

    standard_deviation: BodyForm
    covariance: CovarianceForm | None = None
    inertia_per_mass: tuple[Triple, Triple, Triple] | None = None
    covariance_per_mass: CovarianceForm | None = None
    geometry: GeometryForm | None = None
    verdict: VerdictForm
    notes: tuple[str, ...] = ()


class JointForm(LenientForm):
    """The covariance of several loads together."""

    loads: tuple[str, ...]
    matrix: tuple[tuple[Number, ...], ...]


class LoadsForm(EntryForm):
    """The estimate of a method, with those of all loads where there are several."""

    loads: dict[str, EntryForm] | None = None
    joint: JointForm | None = None


class FileForm(LenientForm):
    """The file."""

    experiment: str
    nominal: NominalForm | None = None
    result: str
    estimates: dict[str, LoadsForm]
    recordings: dict[str, str] | None = None


def read_form(path: Path) -> tuple[YamlDocument, FileForm]:
    """What a file holds as it stands there, and the document for messages.

    Args:
        path: Of the file.

    Raises:
        InputError: It is not there, too large, no JSON, or not of the form of the contract.
    """
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
    return document, validate(FileForm, document, values)


def _wanted(data: dict[str, Any]) -> dict[str, Any]:
    """The keys that are read."""
    values: dict[str, Any] = _some(data, FileForm)
    entries = values.get("estimates")
    if isinstance(entries, dict):
        values["estimates"] = {name: _some(entry, LoadsForm) for name, entry in entries.items()}
        for entry in values["estimates"].values():
            if isinstance(entry, dict) and isinstance(entry.get("loads"), dict):
                loads = entry["loads"].items()
                entry["loads"] = {name: _some(each, EntryForm) for name, each in loads}
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
