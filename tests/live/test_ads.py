"""Beckhoff: the server that pyads has for tests, ended and begun again in mid-stream. It tells its
values only to a client of the same process."""

import socket
import struct
import time
from contextlib import suppress
from itertools import count

import numpy as np
import pytest
from simulated import PAPER

from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.live.sources.table import open_source
from steelyard.robot.file import read_robot

pytestmark = pytest.mark.integration
pyads = pytest.importorskip("pyads")
NODES = {"x": "MAIN.x", "y": "MAIN.y", "z": "MAIN.z"}
PLAN = Experiment(
    "plan",
    read_robot("cogiro"),
    {"tracker": PAPER["tracker"].model_copy(update={"nodes": tuple(NODES.items())})},
    (),
)
URL = "ads://127.0.0.1/127.0.0.1.1.1:851"
START = 1.7e9


@pytest.fixture
def begin(monkeypatch):
    from pyads.testserver import AdsTestServer, AdvancedHandler, PLCVariable, advanced_handler

    with socket.socket() as free:
        free.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            free.bind(("127.0.0.1", 48898))
        except OSError:
            pytest.skip("the port of ADS, which cannot be chosen, is taken")
    stamps = count()
    # The server stamps each variable by itself; a controller stamps all of a cycle alike.
    monkeypatch.setattr(
        advanced_handler,
        "dt_to_filetime",
        lambda _: 116_444_736_000_000_000 + round(1e7 * (START + 0.01 * (next(stamps) // 3))),
    )
    running = []

    def start():
        handler = AdvancedHandler()
        variables = [
            PLCVariable(n, 0.0, ads_type=pyads.constants.ADST_REAL64, symbol_type="LREAL")
            for n in NODES.values()
        ]
        for i, each in enumerate(variables):
            handler.add_variable(each)
            # By itself it gives all of them the same handles.
            each.notification_count = 100 * (i + 1)
        server = AdsTestServer(handler=handler, logging=False)
        server.start()
        running.append(server)

        def write(*values):
            for each, value in zip(variables, values, strict=True):
                each.write(struct.pack("<d", value))

        return write, server

    yield start
    for each in running:
        ended(each)


def ended(server):
    """Close it. It waits for threads of its connections, which may never look whether they should
    end; once there is nobody at the other end they do."""
    for each in server.clients:
        with suppress(OSError):
            each.client.shutdown(socket.SHUT_RDWR)
    server.close()


def received(source, done, seconds=30.0):
    arrivals, remarks, end = [], [], time.monotonic() + seconds
    while not done(arrivals, remarks) and time.monotonic() < end:
        found = source.receive(0.05)
        assert not found.refused
        arrivals += found.arrivals
        remarks += found.remarks
    return arrivals, remarks


@pytest.mark.slow
def test_a_controller_that_goes_is_found_again(begin):
    source = open_source(URL, PLAN)
    _, remarks = received(source, lambda a, r: r)
    assert "no connection" in remarks[0]
    got = []
    for turn in range(2):
        write, server = begin()
        received(source, lambda a, r: any(each.endswith(": connected") for each in r))
        for i in range(20):
            write(turn + 0.1 * i + 0.01, i + 0.02, i + 0.03)
        arrivals, _ = received(source, lambda a, r: sum(len(each.stream) for each in a) >= 20)
        got += arrivals
        ended(server)
        _, remarks = received(source, lambda a, r: r)
        assert "connection lost" in remarks[0]
    source.close()
    position = np.concatenate([each.stream.values["position"] for each in got])
    times = np.concatenate([each.stream.time for each in got])
    assert position[:, 0] == pytest.approx(
        [t + 0.1 * i + 0.01 for t in range(2) for i in range(20)]
    )
    assert times == pytest.approx(START + 0.01 * np.arange(40), abs=1e-6)


@pytest.mark.parametrize(
    "url", ["ads://", "ads://host", "ads://host/1.2.3", "ads://host/1.2.3.4.1.1:x"]
)
def test_addresses_that_are_none(url):
    with pytest.raises(InputError, match="expected ads://HOST/NETID:PORT"):
        open_source(url, PLAN)
