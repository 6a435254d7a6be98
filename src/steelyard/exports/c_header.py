"""A header for C and C++."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from steelyard.arrays import Array
from steelyard.exports.exported import Exported
from steelyard.exports.remarks import number, remarks
from steelyard.inertia import BODY_PARAMETERS, LINEAR_PARAMETERS

TITLE = "a C header"
CONVENTION = (
    (
        "PLATFORM_MASS [kg], platform_center_of_gravity in the platform frame P [m],"
        " platform_inertia: matrix about the centre of gravity in the axes of P [kg m^2]; products"
        " are its elements, minus the integral of x y dm."
    ),
    (
        "platform_body_parameters, platform_standard_deviation and platform_covariance are in the"
        f" order {', '.join(BODY_PARAMETERS)}."
    ),
    (
        "platform_linear_parameters are those in which the dynamics is linear, about the origin of"
        f" P: {', '.join(LINEAR_PARAMETERS)}, with h the mass times the centre of gravity [kg m]"
        " and J about the origin [kg m^2]; the columns of a regressor are in this order."
    ),
    "SI units. C89 and C++.",
)


def write(exported: Exported) -> str:
    """The text of the file."""
    body, estimate = exported.body, exported.estimate
    comment = "".join(
        f" * {_inside_comment(line)}".rstrip() + "\n" for line in remarks(exported, CONVENTION)
    )
    parts = [
        "#ifndef STEELYARD_PLATFORM_H\n#define STEELYARD_PLATFORM_H\n",
        (
            f"#define PLATFORM_ACCEPTED {int(bool(estimate.verdict.accepted))} /* whether the"
            " verdict on the estimate was that it can be relied on */"
        ),
        f"#define PLATFORM_PHYSICAL {int(body.is_physical)} /* whether such a body can exist */\n",
        f"#define PLATFORM_MASS ({number(body.mass)}) /* [kg] */\n",
        _array("platform_center_of_gravity", body.center_of_gravity),
        _array("platform_inertia", body.inertia),
        _array("platform_body_parameters", body.body_parameters, BODY_PARAMETERS),
        _array("platform_standard_deviation", estimate.standard_deviation, BODY_PARAMETERS),
        _array("platform_covariance", estimate.covariance),
        _array("platform_linear_parameters", exported.linear_parameters, LINEAR_PARAMETERS),
        "#endif",
    ]
    return f"/*\n{comment} */\n" + "\n".join(parts) + "\n"


def _array(name: str, values: Array, each: Sequence[str] = ()) -> str:
    """The definition of an array of one or two dimensions, with a comment behind each number."""
    size = "".join(f"[{n}]" for n in values.shape)
    if values.ndim == 1:
        rows = [number(value) for value in values]
    else:
        rows = ["{" + ", ".join(number(value) for value in row) + "}" for row in np.asarray(values)]
    last = len(rows) - 1
    lines = [
        f"    {row}{',' if i < last else ''}{f' /* {each[i]} */' if each else ''}"
        for i, row in enumerate(rows)
    ]
    return f"static const double {name}{size} = {{\n" + "\n".join(lines) + "\n};\n"


def _inside_comment(line: str) -> str:
    """Letters that every compiler takes, and nothing that begins, ends or continues a comment."""
    line = "".join(c if c.isascii() and c != "\\" else "_" for c in line)
    for mark in ("*/", "/*", "??"):
        while mark in line:
            line = line.replace(mark, f"{mark[0]} {mark[1]}")
    return line
