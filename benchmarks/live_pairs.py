"""Ten minutes of replay at @max through every pair of server and client, without an estimator: how many
samples were sent, how many came, how long it took. Ends with status 1 where one was lost.

MQTT needs mosquitto on the machine; what is not installed is said and left out.
"""

from __future__ import annotations

import argparse
import json
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from steelyard.experiment.model import Experiment
from steelyard.live.buffer import Buffer
from steelyard.live.sinks.opcua import asyncua
from steelyard.live.sources.source import SampleSource
from steelyard.live.sources.table import open_source
from steelyard.robot.file import read_robot
from steelyard.simulation.sensors import paper_sensors

RATES = {"cables": 100.0, "imu": 100.0, "tracker": 238.0}
"""[Hz]"""
COLUMNS = {
    "cables": [f"f{i}" for i in range(1, 9)],
    "imu": ["wx", "wy", "wz", "ax", "ay", "az"],
    "tracker": ["x", "y", "z"],
}
BATCH = 20
"""Samples in a message."""
START = 1.7e9
"""[s]"""


def rows(duration: float) -> Iterator[tuple[str, np.ndarray, dict[str, np.ndarray]]]:
    """Batches of samples of all instruments, in the order of their times."""
    rng = np.random.default_rng(1)
    parts = []
    for name, rate in RATES.items():
        times = START + np.arange(round(duration * rate)) / rate
        for first in range(0, len(times), BATCH):
            parts.append((times[first], name, times[first : first + BATCH]))
    for _, name, times in sorted(parts, key=lambda each: each[0]):
        yield name, times, {c: rng.normal(200.0, 5.0, len(times)) for c in COLUMNS[name]}


def message(name: str, times: np.ndarray, columns: dict[str, np.ndarray]) -> bytes:
    found = {"instrument": name, "t": times.tolist()}
    return json.dumps(found | {k: v.tolist() for k, v in columns.items()}).encode()


def counted(source: SampleSource, wanted: int, sent: threading.Event) -> tuple[int, int, list[str]]:
    """Samples that came into a buffer that only counts, refusals, what was said."""
    buffer, remarks, quiet = Buffer(), [], 0
    while buffer.counts.taken < wanted and quiet < 100:
        received = source.receive(0.05)
        remarks += received.remarks
        buffer = buffer.with_arrivals(received.arrivals, {}).refused(received.refused)
        newest = {n: float(s.time[-1]) - 3.0 for n, s in buffer.streams.items() if len(s)}
        buffer = buffer.since(newest)
        quiet = quiet + 1 if sent.is_set() and not received.arrivals else 0
    return buffer.counts.taken, buffer.counts.refused, remarks


def free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


