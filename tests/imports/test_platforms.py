"""Platforms from URDF and MJCF, held against Pinocchio and MuJoCo; anchors of cable printers."""

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from point_clouds import CLOUDS
from written_estimates import estimate_of

import steelyard
from steelyard.errors import InputError
from steelyard.exports.exported import Exported
from steelyard.exports.formats import export
from steelyard.robot.file import read_robot

TOLERANCE = 1e-12


def same(found, ten):
    for part in (slice(0, 1), slice(1, 4), slice(4, 10)):
        largest = np.abs(ten[part]).max()
        np.testing.assert_allclose(found[part], ten[part], rtol=0, atol=TOLERANCE * largest)


@pytest.mark.parametrize("form", ["urdf", "mjcf"])
@pytest.mark.parametrize("cloud", CLOUDS)
def test_what_was_exported_comes_back(tmp_path, cloud, form):
    path = tmp_path / "body.xml"
    path.write_text(export(Exported(estimate_of(cloud.ten)), form))
    found = steelyard.import_robot([path], robot="cogiro")
    same(found.robot.platform.body_parameters, cloud.ten)
    np.testing.assert_array_equal(found.robot.anchors, read_robot("cogiro").anchors)
    assert steelyard.import_robot([path]).robot.m == 0


URDF = """<robot name="r">
  <link name="world"/>
  <joint name="free" type="floating"><parent link="world"/><child link="base"/></joint>
  <link name="base"><inertial><origin xyz="0.1 -0.2 0.3" rpy="0.3 -0.4 0.5"/><mass value="12"/>
    <inertia ixx="2" iyy="3" izz="4" ixy="0.1" ixz="-0.2" iyz="0.3"/></inertial></link>
  <joint name="j" type="fixed"><origin xyz="1 2 3" rpy="0.1 0.2 -0.7"/><parent link="base"/><child link="arm"/></joint>
  <link name="arm"/>
  <joint name="k" type="fixed"><origin xyz="0 0.5 0"/><parent link="arm"/><child link="tip"/></joint>
  <link name="tip"><inertial><origin xyz="0 0 0.4" rpy="1 0 0"/><mass value="3"/>
    <inertia ixx="0.5" iyy="0.6" izz="0.7" ixy="0.01" ixz="0" iyz="0.02"/></inertial></link>
</robot>"""
MJCF = """<mujoco><worldbody><body name="a" pos="9 9 9" quat="0.7 0.1 0.2 0.3"><freejoint/>
  <inertial pos="0.1 -0.2 0.3" quat="0.9 0.1 -0.3 0.2" mass="12" diaginertia="2 3 4"/>
  <body name="b" pos="1 2 3" quat="0.5 0.5 -0.1 0.7">
    <inertial pos="0 0.1 0.4" mass="3" fullinertia="0.5 0.6 0.7 0.01 0.03 0.02"/></body>
</body></worldbody></mujoco>"""


def test_links_that_are_fixed_are_one_body_as_pinocchio_has_it(tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(URDF)
    found = steelyard.import_robot([path])
    # Pinocchio lumps what is fixed; its root may float.
    own = pin.buildModelFromXML(URDF).inertias[1]
    same(
        found.robot.platform.parameters,
        steelyard.Inertia.from_pinocchio(own.toDynamicParameters()).parameters,
    )
    assert "one body of 2 that are fixed to each other: base, tip" in found.notes


@pytest.mark.mujoco
def test_bodies_within_are_one_body_as_mujoco_moves_it(tmp_path):
    path = tmp_path / "robot.xml"
    path.write_text(MJCF)
    body = steelyard.import_robot([path]).robot.platform
    model = mujoco.MjModel.from_xml_string(MJCF)
    data = mujoco.MjData(model)
    data.qpos[:] = [0, 0, 0, 1, 0, 0, 0]
    mujoco.mj_forward(model, data)
    mass = np.zeros((6, 6))
    for i, unit in enumerate(np.eye(6)):
        mujoco.mj_mulM(model, data, mass[i], unit)
    h = body.first_moment
    cross = np.array([[0, -h[2], h[1]], [h[2], 0, -h[0]], [-h[1], h[0], 0]])
    expected = np.block([[body.mass * np.eye(3), -cross], [cross, body.inertia_about_origin]])
    np.testing.assert_allclose(mass, expected, rtol=0, atol=1e-11 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (URDF.replace('"j" type="fixed"', '"j" type="revolute"'), "expected joints of type 'fixed' within a platform, found 'revolute'"),
        (URDF.replace('value="12"', 'value="0"'), "expected a mass above 0"),
        ("<robot name='r'><link name='a'/></robot>", "expected a body with 'inertial', found none"),
        (MJCF.replace('quat="0.9 0.1 -0.3 0.2"', 'euler="1 2 3"'), "expected 'quat' for an orientation, found 'euler'"),
        (MJCF.replace('<body name="b" pos', '<body name="b"><joint/></body><body name="c" pos'), "found one with a joint"),
        ("<mujoco><worldbody><body><geom/></body></worldbody></mujoco>", "what MuJoCo takes from shapes"),
        ("<mujoco><worldbody/></mujoco>", "expected one body in the world"),
    ],
)  # fmt: skip
def test_what_is_no_platform_is_refused(tmp_path, text, message):
    path = tmp_path / "body.xml"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        steelyard.import_robot([path])


