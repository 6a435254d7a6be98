"""All kinds of sources by the beginning of their addresses."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.live.settings import LIVE, LiveSettings
from steelyard.live.sources.ads import AdsReader
from steelyard.live.sources.mqtt import MqttTransport
from steelyard.live.sources.nodes import NodeName, NodeReader, NodeSource, nodes_of
from steelyard.live.sources.opcua import OpcUaReader
from steelyard.live.sources.replay import ReplayedRun, asked_for
from steelyard.live.sources.source import MessageSource, SampleSource, Transport
from steelyard.live.sources.udp import UdpTransport
from steelyard.live.sources.zeromq import ZeroMqTransport

REPLAY = "replay:"
TRANSPORTS: dict[str, Callable[[str], Transport]] = {
    "udp://": UdpTransport,
    "zmq+tcp://": ZeroMqTransport,
    "mqtt://": MqttTransport,
}
"""Beginning of an address -> connection that messages come over."""
READERS: dict[str, Callable[[str, Sequence[NodeName]], NodeReader]] = {
    "opc.tcp://": OpcUaReader,
    "ads://": AdsReader,
}
"""Beginning of an address -> connection that single numbers come over."""


def check_source(url: str) -> None:
    """Refuse an address of no kind before anything is read.

    Raises:
        InputError: It is of no kind.
    """
    if not url.startswith((REPLAY, *TRANSPORTS, *READERS)):
        kinds = ", ".join(("replay:RUN", *TRANSPORTS, *READERS))
        raise InputError(f"--source: expected {kinds}, found '{url}'; choose one of these")


def open_source(url: str, experiment: Experiment, settings: LiveSettings = LIVE) -> SampleSource:
    """A source that is connected.

    Args:
        url: Its address.
        experiment: Whose instruments it reads; of a replay with the run.
        settings: Limits of a message.

    Raises:
        InputError: The address is of no kind, or there is nothing.
    """
    check_source(url)
    if url.startswith(REPLAY):
        name, speed = asked_for(url)
        return ReplayedRun(experiment, experiment.run(name), speed)
    instruments, m = experiment.instruments, experiment.robot.m
    for start, reader in READERS.items():
        if url.startswith(start):
            names = nodes_of(experiment, url)
            return NodeSource(reader(url, names), names, instruments, m, settings)
    transport = next(kind for start, kind in TRANSPORTS.items() if url.startswith(start))
    return MessageSource(transport(url), instruments, m, settings)
