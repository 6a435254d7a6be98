"""The exported robot in MuJoCo: it hangs where it is said to hang, with the tensions of this
package."""

import json
from dataclasses import replace

import casadi as ca
import mujoco
import numpy as np
import pytest
from mujoco_cables import point_robot
from scipy.spatial.transform import Rotation
from written_estimates import estimate_of, file_of

from steelyard.errors import InputError
from steelyard.exports.exported import read_exported
from steelyard.exports.formats import export
from steelyard.exports.hanging import ASSUMED_STRAIN, hang
from steelyard.files.yaml_file import to_yaml
from steelyard.inertia import Inertia
from steelyard.robot import cable
from steelyard.robot.file import read_robot, robot_file
from steelyard.simulation.forward_dynamics import CablePlatform

pytestmark = pytest.mark.mujoco

TENSIONS = 1e-6  # relative; what a user is promised. They agree to 1e-10
POINTS = point_robot()
ROLLERS = read_robot("cogiro").with_straight_cables()
BODY = Inertia(
    183.2, [0.06, -0.05, -0.21], [[101.0, -4.1, 2.2], [-4.1, 92.0, 5.3], [2.2, 5.3, 40.0]]
)
"""Another one than the nominal."""
POSES = (
    (0.0, 0.0, 2.0, 0.0, 0.0, 0.0),
    (1.2, -0.8, 1.4, 0.15, -0.2, 0.3),
    (-2.0, 1.5, 1.0, -0.1, 0.12, -0.25),
)


@pytest.fixture
def exported(tmp_path):
    return read_exported(str(file_of(tmp_path, estimate_of(BODY.body_parameters))))


def simulated(exported, hanging):
    """Model and data of MuJoCo, as they are without being told anything."""
    model = mujoco.MjModel.from_xml_string(export(exported, "mjcf", hanging=hanging))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def tensions(model, data):
    """Of the springs in MuJoCo."""
    return model.tendon_stiffness.reshape(model.ntendon, -1)[:, 0] * np.maximum(
        data.ten_length - model.tendon_lengthspring[:, 1], 0
    )


