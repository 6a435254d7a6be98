"""From what files of another program say of a robot to a robot file, with notes of what is taken,
left out and assumed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from steelyard.errors import InputError
from steelyard.files.document import YamlDocument
from steelyard.imports.description import Cable, Convention, Description, Point
from steelyard.imports.imported import Imported
from steelyard.imports.nominal_body import nominal_body
from steelyard.imports.sources import printable
from steelyard.robot.file import platform_values, robot_file, robot_of
from steelyard.robot.model import Robot

_GRAVITY = 9.81
"""Of robot files that do not say [m/s^2]."""
_CLOSEST_ANCHORS = 1e-6
"""Distance of two anchors, as robot files demand it [m]."""
_LONGEST_NAME = 100
"""Characters of the name of a robot."""


def assemble(
    description: Description,
    *,
    products: Convention | None,
    about: Point | None,
    robot: Robot | None = None,
) -> Imported:
    """Make a robot file.

    Args:
        description: What the files say.
        products: What the products of inertia are, above what the format says.
        about: About which point the inertia is, where the format does not say.
        robot: Whose platform it is, where the files say nothing of cables.

    Raises:
        InputError: This can be no robot file, or something must be said that the files do not say.
    """
    cables = description.cables
    if description.alone:
        return _platform(description, products, about, robot)
    _check_anchors(description)
    tension, tension_notes = _tension(cables)
    properties, property_notes = _properties(cables)
    body = None
    if description.body is not None:
        body = nominal_body(description.body, products=products, about=about)
    x, y, z = description.gravity or (0.0, 0.0, -_GRAVITY)
    values: dict[str, Any] = {
        "name": printable(description.name, _LONGEST_NAME) or printable(description.files[0].stem),
        "gravity": -z if x == y == 0 and z < 0 else [x, y, z],
        "cables": [_cable(each) for each in cables],
        "cable": properties,
        "tension": tension,
        "limits": dict(description.limits),
        "platform": None if body is None else platform_values(body.inertia),
    }
    values = {key: value for key, value in values.items() if value}
    robot = robot_of(YamlDocument(description.files[0], values, {}))
    notes = [*description.notes]
    if description.gravity is None:
        notes.append(f"gravity {_GRAVITY} m/s^2 along -z is assumed: the files do not say")
    if body is not None:
        notes += body.notes
    return Imported(
        format=description.format,
        files=description.files,
        values=values,
        robot=robot,
        convention=None if body is None else body.convention,
        notes=(*notes, *tension_notes, *property_notes, *_missing(robot)),
    )


def _platform(
    description: Description,
    products: Convention | None,
    about: Point | None,
    robot: Robot | None,
) -> Imported:
    """A robot file of a body alone, or of a robot whose platform it is."""
    assert description.body is not None
    body = nominal_body(description.body, products=products, about=about)
    notes = [*description.notes, *body.notes]
    if robot is None:
        name = printable(description.files[0].stem)
        values: dict[str, Any] = {"name": name, "gravity": _GRAVITY, "cables": []}
        notes.append(
            "no cables: a body on a wrench sensor; name the robot that it belongs to with --robot"
        )
        notes.append(f"gravity {_GRAVITY} m/s^2 along -z is assumed: the files do not say")
    else:
        values = robot_file(robot)
        notes.append(
            f"cables, limits and gravity are those of robot '{printable(robot.name)}'; the frame of"
            " the body is taken as the one that its attachments stand in"
        )
    values["platform"] = platform_values(body.inertia)
    made = robot_of(YamlDocument(description.files[0], values, {}))
    return Imported(
        format=description.format,
        files=description.files,
        values=values,
        robot=made,
        convention=body.convention,
        notes=tuple(notes),
    )


def _check_anchors(description: Description) -> None:
    """Refuse a robot without cables, or with two cables from one anchor."""
    cables = description.cables
    if not cables:
        raise InputError(
            f"{description.files[0]}: expected cables, found none; check that this is the whole"
            " robot"
        )
    for i, one in enumerate(cables):
        for j, other in enumerate(cables[:i]):
            if np.linalg.norm(np.subtract(one.anchor, other.anchor)) < _CLOSEST_ANCHORS:
                raise InputError(
                    f"{one.where}: expected anchors that differ, found cable {i + 1} at the anchor"
                    f" of cable {j + 1}; move one of them a little, as it is in reality"
                )


def _cable(cable: Cable) -> dict[str, Any]:
    entry: dict[str, Any] = {"anchor": list(cable.anchor), "attachment": list(cable.attachment)}
    if cable.radius:
        entry["pulley"] = {"radius": cable.radius, "axis": list(cable.axis)}
    return entry


def _tension(cables: Sequence[Cable]) -> tuple[dict[str, float] | None, list[str]]:
    """What all cables allow [N]."""
    highest = [each.highest_tension for each in cables if each.highest_tension is not None]
    lowest = [each.lowest_tension for each in cables if each.lowest_tension is not None]
    if len(highest) < len(cables):
        return None, ["lowest tension left out: there is no highest one"] if lowest else []
    notes = []
    low, high = max([0.0, *lowest]), min(highest)
    if len(lowest) < len(cables):
        notes.append("lowest tension 0 N is assumed where the files do not say")
    if len(set(highest)) > 1 or len(set(lowest)) > 1:
        notes.append(f"tension {low:g} to {high:g} N is what all cables allow: their limits differ")
    if lowest and min(lowest) < 0:
        notes.append(f"lowest tension {min(lowest):g} N is read as 0: a cable cannot push")
    if low >= high:
        why = f"no tension is allowed in all cables (at least {low:g}, at most {high:g} N)"
        return None, [f"tension left out: {why}"]
    return {"min": low, "max": high}, notes


def _properties(cables: Sequence[Cable]) -> tuple[dict[str, float], list[str]]:
    """What all cables have alike, and what they have not."""
    properties, notes = {}, []
    for key in ("diameter", "axial_stiffness"):
        found = {getattr(each, key) for each in cables}
        known = sorted(value for value in found if value is not None)
        if len(found) > 1:
            notes.append(
                f"{key} left out: it differs between the cables ({known[0]:g} to {known[-1]:g})"
            )
        elif known:
            properties[key] = known[0]
    return properties, notes


def _missing(robot: Robot) -> Iterator[str]:
    """Note of what a robot file may have and these files do not state."""
    lacking = {
        "tension": not np.isfinite(robot.tension_limits[1]),
        "cable.axial_stiffness (cables do not stretch)": robot.cable.axial_stiffness is None,
        "cable.linear_density (cables are straight)": robot.cable.linear_density is None,
        "pulley (cables leave from points)": not robot.pulley_radius.any(),
        "limits.position": robot.limits.position is None,
        "limits.rpy_deg": robot.limits.rpy is None,
        "limits.speed and others": robot.limits.speed is None,
    }
    missing = [what for what, lacks in lacking.items() if lacks]
    if missing:
        yield f"not stated, add what you know: {', '.join(missing)}"
