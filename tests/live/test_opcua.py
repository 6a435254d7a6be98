"""OPC UA: a real server on the loopback address, killed and started again in mid-stream."""

import asyncio
import json
import re
import socket
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from places import DATA
from simulated import PAPER

from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.experiment.read import read_plan
from steelyard.live.record import Record
from steelyard.live.sinks.table import open_sink
from steelyard.live.sources.table import open_source
from steelyard.robot.file import read_robot

pytestmark = pytest.mark.integration
pytest.importorskip("asyncua")

FORCES = [f"f{i}" for i in range(1, 9)]
TURNS = ["wx", "wy", "wz"]
PUSHES = ["ax", "ay", "az"]
START = 1.7e9


def free_port():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


def with_nodes(**nodes):
    instruments = {
        name: PAPER[name].model_copy(update={"nodes": tuple((c, f"ns=2;s={c}") for c in columns)})
        for name, columns in nodes.items()
    }
    return Experiment("plan", read_robot("cogiro"), {**PAPER, **instruments}, ())


PLAN = with_nodes(cables=FORCES, imu=TURNS + PUSHES)


class Server:
    """A process that can be killed."""

    def __init__(self, port):
        script = Path(__file__).with_name("opcua_server.py")
        command = [sys.executable, str(script), str(port), *FORCES, *TURNS, *PUSHES]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        assert self.process.stdout.readline() == "ready\n"

    def write(self, *values):
        print(json.dumps(values), file=self.process.stdin, flush=True)
        assert self.process.stdout.readline() == "done\n"

    def kill(self):
        self.process.kill()
        self.process.communicate()


def forces(i):
    # The first does not change: only its time stamp says that there is a new sample.
    return (START + 0.01 * i, {name: 100.0 + (k and i + k) for k, name in enumerate(FORCES)})


def received(source, done, seconds=60.0):
    """Arrivals, remarks and refusals until there is enough."""
    arrivals, remarks, refused, end = [], [], [], time.monotonic() + seconds
    while not done(arrivals, remarks, refused) and time.monotonic() < end:
        found = source.receive(0.05)
        arrivals += found.arrivals
        remarks += found.remarks
        refused += [found.why] * found.refused
    return arrivals, remarks, refused


def samples(arrivals, name):
    return sum(len(each.stream) for each in arrivals if each.instrument == name)


def connected(arrivals, remarks, refused):
    return any(each.endswith(": connected") for each in remarks)


@pytest.mark.slow
@pytest.mark.long
def test_a_server_that_is_killed_is_found_again():
    port = free_port()
    source = open_source(f"opc.tcp://127.0.0.1:{port}", PLAN)
    _, remarks, _ = received(source, lambda a, r, _: r)
    assert "no connection" in remarks[0]
    got, server = [], None
    for turn in range(2):
        server = Server(port)
        received(source, connected)
        own = range(100 * turn, 100 * turn + 60)
        server.write(*map(forces, own))
        arrivals, _, refused = received(source, lambda a, r, _: samples(a, "cables") >= 60)
        assert not refused
        got += arrivals
        server.kill()
        arrivals, remarks, _ = received(source, lambda a, r, _: r)
        assert not arrivals
        assert "connection lost" in remarks[0]
    source.close()
    time_ = np.concatenate([each.stream.time for each in got])
    tension = np.concatenate([each.stream.values["tension"] for each in got])
    sent = [forces(i) for i in (*range(60), *range(100, 160))]
    assert time_ == pytest.approx([t for t, _ in sent], abs=1e-6)
    assert tension.tolist() == [list(values.values()) for _, values in sent]


@pytest.mark.slow
def test_what_is_no_number_and_what_comes_alone_is_refused():
    port = free_port()
    server = Server(port)
    source = open_source(f"opc.tcp://127.0.0.1:{port}", PLAN)
    received(source, connected)
    imu = dict.fromkeys(TURNS + PUSHES, 0.5)
    server.write(
        (START, {**imu, "wx": None}),
        (START + 0.1, {**imu, "wx": 1e20}),
        (START + 0.2, {"wx": 0.1}),
        (START + 0.2001, {name: 0.1 for name in imu if name != "wx"}),
    )
    arrivals, _, refused = received(source, lambda a, *_: samples(a, "imu") >= 2)
    server.kill()
    source.close()
    together = np.concatenate([each.stream.values["angular_velocity"] for each in arrivals])
    assert np.isnan(together[0]).tolist() == [True, False, False]
    assert together[1].tolist() == [0.1] * 3
    assert len(refused) == 1
    assert "expected a reading" in refused[0]


