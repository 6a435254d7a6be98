"""MQTT: a real broker on the loopback address, killed and started again in mid-stream."""

import os
import shutil
import socket
import subprocess
import time

import numpy as np
import pytest

from steelyard.live.record import Record
from steelyard.live.sinks.table import open_sink
from steelyard.live.sources.mqtt import MqttTransport

pytestmark = pytest.mark.integration
BROKER = shutil.which("mosquitto", path=f"{os.environ.get('PATH', '')}:/usr/sbin:/usr/local/sbin")
needs_broker = pytest.mark.skipif(
    BROKER is None, reason="no broker: install mosquitto (apt-get install mosquitto)"
)


class Broker:
    """A process that can be killed."""

    def __init__(self, port, folder):
        settings = folder / "mosquitto.conf"
        settings.write_text(f"listener {port} 127.0.0.1\nallow_anonymous true\n")
        self.process = subprocess.Popen(
            [BROKER, "-c", str(settings)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        end = time.monotonic() + 30.0
        while time.monotonic() < end:
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", port)) == 0:
                    return
            time.sleep(0.02)
        raise AssertionError("the broker does not begin")

    def kill(self):
        self.process.kill()
        self.process.wait()


def looked_at(transport, done, seconds=60.0):
    """Messages and remarks until there is enough."""
    messages, remarks, end = [], [], time.monotonic() + seconds
    while not done(messages, remarks) and time.monotonic() < end:
        new, said = transport.messages(0.05)
        messages += new
        remarks += said
    return messages, remarks


def holds(message):
    return lambda messages, remarks: message in messages


def record(i):
    return Record(float(i), "tool", np.arange(10.0), np.full(10, 0.1), True)


@needs_broker
def test_a_broker_that_is_killed_is_found_again(tmp_path):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    url = f"mqtt://127.0.0.1:{port}/arm"
    transport = MqttTransport(f"{url}/#")
    sink, count = open_sink(f"{url}/estimate"), 0
    for _ in range(2):
        broker = Broker(port, tmp_path)
        looked_at(transport, lambda m, r: any("connected" in each for each in r))
        # Of the sink nobody says when it has connected: what is sent before that may be lost.
        got, end = [], time.monotonic() + 60.0
        while not got and time.monotonic() < end:
            count += 1
            sink.send(record(count))
            got, _ = looked_at(transport, lambda m, r: m, 0.2)
        first = count
        for count in range(first + 1, first + 51):
            sink.send(record(count))
        sent = [record(i).line.encode() for i in range(first + 1, first + 51)]
        got, _ = looked_at(transport, holds(sent[-1]))
        assert got[-50:] == sent
        broker.kill()
        _, remarks = looked_at(transport, lambda m, r: r)
        assert "connection lost, connecting again" in remarks[0]
    sink.close()
    transport.close()
