"""YAML and JSON: the body as a robot file has it, with its covariance, its verdict and its linear
parameters.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from steelyard.arrays import Array
from steelyard.estimates.estimate import plain
from steelyard.exports.exported import Exported
from steelyard.exports.remarks import number, remarks
from steelyard.inertia import BODY_PARAMETERS, LINEAR_PARAMETERS
from steelyard.output import to_json

FORMAT = "steelyard-body/1"
CONVENTION = (
    (
        "platform: as in a robot file, to be pasted there: mass [kg], centre of gravity in the"
        " platform frame P [m], inertia about the centre of gravity in the axes of P [kg m^2]."
    ),
    (
        "Products of inertia are elements of the matrix, minus the integral of x y dm, in the order"
        " yz, xz, xy."
    ),
    (
        "standard_deviation has the same shape; covariance is of the ten in the order of its"
        " 'parameters'."
    ),
    (
        "linear: the same body about the origin of P: first moment mass times centre of gravity [kg"
        " m], inertia about the origin [kg m^2]."
    ),
    "null: not identifiable from the data.",
)


def write_yaml(exported: Exported) -> str:
    """The text of a YAML file."""
    comment = "".join(f"# {line}\n" for line in remarks(exported, CONVENTION))
    return comment + "".join(f"{line}\n" for line in _block(_values(exported)))


def write_json(exported: Exported) -> str:
    """The text of a JSON file; what is a comment elsewhere stands under ``convention`` and
    ``warning``.
    """
    warning = list(exported.impossible)
    values = {
        **_values(exported),
        **({"warning": warning} if warning else {}),
        "convention": list(CONVENTION),
    }
    return to_json(values) + "\n"


def _values(exported: Exported) -> Mapping[str, Any]:
    """What both formats hold."""
    estimate = exported.estimate
    linear = exported.linear_parameters
    return {
        "format": FORMAT,
        "platform": _body(estimate.value),
        "standard_deviation": _body(estimate.standard_deviation),
        "covariance": {
            "parameters": list(BODY_PARAMETERS),
            "matrix": plain(estimate.covariance),
            "correlations": "known" if exported.correlated else "not known",
        },
        "linear": {
            "first_moment": plain(linear[1:4]),
            "inertia": _six(linear[4:]),
            "parameters": list(LINEAR_PARAMETERS),
            "values": plain(linear),
        },
        "verdict": {**estimate.verdict.to_dict(), "physical": estimate.physical},
        "method": estimate.method,
        "experiment": exported.experiment,
        "source": {
            "file": exported.source,
            "sha256": exported.digest,
            "steelyard": exported.version,
        },
    }


def _body(ten: Array) -> dict[str, Any]:
    """Ten values in the shape of the ``platform`` of a robot file."""
    return {"mass": plain(ten[0]), "center_of_gravity": plain(ten[1:4]), "inertia": _six(ten[4:])}


def _six(values: Array) -> dict[str, Any]:
    return {name[1:]: value for name, value in zip(BODY_PARAMETERS[4:], plain(values), strict=True)}


def _block(values: Mapping[str, Any], indent: str = "") -> Iterator[str]:
    """Lines of YAML 1.2: what holds maps or lists in a block, what holds numbers and text in one
    line.
    """
    for key, value in values.items():
        if isinstance(value, Mapping) and (not indent or _deep(value.values())):
            yield f"{indent}{key}:"
            yield from _block(value, indent + "  ")
        elif isinstance(value, list) and _deep(value):
            yield f"{indent}{key}:"
            yield from (f"{indent}- {_flow(row)}" for row in value)
        else:
            yield f"{indent}{key}: {_flow(value)}"


def _deep(values: Iterable[Any]) -> bool:
    return any(isinstance(value, Mapping | list) for value in values)


def _flow(value: Any) -> str:
    """A value in one line. Text always stands in quotes: what a file may hold would else mean
    something here and there.
    """
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {_flow(each)}" for key, each in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_flow, value)) + "]"
    return number(value) if isinstance(value, float) else json.dumps(value, ensure_ascii=False)
