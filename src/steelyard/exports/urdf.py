"""URDF, for ROS and Pinocchio."""

from __future__ import annotations

from xml.etree.ElementTree import Element, SubElement

from steelyard.exports.exported import Exported
from steelyard.exports.remarks import number, numbers, remarks
from steelyard.exports.xml_text import xml_text

TITLE = "URDF"
CONVENTION = (
    "The frame of the link 'platform' is the platform frame P; SI units.",
    "origin: centre of gravity in P, with the axes of P (rpy 0 0 0).",
    (
        "inertia: elements of the inertia matrix about the centre of gravity, in the axes of P;"
        " products are minus the integral of x y dm."
    ),
)


def write(exported: Exported) -> str:
    """The text of the file: a robot of one link."""
    inertial = exported.body.to_urdf()
    root = Element("robot", name=exported.link)
    element = SubElement(SubElement(root, "link", name=exported.link), "inertial")
    SubElement(element, "origin", xyz=numbers(inertial.origin_xyz), rpy="0 0 0")
    SubElement(element, "mass", value=number(inertial.mass))
    moments = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    SubElement(element, "inertia", {name: number(getattr(inertial, name)) for name in moments})
    return xml_text(root, remarks(exported, CONVENTION))
