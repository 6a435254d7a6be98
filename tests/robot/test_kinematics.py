from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from steelyard.errors import InfeasibleError
from steelyard.robot import kinematics
from steelyard.robot.file import read_robot
from steelyard.robot.kinematics import cables_at
from steelyard.robot.model import CableProperties, Robot

TOLERANCE = 1e-9  # [m] and of unit forces: sixth-order differences of lengths of ten metres are good to 1e-11

COGIRO = read_robot("cogiro")
PULLEYS = replace(COGIRO, cable=CableProperties())
POINTS = replace(PULLEYS, pulley_radius=np.zeros(8))


def poses(n, seed=4):
    rng = np.random.default_rng(seed)
    position = rng.uniform([-3, -2, 0.5], [3, 2, 3], (n, 3))
    return position, Rotation.from_euler("ZYX", rng.uniform(-0.6, 0.6, (n, 3)))


def test_point_anchors_give_cross_products_of_arms_and_directions():
    position, turn = poses(20)
    found = cables_at(POINTS, position, turn.as_matrix(), np.ones(8))
    for k in range(20):
        R = turn[k].as_matrix()
        for i in range(8):
            chord = POINTS.anchors[i] - position[k] - R @ POINTS.attachments[i]
            length = np.linalg.norm(chord)
            pull_in_world = chord / length
            torque_in_world = np.cross(R @ POINTS.attachments[i], pull_in_world)
            np.testing.assert_allclose(found.direction[k, i], pull_in_world, atol=TOLERANCE)
            np.testing.assert_allclose(
                found.structure[k, :3, i], R.T @ pull_in_world, atol=TOLERANCE
            )
            np.testing.assert_allclose(
                found.structure[k, 3:, i], R.T @ torque_in_world, atol=TOLERANCE
            )
            assert found.length[k, i] == pytest.approx(length, abs=TOLERANCE)


@pytest.mark.parametrize(
    "robot", [POINTS, PULLEYS, replace(PULLEYS, pulley_radius=np.full(8, 0.3))]
)
def test_structure_matrix_is_minus_the_gradient_of_the_lengths(robot):
    position, turn = poses(10)
    h = 0.01

    def lengths(twist):
        moved = position + turn.apply(twist[:3])
        return cables_at(
            robot, moved, (turn * Rotation.from_rotvec(twist[3:])).as_matrix(), np.ones(8)
        ).length

    gradient = [
        sum(c * (lengths(k * h * e) - lengths(-k * h * e)) for k, c in ((1, 45), (2, -9), (3, 1)))
        / (60 * h)
        for e in np.eye(6)
    ]
    structure = cables_at(robot, position, turn.as_matrix(), np.ones(8)).structure
    np.testing.assert_allclose(structure, -np.stack(gradient, axis=1), atol=TOLERANCE)


def test_turning_the_whole_world_leaves_the_structure_matrix_alone():
    position, turn = poses(5)
    world = Rotation.from_rotvec([0.4, -1.0, 0.7])
    turned = replace(
        COGIRO,
        anchors=world.apply(COGIRO.anchors.copy()),
        pulley_axis=world.apply(COGIRO.pulley_axis.copy()),
        gravity=world.apply(COGIRO.gravity.copy()),
    )
    here = cables_at(COGIRO, position, turn.as_matrix(), np.full(8, 300.0))
    there = cables_at(turned, world.apply(position), (world * turn).as_matrix(), np.full(8, 300.0))
    np.testing.assert_allclose(there.structure, here.structure, atol=TOLERANCE)
    np.testing.assert_allclose(there.length, here.length, atol=TOLERANCE)
    np.testing.assert_allclose(there.winch_tension, here.winch_tension, atol=300 * TOLERANCE)


def test_moving_the_whole_world_leaves_everything_alone():
    position, turn = poses(5)
    shift = np.array([30.0, -20.0, 10.0])
    here = cables_at(COGIRO, position, turn.as_matrix(), np.full(8, 300.0))
    moved = replace(COGIRO, anchors=COGIRO.anchors + shift)
    there = cables_at(moved, position + shift, turn.as_matrix(), np.full(8, 300.0))
    np.testing.assert_allclose(there.structure, here.structure, atol=TOLERANCE)
    np.testing.assert_allclose(there.length, here.length, atol=TOLERANCE)


