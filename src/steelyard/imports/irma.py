"""IRMA Lab of the University of Bologna (github.com/IRMA-LAB: grab_common/libcdpr, cdpr_matlab):
one JSON file, SI units.

With D the swivel point and k the swivel axis of a roller, both fixed in the world, u the unit
vector from k towards the cable's point A on the platform and psi the tangent angle, the cable
leaves at ``D + r (u + u cos psi + k sin psi)`` in the direction ``u sin psi
- k cos psi``; at psi = pi, where the cable has not wrapped yet, that is D and k
  (``calcCableVectors``). D is hence the anchor and k the axis
of a robot file. Where the names are ``pos_PD_loc`` and ``pos_OA_glob``, winches and rollers are on
the platform.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Literal

from pydantic import Field

from steelyard.files.document import YamlDocument
from steelyard.files.file_model import validate
from steelyard.imports.description import Cable, DescribedBody, Description, Vector
from steelyard.imports.sources import Column, ForeignModel, Matrix, Source, only_document, unread

NAME = "IRMA JSON"

_GRAVITY = 9.80665
"""Of all their programs [m/s^2]."""
_SYMMETRIC = 1e-6
"""How far an inertia matrix may be from a symmetric one, as a part of its largest element."""
_HELD_BY_CABLES = {"THREE_R_THREE_T", "THREE_T"}

_MATRIX = "as 'inertia_mat_G_loc' is a matrix in IRMA's programs"


class IrmaPulleyForm(ForeignModel):
    """Roller and one end of a cable."""

    radius: Annotated[float, Field(ge=0)]
    swivel_point: Column | None = Field(None, alias="pos_OD_glob")
    frame_point: Column | None = Field(None, alias="pos_OA_glob")
    vers_k: Column | None = None


class WinchForm(ForeignModel):
    """The other end of a cable."""

    platform_point: Column | None = Field(None, alias="pos_PA_loc")
    platform_swivel_point: Column | None = Field(None, alias="pos_PD_loc")


class ActuatorForm(ForeignModel):
    """One cable."""

    active: bool | Literal[0, 1] = True
    pulley: IrmaPulleyForm
    winch: WinchForm


class OldCableForm(ForeignModel):
    """One cable of older files."""

    swivel_pulley_r: Annotated[float, Field(ge=0)]
    swivel_point: Column = Field(alias="pos_OD_glob")
    platform_point: Column = Field(alias="pos_PA_loc")
    vers_k: Column | None = None


class IrmaPlatformForm(ForeignModel):
    """Body and load."""

    mass: Annotated[float, Field(gt=0)]
    inertia: Matrix = Field(alias="inertia_mat_G_loc")
    center_of_gravity: Column = Field(alias="pos_PG_loc")
    gravity_axis: Column | None = None
    grav_ax: Column | None = None
    ext_force_loc: Column = (0.0, 0.0, 0.0)
    ext_torque_loc: Column = (0.0, 0.0, 0.0)


class IrmaRobotForm(ForeignModel):
    """The whole file."""

    motion_pattern: str = "THREE_R_THREE_T"
    actuator: tuple[ActuatorForm, ...] = ()
    cable: tuple[OldCableForm, ...] = ()
    platform: IrmaPlatformForm


def recognises(source: Source) -> bool:
    """Whether a file has the points of IRMA's robots."""
    if not isinstance(source, YamlDocument) or not isinstance(source.data, dict):
        return False
    entries = source.data.get("actuator", source.data.get("cable"))
    return isinstance(entries, list) and any(_has_points(entry) for entry in entries)


def _has_points(entry: Any) -> bool:
    inner = entry.get("pulley", entry) if isinstance(entry, dict) else None
    return isinstance(inner, dict) and ("pos_OD_glob" in inner or "pos_OA_glob" in inner)


def describe(sources: Sequence[Source], cable_set: str | None) -> Description:
    """The robot of a file.

    Args:
        sources: One file.
        cable_set: None: there are no sets.

    Raises:
        InputError: The file is wrong, or there are several.
    """
    document = only_document(sources, NAME)
    form = validate(IrmaRobotForm, document)
    if form.motion_pattern not in _HELD_BY_CABLES:
        raise document.error(
            ("motion_pattern",),
            f"expected a platform that cables alone hold ({', '.join(sorted(_HELD_BY_CABLES))}),"
            f" found '{form.motion_pattern[:60]}'; a robot file knows no guides",
        )
    gravity, gravity_note = _gravity(form.platform, document)
    return Description(
        format=NAME,
        files=(document.path,),
        cables=(*_cables(form, document), *_old_cables(form, document)),
        body=_body(form.platform, document),
        gravity=gravity,
        notes=(
            gravity_note,
            *_left_out(form),
            *unread(form),
        ),
    )


