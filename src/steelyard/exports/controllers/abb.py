"""Load data of ABB controllers, RAPID."""

from __future__ import annotations

from steelyard.exports.controllers.principal import MILLIMETRES, principal
from steelyard.exports.exported import Exported
from steelyard.exports.remarks import number, one_line, remarks

TITLE = "ABB loaddata"
CONVENTION = (
    (
        "loaddata: mass [kg]; cog [mm] in the platform frame P, which stands for tool0; aom: axes"
        " of moment, quaternion (w, x, y, z) that turns P into the principal axes; ix, iy, iz:"
        " principal moments about the centre of gravity [kg m^2]."
    ),
    (
        "To be pasted into a module; the controller keeps single precision. Where P is not tool0,"
        " transform it first."
    ),
)


def write(exported: Exported) -> str:
    """The text of the file: one declaration of RAPID below its comments."""
    body = exported.body
    found = principal(body)
    cog = ",".join(number(v * MILLIMETRES) for v in body.center_of_gravity)
    aom = ",".join(number(v) for v in found.rotation.as_quat(scalar_first=True, canonical=True))
    moments = ",".join(number(v) for v in found.moments)
    comment = "".join(
        f"! {one_line(line)}".rstrip() + "\n" for line in remarks(exported, CONVENTION)
    )
    return f"{comment}PERS loaddata platform:=[{number(body.mass)},[{cog}],[{aom}],{moments}];\n"