@pytest.mark.parametrize("g", [9.81, 1.62])
def test_hanging_cables_carry_the_platform_and_their_own_weight(g):
    position, turn = poses(5)
    tension = np.random.default_rng(1).uniform(100, 900, (5, 8))
    robot = replace(COGIRO, pulley_radius=np.zeros(8), gravity=np.array([0, 0, -g]))
    found = cables_at(robot, position, turn.as_matrix(), tension)
    pull = tension[:, :, None] * found.direction
    weight = 0.064 * g * found.length
    at_anchor = pull + weight[:, :, None] * [0, 0, 1]
    np.testing.assert_allclose(
        found.winch_tension, np.linalg.norm(at_anchor, axis=2), rtol=TOLERANCE
    )
    force = np.einsum(
        "nij,nj->ni", turn.as_matrix(), np.einsum("nkm,nm->nk", found.structure[:, :3], tension)
    )
    np.testing.assert_allclose(force, pull.sum(axis=1), atol=900 * TOLERANCE)


def slack_and_taut(n):
    """Every third sample has a slack cable, so that quick and full evaluation alternate."""
    tension = np.random.default_rng(2).uniform(100, 5000, (n, 8))
    tension[::3, 4] = 10.0
    return tension


def test_slack_and_taut_samples_hang_between_their_ends():
    position, turn = poses(6)
    robot, tension = replace(COGIRO, pulley_radius=np.zeros(8)), slack_and_taut(6)
    found = cables_at(robot, position, turn.as_matrix(), tension)
    weight, compliance = np.array([0, 0, 0.064 * 9.81]), 1 / COGIRO.cable.axial_stiffness
    for k, i in np.ndindex(6, 8):

        def element(s, y, force=tension[k, i] * found.direction[k, i]):
            pull = force + weight * s
            return (1 / np.linalg.norm(pull) + compliance) * pull

        start = position[k] + turn[k].apply(robot.attachments[i].copy())
        end = solve_ivp(
            element, (0, found.length[k, i]), start, method="DOP853", rtol=1e-12, atol=1e-12
        ).y[:, -1]
        np.testing.assert_allclose(end, robot.anchors[i], atol=TOLERANCE)


@pytest.mark.parametrize("robot", [COGIRO, replace(COGIRO, pulley_radius=np.full(8, 0.3))])
def test_samples_found_quickly_are_as_good_as_those_given_all_steps(robot, monkeypatch):
    position, turn = poses(90)
    tension = slack_and_taut(90)
    found = cables_at(robot, position, turn.as_matrix(), tension)
    monkeypatch.setattr(kinematics, "_QUICK_TOLERANCE", 0.0)
    monkeypatch.setattr(kinematics, "_SLACK_AT_ONCE", 32)
    full = cables_at(robot, position, turn.as_matrix(), tension)
    for name in ("direction", "structure", "length", "winch_tension"):
        np.testing.assert_allclose(
            getattr(found, name), getattr(full, name), rtol=1e-12, atol=TOLERANCE
        )


def test_a_slack_sample_is_found_with_one_rotation_for_all():
    position, _ = poses(6)
    level, tension = np.eye(3), slack_and_taut(6)
    once = cables_at(COGIRO, position, level, tension)
    each = cables_at(COGIRO, position, np.tile(level, (6, 1, 1)), tension)
    np.testing.assert_array_equal(once.structure, each.structure)


def test_straight_cables_pull_as_hard_at_the_winch():
    position, turn = poses(3)
    tension = np.linspace(100, 800, 8)
    found = cables_at(COGIRO.with_straight_cables(), position, turn.as_matrix(), tension)
    np.testing.assert_array_equal(found.winch_tension, np.tile(tension, (3, 1)))


def test_tensions_may_differ_from_sample_to_sample_or_not():
    position, turn = poses(4)
    one = cables_at(COGIRO, position, turn.as_matrix(), np.full(8, 250.0))
    each = cables_at(COGIRO, position, turn.as_matrix(), np.full((4, 8), 250.0))
    np.testing.assert_array_equal(one.structure, each.structure)


