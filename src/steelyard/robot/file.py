"""The robot file: its form, and the way from it to a :class:`Robot` and back."""

from __future__ import annotations

import math
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from steelyard.errors import InputError
from steelyard.files.document import YamlDocument, require_printable
from steelyard.files.file_model import FileModel, validate
from steelyard.files.yaml_file import read_yaml
from steelyard.inertia import BODY_PARAMETERS, Inertia, six, symmetric
from steelyard.robot.covariance import read_covariance
from steelyard.robot.model import CableProperties, Limits, Robot, too_far

Vector = tuple[float, float, float]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]

_LIBRARY = resources.files("steelyard.robot") / "library"
"""Folder of the bundled robots."""
_CLOSEST_ANCHORS = 1e-6
"""Distance of two anchors below which they are one [m]."""
MOST_CABLES = 64
"""Far above any robot: a longer list is a mistake."""


class PulleyForm(FileModel):
    """A swivelling roller at the anchor."""

    radius: NotNegative
    """[m]"""
    axis: Vector = (0.0, 0.0, 1.0)
    """Direction of travel of the cable where it enters the roller, world frame."""


class CableForm(FileModel):
    """One cable."""

    anchor: Vector
    """Where the cable leaves the frame or enters its roller, world frame [m]."""
    attachment: Vector
    """Where it is fixed to the platform, platform frame [m]."""
    pulley: PulleyForm | None = None


class CablePropertiesForm(FileModel):
    """What the cables are made of."""

    diameter: Positive | None = None
    """[m]"""
    axial_stiffness: Positive | None = None
    """EA [N]; without it the cable does not stretch."""
    linear_density: NotNegative | None = None
    """[kg/m]; without it the cable is straight."""
    damping_ratio: Annotated[float, Field(ge=0, le=1)] = 0.02
    """Of each cable as a spring with a quarter of the platform's mass; for simulation only."""


class TensionForm(FileModel):
    """Allowed tensions [N]."""

    min: NotNegative
    """[N]"""
    max: Positive
    """[N]"""


class LimitsForm(FileModel):
    """What a motion must keep to."""

    position: tuple[Vector, Vector] | None = None
    """Lowest and highest position of the platform origin, world frame [m]."""
    rpy_deg: tuple[Vector, Vector] | None = None
    """Lowest and highest roll, pitch, yaw [deg]."""
    speed: Positive | None = None
    """[m/s]"""
    acceleration: Positive | None = None
    """[m/s^2]"""
    angular_speed: Positive | None = None
    """[rad/s]"""
    angular_acceleration: Positive | None = None
    """[rad/s^2]"""
    cable_speed: Positive | None = None
    """At which winches feed a cable [m/s]."""


class MomentsForm(FileModel):
    """Inertia about the centre of gravity, elements of the matrix [kg m^2]."""

    xx: float
    yy: float
    zz: float
    yz: float = 0.0
    xz: float = 0.0
    xy: float = 0.0


class PlatformForm(FileModel):
    """Nominal body."""

    mass: Positive
    """[kg]"""
    center_of_gravity: Vector
    """Platform frame [m]."""
    inertia: MomentsForm
    """About the centre of gravity, platform axes [kg m^2]."""


class RobotForm(FileModel):
    """A cable-driven parallel robot and its platform."""

    name: str
    gravity: Positive | Vector = 9.81
    """Downwards, or a vector in the world frame where that is tilted [m/s^2]."""
    cables: tuple[CableForm, ...] = Field(max_length=MOST_CABLES)
    """In the order of the force sensors; [] is a body on a wrench sensor."""
    cable: CablePropertiesForm = CablePropertiesForm()
    """What all cables are made of."""
    tension: TensionForm | None = None
    """Allowed tensions [N]."""
    limits: LimitsForm = LimitsForm()
    platform: PlatformForm | None = None
    covariance: str | None = None
    """Table of the covariance of anchors and attachments that `calibrate` has written, relative to
    this file; in place of `uncertainty: {anchor, attachment}` of an experiment."""
    """Nominal body, to compare with and to simulate."""


def bundled_names() -> list[str]:
    """Names of the robots that come with steelyard."""
    files = [entry.name for entry in _LIBRARY.iterdir()]
    return sorted(name.removesuffix(".yaml") for name in files if name.endswith(".yaml"))


def bundled_text(name: str) -> str:
    """Robot file of a bundled robot.

    Raises:
        InputError: There is none of that name.
    """
    if name not in bundled_names():
        raise InputError(
            f"robot '{name}': expected one of {', '.join(bundled_names())}, found none of that"
            " name; choose one of these"
        )
    return (_LIBRARY / f"{name}.yaml").read_text(encoding="utf-8")


def read_robot(name_or_path: str | Path, folder: Path = Path()) -> Robot:
    """Read a bundled robot by name, or a robot file.

    Args:
        name_or_path: Bundled name, or path relative to ``folder``.
        folder: Where relative paths start.

    Raises:
        InputError: No such robot, or its file is wrong.
    """
    name_or_path = str(name_or_path)
    if name_or_path in bundled_names():
        return _bundled_robot(name_or_path)
    if not name_or_path.endswith((".yaml", ".yml")) and not (folder / name_or_path).exists():
        raise InputError(
            f"robot '{name_or_path}': expected the path of a robot file or one of"
            f" {', '.join(bundled_names())}, found neither; check the name"
        )
    return robot_of(read_yaml(folder / name_or_path))


