"""WireCenter and WiPy (programs of the library WireX by Andreas Pott): one XML file ``*.wcrfx``
with the root ``models``, SI units, as ``CRobotDocument::saveXml`` of WireX writes it.

``CKinematics::doInverseKinematicsPulleyEx``: the roller of a cable swivels about the z axis of
``base`` (third column of a11 to a33) through its point; the centre lies ``radius`` from there,
square to that axis, towards the platform; the cable comes along z and leaves after the wrap angle
acos(free length / distance) + acos(z / distance), both seen from the centre: as in a robot file.

``CRobotDocument::loadXml`` reads the geometry alone. What a file says of body and cable may thus be
what the program began with, whoever the robot is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from steelyard.errors import InputError
from steelyard.imports.description import Cable, DescribedBody, Description, Vector
from steelyard.imports.sources import Source, printable
from steelyard.imports.xml_file import Element
from steelyard.rotations import is_rotation

NAME = "WireCenter"

_GRAVITY = (0.0, 0.0, -9.81)
"""Of WireX, which states none in its files [m/s^2]."""
_ORTHONORMAL = 1e-5
"""How far a matrix may be from a rotation: WireX writes six digits."""
_SYMMETRIC = 1e-5
"""How far an inertia tensor may be from a symmetric one, as a part of its largest element."""
_TURN = tuple(f"a{row}{column}" for row in "123" for column in "123")
_TENSOR = tuple(f"I{row}{column}" for row in "xyz" for column in "xyz")
_DEFAULT_RADIUS = 0.1
"""Of the rollers of a robot to which nobody has given any [m]."""
_DEFAULT_BODY = (25.0, (0.0, 1.0, 0.2), (2.0, 0.0, 0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 4.0))
"""Mass, centre of gravity and tensor of a robot to which nobody has given any."""


def recognises(source: Source) -> bool:
    """Whether a file is one of models of WireCenter."""
    return (
        isinstance(source, Element)
        and source.tag == "models"
        and any(child.tag in {"robot", "wireRobot"} for child in source.children)
    )


def describe(sources: Sequence[Source], cable_set: str | None) -> Description:
    """The robot of a file.

    Args:
        sources: One file.
        cable_set: None: there are no sets.

    Raises:
        InputError: The file is wrong, of the older form, or there are several, or its platform
            cannot move in all ways.
    """
    models = sources[0]
    assert isinstance(models, Element)
    if len(sources) > 1:
        raise InputError(
            f"{sources[1].path}: expected one file of {NAME}, found {len(sources)}; import one at"
            " a time"
        )
    if models.find("robot") is None:
        raise models.error(
            "expected 'robot' inside, found 'wireRobot', the older form; load it in WireCenter and"
            " save it again"
        )
    robot = models.child("robot")
    pattern = robot.attributes.get("motionpattern", "3R3T")
    if pattern != "3R3T":
        raise robot.error(
            f"expected the motionpattern '3R3T', found '{printable(pattern)}'; a robot file"
            " describes a platform that cables alone hold, which moves in all ways"
        )
    chains = robot.child("geometry").all("chain")
    body = _body(robot)
    return Description(
        format=NAME,
        files=(models.path,),
        name=robot.attributes.get("name", ""),
        cables=tuple(_cable(chain) for chain in chains),
        body=body if isinstance(body, DescribedBody) else None,
        gravity=_GRAVITY,
        notes=(
            f"gravity {-_GRAVITY[2]} m/s^2 along -z: WireX's constant, not in its files",
            *_roller_notes(chains),
            *([f"no platform: {body}"] if isinstance(body, str) else []),
            *_cable_notes(models),
        ),
    )


def _vector(element: Element) -> Vector:
    """The attributes x, y, z."""
    x, y, z = (element.numbers_of(key, 1)[0] for key in "xyz")
    return x, y, z


def _cable(chain: Element) -> Cable:
    """A cable from its base to its point on the platform."""
    base = chain.child("base")
    radius = base.numbers_of("radius", 1)[0] if "radius" in base.attributes else 0.0
    if radius < 0:
        raise base.error(f"expected a radius at least 0, found {radius:g}; correct it")
    return Cable(
        where=chain.where,
        anchor=_vector(base),
        attachment=_vector(chain.child("platform")),
        radius=radius,
        axis=_axis(base) if radius else (0.0, 0.0, 1.0),
    )


def _axis(base: Element) -> Vector:
    """Third column of the rotation of a base; z where none is stated, as in WireX."""
    if not any(key in base.attributes for key in _TURN):
        return 0.0, 0.0, 1.0
    R = np.reshape([base.numbers_of(key, 1)[0] for key in _TURN], (3, 3))
    if not is_rotation(R, _ORTHONORMAL):
        raise base.error("expected a rotation matrix in a11 to a33, found another; correct it")
    x, y, z = (float(v) for v in R[:, 2])
    return x, y, z


def _body(robot: Element) -> DescribedBody | str:
    """The body, or why there is none."""
    platform = robot.find("platform")
    if platform is None or not {"mass"} <= platform.attributes.keys():
        return "the file has no mass of it"
    tensor, center = platform.find("inertiatensor"), platform.find("centerofgravity")
    if tensor is None or center is None:
        return "the file has no inertia or no centre of gravity of it"
    mass = platform.numbers_of("mass", 1, infinite=True)[0]
    values = tuple(tensor.numbers_of(key, 1, infinite=True)[0] for key in _TENSOR)
    if not np.isfinite([mass, *values]).all():
        return "its inertia is infinite, which is how cdpyr says that it was not given"
    if (mass, _vector(center), values) == _DEFAULT_BODY:
        return (
            f"the file has the one that WireX begins with ({mass:g} kg, centre of gravity"
            " (0, 1, 0.2) m), whatever the robot"
        )
    if mass <= 0:
        raise platform.error(f"expected a mass above 0, found {mass:g}; correct it")
    J = np.reshape(values, (3, 3))
    if np.abs(J - J.T).max() > _SYMMETRIC * np.abs(J).max():
        raise tensor.error("expected a symmetric matrix, found another; correct it")
    return DescribedBody(
        where=platform.where,
        mass=mass,
        center_of_gravity=_vector(center),
        moments=(float(J[0, 0]), float(J[1, 1]), float(J[2, 2])),
        products=(float(J[1, 2]), float(J[0, 2]), float(J[0, 1])),
        convention=None,
        reason="files of WireCenter do not say it",
        about=None,
    )


def _roller_notes(chains: Sequence[Element]) -> Iterator[str]:
    """Notes of rollers that the file does not state, or that nobody may have stated."""
    bases = [chain.child("base") for chain in chains]
    without = [base for base in bases if "radius" not in base.attributes]
    if without:
        yield (
            f"rollers of {len(without)} cables left out: no radius is stated (WireX would take"
            f" {_DEFAULT_RADIUS} m)"
        )
    stated = [base.numbers_of("radius", 1)[0] for base in bases if base not in without]
    if stated and set(stated) == {_DEFAULT_RADIUS}:
        yield (
            f"all rollers have the {_DEFAULT_RADIUS} m that WireX begins with: check them, or take"
            " 'pulley' out where cables leave from points"
        )
    if any(stated) and not any(key in base.attributes for base in bases for key in _TURN):
        yield "rollers swivel about z, along which the cables come: no orientation is stated"


def _cable_notes(models: Element) -> Iterator[str]:
    """Note of what the file says of the cable, and why it is not taken over."""
    cables = models.all("cable")
    if not cables:
        return
    cable = cables[0].attributes
    named = ", ".join(
        f"{key} {printable(cable[key])}"
        for key in ("elasticity", "radius", "weight", "minimum_load", "breaking_load")
        if key in cable
    )
    stiffness = ""
    if {"elasticity", "radius"} <= cable.keys():
        E, r = (cables[0].numbers_of(key, 1)[0] for key in ("elasticity", "radius"))
        stiffness = f"; with these axial_stiffness is {E * math.pi * r**2:.4g} N"
    yield (
        f"cable left out ({named}): WireX writes the one of the program, which it does not read"
        f" from the file of a robot{stiffness}"
    )
