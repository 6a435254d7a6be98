"""What there is to say of a robot: its cables, its platform, and whether they go together."""

from __future__ import annotations

import numpy as np

from steelyard.digits import between, fixed
from steelyard.errors import InputError
from steelyard.exports.hanging import LEAST_CABLES, hang
from steelyard.report.blocks.document import (
    Block,
    Document,
    Grid,
    Section,
    Statement,
    Statements,
)
from steelyard.report.blocks.robot_scene import robot_scene
from steelyard.report.evidence.values import Shape
from steelyard.robot.model import Robot

_PLACES = 4
"""Digits behind the point of coordinates [m]: those of a tracker."""


def robot_document(robot: Robot) -> Document:
    """The robot, drawn where its cables hold the platform best."""
    body = robot.platform
    mass = "no nominal platform" if body is None else f"a platform of {body.mass:.6g} kg"
    lead = Statement(f"{robot.m or 'No'} cable{'' if robot.m == 1 else 's'}, {mass}.")
    said, place = _held(robot)
    blocks: list[Block] = [Statements(tuple(said))] if said else []
    if robot.m:
        shape = Shape(
            name=robot.name,
            anchors=tuple(map(tuple, robot.anchors.tolist())),
            attachments=tuple(map(tuple, robot.attachments.tolist())),
        )
        centre = None if body is None else body.center_of_gravity
        blocks += [robot_scene(shape, [], centre, place), _cables(robot, place)]
    section = Section("robot", "The robot", tuple(blocks))
    return Document(f"Robot {robot.name}", lead, (section,) if blocks else ())


def _held(robot: Robot) -> tuple[list[Statement], np.ndarray]:
    """Whether the cables hold the nominal platform, and where it is drawn [m], shape (3,)."""
    limits = robot.limits.position
    middle = robot.anchors.mean(axis=0) if robot.m else np.zeros(3)
    if limits is not None:
        middle = np.mean(np.array(limits), axis=0)
    elif robot.m:
        # Half way down from the anchors, where nothing says where the platform works.
        middle = middle - robot.up * np.ptp(robot.anchors @ robot.up) / 2
    if robot.platform is None or robot.m < LEAST_CABLES:
        return [], middle
    try:
        found = hang(robot, robot.platform)
    except InputError as error:
        return [Statement(str(error).removeprefix("robot: "), "bad")], middle
    low, high = found.tension.min(), found.tension.max()
    at = ", ".join(f"{v:.3g}" for v in found.position)
    held = f"At ({at}) m, level, its cables hold the platform with {between(low, high)} N."
    return [Statement(held, "good")], found.position


def _cables(robot: Robot, place: np.ndarray) -> Grid:
    """Where the cables are fixed, and how long they are with the platform where it is drawn."""
    chords = np.linalg.norm(robot.anchors - place - robot.attachments, axis=1)
    rows = tuple(
        (
            str(i + 1),
            ", ".join(fixed(v, _PLACES) for v in robot.anchors[i]),
            ", ".join(fixed(v, _PLACES) for v in robot.attachments[i]),
            fixed(robot.pulley_radius[i], _PLACES) if robot.pulley_radius[i] else "-",
            fixed(chords[i], _PLACES),
        )
        for i in range(robot.m)
    )
    head = ("cable", "anchor", "attachment", "roller radius", "chord")
    caption = (
        "cables: anchor in the world, attachment on the platform, straight length as drawn [m]"
    )
    return Grid(caption, head, rows, frozenset({3, 4}))