def ours(robot, position, rotation, length, stiffness):
    """Tensions of this package for unstrained lengths."""
    elastic = replace(robot, cable=replace(robot.cable, axial_stiffness=stiffness))
    points = position + robot.attachments @ rotation.T
    shapes = [
        cable.by_length(cable.spec(elastic, i), ca.DM(points[i]), float(length[i])).tension
        for i in range(robot.m)
    ]
    return np.array(ca.evalf(ca.vertcat(*shapes))).ravel()


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("robot", [POINTS, ROLLERS], ids=["points", "rollers"])
def test_it_hangs_at_rest_with_our_tensions(exported, robot, pose):
    hanging = hang(robot, BODY, pose)
    model, data = simulated(exported, hanging)
    R = Rotation.from_euler("ZYX", pose[:2:-1]).as_matrix()
    np.testing.assert_allclose(data.body("platform").xpos, pose[:3], atol=1e-12)
    np.testing.assert_allclose(data.body("platform").xmat.reshape(3, 3), R, atol=1e-12)
    found = tensions(model, data)
    np.testing.assert_allclose(
        found,
        ours(robot, np.array(pose[:3]), R, hanging.length, robot.cable.axial_stiffness),
        rtol=TENSIONS,
    )
    np.testing.assert_allclose(found, hanging.tension, rtol=TENSIONS)
    assert found.min() > robot.tension_limits[0] - 1e-6
    np.testing.assert_allclose(data.qacc, 0, atol=1e-8)
    # The weight, and its torque about the platform origin, by their definitions.
    weight = BODY.mass * robot.gravity
    lever = R @ BODY.center_of_gravity
    np.testing.assert_allclose(data.qfrc_spring[:3], -weight, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(
        R @ data.qfrc_spring[3:], -np.cross(lever, weight), rtol=1e-9, atol=1e-6
    )


@pytest.mark.parametrize(("moved", "slack"), [(0.002, False), (0.1, True)])
def test_same_lengths_elsewhere_give_our_tensions(exported, moved, slack):
    """Away from home too, also where some cables are slack."""
    hanging = hang(POINTS, BODY)
    model, data = simulated(exported, hanging)
    turned = Rotation.from_euler("ZYX", moved * np.array([0.5, -0.3, 0.4]))
    data.qpos[:3] += moved * np.array([1, -1, -2])
    data.qpos[3:] = turned.as_quat(scalar_first=True)
    mujoco.mj_forward(model, data)
    expected = ours(POINTS, data.qpos[:3], turned.as_matrix(), hanging.length, 5e5)
    found = tensions(model, data)
    np.testing.assert_allclose(found, np.maximum(expected, 0), rtol=TENSIONS, atol=1e-6)
    # What MuJoCo itself makes of the springs.
    pull = POINTS.anchors - data.qpos[:3] - POINTS.attachments @ turned.as_matrix().T
    pull /= np.linalg.norm(pull, axis=1)[:, None]
    np.testing.assert_allclose(data.qfrc_spring[:3], found @ pull, rtol=1e-9, atol=1e-6)
    assert (found == 0).any() == slack


def test_a_simulation_that_starts_at_home_stays_there(exported):
    hanging = hang(ROLLERS, BODY)
    model, data = simulated(exported, hanging)
    home = data.qpos.copy()
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    np.testing.assert_array_equal(data.qpos, home)
    mujoco.mj_step(model, data, nstep=round(1.0 / model.opt.timestep))
    np.testing.assert_allclose(data.qpos, home, atol=1e-9)
    np.testing.assert_allclose(data.qvel, 0, atol=1e-9)
    np.testing.assert_allclose(tensions(model, data), hanging.tension, rtol=TENSIONS)


def test_it_swings_as_the_cables_let_it_and_comes_to_rest_at_home(exported):
    hanging = hang(POINTS, BODY)
    model, data = simulated(exported, hanging)
    home = data.qpos.copy()
    data.qvel[:] = [0.05, -0.03, 0.02, 0.02, 0.04, -0.03]
    mujoco.mj_step(model, data, nstep=100)
    assert np.abs(data.qpos - home).max() > 1e-4
    # Damping of 2 % of critical: a fast time of dying away, so that a short test sees the end.
    model.tendon_damping[:] *= 25
    mujoco.mj_step(model, data, nstep=round(6.0 / model.opt.timestep))
    np.testing.assert_allclose(data.qpos, home, atol=1e-5)


def test_half_the_time_step_gives_the_same_motion(exported):
    ends = []
    for divisor in (1, 2):
        model, data = simulated(exported, hang(POINTS, BODY))
        model.opt.timestep /= divisor
        data.qvel[:] = [0.1, -0.1, 0.05, 0.1, 0.1, -0.1]
        mujoco.mj_step(model, data, nstep=round(0.5 / model.opt.timestep))
        ends.append(data.qpos.copy())
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-6)


@pytest.mark.parametrize("stiffness", [5e5, 5e6, 5e7])
def test_the_time_step_resolves_the_fastest_swing(stiffness):
    robot = replace(POINTS, cable=replace(POINTS.cable, axial_stiffness=stiffness), platform=BODY)
    hanging = hang(robot, BODY)
    fastest = CablePlatform(robot, BODY).natural_frequencies(np.array(POSES[0])).max()
    steps = 1 / (fastest * hanging.time_step)
    assert steps > 60
    assert steps < 160 or hanging.time_step == 1e-3


