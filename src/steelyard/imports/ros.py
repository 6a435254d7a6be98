"""ROS packages that simulate cable robots in Gazebo (github.com/oKermorgant/cdpr and its
descendants): one YAML file, SI units.

``gen_cdpr.py`` makes the simulated robot of it: points of the frame in the world, points of the
platform in the frame of its link, whose inertia has no pose of its own, so that the centre of
gravity is the origin. The controllers read the six numbers of ``platform.inertia`` as xx, yy, zz,
xy, xz, yz of the inertia matrix, ``joints.actuated.min`` and ``effort`` as limits of the tension.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Any

from pydantic import Field

from steelyard.files.document import YamlDocument
from steelyard.files.file_model import validate
from steelyard.imports.description import Cable, Convention, DescribedBody, Description, Vector
from steelyard.imports.sources import ForeignModel, Source, only_document, unread

NAME = "ROS-style YAML"

_INNER = "model"
"""Key under which some packages have the robot."""

_LIST = "as the controllers of these packages put xx, yy, zz, xy, xz, yz into the inertia matrix"
_MAP = "the simulator of these packages reads none of them from 'platform.inertial'"


class PointForm(ForeignModel):
    """One cable."""

    frame: Vector
    platform: Vector


class InertialForm(ForeignModel):
    """Inertia by names."""

    xx: float
    yy: float
    zz: float
    yz: float = 0.0
    xz: float = 0.0
    xy: float = 0.0


class RosPlatformForm(ForeignModel):
    """Body."""

    mass: Annotated[float, Field(gt=0)] | None = None
    inertia: tuple[float, float, float, float, float, float] | None = None
    inertial: InertialForm | None = None


class ActuatedForm(ForeignModel):
    """What the winches can."""

    min: float | None = None
    effort: float | None = None
    velocity: Annotated[float, Field(gt=0)] | None = None


class JointsForm(ForeignModel):
    """Joints of the simulated robot, of which the prismatic ones are the cables."""

    actuated: ActuatedForm = ActuatedForm()


class RosCableForm(ForeignModel):
    """What the cables are made of."""

    radius: Annotated[float, Field(ge=0)] = 0.0


class RosRobotForm(ForeignModel):
    """The whole file, or what stands under 'model'."""

    points: tuple[PointForm, ...]
    platform: RosPlatformForm = RosPlatformForm()
    joints: JointsForm = JointsForm()
    cable: RosCableForm = RosCableForm()


def recognises(source: Source) -> bool:
    """Whether a file has a list of points of frame and platform."""
    return isinstance(source, YamlDocument) and _place(source.data) is not None


def _place(data: Any) -> tuple[str, ...] | None:
    """Where in a file the robot stands."""
    for key in ((), (_INNER,)):
        inner = data.get(_INNER) if key and isinstance(data, dict) else data
        points = inner.get("points") if isinstance(inner, dict) else None
        if isinstance(points, list) and any(
            isinstance(p, dict) and {"frame", "platform"} <= p.keys() for p in points
        ):
            return key
    return None


def describe(sources: Sequence[Source], cable_set: str | None) -> Description:
    """The robot of a file.

    Args:
        sources: One file.
        cable_set: None: there are no sets.

    Raises:
        InputError: The file is wrong, or there are several.
    """
    document = only_document(sources, NAME)
    place = _place(document.data) or ()
    form = validate(RosRobotForm, document, document.data[_INNER] if place else None, place)
    winch = form.joints.actuated
    body = _body(form.platform, document, place)
    return Description(
        format=NAME,
        files=(document.path,),
        cables=tuple(
            Cable(
                where=document.where((*place, "points", i)),
                anchor=point.frame,
                attachment=point.platform,
                lowest_tension=winch.min,
                highest_tension=winch.effort,
                diameter=2 * form.cable.radius or None,
            )
            for i, point in enumerate(form.points)
        ),
        body=body,
        limits={} if winch.velocity is None else {"cable_speed": winch.velocity},
        notes=(*_notes(winch, form.platform, body), *unread(form)),
    )


def _body(
    platform: RosPlatformForm, document: YamlDocument, place: tuple[str, ...]
) -> DescribedBody | None:
    """Mass and inertia of the platform; None: the file has not both."""
    named = platform.inertial
    moments: Vector
    products: Vector
    convention: Convention | None
    if platform.inertia is not None:
        xx, yy, zz, xy, xz, yz = platform.inertia
        moments, products, convention, reason = (xx, yy, zz), (yz, xz, xy), "matrix", _LIST
    elif named is not None:
        moments, products = (named.xx, named.yy, named.zz), (named.yz, named.xz, named.xy)
        convention, reason = None, _MAP
    else:
        return None
    if platform.mass is None:
        return None
    return DescribedBody(
        where=document.where((*place, "platform")),
        mass=platform.mass,
        center_of_gravity=(0.0, 0.0, 0.0),
        moments=moments,
        products=products,
        convention=convention,
        reason=reason,
    )


def _notes(
    winch: ActuatedForm, platform: RosPlatformForm, body: DescribedBody | None
) -> Iterator[str]:
    """Notes of what the winches and the platform were taken from."""
    if winch.effort is not None:
        yield "highest tension is 'effort' of the actuated joints, lowest their 'min'"
    if winch.velocity is not None:
        yield "limit of the cable speed is 'velocity' of the actuated joints"
    if body is not None:
        yield "centre of gravity at the origin of the platform frame, as the simulator puts it"
    else:
        missing = "inertia" if platform.mass is not None else "mass"
        yield f"no platform: the file has no {missing} of it"
