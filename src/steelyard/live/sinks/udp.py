"""``udp://HOST:PORT``: a datagram for every estimate."""

from __future__ import annotations

import socket
from contextlib import suppress
from typing import Any

from steelyard.errors import InputError
from steelyard.live.record import Record
from steelyard.live.sources.source import host_and_port


class UdpSink:
    """Datagrams to one address; nobody says whether they arrive."""

    def __init__(self, url: str) -> None:
        host, port = host_and_port(url, "udp://HOST:PORT")
        try:
            family, kind, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        except OSError as error:
            raise InputError(
                f"--publish: expected a host that can be found, found {url}"
                f" ({error.strerror or error}); check its name"
            ) from error
        self._address: Any = address
        self._socket = socket.socket(family, kind)

    def send(self, record: Record) -> None:
        """See :meth:`.Sink.send`."""
        with suppress(OSError):
            self._socket.sendto(record.line.encode(), self._address)

    def close(self) -> None:
        """End the connection."""
        self._socket.close()