def test_motors_add_tension_within_the_limits_of_the_robot(exported):
    hanging = hang(POINTS, BODY)
    model, data = simulated(exported, hanging)
    low, high = model.actuator_ctrlrange.T
    np.testing.assert_allclose(hanging.tension + low, POINTS.tension_limits[0], rtol=1e-9)
    np.testing.assert_allclose(hanging.tension + high, POINTS.tension_limits[1], rtol=1e-9)
    data.ctrl[:] = np.linspace(-100, 400, POINTS.m)
    mujoco.mj_forward(model, data)
    pull = POINTS.anchors - hanging.position - POINTS.attachments
    pull /= np.linalg.norm(pull, axis=1)[:, None]
    np.testing.assert_allclose(data.qfrc_actuator[:3], data.ctrl @ pull, rtol=1e-9)
    np.testing.assert_allclose(
        data.qfrc_actuator[3:], data.ctrl @ np.cross(POINTS.attachments, pull), rtol=1e-9, atol=1e-9
    )


def test_winches_feed_by_the_springs(exported):
    """As the comment says: length and stiffness set while it runs are those of a cable of another
    unstrained length."""
    hanging = hang(POINTS, BODY)
    model, data = simulated(exported, hanging)
    fed = hanging.length + np.linspace(-0.01, 0.01, POINTS.m)
    model.tendon_lengthspring[:, 1] = fed
    model.tendon_stiffness[:] = np.reshape(5e5 / fed, model.tendon_stiffness.shape)
    mujoco.mj_forward(model, data)
    expected = np.maximum(ours(POINTS, hanging.position, np.eye(3), fed, 5e5), 0)
    np.testing.assert_allclose(tensions(model, data), expected, rtol=TENSIONS, atol=1e-6)


def test_sites_stand_where_the_robot_file_has_them(exported):
    model, data = simulated(exported, hang(ROLLERS, BODY, POSES[1]))
    for i in range(ROLLERS.m):
        np.testing.assert_array_equal(model.site(f"anchor_{i + 1}").pos, ROLLERS.anchors[i])
        np.testing.assert_array_equal(model.site(f"attachment_{i + 1}").pos, ROLLERS.attachments[i])
        # On the roller: as far from its centre as it is wide, and the cable is square to that
        # radius.
        leave, end = data.site(f"leave_{i + 1}").xpos, data.site(f"attachment_{i + 1}").xpos
        outward = (end - ROLLERS.anchors[i]) * [1, 1, 0]
        centre = ROLLERS.anchors[i] + 0.05 * outward / np.linalg.norm(outward)
        assert np.linalg.norm(leave - centre) == pytest.approx(0.05, abs=1e-9)
        assert (leave - centre) @ (end - leave) == pytest.approx(0, abs=1e-9)


def test_gravity_may_be_tilted(exported):
    robot = replace(POINTS, gravity=np.array([0.4, -0.3, -9.7]))
    model, data = simulated(exported, hang(robot, BODY))
    np.testing.assert_array_equal(model.opt.gravity, robot.gravity)
    np.testing.assert_allclose(data.qacc, 0, atol=1e-8)


def test_the_pose_is_the_nearest_to_the_middle_that_can_be_held(exported):
    np.testing.assert_array_equal(hang(POINTS, BODY).position, [0, 0, 2])
    narrow = replace(POINTS, tension_limits=(50.0, 700.0))
    hanging = hang(narrow, BODY)
    assert np.linalg.norm(hanging.position - [0, 0, 2]) > 0.1
    assert hanging.tension.max() < 700 + 1e-6
    np.testing.assert_allclose(simulated(exported, hanging)[1].qacc, 0, atol=1e-8)


def remarks_on(exported, hanging):
    comment = export(exported, "mjcf", hanging=hanging).split("-->", 1)[0]
    return " ".join(comment.split())


def test_what_is_left_out_is_said(exported):
    real = remarks_on(exported, hang(read_robot("cogiro"), BODY))
    assert "Left out: rollers turn and swivel" in real
    assert "Left out: the weight of the cables" in real
    assert "Left out" not in remarks_on(exported, hang(POINTS, BODY))
    assert "EA = 500000.0 N." in real


