"""All kinds of sinks by the beginning of their addresses."""

from __future__ import annotations

from collections.abc import Callable

from steelyard.errors import InputError
from steelyard.live.sinks.foxglove import FoxgloveSink, McapSink
from steelyard.live.sinks.mqtt import MqttSink
from steelyard.live.sinks.opcua import OpcUaSink
from steelyard.live.sinks.sink import Sink
from steelyard.live.sinks.udp import UdpSink
from steelyard.live.sinks.zeromq import ZeroMqSink
from steelyard.plugins.provided import names, provided

SINKS: dict[str, Callable[[str], Sink]] = {
    "udp://": UdpSink,
    "zmq+tcp://": ZeroMqSink,
    "mqtt://": MqttSink,
    "opc.tcp://": OpcUaSink,
    "foxglove:": FoxgloveSink,
    "mcap:": McapSink,
}
"""Beginning of an address -> sink."""


def _scheme(url: str) -> str:
    """Beginning of an address, before its colon."""
    return url.partition("://")[0] if "://" in url else ""


def check_sink(url: str) -> None:
    """Refuse an address of no kind before anything is read.

    Raises:
        InputError: It is of no kind.
    """
    if not url.startswith(tuple(SINKS)) and _scheme(url) not in names("sinks"):
        raise InputError(
            f"--publish: expected {', '.join(SINKS)}, found '{url}'; choose one of these"
        )


def open_sink(url: str) -> Sink:
    """A sink that is connected, or connects by itself.

    Raises:
        InputError: It is of no kind, or its address is none.
    """
    check_sink(url)
    if not url.startswith(tuple(SINKS)):
        sink: Sink = provided("sinks", _scheme(url))(url)
        return sink
    return next(kind for start, kind in SINKS.items() if url.startswith(start))(url)