@pytest.mark.slow
def test_nodes_that_a_server_has_not_are_named():
    port = free_port()
    server = Server(port)
    plan = with_nodes(tracker=["x", "y", "z"])
    source = open_source(f"opc.tcp://127.0.0.1:{port}", plan)
    _, remarks, _ = received(source, lambda a, r, _: r)
    assert "the server has no nodes ns=2;s=x, ns=2;s=y, ns=2;s=z" in remarks[0]
    source.close()
    server.kill()


@pytest.mark.parametrize(
    ("plan", "url", "said"),
    [
        (with_nodes(), "opc.tcp://localhost:4840", "expected instruments with 'nodes'"),
        (with_nodes(cables=FORCES[:3]), "opc.tcp://localhost:4840", "'nodes' of cables: expected"),
        (PLAN, "opc.tcp://localhost", "give host and port"),
        (
            replace(
                PLAN, instruments={"c": PAPER["cables"].model_copy(update={"nodes": tuple((c, "ns=x") for c in FORCES)})}
            ),
            "opc.tcp://localhost:4840",
            "instruments.c.nodes.f1: expected a node id",
        ),
    ],
)  # fmt: skip
def test_plans_that_name_no_nodes_are_refused(plan, url, said):
    with pytest.raises(InputError, match=said):
        open_source(url, plan)


@pytest.mark.slow
def test_a_port_that_is_taken_is_refused():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(InputError, match="choose another"):
            open_sink(f"opc.tcp://127.0.0.1:{taken.getsockname()[1]}")


@pytest.mark.slow
def test_every_number_is_a_node():
    import asyncua

    port = free_port()
    url = f"opc.tcp://127.0.0.1:{port}"

    async def read(names):
        async with asyncua.Client(url) as client:
            space = await client.get_namespace_index("urn:steelyard:watch")
            nodes = [client.get_node(f"ns={space};s={name}") for name in names]
            return [await each.read_data_value(raise_on_bad_status=False) for each in nodes]

    for mass in (20.0, 21.0):
        # The second one is on the port of the first, which is gone.
        sink = open_sink(url)
        value = np.array([mass, *np.arange(1.0, 10.0)])
        deviation = np.array([np.nan, *np.full(9, 0.1)])
        sink.send(Record(1.5, "tool", value, deviation, None, ("a", "b")))
        found = asyncio.run(read(["t", "mass", "Jxy", "sigma_mass", "accepted", "load", "reasons"]))
        sink.close()
        assert [each.Value.Value for each in found] == [
            1.5, mass, 9.0, None, None, "tool", "a; b",
        ]  # fmt: skip
        assert [each.StatusCode.is_good() for each in found] == [
            True, True, True, False, False, True, True,
        ]  # fmt: skip
        assert len({each.SourceTimestamp for each in found}) == 1


def test_nodes_stand_in_the_experiment_file(tmp_path):
    text = (DATA / "points-00" / "experiment.yaml").read_text()
    text = text.partition("runs:")[0].replace("../cogiro-points.yaml", "cogiro")
    text = re.sub(r"kind: (?!command)(\w+)", r"kind: \1\n    rate: 100", text)
    path = tmp_path / "experiment.yaml"
    path.write_text(text.replace("target:", "nodes: {x: ns=2;s=x, y: ns=2;i=7}\n    target:", 1))
    found = read_plan(path).instruments["tracker"]
    assert dict(found.nodes) == {"x": "ns=2;s=x", "y": "ns=2;i=7"}
    assert hash(found) == hash(read_plan(path).instruments["tracker"])
    path.write_text(text.replace("target:", "nodes: {f1: ns=2;s=x}\n    target:", 1))
    with pytest.raises(InputError, match="expected a column of the kind 'position', found 'f1'"):
        read_plan(path)