def test_sag_and_roll_are_of_the_size_that_is_said():
    hanging = hang(read_robot("cogiro"), BODY)
    # A parabola: weight across over eight times the tension; a hundredth of ten metres of 64 g/m at
    # some 650 N.
    chord = np.linalg.norm(hanging.leave - hanging.position - hanging.robot.attachments, axis=1)
    assert 0.5 < hanging.sag / (0.064 * 9.81 * chord.max() ** 2 / (8 * hanging.tension.min())) <= 1
    assert 0.005 < hanging.roll < 0.1
    assert hang(POINTS, BODY).sag == hang(POINTS, BODY).roll == 0


def test_without_a_stiffness_a_stiff_cable_is_assumed_and_said(exported):
    robot = replace(POINTS, cable=replace(POINTS.cable, axial_stiffness=None))
    hanging = hang(robot, BODY)
    model, data = simulated(exported, hanging)
    strain = data.ten_length / hanging.length - 1
    assert strain.max() == pytest.approx(ASSUMED_STRAIN, rel=1e-9)
    np.testing.assert_allclose(tensions(model, data), hanging.tension, rtol=TENSIONS)
    assert "no axial_stiffness" in remarks_on(exported, hanging)
    assert "no axial_stiffness" not in remarks_on(exported, hang(POINTS, BODY))


def test_without_limits_motors_have_no_range(exported):
    hanging = hang(replace(POINTS, tension_limits=(0.0, np.inf)), BODY)
    model, data = simulated(exported, hanging)
    assert not model.actuator_ctrllimited.any()
    np.testing.assert_allclose(data.qacc, 0, atol=1e-8)
    assert "the robot file has no limits" in remarks_on(exported, hanging)


@pytest.mark.parametrize(
    ("robot", "body", "pose", "message"),
    [
        (replace(POINTS, anchors=np.zeros((0, 3)), attachments=np.zeros((0, 3)), pulley_radius=[], pulley_axis=[]), BODY, None, "expected a robot with cables, found none"),
        (replace(POINTS, tension_limits=(50.0, 100.0)), BODY, None, "can hold 183.2 kg with 50 to 100 N, found none; check the robot file"),
        (POINTS, BODY, (0, 0, 2, 2.0, 0, 0), "can hold 183.2 kg with 50 to 5000 N, found that it is not; choose another pose"),
        (POINTS, BODY, (0, 0, 2, np.inf, 0, 0), "pose: expected six finite numbers"),
        (POINTS, replace(BODY, inertia=np.diag([1.0, 1.0, 3.0])), None, "expected a body that can exist"),
    ],
)  # fmt: skip
def test_what_cannot_hang_is_refused(robot, body, pose, message):
    with pytest.raises(InputError, match=message):
        hang(robot, body, pose)


def test_other_formats_have_no_cables(exported):
    with pytest.raises(InputError, match="robot: expected format mjcf"):
        export(exported, "urdf", hanging=hang(POINTS, BODY))


# The verb


def test_the_verb_writes_the_robot(run, tmp_path):
    file_of(tmp_path, estimate_of(BODY.body_parameters))
    robot = robot_file(replace(POINTS, name='a "robot" --><x/>'))
    (tmp_path / "robot.yaml").write_text(to_yaml(robot))
    options = [
        "--format",
        "mjcf",
        "--robot",
        tmp_path / "robot.yaml",
        "--out",
        tmp_path / "robot.xml",
    ]
    status, out, err = run(
        "export", tmp_path, *options, "--pose", 1.2, -0.8, 1.4, 5, -10, 15, "--json"
    )
    assert (status, err) == (0, "")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "robot.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    found = json.loads(out)["robot"]
    np.testing.assert_allclose(found["position"], [1.2, -0.8, 1.4])
    turned = Rotation.from_euler("ZYX", [15, -10, 5], degrees=True)
    np.testing.assert_allclose(
        Rotation.from_quat(found["quaternion"], scalar_first=True).as_matrix(),
        turned.as_matrix(),
        atol=1e-12,
    )
    np.testing.assert_allclose(tensions(model, data), found["tension"], rtol=TENSIONS)
    np.testing.assert_allclose(model.tendon_lengthspring[:, 1], found["length"], rtol=1e-12)
    first = (tmp_path / "robot.xml").read_bytes()
    assert (
        run("export", tmp_path, *options, "--pose", 1.2, -0.8, 1.4, 5, -10, 15, "--force")[0] == 0
    )
    assert (tmp_path / "robot.xml").read_bytes() == first


