"""The verb, and connections to real servers on the loopback address."""

import json
import socket
import time

import numpy as np
import polars as pl
import pytest
from places import DATA

from steelyard.errors import InputError
from steelyard.live.record import Record
from steelyard.live.sinks.table import open_sink
from steelyard.live.sources.mqtt import mqtt_client
from steelyard.live.sources.zeromq import ZeroMqTransport

pytestmark = pytest.mark.integration
RECORD = Record(1.5, "tool", np.arange(10.0), np.full(10, 0.1), True)
POINTS = DATA / "points-00" / "experiment.yaml"


def free_port():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


@pytest.fixture(scope="module")
def watched(tmp_path_factory):
    """Lines of a replay, and the folder that it was written to."""
    import subprocess
    import sys

    folder = tmp_path_factory.mktemp("watched")
    command = [sys.executable, "-m", "steelyard", "watch", str(POINTS)]
    command += ["--source", "replay:sine-0@max", "--out", str(folder / "live.jsonl")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder, [json.loads(line) for line in done.stdout.splitlines()], done.stderr


def test_a_replay_prints_one_line_for_every_estimate(watched):
    folder, lines, said = watched
    assert len(lines) > 20
    assert {"t", "load", "mass", "center_of_gravity", "inertia"} <= lines[0].keys()
    assert {"standard_deviation", "accepted", "events"} <= lines[0].keys()
    assert np.all(np.diff([line["t"] for line in lines]) > 0)
    first, last = lines[0]["standard_deviation"], lines[-1]["standard_deviation"]
    assert last["mass"] < first["mass"]
    assert lines[-1]["accepted"] is True
    assert said == ""  # narration is for terminals
    assert [json.loads(line) for line in (folder / "live.jsonl").read_text().splitlines()] == lines


def test_the_end_is_an_estimate_as_identify_writes_it(watched):
    folder, lines, _ = watched
    found = json.loads((folder / "estimate.json").read_text())
    assert found["format"] == "steelyard-estimate/1"
    assert found["result"] == "recursive"
    own = found["estimates"]["recursive"]
    assert own["verdict"]["accepted"] is True
    assert own["mass"] == pytest.approx(lines[-1]["mass"], abs=0.5)


@pytest.mark.slow
def test_fewer_lines_a_table_and_an_early_end(run, tmp_path):
    out = tmp_path / "live.parquet"
    status, text, _ = run(
        "watch", POINTS, "--source", "replay:sine-0@max", "--rate", 0.5, "--until", 12,
        "--out", out, "--quiet",
    )  # fmt: skip
    assert status in (0, 3)
    lines = [json.loads(line) for line in text.splitlines()]
    assert np.all(np.diff([line["t"] for line in lines]) >= 2.0)
    table = pl.read_parquet(out)
    assert table["t"].to_list() == pytest.approx([line["t"] for line in lines], abs=1e-6)
    assert {"mass", "sigma_mass", "Jxy", "sigma_Jxy"} <= set(table.columns)


@pytest.mark.slow
def test_estimates_are_passed_on(run):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as far:
        far.bind(("127.0.0.1", 0))
        far.settimeout(10)
        url = f"udp://127.0.0.1:{far.getsockname()[1]}"
        _, text, _ = run(
            "watch", POINTS, "--source", "replay:sine-0@max", "--until", 9, "--publish", url
        )
        lines = text.splitlines()
        assert [far.recv(1 << 16).decode() for _ in lines] == lines


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--source", "ftp://host:1"], "--source: expected replay:RUN"),
        (["--source", "replay:nothing@max"], "expected one of sine-0, found 'nothing'"),
        (["--source", "replay:sine-0@-1"], "positive number or 'max'"),
        (["--source", "udp://127.0.0.1"], "give host and port"),
        (["--source", "replay:sine-0", "--publish", "tcp://host:1"], "--publish: expected"),
        (["--source", "mqtt://host"], "a topic"),
        ([], "Missing option '--source'"),
    ],
)
def test_what_cannot_be_watched_is_said(run, options, said):
    status, out, err = run("watch", POINTS, *options)
    assert (status, out) == (2, "")
    assert said in err
    assert err.count("\n") == 1


def test_what_is_there_is_not_overwritten(run, tmp_path):
    (tmp_path / "estimate.json").write_text("{}")
    status, _, err = run(
        "watch", POINTS, "--source", "replay:sine-0@max", "--out", tmp_path / "live.jsonl"
    )
    assert status == 2
    assert "estimate.json" in err
    assert not (tmp_path / "live.jsonl").exists()


@pytest.mark.parametrize(
    ("url", "expected"),
    [
        ("mqtt://broker/arm/cell", ("broker", 1883, "arm/cell")),
        ("mqtt://broker:18830/arm/#", ("broker", 18830, "arm/#")),
        ("mqtt://user:p%40ss@broker/+/cell", ("broker", 1883, "+/cell")),
    ],
)
def test_topics_may_have_wildcards(url, expected):
    _, *found = mqtt_client(url)
    assert tuple(found) == expected


def received(transport, count, until=20.0):
    """Messages and remarks, until there are so many messages."""
    messages, remarks, end = [], [], time.monotonic() + until
    while len(messages) < count and time.monotonic() < end:
        new, said = transport.messages(0.05)
        messages += new
        remarks += said
    return messages, remarks


def sent_until_received(sink, transport, count):
    """Send until so many arrive: a subscriber hears nothing before it has connected."""
    messages, remarks, end = [], [], time.monotonic() + 30.0
    while len(messages) < count and time.monotonic() < end:
        sink.send(RECORD)
        new, said = received(transport, 1, 0.1)
        messages += new
        remarks += said
    return messages, remarks


def test_a_publisher_that_is_killed_is_found_again():
    url = f"zmq+tcp://127.0.0.1:{free_port()}"
    transport = ZeroMqTransport(url)
    for turn in range(2):
        sink = open_sink(url)
        messages, remarks = sent_until_received(sink, transport, 3)
        sink.close()
        assert len(messages) >= 3
        assert any("connected" in each for each in remarks)
        _, remarks = received(transport, 1, 0.5)
        assert turn or any("lost" in each for each in remarks)
    transport.close()


def test_a_place_that_is_taken_is_refused():
    url = f"zmq+tcp://127.0.0.1:{free_port()}"
    sink = open_sink(url)
    with pytest.raises(InputError, match="choose another"):
        open_sink(url)
    sink.close()
