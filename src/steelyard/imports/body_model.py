"""The platform from a model of a simulator: URDF or MJCF with one body, or several that do not move
against each other.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.imports.description import DescribedBody, Description
from steelyard.imports.sources import Source
from steelyard.imports.xml_file import Element
from steelyard.inertia import Inertia, six, symmetric

NAME = "URDF or MJCF of a platform"
_MATRIX = "as these formats define them as elements of the inertia matrix"
_FREE = frozenset({"floating", "planar"})
_Pose = tuple[Array, Array]
"""Position [m], shape (3,), and rotation, shape (3, 3)."""
_HERE: _Pose = (np.zeros(3), np.eye(3))


def recognises(source: Source) -> bool:
    """Whether a file is a model of bodies."""
    if not isinstance(source, Element):
        return False
    return (source.tag == "robot" and bool(source.all("link"))) or (
        source.tag == "mujoco" and bool(source.all("worldbody"))
    )


def describe(sources: Sequence[Source], cable_set: str | None) -> Description:
    """The body of a file, without cables.

    Args:
        sources: One file.
        cable_set: None: there are no sets.

    Raises:
        InputError: There are several files, no inertia, or bodies that move against each other.
    """
    source = sources[0]
    if len(sources) > 1 or not isinstance(source, Element):
        raise InputError(
            f"{sources[-1].path}: expected one {NAME}, found {len(sources)} files; import one at a"
            " time"
        )
    parts = list(_urdf(source) if source.tag == "robot" else _mjcf(source))
    if not parts:
        raise source.error("expected a body with 'inertial', found none; add it")
    whole = Inertia.from_parameters(np.sum([part.parameters for _, part in parts], axis=0))
    J = six(whole.inertia)
    frame = "the root link" if source.tag == "robot" else "the outermost body"
    notes = [f"platform frame = frame of {frame}"]
    if len(parts) > 1:
        names = ", ".join(name for name, _ in parts)
        notes.append(f"one body of {len(parts)} that are fixed to each other: {names}")
    x, y, z = whole.center_of_gravity.tolist()
    return Description(
        format=NAME,
        files=(source.path,),
        cables=(),
        body=DescribedBody(
            source.where,
            whole.mass,
            (x, y, z),
            (float(J[0]), float(J[1]), float(J[2])),
            (float(J[3]), float(J[4]), float(J[5])),
            "matrix",
            _MATRIX,
        ),
        notes=tuple(notes),
        alone=True,
    )


def _urdf(robot: Element) -> Iterator[tuple[str, Inertia]]:
    """Name and inertia in the root's frame of every link with one."""
    links = {link.attribute("name"): link for link in robot.all("link")}
    joints = {joint.child("child").attribute("link"): joint for joint in robot.all("joint")}
    for name, link in links.items():
        inertial = link.find("inertial")
        if inertial is None:
            continue
        place, above = _HERE, name
        for _ in range(len(joints) + 1):
            joint = joints.get(above)
            if joint is None:
                break
            if joint.attributes.get("type") in _FREE and not _carries(robot, links, joint):
                # What the platform floats in.
                break
            if joint.attributes.get("type") != "fixed":
                raise joint.error(
                    "expected joints of type 'fixed' within a platform, found"
                    f" '{joint.attributes.get('type', 'none')}'; import the platform alone"
                )
            place = _within(_origin(joint), place)
            above = joint.child("parent").attribute("link")
        J = inertial.child("inertia")
        names = ("ixx", "iyy", "izz", "iyz", "ixz", "ixy")
        numbers = [J.numbers_of(key, 1)[0] for key in names]
        mass = inertial.child("mass").numbers_of("value", 1)[0]
        yield name, _moved(inertial, mass, symmetric(numbers), _within(place, _origin(inertial)))


def _carries(robot: Element, links: dict[str, Element], joint: Element) -> bool:
    """Whether the parent of a joint has a mass."""
    parent = links.get(joint.child("parent").attribute("link"))
    return parent is not None and parent.find("inertial") is not None


def _origin(element: Element) -> _Pose:
    """Pose of an element, as its ``origin`` says."""
    origin = element.find("origin")
    if origin is None:
        return _HERE
    xyz = origin.numbers_of("xyz", 3) if "xyz" in origin.attributes else (0.0, 0.0, 0.0)
    rpy = origin.numbers_of("rpy", 3) if "rpy" in origin.attributes else (0.0, 0.0, 0.0)
    return np.array(xyz), np.asarray(Rotation.from_euler("ZYX", rpy[::-1]).as_matrix())


def _mjcf(model: Element) -> Iterator[tuple[str, Inertia]]:
    """Name and inertia in the frame of the outermost body of every body with one."""
    world = model.child("worldbody")
    outer = world.all("body")
    if len(outer) != 1:
        raise world.error(
            f"expected one body in the world, the platform, found {len(outer)}; import the platform"
            " alone"
        )
    yield from _bodies(outer[0], _HERE)


def _bodies(body: Element, place: _Pose) -> Iterator[tuple[str, Inertia]]:
    """A body and those within it."""
    inertial = body.find("inertial")
    name = body.attributes.get("name", "without a name")
    if inertial is not None:
        mass = inertial.numbers_of("mass", 1)[0]
        if "fullinertia" in inertial.attributes:
            xx, yy, zz, xy, xz, yz = inertial.numbers_of("fullinertia", 6)
            J = symmetric([xx, yy, zz, yz, xz, xy])
        else:
            J = np.diag(inertial.numbers_of("diaginertia", 3))
        yield name, _moved(inertial, mass, J, _within(place, _pose(inertial)))
    elif body.all("geom"):
        raise body.error(
            "expected 'inertial' in a body with shapes, found none: what MuJoCo takes from shapes"
            " is not in the file; write it there ('inertiafromgeom', save the compiled model)"
        )
    for inner in body.all("body"):
        if any(inner.all(tag) for tag in ("joint", "freejoint")):
            raise inner.error(
                "expected bodies without joints within a platform, found one with a joint; import"
                " the platform alone"
            )
        yield from _bodies(inner, _within(place, _pose(inner)))


def _pose(element: Element) -> _Pose:
    """Pose of an element of MJCF."""
    for key in ("axisangle", "xyaxes", "zaxis", "euler"):
        if key in element.attributes:
            raise element.error(
                f"expected 'quat' for an orientation, found '{key}'; turn it into one"
            )
    pos = element.numbers_of("pos", 3) if "pos" in element.attributes else (0.0, 0.0, 0.0)
    if "quat" not in element.attributes:
        return np.array(pos), np.eye(3)
    quat = np.array(element.numbers_of("quat", 4))
    if not quat.any():
        raise element.error("expected a quaternion, found 0 0 0 0; correct it")
    return np.array(pos), np.asarray(Rotation.from_quat(quat, scalar_first=True).as_matrix())


def _within(outer: _Pose, inner: _Pose) -> _Pose:
    """Pose of what stands in a frame that has a pose itself."""
    return outer[0] + outer[1] @ inner[0], outer[1] @ inner[1]


def _moved(element: Element, mass: float, J: Array, place: _Pose) -> Inertia:
    """Inertia of a part whose own frame stands in its centre of gravity."""
    if not mass > 0:
        raise element.error(f"expected a mass above 0 [kg], found {mass:g}; correct it")
    position, rotation = place
    return Inertia(mass, position, rotation @ J @ rotation.T)
