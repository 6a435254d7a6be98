"""MJCF, for MuJoCo: the platform alone, or on the cables of its robot."""

from __future__ import annotations

from collections.abc import Iterator
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from steelyard.exports.exported import Exported
from steelyard.exports.hanging import ASSUMED_STRAIN, LEAST_CABLES, Hanging
from steelyard.exports.remarks import number, numbers, remarks
from steelyard.exports.xml_text import xml_text
from steelyard.imports.sources import printable

TITLE = "MJCF"
CONVENTION = (
    "The frame of the body 'platform' is the platform frame P; SI units.",
    (
        "inertial: pos is the centre of gravity in P; fullinertia is xx, yy, zz, xy, xz, yz of the"
        " inertia matrix about the centre of gravity, in the axes of P; products are its elements,"
        " minus the integral of x y dm. MuJoCo keeps its principal moments and axes."
    ),
)
_WIDTH = "0.01"  # [m], of cables in pictures; a real one cannot be seen


def write(exported: Exported) -> str:
    """The text of the file: the platform, free in space."""
    root = Element("mujoco", model=exported.link)
    _platform(SubElement(root, "worldbody"), exported)
    return xml_text(root, remarks(exported, CONVENTION))


def write_robot(exported: Exported, hanging: Hanging) -> str:
    """The text of the file: the platform on its cables, at rest.

    Args:
        exported: The estimate.
        hanging: Its body on a robot.
    """
    robot = hanging.robot
    root = Element("mujoco", model=printable(robot.name) or "robot")
    step, gravity = number(hanging.time_step), numbers(robot.gravity)
    SubElement(root, "option", timestep=step, gravity=gravity, integrator="RK4")
    world, tendons, actuators = (
        SubElement(root, tag) for tag in ("worldbody", "tendon", "actuator")
    )
    for i in range(robot.m):
        SubElement(world, "site", name=f"anchor_{i + 1}", pos=numbers(robot.anchors[i]))
        if robot.pulley_radius[i]:
            SubElement(world, "site", name=f"leave_{i + 1}", pos=numbers(hanging.leave[i]))
    platform = _platform(world, exported)
    platform.set("pos", numbers(hanging.position))
    platform.set("quat", numbers(hanging.quaternion))
    low, high = robot.tension_limits
    for i in range(robot.m):
        SubElement(platform, "site", name=f"attachment_{i + 1}", pos=numbers(robot.attachments[i]))
        spatial = SubElement(
            tendons,
            "spatial",
            name=f"cable_{i + 1}",
            springlength=f"0 {number(hanging.slack[i])}",
            stiffness=number(hanging.stiffness[i]),
            damping=number(hanging.damping[i]),
            width=_WIDTH,
        )
        for end in ("leave" if robot.pulley_radius[i] else "anchor", "attachment"):
            SubElement(spatial, "site", site=f"{end}_{i + 1}")
        motor = SubElement(
            actuators, "motor", name=f"pull_{i + 1}", tendon=f"cable_{i + 1}", gear="-1"
        )
        if np.isfinite(high):
            # Nothing added must be allowed, also where a tension is at its limit but for rounding.
            least, most = min(0.0, low - hanging.tension[i]), max(0.0, high - hanging.tension[i])
            motor.set("ctrlrange", numbers((least, most)))
    sensors = SubElement(root, "sensor")
    for i in range(robot.m):
        cable = f"cable_{i + 1}"
        SubElement(sensors, "tendonpos", name=f"length_{i + 1}", tendon=cable)
        SubElement(sensors, "tendonvel", name=f"rate_{i + 1}", tendon=cable)
        SubElement(sensors, "actuatorfrc", name=f"added_{i + 1}", actuator=f"pull_{i + 1}")
    home = {"name": "home", "qpos": numbers((*hanging.position, *hanging.quaternion))}
    SubElement(SubElement(root, "keyframe"), "key", home)
    return xml_text(root, remarks(exported, (*CONVENTION, *_robot_remarks(hanging))))


def _platform(world: Element, exported: Exported) -> Element:
    """The body."""
    inertial = exported.body.to_mujoco()
    platform = SubElement(world, "body", name=exported.link)
    SubElement(platform, "freejoint", name=exported.link)
    pos, fullinertia = numbers(inertial.pos), numbers(inertial.fullinertia)
    SubElement(platform, "inertial", mass=number(inertial.mass), pos=pos, fullinertia=fullinertia)
    return platform


def _robot_remarks(hanging: Hanging) -> Iterator[str]:
    """What a user should know about the robot."""
    robot = hanging.robot
    yield (
        f"Robot '{printable(robot.name)}', {robot.m} cables: site anchor_i in the world frame,"
        " attachment_i on the platform, spatial tendon cable_i between them, its spring slack up"
        " to springlength: tension = stiffness (length - springlength), never below 0."
    )
    assumed = ""
    if not robot.cable.axial_stiffness:
        assumed = (
            ", which is assumed (the robot file has no axial_stiffness): it strains the tightest"
            f" cable by {ASSUMED_STRAIN * 1e3:g} in a thousand at home"
        )
    yield (
        "stiffness = EA / unstrained length, springlength = the part of it between the sites, EA ="
        f" {number(hanging.axial_stiffness)} N{assumed}. A winch that feeds: set"
        " model.tendon_lengthspring[i] = (0, springlength) and model.tendon_stiffness[i] to the"
        " new values at every step."
    )
    low, high = robot.tension_limits
    span = "the robot file has no limits"
    if np.isfinite(high):
        span = f"their ranges are those with which the tension at home is {low:g} to {high:g} N"
    yield (
        f"Motors pull_i: ctrl is tension that is added to the spring's [N], 0 keeps it ({span}). To"
        " command tensions alone set model.tendon_stiffness[:] = 0 and take the ranges off. A"
        " negative ctrl, and damping, pushes where a cable is slack; a real one does not."
    )
    yield (
        "Sensors length_i, rate_i and added_i: what a force sensor in cable i reads is stiffness"
        " max(length - springlength, 0) + damping rate + added; MuJoCo has no sensor of the pull"
        " of a spring itself."
    )
    if robot.m < LEAST_CABLES:
        yield (
            f"{robot.m} cables do not fix a pose: the platform swings about the one in which it"
            " comes to rest."
        )
    tensions = ", ".join(f"{value:.5g}" for value in hanging.tension)
    lengths = ", ".join(f"{value:.6g}" for value in hanging.length)
    yield (
        "The model starts at rest; the keyframe 'home' is the same. Tensions there [N]:"
        f" {tensions}."
    )
    yield f"Unstrained lengths from anchor to attachment [m]: {lengths}."
    if robot.pulley_radius.any():
        yield (
            "Left out: rollers turn and swivel. Cables begin where they leave their rollers at"
            " home (site leave_i), so that lengths, directions and tensions are right there;"
            f" within the workspace these points would move by up to {hanging.roll * 1e3:.3g} mm."
        )
    if robot.cable.linear_density:
        yield (
            "Left out: the weight of the cables, by which they would hang through at home by up to "
            f"{hanging.sag * 1e3:.3g} mm; their tensions there are those of straight ones."
        )