def test_the_verb_takes_bundled_robots(run, tmp_path):
    file_of(tmp_path, estimate_of(BODY.body_parameters))
    status, out, err = run(
        "export", tmp_path, "--format", "mjcf", "--robot", "cogiro", "--out", tmp_path / "robot.xml"
    )
    assert (status, err) == (0, "")
    assert "on the 8 cables of cogiro as MJCF" in out
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "robot.xml")).ntendon == 8


# Fewer than six cables


def four_cables():
    """Four corners above a platform with four."""
    corners = np.array([[-1.0, -1], [-1, 1], [1, 1], [1, -1]])
    return replace(
        POINTS,
        anchors=np.column_stack([4 * corners, [4.0, 4.1, 3.9, 4.0]]),
        attachments=np.column_stack([0.5 * corners, [0.3, 0.3, 0.32, 0.3]]),
        pulley_radius=np.zeros(4),
        pulley_axis=np.tile([0, 0, 1.0], (4, 1)),
        limits=replace(POINTS.limits, position=((-1, -1, 0.5), (1, 1, 2.5))),
    )


@pytest.mark.parametrize("pose", [None, (0.3, -0.2, 1.2, 0, 0, 0.1)])
def test_on_fewer_than_six_cables_it_hangs_where_it_comes_to_rest(exported, pose):
    robot = four_cables()
    hanging = hang(robot, BODY, pose)
    model, data = simulated(exported, hanging)
    np.testing.assert_allclose(data.qacc, 0, atol=1e-6)
    np.testing.assert_allclose(tensions(model, data), hanging.tension, rtol=TENSIONS, atol=1e-6)
    # It stays, for it is the lowest place.
    mujoco.mj_step(model, data, nstep=round(0.3 / model.opt.timestep))
    np.testing.assert_allclose(data.body("platform").xpos, hanging.position, atol=1e-5)
    assert "4 cables do not fix a pose" in remarks_on(exported, hanging)


def test_sensors_tell_what_a_force_sensor_would_read(exported):
    hanging = hang(POINTS, BODY)
    model, data = simulated(exported, hanging)
    data.ctrl[:] = np.linspace(0, 300, POINTS.m)
    data.qvel[:] = [0.05, -0.03, 0.02, 0.02, 0.04, -0.03]
    mujoco.mj_forward(model, data)
    read = np.array(
        [
            [data.sensor(f"{name}_{i + 1}").data[0] for name in ("length", "rate", "added")]
            for i in range(POINTS.m)
        ]
    )
    spring, damping = (
        model.tendon_stiffness.reshape(POINTS.m, -1)[:, 0],
        model.tendon_damping.reshape(POINTS.m, -1)[:, 0],
    )
    told = (
        spring * np.maximum(read[:, 0] - model.tendon_lengthspring[:, 1], 0)
        + damping * read[:, 1]
        + read[:, 2]
    )
    # By the wrench that all of it exerts on the platform.
    pull = POINTS.anchors - hanging.position - POINTS.attachments
    pull /= np.linalg.norm(pull, axis=1)[:, None]
    exerted = data.qfrc_spring + data.qfrc_damper + data.qfrc_actuator
    np.testing.assert_allclose(exerted[:3], told @ pull, rtol=1e-9, atol=1e-7)
    np.testing.assert_allclose(
        exerted[3:], told @ np.cross(POINTS.attachments, pull), rtol=1e-9, atol=1e-7
    )
