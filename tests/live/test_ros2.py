"""The ROS 2 bridge: its conversions, with messages that have the same fields."""

import ast
import importlib.util
import json
import math
from types import SimpleNamespace as Message
from xml.etree import ElementTree

import numpy as np
import pytest
from places import ROOT
from simulated import PAPER

from steelyard.instruments import Pose, Wrench
from steelyard.live.message import arrivals_of
from steelyard.live.record import Record

FOLDER = ROOT / "ros2" / "steelyard_ros2"


def module():
    place = FOLDER / "steelyard_ros2" / "convert.py"
    spec = importlib.util.spec_from_file_location("steelyard_ros2_convert", place)
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


convert = module()
HEADER = Message(stamp=Message(sec=1700000000, nanosec=250_000_000))
POINT = Message(x=0.1, y=0.2, z=0.3)
TURN = Message(w=0.5, x=0.5, y=0.5, z=0.5)
INSTRUMENTS = {**PAPER, "pose": Pose(kind="pose"), "sensor": Wrench(kind="wrench")}
IMU = Message(
    header=HEADER,
    angular_velocity=POINT,
    linear_acceleration=Message(x=0.0, y=math.nan, z=9.81),
    orientation=TURN,
    orientation_covariance=[0.0] * 9,
)


def stream(instrument, kind, message):
    line = convert.sample(instrument, kind, message)
    (found,) = arrivals_of(line.encode(), INSTRUMENTS, 8)
    assert found.stream.time.tolist() == [1700000000.25]
    return {name: values[0] for name, values in found.stream.values.items()}


def test_messages_become_samples_that_are_read():
    joints = Message(header=HEADER, effort=[200.0 + i for i in range(8)])
    found = stream("cables", "sensor_msgs/msg/JointState", joints)
    assert found["tension"].tolist() == joints.effort
    found = stream("imu", "sensor_msgs/msg/Imu", IMU)
    assert found["angular_velocity"].tolist() == [0.1, 0.2, 0.3]
    assert np.isnan(found["specific_force"]).tolist() == [False, True, False]
    # A third of a turn about the diagonal: x to y, y to z, z to x.
    assert found["orientation"] == pytest.approx(np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]]))
    blind = Message(**{**vars(IMU), "orientation_covariance": [-1.0] + [0.0] * 8})
    assert "orientation" not in stream("imu", "sensor_msgs/msg/Imu", blind)
    point = Message(header=HEADER, point=POINT)
    found = stream("tracker", "geometry_msgs/msg/PointStamped", point)
    assert found["position"].tolist() == [0.1, 0.2, 0.3]
    pose = Message(header=HEADER, pose=Message(position=POINT, orientation=TURN))
    assert "position" in stream("pose", "geometry_msgs/msg/PoseStamped", pose)
    wrench = Message(header=HEADER, wrench=Message(force=POINT, torque=TURN))
    assert len(stream("sensor", "geometry_msgs/msg/WrenchStamped", wrench)) == 2


def test_estimates_become_messages():
    value = np.array([20.0, 0.1, 0.2, 0.3, 1.0, 2.0, 3.0, 0.4, 0.5, np.nan])
    line = json.loads(Record(2.5, "tool", value, 0.1 * value, False, ("a", "b")).line)
    message = convert.fill_inertia(line, Message(com=Message()))
    assert (message.m, message.com.x, message.com.y, message.com.z) == (20.0, 0.1, 0.2, 0.3)
    assert (message.ixx, message.iyy, message.izz) == (1.0, 2.0, 3.0)
    assert (message.iyz, message.ixz) == (0.4, 0.5)
    assert math.isnan(message.ixy)
    found = np.array(convert.covariance(line)).reshape(10, 10)
    assert np.diag(found) == pytest.approx((0.1 * value) ** 2, nan_ok=True)
    assert np.isnan(found[~np.eye(10, dtype=bool)]).all()
    assert convert.verdict(line, 0.1) == (
        1, "not accepted", {"load": "tool", "t": "2.500", "reason 1": "a", "reason 2": "b"},
    )  # fmt: skip
    assert convert.verdict({**line, "accepted": True}, 0.1)[:2] == (0, "accepted")
    assert convert.verdict({**line, "accepted": None}, 0.1)[0] == 3
    assert convert.verdict(line, 20.0)[0] == convert.verdict(None, 0.0)[0] == 3


def test_what_nothing_tells_is_no_number():
    nothing = np.full(10, np.nan)
    line = json.loads(Record(2.5, "tool", nothing, nothing, None).line)
    message = convert.fill_inertia(line, Message(com=Message()))
    assert math.isnan(message.m)
    assert all(math.isnan(each) for each in convert.covariance(line))


def test_parameters():
    assert convert.topics_of(["imu:/a/b", "cables:/c"]) == {"imu": "/a/b", "cables": "/c"}
    assert convert.address_of("host:7") == ("host", 7)
    for wrong in (["imu"], ["imu:/a", "imu:/b"], [":/a"]):
        with pytest.raises(ValueError, match="INSTRUMENT:TOPIC"):
            convert.topics_of(wrong)
    with pytest.raises(ValueError, match="HOST:PORT"):
        convert.address_of("7001")


def test_the_package_is_whole():
    package = ElementTree.parse(FOLDER / "package.xml").getroot()
    assert package.findtext("name") == "steelyard_ros2"
    assert (FOLDER / "resource" / "steelyard_ros2").exists()
    depends = {each.text for each in package.findall("exec_depend")}
    node = ast.parse((FOLDER / "steelyard_ros2" / "node.py").read_text())
    for each in ast.walk(node):
        if isinstance(each, ast.ImportFrom) and each.module.split(".")[0].endswith("_msgs"):
            assert each.module.split(".")[0] in depends
