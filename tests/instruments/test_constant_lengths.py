"""What locked winches say without being read."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from steelyard.instruments.equations import predict
from steelyard.instruments.unread_cables import CHANGE, ConstantLengths
from steelyard.motion.state import State
from steelyard.robot.model import CableProperties, Robot

ANCHORS = np.array([[2.0, 1.0, 4.0], [-2.0, 1.5, 4.2], [0.3, -2.0, 3.8]])
ATTACHMENTS = np.array([[0.3, 0.2, 0.1], [-0.3, 0.2, 0.1], [0.0, -0.3, 0.1]])


@pytest.mark.parametrize("stiffness", [None, 3e5])
def test_a_length_is_the_chord_without_its_stretch(stiffness):
    """By hand: a straight cable of unstrained length l under tension T is l (1 + T / EA) long; what
    the robot file says of EA is where the fit begins, and does not act beside it."""
    robot = Robot("swing", ANCHORS, ATTACHMENTS, cable=CableProperties(axial_stiffness=stiffness))
    own = ConstantLengths(cables=3, noise=3e-4, axial_stiffness=stiffness)
    rng = np.random.default_rng(733)
    position = np.array([0.1, 0.0, 1.0]) + 0.1 * rng.normal(size=(5, 3))
    rotation = Rotation.from_rotvec(0.2 * rng.normal(size=(5, 3)))
    tension = rng.uniform(10, 60, (5, 3))
    length, compliance = np.array([3.0, 3.5, 3.2]), 2e-5
    turned = np.stack([rotation.apply(each) for each in ATTACHMENTS], axis=1)
    chord = np.linalg.norm(ANCHORS - position[:, None] - turned, axis=2)
    nothing = dict.fromkeys(("velocity", "omega", "specific_force", "alpha", "wrench"))
    state = State(position, rotation.as_matrix(), tension=tension, gravity=np.zeros(3), **nothing)
    errors = {"length": length, "compliance": np.array([compliance])}
    found = predict(own, robot, state, errors)[CHANGE]
    np.testing.assert_allclose(found, chord / (1 + compliance * tension) - length, atol=1e-12)


def test_lengths_are_unknown_in_every_run_and_the_stretch_is_one_number():
    own = ConstantLengths(cables=3, noise=3e-4, axial_stiffness=2e5)
    length, softness = own.terms(3)
    assert (length.size, length.prior.per) == (3, "run")
    assert length.deviation.min() >= 100
    assert softness.mean == pytest.approx(5e-6)
    # A stretch that nobody has stated is told by the motion alone.
    assert softness.deviation == pytest.approx(1e-4)
    assert ConstantLengths(cables=3, noise=3e-4).terms(3)[1].mean == 0


def test_nobody_reads_them():
    own = ConstantLengths(cables=3, noise=3e-4)
    assert own.stands_in(3)
    assert own.is_cable_motion
    assert not own.is_motion
