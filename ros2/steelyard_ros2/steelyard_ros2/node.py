"""The node: topics out as datagrams, estimates in as datagrams."""

import json
import socket
import time

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import InertiaStamped
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rosidl_runtime_py.utilities import get_message
from std_msgs.msg import Float64MultiArray, MultiArrayDimension

from steelyard_ros2.convert import (
    COLUMNS,
    address_of,
    covariance,
    fill_inertia,
    sample,
    topics_of,
    verdict,
)


class Bridge(Node):
    """Forwards topics to steelyard watch and publishes its estimates."""

    def __init__(self):
        super().__init__("steelyard")
        topics = self.declare_parameter("topics", [""]).value
        self._waiting = topics_of([each for each in topics if each])
        self._send = address_of(self.declare_parameter("send", "127.0.0.1:7001").value)
        receive = address_of(self.declare_parameter("receive", "127.0.0.1:7002").value)
        self._frame = self.declare_parameter("frame", "platform").value
        self._out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._in = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._in.bind(receive)
        self._in.setblocking(False)
        self._last, self._came = None, 0.0
        self._inertia = self.create_publisher(InertiaStamped, "~/inertia", 10)
        self._covariance = self.create_publisher(Float64MultiArray, "~/covariance", 10)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.create_timer(1.0, self._look_for_topics)
        self.create_timer(0.05, self._read)
        self.create_timer(1.0, self._diagnose)

    def _look_for_topics(self):
        """Subscribe to what has a publisher by now: it says the type."""
        kinds = dict(self.get_topic_names_and_types())
        for instrument, topic in list(self._waiting.items()):
            kind = next((each for each in kinds.get(topic, ()) if each in COLUMNS), None)
            if kind is None:
                if topic in kinds:
                    known = ", ".join(COLUMNS)
                    self.get_logger().error(
                        f"{topic}: expected one of {known}, found {kinds[topic]}", once=True
                    )
                continue
            del self._waiting[instrument]
            self.create_subscription(
                get_message(kind), topic, self._forward(instrument, kind), qos_profile_sensor_data
            )
            self.get_logger().info(f"{instrument}: {topic} ({kind})")

    def _forward(self, instrument, kind):
        def came(message):
            self._out.sendto(sample(instrument, kind, message).encode(), self._send)

        return came

    def _read(self):
        """Publish every estimate that has come."""
        while True:
            try:
                data = self._in.recv(65_535)
            except BlockingIOError:
                return
            try:
                estimate = json.loads(data)
                message = InertiaStamped()
                fill_inertia(estimate, message.inertia)
                numbers = covariance(estimate)
            except (ValueError, KeyError, TypeError):
                self.get_logger().warning(
                    "no estimate of steelyard watch", throttle_duration_sec=10
                )
                continue
            self._last, self._came = estimate, time.monotonic()
            message.header.stamp = self.get_clock().now().to_msg()
            message.header.frame_id = self._frame
            self._inertia.publish(message)
            array = Float64MultiArray(data=numbers)
            array.layout.dim = [
                MultiArrayDimension(label="row", size=10, stride=100),
                MultiArrayDimension(label="column", size=10, stride=10),
            ]
            self._covariance.publish(array)

    def _diagnose(self):
        level, text, values = verdict(self._last, time.monotonic() - self._came)
        status = DiagnosticStatus(name="steelyard: platform", message=text)
        status.level = bytes([level])
        status.values = [KeyValue(key=key, value=value) for key, value in values.items()]
        array = DiagnosticArray(status=[status])
        array.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(array)


def main():
    """Run the node."""
    rclpy.init()
    node = Bridge()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
