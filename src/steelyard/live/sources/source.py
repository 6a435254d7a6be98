"""What a source is, and the one that receives messages."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from steelyard.errors import InputError
from steelyard.instruments import Instrument
from steelyard.live.message import Arrival, arrivals_of
from steelyard.live.settings import LIVE, LiveSettings


@dataclass(frozen=True)
class Received:
    """What has come since the last look."""

    arrivals: tuple[Arrival, ...] = ()
    refused: int = 0
    """Messages that could not be read."""
    why: str = ""
    """What was wrong with the last of them, in words."""
    remarks: tuple[str, ...] = ()
    """What has happened to the connection, in words."""
    ended: bool = False
    """Whether nothing more will come."""


class SampleSource(Protocol):
    """Somewhere that samples come from."""

    def receive(self, seconds: float) -> Received:
        """What comes within so many seconds, at the latest [s]."""

    def close(self) -> None:
        """End the connection."""


class Transport(Protocol):
    """A connection that messages come over."""

    def messages(self, seconds: float) -> tuple[list[bytes], list[str]]:
        """What comes within so many seconds [s], and what has happened to the connection."""

    def close(self) -> None:
        """End the connection."""


@dataclass
class MessageSource:
    """A source of messages, over whatever they come."""

    transport: Transport
    instruments: Mapping[str, Instrument]
    m: int
    """Number of cables."""
    settings: LiveSettings = field(default=LIVE)

    def receive(self, seconds: float) -> Received:
        """See :meth:`SampleSource.receive`."""
        messages, remarks = self.transport.messages(seconds)
        arrivals: list[Arrival] = []
        refused, why = 0, ""
        for each in messages:
            try:
                arrivals += arrivals_of(each, self.instruments, self.m, self.settings)
            except InputError as error:
                refused, why = refused + 1, str(error)
        return Received(tuple(arrivals), refused, why, tuple(remarks))

    def close(self) -> None:
        """See :meth:`SampleSource.close`."""
        self.transport.close()


def host_and_port(url: str, example: str) -> tuple[str, int]:
    """From ``SCHEME://HOST:PORT``.

    Args:
        url: As given.
        example: What it should look like.

    Raises:
        InputError: It is no such address.
    """
    address = url.split("://", 1)[-1].split("/", 1)[0]
    host, colon, port = address.rpartition(":")
    if not colon or not port.isdigit() or not 0 < int(port) < 1 << 16:
        raise InputError(f"--source: expected {example}, found '{url}'; give host and port")
    return host.strip("[]") or "127.0.0.1", int(port)


def library(name: str, load: Callable[[], object]) -> object:
    """A library that only some sources and sinks need.

    Args:
        name: Of the package.
        load: Imports it.

    Raises:
        InputError: It is not installed.
    """
    try:
        return load()
    except ImportError as error:
        raise InputError(
            f"expected the package '{name}' for this address, found none; install it with pip"
            f" install 'steelyard[live]'"
        ) from error
