"""Where messages of robot middleware hold what the contract has in columns."""

from __future__ import annotations

import re
from collections.abc import Collection

_FIELDS: dict[str, tuple[str, ...]] = {
    "t": ("header.stamp", "receive_time"),
    **{f"w{axis}": (f"angular_velocity.{axis}",) for axis in "xyz"},
    **{f"a{axis}": (f"linear_acceleration.{axis}",) for axis in "xyz"},
    **{f"f{axis}": (f"wrench.force.{axis}", f"force.{axis}") for axis in "xyz"},
    **{f"t{axis}": (f"wrench.torque.{axis}", f"torque.{axis}") for axis in "xyz"},
    **{
        axis: (
            f"point.{axis}",
            f"pose.position.{axis}",
            f"transform.translation.{axis}",
            f"position.{axis}",
        )
        for axis in "xyz"
    },
    **{
        f"q{axis}": (
            f"orientation.{axis}",
            f"pose.orientation.{axis}",
            f"transform.rotation.{axis}",
            f"quaternion.{axis}",
        )
        for axis in "wxyz"
    },
}
"""Column of the contract -> fields of messages (sensor_msgs/Imu, geometry_msgs/…Stamped) that hold
it."""

_PER_CABLE = {"f": ("effort", "data"), "l": ("position", "data")}
"""Columns of one cable each -> arrays of messages (sensor_msgs/JointState,
std_msgs/Float64MultiArray) that hold them."""


def column_in(log: Collection[str], column: str, named: str | None) -> str | None:
    """Column of a log that holds a column of the contract.

    Args:
        log: Names in the log.
        column: Name in the contract.
        named: What the experiment file calls it; None: it says nothing.

    Returns:
        The name in the log; None where there is none.
    """
    if named is not None:
        # Paths may be written as of folders.
        return next(
            (name for name in (named, named.strip("/").replace("/", ".")) if name in log), None
        )
    if column in log:
        return column
    fields = _FIELDS.get(column, ())
    cable = re.fullmatch(r"([fl])([1-9]\d*)", column)
    if cable:
        fields = tuple(f"{array}[{int(cable[2]) - 1}]" for array in _PER_CABLE[cable[1]])
    return next((field for field in fields if field in log), None)
