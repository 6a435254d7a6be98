"""Recordings that may be added to an experiment: a weighed body on the platform or in place of what
it carries, or poses at rest.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from steelyard.arrays import Array
from steelyard.excitation.information.noise_free_recording import tensions_near_level
from steelyard.excitation.limits.motion_constraints import Margin, MotionConstraints
from steelyard.excitation.limits.rest_poses import default_start_pose, rest_constraint
from steelyard.excitation.limits.verification import times_of
from steelyard.excitation.poses.candidate_poses import regular_grid
from steelyard.excitation.settings import DEFAULT, DesignSettings
from steelyard.experiment.model import Load
from steelyard.inertia import Inertia
from steelyard.motion.trajectory import Trajectory
from steelyard.robot.model import Robot
from steelyard.simulation.response import ExactMotion

Kind = Literal["added", "in place", "poses"]
"""A weighed body on what the platform carries; one in place of it; the same body in further
poses."""


@dataclass(frozen=True, eq=False)
class Addition:
    """One recording more."""

    kind: Kind
    load: Load | None
    """What the platform carries then; None: what it has carried."""
    poses: Array | None
    """At rest: x, y, z [m], roll, pitch, yaw [rad], shape (n, 6); None: it moves as before."""
    mass: float | None = None
    """Of the weighed body [kg]."""
    position: Array | None = None
    """Of its centre of gravity in the platform frame [m], shape (3,)."""
    place: str = ""
    """The same in words."""
    run: str = "reference"
    """Name of the recording, and of its load where it has one of its own."""

    def __str__(self) -> str:
        how = "in the same motion" if self.poses is None else f"in {len(self.poses)} poses at rest"
        if self.kind == "poses":
            count = len(self.poses if self.poses is not None else ())
            return f"no reference, {count} more poses at rest"
        what = f"{self.mass:.3g} kg {self.place}"
        return f"{what} {how}" if self.kind == "added" else f"{what}, {how}"


def additions(
    robot: Robot,
    body: Inertia,
    poses: Array,
    *,
    sigma: float,
    motion: Trajectory | None,
    level: float,
    name: str,
    settings: DesignSettings = DEFAULT,
) -> Iterator[Addition]:
    """All that are compared.

    Args:
        robot: With its limits.
        body: That it carries.
        poses: At rest, shape (n, 6).
        sigma: 1-sigma to which a reference is weighed [kg].
        motion: In which it may be carried; None: there is none.
        level: Tension near which the cables are held [N].
        name: Of the recording and its load.
        settings: Of the references.
    """
    yield Addition("poses", None, poses, run=name)
    for share in settings.reference_shares:
        mass = share * body.mass
        for place, position in places_on(robot).items():
            load = _with_added(name, body, mass, position, sigma, settings)
            held = _held(robot, load, poses, level)
            if len(held):
                yield Addition("added", load, held, mass, position, place, name)
        if motion is not None:
            place, position = next(iter(places_on(robot).items()))
            load = _with_added(name, body, mass, position, sigma, settings)
            if _can_move(robot, load, motion, level, settings):
                yield Addition("added", load, None, mass, position, place, name)
    for share in settings.replacing_shares:
        mass = share * body.mass
        nominal = Inertia.from_parameters(share * body.parameters)
        load = Load(name, known={"mass": (mass, sigma)}, nominal=nominal)
        held = _held(robot, load, poses, level)
        if len(held):
            place = "weighed as a whole, in place of what it carries"
            yield Addition(
                "in place", load, held, mass, np.array(body.center_of_gravity), place, name
            )


def rest_poses(
    constraints: MotionConstraints, count: int, settings: DesignSettings = DEFAULT
) -> Array:
    """The pose where a motion would begin, then corners of the workspace, turned about one axis
    after the other, as far as the cables can hold the platform there; shape (n, 6), n at most
    ``count``.

    Args:
        constraints: Of a robot with limits on its pose.
        count: Poses wanted.
        settings: Of the poses.
    """
    home = default_start_pose(constraints, settings)[None]
    return np.concatenate([home, regular_grid(constraints, count - 1, settings)])


def places_on(robot: Robot) -> Mapping[str, Array]:
    """Where a body may be fastened to the platform, in words, and the place in its frame [m], shape
    (3,): within the hull of the attachments.
    """
    if not robot.m:
        return {"at the origin of the platform": np.zeros(3)}
    points = robot.attachments
    low, high = points.min(axis=0), points.max(axis=0)
    near = 0.1 * float(np.max(high - low))
    found = {
        "at the middle of the attachments": points.mean(axis=0),
        "at the lowest attachments": points[points[:, 2] <= low[2] + near].mean(axis=0),
        "out along +x": points[points[:, 0] >= high[0] - near].mean(axis=0),
        "out along +y": points[points[:, 1] >= high[1] - near].mean(axis=0),
    }
    kept: dict[str, Array] = {}
    for place, position in found.items():
        # Attachments in a plane have no lower ones than their middle.
        if all(np.linalg.norm(position - each) > near / 2 for each in kept.values()):
            kept[place] = position
    return kept


def _with_added(
    name: str,
    body: Inertia,
    mass: float,
    position: Array,
    sigma: float,
    settings: DesignSettings,
) -> Load:
    """What is carried with a compact body of known mass and place on it."""
    radius = (3 * mass / (4 * np.pi * settings.reference_density)) ** (1 / 3)
    ball = Inertia(mass, position, 0.4 * mass * radius**2 * np.eye(3))
    places = zip(("cx", "cy", "cz"), position, strict=True)
    known = {name: (float(value), settings.reference_place) for name, value in places}
    nominal = Inertia.from_parameters(body.parameters + ball.parameters)
    return Load(name, nominal=nominal, added={"mass": (mass, sigma), **known})


def _held(robot: Robot, load: Load, poses: Array, level: float) -> Array:
    """Those of the poses in which the cables can hold a load, shape (n, 6)."""
    heavier = replace(robot, platform=load.nominal)
    exact = MotionConstraints(heavier, {}, Margin(0.0, robot.size), level, 1.0)
    return np.asarray(poses[rest_constraint(exact, poses) <= 1])


def _can_move(
    robot: Robot, load: Load, motion: Trajectory, level: float, settings: DesignSettings
) -> bool:
    """Whether no cable needs more than it may pull."""
    if not robot.m:
        return True
    assert load.nominal is not None
    times = times_of(motion, settings.body_checks_per_second)
    state = ExactMotion(robot, load.nominal, motion).at(times)
    needed = tensions_near_level(robot, state, level, settings)
    return bool(needed.max() <= robot.tension_limits[1])