@cache
def _bundled_robot(name: str) -> Robot:
    """A robot of the library, which does not change: one value for all who ask."""
    with resources.as_file(_LIBRARY / f"{name}.yaml") as path:
        return robot_of(read_yaml(path))


def robot_of(document: YamlDocument) -> Robot:
    """The robot that a document describes.

    Raises:
        InputError: The document does not fit the contract, or the robot makes no sense.
    """
    require_printable(document)
    form = validate(RobotForm, document)
    _check(form, document)
    gravity = form.gravity if isinstance(form.gravity, tuple) else (0.0, 0.0, -form.gravity)
    radians = None
    if form.limits.rpy_deg:
        radians = tuple(tuple(map(math.radians, row)) for row in form.limits.rpy_deg)
    pulleys = [cable.pulley or PulleyForm(radius=0.0) for cable in form.cables]
    return Robot(
        name=form.name,
        gravity=np.array(gravity),
        anchors=np.array([c.anchor for c in form.cables]),
        attachments=np.array([c.attachment for c in form.cables]),
        pulley_radius=np.array([pulley.radius for pulley in pulleys]),
        pulley_axis=np.array([pulley.axis for pulley in pulleys]).reshape(-1, 3),
        cable=CableProperties(**form.cable.model_dump()),
        tension_limits=(form.tension.min, form.tension.max) if form.tension else (0.0, math.inf),
        limits=Limits(
            position=form.limits.position,
            rpy=radians,  # type: ignore[arg-type]
            **form.limits.model_dump(exclude={"position", "rpy_deg"}),
        ),
        platform=body_of_form(form.platform),
        covariance=(
            read_covariance(document.path.parent / form.covariance, len(form.cables))
            if form.covariance
            else None
        ),
    )


def body_of_form(form: PlatformForm | None) -> Inertia | None:
    """The nominal body that a file states; None: it states none."""
    if form is None:
        return None
    J = form.inertia
    inertia = symmetric([J.xx, J.yy, J.zz, J.yz, J.xz, J.xy])
    return Inertia(form.mass, np.array(form.center_of_gravity), inertia)


def _check(form: RobotForm, document: YamlDocument) -> None:
    """What the form of the file cannot say."""
    for i, one in enumerate(form.cables):
        for j, other in enumerate(form.cables[:i]):
            if math.dist(one.anchor, other.anchor) < _CLOSEST_ANCHORS:
                raise document.error(
                    ("cables", i, "anchor"),
                    f"expected anchors that differ, found cable {i + 1} at the anchor of cable"
                    f" {j + 1}; correct one of them",
                )
        for key in ("anchor", "attachment"):
            far = too_far(getattr(one, key))
            if far:
                raise document.error(("cables", i, key), far)
        if one.pulley and math.hypot(*one.pulley.axis) < 1e-9:
            raise document.error(
                ("cables", i, "pulley", "axis"),
                "expected a direction, found a vector of length 0; correct it",
            )
    if isinstance(form.gravity, tuple) and math.hypot(*form.gravity) < 1e-9:
        raise document.error(
            ("gravity",),
            "expected a vector, found one of length 0; give gravity where the robot stands",
        )
    if form.tension and form.tension.min >= form.tension.max:
        raise document.error(
            ("tension",),
            f"expected min below max, found {form.tension.min:g} and {form.tension.max:g} N;"
            " exchange them",
        )
    for key in ("position", "rpy_deg"):
        box = getattr(form.limits, key)
        if box and any(low >= high for low, high in zip(*box, strict=True)):
            raise document.error(
                ("limits", key),
                f"expected the lowest corner first, then the highest, found {box[0]} and {box[1]};"
                " correct it",
            )


def robot_file(robot: Robot) -> dict[str, Any]:
    """A robot as the plain values of its file; :func:`robot_of` gives it back."""
    cables = []
    for i in range(robot.m):
        entry: dict[str, Any] = {
            "anchor": robot.anchors[i].tolist(),
            "attachment": robot.attachments[i].tolist(),
        }
        if robot.pulley_radius[i]:
            entry["pulley"] = {
                "radius": float(robot.pulley_radius[i]),
                "axis": robot.pulley_axis[i].tolist(),
            }
        cables.append(entry)
    g = robot.gravity
    values: dict[str, Any] = {
        "name": robot.name,
        "gravity": float(-g[2]) if g[0] == g[1] == 0 and g[2] < 0 else g.tolist(),
        "cables": cables,
    }
    if robot.m:
        values["cable"] = {k: v for k, v in vars(robot.cable).items() if v is not None}
    if np.isfinite(robot.tension_limits[1]):
        values["tension"] = {"min": robot.tension_limits[0], "max": robot.tension_limits[1]}
    limits = {k: v for k, v in vars(robot.limits).items() if v is not None}
    if "rpy" in limits:
        # Degrees with the digits that a person wrote, not those of the conversion.
        limits["rpy_deg"] = np.degrees(limits.pop("rpy")).round(9).tolist()
    if "position" in limits:
        limits["position"] = [list(row) for row in limits["position"]]
    if limits:
        values["limits"] = limits
    if robot.platform is not None:
        values["platform"] = platform_values(robot.platform)
    return values


def platform_values(body: Inertia) -> dict[str, Any]:
    """A body as the plain values of the platform of a robot file."""
    moments = zip(BODY_PARAMETERS[4:], six(body.inertia).tolist(), strict=True)
    return {
        "mass": body.mass,
        "center_of_gravity": body.center_of_gravity.tolist(),
        "inertia": {name[1:]: value + 0.0 for name, value in moments},
    }