def _cables(form: IrmaRobotForm, document: YamlDocument) -> list[Cable]:
    """Cables of the active actuators, with rollers at the winch or on the platform."""
    cables = []
    for i, each in enumerate(form.actuator):
        if not each.active:
            continue
        pulley, winch = each.pulley, each.winch
        fixed = (pulley.swivel_point, winch.platform_point)
        moving = (pulley.frame_point, winch.platform_swivel_point)
        where = document.where(("actuator", i))
        if None not in fixed:
            key = ("actuator", i, "pulley", "vers_k")
            axis = _axis(pulley.radius, pulley.vers_k, document, key)
            cables.append(Cable(where, *fixed, pulley.radius, axis))  # type: ignore[arg-type]
        elif None not in moving:
            cables.append(Cable(where, *moving))  # type: ignore[arg-type]
        else:
            raise document.error(
                ("actuator", i),
                "expected pulley.pos_OD_glob and winch.pos_PA_loc, or pulley.pos_OA_glob and"
                " winch.pos_PD_loc, found only one of them; add the other",
            )
    return cables


def _old_cables(form: IrmaRobotForm, document: YamlDocument) -> list[Cable]:
    """Cables of the older form of the file."""
    cables = []
    for i, each in enumerate(form.cable):
        radius, where = each.swivel_pulley_r, document.where(("cable", i))
        axis = _axis(radius, each.vers_k, document, ("cable", i, "vers_k"))
        cables.append(Cable(where, each.swivel_point, each.platform_point, radius, axis))
    return cables


def _axis(
    radius: float, axis: Vector | None, document: YamlDocument, key: tuple[str | int, ...]
) -> Vector:
    """Swivel axis; without a roller any will do."""
    if not radius:
        return 0.0, 0.0, 1.0
    if axis is None:
        raise document.error(
            key, "expected the swivel axis of the roller, found it missing; add 'vers_k'"
        )
    if math.hypot(*axis) < 1e-9:
        raise document.error(key, "expected a direction, found a vector of length 0; correct it")
    return axis


def _body(platform: IrmaPlatformForm, document: YamlDocument) -> DescribedBody:
    """Mass, centre of gravity and inertia, whose matrix has to be symmetric."""
    J = platform.inertia
    largest = max(abs(value) for row in J for value in row)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        if abs(J[i][j] - J[j][i]) > _SYMMETRIC * largest:
            raise document.error(
                ("platform", "inertia_mat_G_loc"),
                f"expected a symmetric matrix, found {J[i][j]:g} and {J[j][i]:g} in two places that"
                " belong together; correct one",
            )
    return DescribedBody(
        where=document.where(("platform",)),
        mass=platform.mass,
        center_of_gravity=platform.center_of_gravity,
        moments=(J[0][0], J[1][1], J[2][2]),
        products=(J[1][2], J[0][2], J[0][1]),
        convention="matrix",
        reason=_MATRIX,
    )


def _gravity(platform: IrmaPlatformForm, document: YamlDocument) -> tuple[Vector, str]:
    """Gravity [m/s^2]: along minus the axis of the file."""
    axis = platform.gravity_axis or platform.grav_ax
    if axis is None:
        note = f"gravity {_GRAVITY} m/s^2 along -z: the file has no 'gravity_axis'"
        return (0.0, 0.0, -_GRAVITY), note
    length = math.hypot(*axis)
    if length < 1e-9:
        key = "gravity_axis" if platform.gravity_axis else "grav_ax"
        raise document.error(
            ("platform", key), "expected a direction, found a vector of length 0; correct it"
        )
    x, y, z = (0.0 - _GRAVITY * v / length for v in axis)
    return (x, y, z), f"gravity {_GRAVITY} m/s^2, IRMA's constant, against the axis of the file"


def _left_out(form: IrmaRobotForm) -> Iterator[str]:
    """Notes of what a robot file cannot have: platforms that do not turn, idle actuators, rollers
    of winches on the platform, constant loads.
    """
    if form.motion_pattern != "THREE_R_THREE_T":
        yield (
            f"IRMA's programs keep the platform from turning ({form.motion_pattern}), a robot file"
            " does not"
        )
    idle = [str(i) for i, each in enumerate(form.actuator) if not each.active]
    if idle:
        yield f"actuators {', '.join(idle)} (counted from 0) are not active and left out"
    active = [each.pulley for each in form.actuator if each.active]
    moving = [pulley.radius for pulley in active if pulley.swivel_point is None]
    if moving:
        rollers = ""
        if max(moving) > 0:
            rollers = (
                f"; their rollers of radius up to {max(moving):g} m are left out: a robot file has"
                " rollers at the anchors only, so that lengths and directions are off by as much"
            )
        yield f"winches are on the platform: the attachments are 'pos_PD_loc'{rollers}"
    loads = []
    for key in ("ext_force_loc", "ext_torque_loc"):
        load = getattr(form.platform, key)
        if any(load):
            loads.append(f"{key} ({', '.join(f'{v:g}' for v in load)})")
    if loads:
        yield f"constant load on the platform left out: {', '.join(loads)}"
