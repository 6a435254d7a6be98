"""From messages of ROS to samples of steelyard, and from its estimates to messages; no ROS is
imported here: messages are whatever has their fields.
"""

import json
import math

TEN = ("mass", "cx", "cy", "cz", "Jxx", "Jyy", "Jzz", "Jyz", "Jxz", "Jxy")
"""Order of the covariance."""
PLACES = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
"""Where xx, yy, zz, yz, xz, xy stand in the inertia matrix."""
OK, WARN, STALE = 0, 1, 3
"""Levels of diagnostic_msgs/msg/DiagnosticStatus."""


def seconds(stamp):
    """Time of a header [s]."""
    return stamp.sec + 1e-9 * stamp.nanosec


def _number(value):
    """Null where a sensor has nothing: JSON knows no NaN."""
    return float(value) if math.isfinite(value) else None


def _vector(names, vector):
    return {name: _number(getattr(vector, axis)) for name, axis in zip(names, "xyz", strict=True)}


def _quaternion(q):
    return {f"q{axis}": _number(getattr(q, axis)) for axis in "wxyz"}


def _joints(message):
    return {f"f{i}": _number(force) for i, force in enumerate(message.effort, start=1)}


def _imu(message):
    found = _vector(("wx", "wy", "wz"), message.angular_velocity)
    found |= _vector(("ax", "ay", "az"), message.linear_acceleration)
    # By the definition of the message, -1 says that there is no orientation.
    if message.orientation_covariance[0] != -1:
        found |= _quaternion(message.orientation)
    return found


def _point(message):
    return _vector("xyz", message.point)


def _pose(message):
    return {**_vector("xyz", message.pose.position), **_quaternion(message.pose.orientation)}


def _wrench(message):
    force = _vector(("fx", "fy", "fz"), message.wrench.force)
    return {**force, **_vector(("tx", "ty", "tz"), message.wrench.torque)}


COLUMNS = {
    "sensor_msgs/msg/JointState": _joints,
    "sensor_msgs/msg/Imu": _imu,
    "geometry_msgs/msg/PointStamped": _point,
    "geometry_msgs/msg/PoseStamped": _pose,
    "geometry_msgs/msg/WrenchStamped": _wrench,
}
"""Type of a message -> its columns."""


def sample(instrument, kind, message):
    """A message as a line of JSON that steelyard reads.

    Args:
        instrument: Its name in the experiment file.
        kind: Type of the message, one of COLUMNS.
        message: With the fields of that type.
    """
    found = {"instrument": instrument, "t": seconds(message.header.stamp)}
    return json.dumps({**found, **COLUMNS[kind](message)}, allow_nan=False)


def topics_of(entries):
    """Instrument -> topic, from entries INSTRUMENT:TOPIC.

    Raises:
        ValueError: An entry is none, or an instrument has two.
    """
    found = {}
    for entry in entries:
        name, colon, topic = entry.partition(":")
        if not (name and colon and topic) or name in found:
            raise ValueError(f"topics: expected INSTRUMENT:TOPIC, each once, found '{entry}'")
        found[name] = topic
    return found


def address_of(text):
    """Host and port.

    Raises:
        ValueError: It is no such address.
    """
    host, _, port = text.rpartition(":")
    if not host or not port.isdigit():
        raise ValueError(f"expected HOST:PORT, found '{text}'")
    return host, int(port)


def _known(value):
    return math.nan if value is None else float(value)


def fill_inertia(estimate, message):
    """An estimate in the fields of geometry_msgs/msg/Inertia: about the centre of gravity, along
    the axes of the platform frame; NaN where the data do not tell a number.
    """
    message.m = _known(estimate["mass"])
    place = estimate["center_of_gravity"] or [None] * 3
    message.com.x, message.com.y, message.com.z = map(_known, place)
    J = estimate["inertia"] or [[None] * 3] * 3
    for name, (i, j) in zip(("ixx", "iyy", "izz", "iyz", "ixz", "ixy"), PLACES, strict=True):
        setattr(message, name, _known(J[i][j]))
    return message


def covariance(estimate):
    """Covariance of TEN, row by row, 100 numbers: squares of the standard deviations, NaN beside
    the diagonal, where lines of watch say nothing.
    """
    sigma = estimate["standard_deviation"]
    place = sigma["center_of_gravity"] or [None] * 3
    J = sigma["inertia"] or [[None] * 3] * 3
    ten = [_known(each) for each in (sigma["mass"], *place, *(J[i][j] for i, j in PLACES))]
    return [ten[i] ** 2 if i == j else math.nan for i in range(10) for j in range(10)]


def verdict(estimate, age):
    """Level, message and values of a diagnostic status.

    Args:
        estimate: The last one; None: there was none.
        age: Since it came [s].
    """
    if estimate is None or age > 10.0:
        return STALE, "no estimates from steelyard watch", {}
    values = {"load": estimate["load"], "t": f"{estimate['t']:.3f}"}
    if estimate["accepted"] is None:
        return STALE, "not judged yet", values
    if estimate["accepted"]:
        return OK, "accepted", values
    values |= {f"reason {i}": each for i, each in enumerate(estimate["reasons"], start=1)}
    return WARN, "not accepted", values
