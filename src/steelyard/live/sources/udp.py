"""``udp://HOST:PORT``: datagrams, each a message."""

from __future__ import annotations

import socket
import time

from steelyard.errors import InputError
from steelyard.live.sources.source import host_and_port

_LARGEST = 65_535
"""Of a datagram [bytes]."""
_ROOM = 1 << 22
"""That the system is asked to keep datagrams in until they are read [bytes]."""
_AT_ONCE = 10_000
"""Datagrams that are taken at once, at most."""


class UdpTransport:
    """A socket that datagrams are sent to."""

    def __init__(self, url: str) -> None:
        host, port = host_and_port(url, "udp://HOST:PORT")
        own = None
        try:
            family, kind, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
            own = socket.socket(family, kind)
            own.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _ROOM)
            own.bind(address)
        except OSError as error:
            if own is not None:
                own.close()
            raise InputError(
                f"--source: expected an address of this machine to listen on, found {url}"
                f" ({error.strerror or error}); choose another"
            ) from error
        self._socket = own

    def messages(self, seconds: float) -> tuple[list[bytes], list[str]]:
        """See :meth:`.Transport.messages`."""
        until = time.monotonic() + seconds
        found: list[bytes] = []
        while len(found) < _AT_ONCE:
            left = until - time.monotonic()
            if found and left <= 0:
                break
            self._socket.settimeout(max(left, 1e-4))
            try:
                found.append(self._socket.recv(_LARGEST))
            except (TimeoutError, BlockingIOError):
                break
        return found, []

    def close(self) -> None:
        """End the connection."""
        self._socket.close()