def by_udp(port: int, duration: float, ready: Callable[[], None]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for i, each in enumerate(rows(duration)):
            out.sendto(message(*each), ("127.0.0.1", port))
            if i % 20 == 19:
                # Nothing holds datagrams back: a sender that never waits fills any buffer.
                time.sleep(0.01)


def by_zmq(port: int, duration: float, ready: Callable[[], None]) -> None:
    import zmq

    with zmq.Context() as context, context.socket(zmq.PUB) as out:
        out.setsockopt(zmq.SNDHWM, 0)
        out.bind(f"tcp://127.0.0.1:{port}")
        ready()
        # A subscription takes a moment more than a connection.
        time.sleep(0.5)
        for each in rows(duration):
            out.send(message(*each))
        out.close(linger=-1)


def by_mqtt(port: int, duration: float, ready: Callable[[], None]) -> None:
    from paho.mqtt import client

    out = client.Client(client.CallbackAPIVersion.VERSION2)
    out.connect("127.0.0.1", port)
    out.loop_start()
    ready()
    time.sleep(0.5)
    for each in rows(duration):
        out.publish("arm/samples", message(*each), qos=1)
    while out._out_messages:
        time.sleep(0.05)
    out.disconnect()
    out.loop_stop()


def by_opcua(port: int, duration: float, ready: Callable[[], None]) -> None:
    import asyncio
    from datetime import UTC, datetime

    package = asyncua()
    ua = package.ua

    async def serve() -> None:
        server = package.Server()
        await server.init()
        server.set_endpoint(f"opc.tcp://127.0.0.1:{port}")
        server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
        space = await server.register_namespace("urn:benchmark")
        nodes = {
            c: await server.nodes.objects.add_variable(ua.NodeId(c, space), c, 0.0)
            for columns in COLUMNS.values()
            for c in columns
        }
        async with server:
            await asyncio.get_running_loop().run_in_executor(None, ready)
            for name, times, columns in rows(duration):
                for i, t in enumerate(times):
                    stamp = datetime.fromtimestamp(t, UTC)
                    for column in COLUMNS[name]:
                        value = ua.Variant(float(columns[column][i]))
                        await nodes[column].write_value(
                            ua.DataValue(value, ua.StatusCode(0), stamp, stamp)
                        )
                # The server keeps so many values of a node until they are sent.
                await asyncio.sleep(0.002)
            await asyncio.sleep(2.0)

    asyncio.run(serve())


def plan() -> Experiment:
    robot = read_robot("cogiro")
    suite = paper_sensors(robot).instruments
    instruments = {
        name: suite[name].model_copy(update={"nodes": {c: f"ns=2;s={c}" for c in COLUMNS[name]}})
        for name in RATES
    }
    return Experiment("live", robot, instruments, ())


def broker(port: int, folder: Path) -> subprocess.Popen[bytes] | None:
    found = shutil.which("mosquitto", path="/usr/sbin:/usr/local/sbin:/usr/bin")
    if found is None:
        return None
    settings = folder / "mosquitto.conf"
    # By default a broker drops messages that wait for a slow client beyond 1000.
    settings.write_text(f"listener {port} 127.0.0.1\nallow_anonymous true\nmax_queued_messages 0\n")
    started = subprocess.Popen([found, "-c", str(settings)], stderr=subprocess.DEVNULL)
    time.sleep(1.0)
    return started


def measure(kind: str, duration: float, folder: Path) -> bool:
    """Print the figures of one pair; whether all came."""
    port, send = free_port(), {
        "udp": by_udp, "zmq+tcp": by_zmq, "mqtt": by_mqtt, "opc.tcp": by_opcua,
    }[kind]  # fmt: skip
    wanted = sum(round(duration * rate) for rate in RATES.values())
    process = broker(port, folder) if kind == "mqtt" else None
    if kind == "mqtt" and process is None:
        print(f"{kind:>8}: no mosquitto on this machine")
        return True
    url = f"{kind}://127.0.0.1:{port}" + ("/arm/#" if kind == "mqtt" else "")
    source = open_source(url, plan())
    connected, sent = threading.Event(), threading.Event()

    def work() -> None:
        send(port, duration, lambda: connected.wait(30) and None)
        sent.set()

    thread = threading.Thread(target=work)
    began, cpu = time.monotonic(), time.process_time()
    thread.start()

    class Watched:
        def receive(self, seconds: float) -> object:
            received = source.receive(seconds)
            if any(each.endswith("connected") for each in received.remarks):
                connected.set()
            return received

    taken, refused, remarks = counted(Watched(), wanted, sent)  # type: ignore[arg-type]
    wall, cpu = time.monotonic() - began, time.process_time() - cpu
    thread.join()
    source.close()
    if process is not None:
        process.kill()
        process.wait()
    lost = wanted - taken
    print(
        f"{kind:>8}: {wanted} samples of {duration:g} s sent, {taken} came, {lost} lost, {refused}"
        f" refused; {wall:.1f} s ({cpu:.1f} s of CPU for both ends)",
        flush=True,
    )
    for each in remarks:
        if "connected" not in each:
            print(f"          {each}")
    return lost == 0 and refused == 0


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--duration", type=float, default=600.0, help="[s]")
    arguments.add_argument("kinds", nargs="*", default=["udp", "zmq+tcp", "mqtt", "opc.tcp"])
    given = arguments.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = [measure(kind, given.duration, Path(folder)) for kind in given.kinds]
    sys.exit(0 if all(found) else 1)


if __name__ == "__main__":
    main()
