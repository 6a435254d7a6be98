"""``zmq+tcp://HOST:PORT``: a ZeroMQ publisher that anyone may subscribe to."""

from __future__ import annotations

from steelyard.errors import InputError
from steelyard.live.record import Record
from steelyard.live.sources.source import host_and_port
from steelyard.live.sources.zeromq import zmq


class ZeroMqSink:
    """A publisher on an address of this machine."""

    def __init__(self, url: str) -> None:
        own = zmq()
        host, port = host_and_port(url, "zmq+tcp://HOST:PORT")
        self._context = own.Context()
        self._socket = self._context.socket(own.PUB)
        self._socket.setsockopt(own.LINGER, 200)
        try:
            self._socket.bind(f"tcp://{host}:{port}")
        except own.ZMQError as error:
            self.close()
            raise InputError(
                f"--publish: expected an address of this machine, found {url} ({error}); choose"
                " another"
            ) from error

    def send(self, record: Record) -> None:
        """See :meth:`.Sink.send`."""
        self._socket.send_string(record.line)

    def close(self) -> None:
        """End the connection."""
        self._socket.close()
        self._context.term()