@pytest.mark.parametrize("m", [1, 2, 3, 6])
def test_a_robot_may_have_few_cables(m):
    position, turn = poses(4)
    full = cables_at(POINTS, position, turn.as_matrix(), np.ones(8))
    few = Robot("few", POINTS.anchors[:m], POINTS.attachments[:m])
    found = cables_at(few, position, turn.as_matrix(), np.ones(m))
    assert found.direction.shape == (4, m, 3)
    assert found.structure.shape == (4, 6, m)
    assert found.length.shape == found.winch_tension.shape == (4, m)
    np.testing.assert_allclose(found.structure, full.structure[:, :, :m], atol=TOLERANCE)


def poses_of_which_the_third_has_the_fifth_attachment_inside_its_roller():
    position, turn = poses(3)
    centre = COGIRO.anchors[4] + [-0.04, -0.02, 0.0]
    position[2] = centre - turn[2].apply(COGIRO.attachments[4].copy())
    return position, turn.as_matrix()


@pytest.mark.parametrize("robot", [COGIRO, PULLEYS], ids=["hanging", "straight"])
def test_a_pose_that_no_cable_can_reach_is_refused_by_cable_and_sample(robot):
    position, rotation = poses_of_which_the_third_has_the_fifth_attachment_inside_its_roller()
    with pytest.raises(InfeasibleError, match=r"cable 5 of 'cogiro': expected .* at sample 2"):
        cables_at(robot, position, rotation, np.full(8, 300.0))


def test_that_error_carries_its_sample():
    position, rotation = poses_of_which_the_third_has_the_fifth_attachment_inside_its_roller()
    with pytest.raises(InfeasibleError) as caught:
        cables_at(COGIRO, position, rotation, np.full(8, 300.0))
    assert caught.value.sample == 2


@pytest.mark.parametrize("reading", [0.0, -3.0])
def test_a_reading_at_or_below_zero_does_not_stop_the_others(reading):
    position, turn = poses(1)
    tension = np.full(8, 300.0)
    expected = cables_at(COGIRO, position, turn.as_matrix(), tension)
    tension[4] = reading
    found = cables_at(COGIRO, position, turn.as_matrix(), tension)
    assert np.isfinite(found.direction).all()
    others = [0, 1, 2, 3, 5, 6, 7]
    np.testing.assert_allclose(
        found.structure[:, :, others], expected.structure[:, :, others], atol=TOLERANCE
    )


def test_inputs_stay_as_they_are():
    position, turn = poses(3)
    R, tension = turn.as_matrix(), np.full((3, 8), -1.0)
    kept = position.copy(), R.copy()
    cables_at(PULLEYS, position, R, tension)
    np.testing.assert_array_equal(position, kept[0])
    np.testing.assert_array_equal(R, kept[1])
    np.testing.assert_array_equal(tension, -1.0)


def test_a_robot_holds_read_only_copies_and_unit_axes():
    axes = np.tile([0.0, 0.0, 7.0], (8, 1))
    robot = replace(COGIRO, pulley_axis=axes)
    axes[:] = 0
    np.testing.assert_array_equal(robot.pulley_axis, np.tile([0.0, 0.0, 1.0], (8, 1)))
    for array in (
        robot.anchors,
        robot.attachments,
        robot.gravity,
        robot.pulley_radius,
        robot.pulley_axis,
    ):
        assert not array.flags.writeable
    np.testing.assert_allclose(replace(robot, gravity=np.array([3.0, 0, -4])).up, [-0.6, 0, 0.8])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"attachments": np.zeros((7, 3))}, r"attachments: expected shape 8 x 3, found \(7, 3\)"),
        ({"gravity": np.zeros(2)}, r"gravity: expected shape 3, found \(2,\)"),
        ({"anchors": np.full((8, 3), np.nan)}, r"anchors: expected finite numbers"),
        ({"pulley_radius": np.zeros(3)}, r"pulley_radius: expected shape 8"),
    ],
)
def test_a_robot_of_the_wrong_form_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        replace(COGIRO, **change)
