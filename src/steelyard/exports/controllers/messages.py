"""Payload messages: Universal Robots, Franka, and ROS."""

from __future__ import annotations

from steelyard.exports.exported import Exported
from steelyard.exports.remarks import number, one_line, remarks

UR_TITLE = "URScript"
UR_CONVENTION = (
    (
        "set_target_payload(m, cog, inertia): mass [kg], centre of gravity [m] in the platform"
        " frame P, which stands for the tool flange, and Ixx, Iyy, Izz, Ixy, Ixz, Iyz about the"
        " centre of gravity in the axes of P [kg m^2]; products are elements of the matrix, minus"
        " the integral of x y dm."
    ),
    "To be run in a program, or sent to the script port. PolyScope 5.10 and newer.",
)
FRANKA_TITLE = "Franka SetLoad"
FRANKA_CONVENTION = (
    (
        "Request of franka_msgs/srv/SetLoad, and the arguments of setLoad of libfranka: mass [kg],"
        " center_of_mass [m] in the platform frame P, which stands for the flange, load_inertia:"
        " matrix about the centre of gravity in the axes of P, column by column [kg m^2]."
    ),
    "Products are elements of the matrix, minus the integral of x y dm.",
)
ROS_TITLE = "geometry_msgs/InertiaStamped"
ROS_CONVENTION = (
    (
        "geometry_msgs/msg/InertiaStamped: m [kg], com [m] in the frame of frame_id, ixx to izz"
        " about the centre of gravity in the axes of that frame [kg m^2]."
    ),
    "Products are elements of the matrix, minus the integral of x y dm. The frame is the platform"
    " frame P.",
)


def write_ur(exported: Exported) -> str:
    """The text of the file: one call of URScript below its comments."""
    body, J = exported.body, exported.body.inertia
    six = (J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2])
    comment = _hashes(exported, UR_CONVENTION)
    return (
        f"{comment}set_target_payload({number(body.mass)}, {_listed(body.center_of_gravity)},"
        f" {_listed(six)})\n"
    )


def write_franka(exported: Exported) -> str:
    """The text of the file: a request as YAML."""
    body = exported.body
    return (
        f"{_hashes(exported, FRANKA_CONVENTION)}mass: {number(body.mass)}\n"
        f"center_of_mass: {_listed(body.center_of_gravity)}\n"
        f"load_inertia: {_listed(body.inertia.T.ravel())}\n"
    )


def write_ros(exported: Exported) -> str:
    """The text of the file: a message as YAML."""
    body, J = exported.body, exported.body.inertia
    x, y, z = (number(v) for v in body.center_of_gravity)
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    places = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    elements = "".join(
        f"  {name}: {number(J[place])}\n" for name, place in zip(names, places, strict=True)
    )
    return (
        f"{_hashes(exported, ROS_CONVENTION)}header:\n  stamp: {{sec: 0, nanosec: 0}}\n"
        f'  frame_id: "{exported.link}"\ninertia:\n  m: {number(body.mass)}\n'
        f"  com: {{x: {x}, y: {y}, z: {z}}}\n{elements}"
    )


def _hashes(exported: Exported, convention: tuple[str, ...]) -> str:
    """The comment."""
    lines = remarks(exported, convention)
    return "".join(f"# {one_line(line)}".rstrip() + "\n" for line in lines)


def _listed(values: object) -> str:
    """Numbers in brackets."""
    return "[" + ", ".join(number(float(v)) for v in values) + "]"  # type: ignore[attr-defined]
