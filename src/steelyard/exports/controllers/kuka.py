"""Load data of KUKA controllers, KRL."""

from __future__ import annotations

from steelyard.exports.controllers.principal import MILLIMETRES, principal
from steelyard.exports.exported import Exported
from steelyard.exports.remarks import number, one_line, remarks

TITLE = "KUKA load data"
CONVENTION = (
    (
        "LOAD: M mass [kg]; CM X, Y, Z centre of gravity [mm] in the platform frame P, which stands"
        " for the flange; J X, Y, Z principal moments about the centre of gravity [kg m^2]."
    ),
    (
        "CM A, B, C turn P into the principal axes [deg]: R = Rz(A) Ry(B) Rx(C), columns are the"
        " axes in P."
    ),
    (
        "To be pasted into $config.dat or a submit file; the controller keeps single precision."
        " Where P is not the flange, transform it first."
    ),
)


def write(exported: Exported) -> str:
    """The text of the file: one line of KRL below its comments."""
    body = exported.body
    found = principal(body)
    x, y, z = (number(v * MILLIMETRES) for v in body.center_of_gravity)
    a, b, c = (number(v) for v in found.rotation.as_euler("ZYX", degrees=True))
    jx, jy, jz = (number(v) for v in found.moments)
    comment = "".join(
        f"; {one_line(line)}".rstrip() + "\n" for line in remarks(exported, CONVENTION)
    )
    return (
        f"{comment}LOAD_DATA[1]={{M {number(body.mass)},CM {{X {x},Y {y},Z {z},A {a},B {b},C {c}}},"
        f"J {{X {jx},Y {jy},Z {jz}}}}}\n"
    )
