"""How `watch` ends, and what patience does."""

import json
import signal
import socket
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from places import DATA

from steelyard.experiment.read import read_experiment
from steelyard.experiment.recording import Stream
from steelyard.live.message import Arrival
from steelyard.live.session import Session
from steelyard.live.settings import LIVE

pytestmark = pytest.mark.integration
POINTS = DATA / "points-00" / "experiment.yaml"


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_end_that_is_asked_for_writes_what_is_known(tmp_path, number):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "steelyard", "watch", str(POINTS), "--source"]
    command += [f"udp://127.0.0.1:{port}", "--out", str(tmp_path / "live.jsonl"), "--page", "0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    # The first remark says where the page is: from then on signals are waited for.
    assert "page: http://127.0.0.1:" in process.stderr.readline()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for _ in range(20):
            out.sendto(b"not a message", ("127.0.0.1", port))
            time.sleep(0.05)
    process.send_signal(number)
    text, said = process.communicate(timeout=120)
    assert process.returncode == 3
    assert text == ""
    assert "Traceback" not in said
    assert said == ""  # narration is for terminals; the file says why
    found = json.loads((tmp_path / "estimate.json").read_text())["estimates"]["recursive"]
    assert found["mass"] is None
    assert "nothing was told: expected forces and motion" in found["verdict"]["reasons"][0]
    assert "messages that could not be read" in found["notes"][-1]
    assert (tmp_path / "live.jsonl").read_text() == ""


def test_patience_decides_when_a_chunk_is_whole():
    points = read_experiment(POINTS)
    plan, run = replace(points, runs=()), points.runs[0]

    class Grid:
        def span(self, number):
            return 0.0, 1.0

    class Window:
        grid = Grid()

    class Before:
        window, number = Window(), 0

    for patience, last, ready in [
        (0.2, 1.1, False),
        (0.2, 1.21, True),
        (0.0, 1.01, True),
        (1.0, 1.9, False),
    ]:
        session = Session(
            plan,
            run.name,
            dict.fromkeys(run.streams, 0.0),
            settings=replace(LIVE, patience=patience),
        )
        arrivals = [
            Arrival(name, Stream(np.array([0.0, last]), {"x": np.zeros((2, 1))}, "test"))
            for name in run.streams
        ]  # fmt: skip
        assert session.taken(arrivals)._is_ready(Before()) is ready
