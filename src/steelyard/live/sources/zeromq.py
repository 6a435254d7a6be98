"""``zmq+tcp://HOST:PORT``: messages that a ZeroMQ publisher sends; it reconnects by itself."""

from __future__ import annotations

import time
from typing import Any

from steelyard.live.settings import LIVE
from steelyard.live.sources.source import host_and_port, library

_WAIT, _LONGEST_WAIT = 100, 5000
"""First and longest wait before connecting again [ms]."""
_AT_ONCE = 10_000
"""Messages that are taken at once, at most."""


def zmq() -> Any:
    """The package."""

    def load() -> Any:
        import zmq

        return zmq

    return library("pyzmq", load)


class ZeroMqTransport:
    """A subscriber of all that a publisher sends."""

    def __init__(self, url: str) -> None:
        self._zmq = zmq()
        host, port = host_and_port(url, "zmq+tcp://HOST:PORT")
        self._context = self._zmq.Context()
        self._socket = self._context.socket(self._zmq.SUB)
        for option, value in (
            (self._zmq.LINGER, 0),
            (self._zmq.RECONNECT_IVL, _WAIT),
            (self._zmq.RECONNECT_IVL_MAX, _LONGEST_WAIT),
            (self._zmq.MAXMSGSIZE, LIVE.largest_message),
            (self._zmq.RCVHWM, 0),
        ):
            self._socket.setsockopt(option, value)
        self._socket.subscribe(b"")
        self._monitor = self._socket.get_monitor_socket(
            self._zmq.EVENT_CONNECTED | self._zmq.EVENT_DISCONNECTED
        )
        self._address = f"tcp://{host}:{port}"
        self._socket.connect(self._address)

    def messages(self, seconds: float) -> tuple[list[bytes], list[str]]:
        """See :meth:`.Transport.messages`."""
        until = time.monotonic() + seconds
        found: list[bytes] = []
        while len(found) < _AT_ONCE:
            left = until - time.monotonic()
            if found and left <= 0:
                break
            if not self._socket.poll(max(0, int(1e3 * left))):
                break
            found.append(self._socket.recv())
        return found, list(self._remarks())

    def _remarks(self) -> list[str]:
        """What has happened to the connection."""
        from zmq.utils.monitor import recv_monitor_message

        found = []
        while self._monitor.poll(0):
            event = recv_monitor_message(self._monitor)["event"]
            lost = event == self._zmq.EVENT_DISCONNECTED
            found.append(
                f"{self._address}: connection lost, connecting again"
                if lost
                else f"{self._address}: connected"
            )
        return found

    def close(self) -> None:
        """End the connection."""
        self._socket.disable_monitor()
        self._monitor.close(linger=0)
        self._socket.close()
        self._context.term()
