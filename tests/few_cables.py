"""Platforms that hang on fewer than six cables, and swing."""

from dataclasses import replace

import numpy as np

from steelyard.inertia import Inertia
from steelyard.robot.file import read_robot
from steelyard.robot.model import Limits

HEIGHT = 2.5  # [m], of the anchors
ABOVE = 0.15  # [m], attachments above the origin
WIDE, NARROW = 2.0, 0.3  # [m], radii of anchors and attachments


def few_cables(count):
    """A body of 5 kg on straight elastic cables to the corners of a regular frame."""
    angle = 2 * np.pi * (np.arange(count) + 0.5) / count
    corners = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)])
    robot = read_robot("cogiro").with_straight_cables()
    body = [5.0, 0.01, -0.005, 0.03, 0.08, 0.1, 0.12, 0.01, 0.0, -0.01]
    return replace(
        robot,
        anchors=WIDE * corners + [0, 0, HEIGHT],
        attachments=NARROW * corners + [0, 0, ABOVE],
        pulley_radius=np.zeros(count),
        pulley_axis=robot.pulley_axis[:count],
        cable=replace(robot.cable, axial_stiffness=50_000.0, damping_ratio=0.0),
        platform=Inertia.from_body_parameters(np.array(body)),
        limits=Limits(),
        tension_limits=(1.0, 500.0),
    )
