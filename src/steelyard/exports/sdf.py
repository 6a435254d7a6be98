"""SDFormat, for Gazebo and Drake."""

from __future__ import annotations

from xml.etree.ElementTree import Element, SubElement

from steelyard.exports.exported import Exported
from steelyard.exports.remarks import number, numbers, remarks
from steelyard.exports.xml_text import xml_text

TITLE = "SDF"
VERSION = "1.9"
"""Of the format: that of Gazebo Fortress; later releases read it as well."""
CONVENTION = (
    (
        "The frame of the link 'platform' is the platform frame P, and so is that of the model; SI"
        " units."
    ),
    (
        "pose: centre of gravity in P, then roll, pitch, yaw of the inertial frame, 0: it has the"
        " axes of P."
    ),
    (
        "inertia: elements of the inertia matrix about the centre of gravity, in the axes of P;"
        " products are minus the integral of x y dm."
    ),
)


def write(exported: Exported) -> str:
    """The text of the file: a model of one link."""
    inertial = exported.body.to_urdf()
    root = Element("sdf", version=VERSION)
    link = SubElement(SubElement(root, "model", name=exported.link), "link", name=exported.link)
    element = SubElement(link, "inertial")
    SubElement(element, "mass").text = number(inertial.mass)
    SubElement(element, "pose").text = f"{numbers(inertial.origin_xyz)} 0 0 0"
    inertia = SubElement(element, "inertia")
    for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"):
        SubElement(inertia, name).text = number(getattr(inertial, name))
    return xml_text(root, remarks(exported, CONVENTION))
