"""Foxglove: a client of its WebSocket, and the file of the same messages."""

import json
import socket
import struct
import time

import numpy as np
import pytest

from steelyard.errors import InputError
from steelyard.live.record import Record
from steelyard.live.sinks.foxglove import TOPIC
from steelyard.live.sinks.table import open_sink

pytestmark = pytest.mark.integration
pytest.importorskip("foxglove")


def record(i):
    value = np.where(np.arange(10) == 9, np.nan, np.arange(10.0))
    return Record(i / 4, "tool", value, np.full(10, 0.1), None, unmodelled=np.arange(6.0))


def opened(url):
    """A sink; the port of one that has ended is free again after a moment."""
    end = time.monotonic() + 60.0
    while True:
        try:
            return open_sink(url)
        except InputError:
            assert time.monotonic() < end
            time.sleep(0.1)


def told(client, count):
    """Messages of the topic."""
    found = []
    while len(found) < count:
        data = client.recv(timeout=60)
        if isinstance(data, str):
            said = json.loads(data)
            for each in said.get("channels", ()) if said["op"] == "advertise" else ():
                assert each["topic"] == TOPIC
                wanted = {"op": "subscribe", "subscriptions": [{"id": 7, "channelId": each["id"]}]}
                client.send(json.dumps(wanted))
                return []
        else:
            code, number, stamp = struct.unpack("<BIQ", data[:13])
            if code == 1:
                assert number == 7
                found.append((stamp, json.loads(data[13:])))
    return found


def test_a_client_sees_estimates_also_after_a_restart():
    from websockets.sync.client import connect

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    for _ in range(2):
        sink = opened(f"foxglove:{port}")
        with connect(f"ws://127.0.0.1:{port}", subprotocols=["foxglove.sdk.v1"]) as client:
            told(client, 1)
            # The server takes a subscription in its own time.
            got, count = [], 0
            while not got:
                sink.send(record(count))
                count += 1
                try:
                    data = client.recv(timeout=0.1)
                except TimeoutError:
                    continue
                got = [data] if isinstance(data, bytes) else []
            sent = range(count, count + 20)
            for i in sent:
                sink.send(record(i))
            found = told(client, 20)
        sink.close()
        assert [stamp for stamp, _ in found] == [i * 250_000_000 for i in sent]
        assert [each for _, each in found] == [record(i).to_dict() for i in sent]


def test_a_file_of_the_same_messages(tmp_path):
    from mcap.reader import make_reader

    path = tmp_path / "live.mcap"
    sink = open_sink(f"mcap:{path}")
    for i in range(5):
        sink.send(record(i))
    sink.close()
    with path.open("rb") as file:
        found = [
            (channel.topic, message.log_time, json.loads(message.data))
            for _, channel, message in make_reader(file).iter_messages()
        ]
    assert found == [(TOPIC, i * 250_000_000, record(i).to_dict()) for i in range(5)]
    with pytest.raises(InputError, match="a new file"):
        open_sink(f"mcap:{path}")


@pytest.mark.parametrize(
    "url", ["foxglove:", "foxglove:no", "foxglove:99999", "mcap:a.txt", "mcap:no/x.mcap"]
)
def test_addresses_that_are_none(url):
    with pytest.raises(InputError, match="publish: expected"):
        open_sink(url)


def test_a_port_that_is_taken_is_refused():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(InputError, match="choose another"):
            open_sink(f"foxglove:{taken.getsockname()[1]}")
