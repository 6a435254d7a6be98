"""What the cables' own inertia does to the platform, against a cable cut into many masses."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from steelyard.robot.cable_inertia import cable_inertia_wrench
from steelyard.robot.file import read_robot

SLICES = 4000
TOLERANCE = 1e-6  # of the largest force: midpoints of 4000 slices are good for 1e-7


@pytest.fixture
def motion():
    rng = np.random.default_rng(5)
    return {
        "position": np.array([[0.3, -0.4, 1.7], [0.0, 0.2, 1.2]]),
        "rotation": Rotation.from_rotvec([[0.2, -0.1, 0.3], [0.0, 0.0, 0.0]]).as_matrix(),
        "specific_force": rng.normal(0, 2, (2, 3)) + np.array([0, 0, 9.81]),
        "omega": rng.normal(0, 0.5, (2, 3)),
        "alpha": rng.normal(0, 2, (2, 3)),
        "gravity": np.array([0.0, 0.0, -9.81]),
    }


@pytest.fixture
def robot():
    bundled = read_robot("cogiro")
    return replace(
        bundled,
        pulley_radius=np.zeros(bundled.m),
        cable=replace(bundled.cable, axial_stiffness=None),
    )


def by_slices(robot, motion, sample):
    """Every slice of a straight cable moves across it in proportion to its distance from the
    anchor; moments about the anchor give what the platform end has to carry of its inertia."""
    p, R, s, w, dw = (
        motion[key][sample] for key in ("position", "rotation", "specific_force", "omega", "alpha")
    )
    wrench = np.zeros(6)
    for anchor, b in zip(robot.anchors, robot.attachments, strict=True):
        acceleration = R @ (s + np.cross(dw, b) + np.cross(w, np.cross(w, b))) + motion["gravity"]
        chord = p + R @ b - anchor
        length = np.linalg.norm(chord)
        u = chord / length
        across = acceleration - u * (u @ acceleration)
        places = (np.arange(SLICES) + 0.5) / SLICES
        masses = robot.cable.linear_density * length / SLICES
        inertia = -masses * places[:, None] * across
        force = R.T @ np.sum(places[:, None] * inertia, axis=0)
        wrench += np.concatenate([force, np.cross(b, force)])
    return wrench


def test_a_third_of_each_cable_moves_along_across_it(robot, motion):
    found = cable_inertia_wrench(robot, **motion)
    for sample in range(2):
        expected = by_slices(robot, motion, sample)
        np.testing.assert_allclose(found[sample], expected, atol=TOLERANCE * np.abs(expected).max())


def test_a_platform_at_rest_drags_nothing(robot, motion):
    still = {**motion, "omega": np.zeros((2, 3)), "alpha": np.zeros((2, 3))}
    still["specific_force"] = -np.einsum("nji,j->ni", motion["rotation"], motion["gravity"])
    np.testing.assert_allclose(cable_inertia_wrench(robot, **still), 0.0, atol=1e-12)


def test_the_cables_resist_every_translation(robot, motion):
    rng = np.random.default_rng(0)
    still = {**motion, "omega": np.zeros((2, 3)), "alpha": np.zeros((2, 3))}
    for _ in range(10):
        a = rng.normal(0, 1, 3)
        still["specific_force"] = np.einsum("nji,j->ni", motion["rotation"], a - motion["gravity"])
        force = np.einsum(
            "nij,nj->ni", motion["rotation"], cable_inertia_wrench(robot, **still)[:, :3]
        )
        assert np.all(force @ a < 0)
