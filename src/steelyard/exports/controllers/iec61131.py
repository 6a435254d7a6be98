"""Structured text of IEC 61131-3: constants, and a function block of the wrench that moves the
body.
"""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca

from steelyard.dynamics import newton_euler
from steelyard.exports.exported import Exported
from steelyard.exports.remarks import number, one_line, remarks
from steelyard.inertia import LINEAR_PARAMETERS, TEN

TITLE = "structured text"
CONVENTION = (
    (
        "PLATFORM.Mass [kg], CenterOfGravity in the platform frame P [m], Inertia: matrix about"
        " the centre of gravity in the axes of P [kg m^2], products are its elements, minus the"
        " integral of x y dm; Accepted: whether the verdict was that the estimate can be relied on."
    ),
    (
        "LinearParameters are those in which the dynamics is linear, about the origin of P:"
        f" {', '.join(LINEAR_PARAMETERS)}, with h the mass times the centre of gravity [kg m] and J"
        " about the origin [kg m^2]."
    ),
    (
        "FB_PlatformWrench: wrench that moves the body, about the origin of P, in P [N], [N m],"
        " from SpecificForce = R^T (acceleration of the origin - gravity) [m/s^2], Omega, angular"
        " velocity [rad/s], and Alpha, its derivative [rad/s^2], all in P. At rest and level"
        " SpecificForce is (0, 0, 9.81)."
    ),
    "IEC 61131-3, third edition: LREAL is double precision.",
)
_MOTION = ("SpecificForce", "Omega", "Alpha")


def write(exported: Exported) -> str:
    """The text of the file."""
    body = exported.body
    comment = "".join(
        f"   {_inside_comment(line)}".rstrip() + "\n" for line in remarks(exported, CONVENTION)
    )
    accepted = "TRUE" if exported.estimate.verdict.accepted else "FALSE"
    listed = {
        "CenterOfGravity": body.center_of_gravity,
        "Inertia": body.inertia.ravel(),
        "LinearParameters": exported.linear_parameters,
    }
    values = ",\n".join(
        f"        {name} := [{', '.join(number(v) for v in each)}]" for name, each in listed.items()
    )
    return f"""(*
{comment}*)
TYPE ST_Platform :
STRUCT
    Accepted : BOOL;
    Mass : LREAL;
    CenterOfGravity : ARRAY[1..3] OF LREAL;
    Inertia : ARRAY[1..3, 1..3] OF LREAL;
    LinearParameters : ARRAY[1..{TEN}] OF LREAL;
END_STRUCT
END_TYPE

VAR_GLOBAL CONSTANT
    PLATFORM : ST_Platform := (
        Accepted := {accepted},
        Mass := {number(body.mass)},
{values}
    );
END_VAR

FUNCTION_BLOCK FB_PlatformWrench
VAR_INPUT
    SpecificForce : ARRAY[1..3] OF LREAL;
    Omega : ARRAY[1..3] OF LREAL;
    Alpha : ARRAY[1..3] OF LREAL;
END_VAR
VAR_OUTPUT
    Force : ARRAY[1..3] OF LREAL;
    Torque : ARRAY[1..3] OF LREAL;
END_VAR
{_block()}END_FUNCTION_BLOCK
"""


def _block() -> str:
    """Variables and statements of the wrench, from the one expression of the Newton-Euler
    equations.
    """
    symbols = [ca.SX.sym("p", TEN), *(ca.SX.sym(name, 3) for name in _MOTION)]
    wrench = newton_euler(*symbols)
    function = ca.Function("wrench", symbols, [wrench[:3], wrench[3:]])
    lines = list(_statements(function))
    variables = f"VAR\n    w : ARRAY[0..{function.sz_w() - 1}] OF LREAL;\nEND_VAR\n"
    return variables + "".join(f"{line}\n" for line in lines)


def _statements(function: ca.Function) -> Iterator[str]:
    """A statement for each operation of an expression.

    Args:
        function: Of the ten and the motion, to force and torque.
    """
    inputs = ("PLATFORM.LinearParameters", *_MOTION)
    two = {ca.OP_ADD: "+", ca.OP_SUB: "-", ca.OP_MUL: "*"}
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        into, source = function.instruction_output(k), function.instruction_input(k)
        if operation == ca.OP_INPUT:
            yield f"w[{into[0]}] := {inputs[source[0]]}[{source[1] + 1}];"
        elif operation == ca.OP_OUTPUT:
            yield f"{('Force', 'Torque')[into[0]]}[{into[1] + 1}] := w[{source[0]}];"
        elif operation == ca.OP_NEG:
            yield f"w[{into[0]}] := -w[{source[0]}];"
        elif operation == ca.OP_SQ:
            yield f"w[{into[0]}] := w[{source[0]}] * w[{source[0]}];"
        else:
            yield f"w[{into[0]}] := w[{source[0]}] {two[operation]} w[{source[1]}];"


def _inside_comment(line: str) -> str:
    """Nothing that begins or ends a comment."""
    line = one_line(line)
    for mark in ("(*", "*)"):
        while mark in line:
            line = line.replace(mark, f"{mark[0]} {mark[1]}")
    return line
