"""Keys of the errors and forces that belong to the robot and its surroundings, not to an
instrument.
"""

from __future__ import annotations

from steelyard.dynamics import FLEXIBILITY

ROBOT = "robot"
"""Owner of the errors of the robot file."""
DRAG = "cable_inertia"
"""Key of how far the platform feels the inertia of its cables: 1 as theory has it, 0 where they
follow without any."""
ATTACHED = (
    ("attached.force", 3),
    ("attached.stiffness", 1),
    ("attached.moments", 9),
    ("attached.stiffness_moment", 3),
)
"""Keys and sizes of what a hose does, see :func:`steelyard.robot.surroundings.attached_wrench`."""
HOSES = "hose"
"""First part of the keys of hoses that are stated."""
DAMPING = (("damping.moving", 1), ("damping.turning", 1))
"""The same of what decays swings, see :func:`steelyard.robot.surroundings.damping_wrench`."""
AIR = (("drag.area", 1), ("drag.turning", 1), *DAMPING)
"""And of the air, see :func:`steelyard.robot.surroundings.air_wrench`."""
SWIVEL = "swivel.friction"
"""Key of the friction where cables turn about their anchors, see
:func:`steelyard.robot.surroundings.swivel_wrench`."""
BENDING = (("bending.force", 6), ("bending.coupling", 9), ("bending.torque", 6))
"""Keys and sizes of what parts of a platform that bend do, see
:func:`steelyard.dynamics.bending_regressor`."""
BENDING_KEYS = tuple((ROBOT, key, None) for key, _ in BENDING)
"""The same with their owner, and in all runs."""
LOAD = "load"
"""First part of the keys of what further loads are more than the first: ten linear parameters."""
APPARENT = "apparent"
"""First part of the keys of how a load in which something moves answers accelerations beside what
it weighs: ten linear parameters."""


def element_of(key: str, component: int) -> tuple[int, int]:
    """Row and column, in the matrix of residual flexibility, of a number of what bends.

    Args:
        key: One of :data:`BENDING`.
        component: Of it.
    """
    before = 0
    for own, size in BENDING:
        if own == key:
            break
        before += size
    return FLEXIBILITY[before + component]
