"""Fields of messages, by the names of the messages' own definitions."""

import pytest

from steelyard.experiment.streams.fields import column_in

IMU = ["header.stamp", "orientation.w", "angular_velocity.x", "linear_acceleration.z"]


@pytest.mark.parametrize(
    ("log", "column", "found"),
    [
        (IMU, "t", "header.stamp"),
        (IMU, "wx", "angular_velocity.x"),
        (IMU, "az", "linear_acceleration.z"),
        (IMU, "qw", "orientation.w"),
        (IMU, "wy", None),
        (["wrench.torque.y"], "ty", "wrench.torque.y"),
        (["pose.position.x"], "x", "pose.position.x"),
        (["effort[0]", "effort[7]"], "f8", "effort[7]"),
        (["position[0]"], "l1", "position[0]"),
        (["effort[0]"], "f0", None),
        (["f1", "effort[0]"], "f1", "f1"),
    ],
)
def test_where_a_column_is(log, column, found):
    assert column_in(log, column, None) == found


def test_what_the_file_calls_it_counts_alone():
    log = ["wx", "imu.rate.x"]
    assert column_in(log, "wx", "imu.rate.x") == "imu.rate.x"
    assert column_in(log, "wx", "/imu/rate/x") == "imu.rate.x"
    assert column_in(log, "wx", "elsewhere") is None