# Cable printers

REPRAP = """; Hangprinter
M669 K0
M669 K6 A0.00:-1604.54:-114.08 B1312.51:1270.88:-162.19 C-1440.27:741.63:-161.23 D2345.00 P2000
M666 Q0.035 ; buildup
"""
KLIPPER = """[printer]
kinematics: winch
[stepper_a]
anchor_x: 0
anchor_y: -2000 # metres? no
anchor_z = -100
[stepper_b]
anchor_x: 2000
anchor_y: 1000
anchor_z: -100
[extruder]
rotation_distance: 33
"""


@pytest.mark.parametrize(
    ("name", "text", "anchors"),
    [
        ("config.g", REPRAP, [[0, -1.60454, -0.11408], [1.31251, 1.27088, -0.16219], [-1.44027, 0.74163, -0.16123], [0, 0, 2.345]]),
        ("config.g", REPRAP.replace("D2345.00", "D1:2:2345"), [[0, -1.60454, -0.11408], [1.31251, 1.27088, -0.16219], [-1.44027, 0.74163, -0.16123], [0.001, 0.002, 2.345]]),
        ("printer.cfg", KLIPPER, [[0, -2, -0.1], [2, 1, -0.1]]),
    ],
)  # fmt: skip
def test_anchors_of_printers(run, tmp_path, name, text, anchors):
    (tmp_path / name).write_text(text)
    status, out, err = run("import", tmp_path / name, "--out", tmp_path / "robot.yaml")
    assert (status, err) == (0, "")
    assert "all cables are assumed to meet in the origin of the platform" in out
    robot = read_robot(str(tmp_path / "robot.yaml"))
    np.testing.assert_allclose(robot.anchors, anchors, rtol=0, atol=1e-12)
    assert not robot.attachments.any()


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.g", "G28\n", "found lines without anchors"),
        ("a.g", "M669 K6 A1:2 B1:2:3\n", "a.g:1: expected x:y:z of anchor A, found '1:2'"),
        ("a.cfg", KLIPPER.replace("anchor_z = -100\n", "", 1), "a.cfg:3: .*found no anchor_z; add it"),
        ("a.cfg", KLIPPER.replace("2000 #", "far #"), "a.cfg:5: expected a number .*found '-far'"),
    ],
)  # fmt: skip
def test_what_is_no_printer_is_refused(tmp_path, name, text, message):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=message):
        steelyard.import_robot([tmp_path / name])


def test_the_verb_puts_a_platform_into_its_robot(run, tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(URDF)
    status, out, err = run("import", path, "--robot", "cogiro", "--out", tmp_path / "robot.yaml")
    assert (status, err) == (0, "")
    assert "cables, limits and gravity are those of robot 'cogiro'" in out
    robot = read_robot(str(tmp_path / "robot.yaml"))
    assert (robot.m, robot.platform.mass) == (8, 15.0)
    (tmp_path / "a.g").write_text(REPRAP)
    status, _, err = run(
        "import", tmp_path / "a.g", "--robot", "cogiro", "--out", tmp_path / "x.yaml"
    )
    assert status == 2
    assert "--robot: expected none, as configuration of a cable printer has cables" in err
