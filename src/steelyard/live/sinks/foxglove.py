"""``foxglove:PORT``: a WebSocket server for Foxglove; ``mcap:FILE``: what it would send, as a
file.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from steelyard.errors import InputError
from steelyard.live.record import Record
from steelyard.live.sources.source import library

TOPIC = "/steelyard/estimate"
_NUMBER = {"type": ["number", "null"]}
_VECTOR = {"type": "array", "items": _NUMBER}
_TEN = {
    "mass": _NUMBER,
    "center_of_gravity": _VECTOR,
    "inertia": {"type": "array", "items": _VECTOR},
}
_SCHEMA = {
    "title": "steelyard.Estimate",
    "type": "object",
    "properties": {
        "t": {"type": "number"},
        "load": {"type": "string"},
        **_TEN,
        "standard_deviation": {"type": "object", "properties": _TEN},
        "accepted": {"type": ["boolean", "null"]},
        "reasons": {"type": "array", "items": {"type": "string"}},
        "events": {"type": "array", "items": {"type": "object"}},
        "unmodelled": {"type": ["array", "null"], "items": _NUMBER},
    },
}


def _package() -> Any:
    def load() -> Any:
        import foxglove

        return foxglove

    return library("foxglove-sdk", load)


class _Logged:
    """Estimates on one channel, for whatever writes them."""

    def __init__(self) -> None:
        self.package = _package()
        self.context = self.package.Context()
        self._channel = self.package.Channel(TOPIC, schema=_SCHEMA, context=self.context)

    def log(self, record: Record) -> None:
        """Send one, at its time on the clock of the forces."""
        self._channel.log(record.to_dict(), log_time=max(0, round(record.time * 1e9)))

    def close(self) -> None:
        """End the channel."""
        self._channel.close()


class FoxgloveSink:
    """A server on the loopback address; those who listen too slowly miss estimates."""

    def __init__(self, url: str) -> None:
        port = url.partition(":")[2]
        if not port.isdecimal() or not 0 < int(port) < 1 << 16:
            raise InputError(f"--publish: expected foxglove:PORT, found '{url}'; give a port")
        self._logged = _Logged()
        try:
            self._server = self._logged.package.start_server(
                name="steelyard", port=int(port), context=self._logged.context
            )
        except (OSError, RuntimeError) as error:
            raise InputError(
                f"--publish: expected a free port, found {url} ({error}); choose another"
            ) from error

    def send(self, record: Record) -> None:
        """See :meth:`.Sink.send`."""
        self._logged.log(record)

    def close(self) -> None:
        """End the server."""
        self._logged.close()
        self._server.stop()


class McapSink:
    """A file that must not be there yet; it can be read once it is closed."""

    def __init__(self, url: str) -> None:
        path = Path(url.partition(":")[2])
        if path.suffix != ".mcap" or path.exists() or not path.parent.is_dir():
            raise InputError(
                f"--publish: expected mcap:FILE.mcap, a new file in a folder that is there, found"
                f" '{url}'; choose another"
            )
        self._logged = _Logged()
        try:
            self._writer = self._logged.package.open_mcap(path, context=self._logged.context)
        except OSError as error:
            raise InputError(
                f"--publish: expected a file that can be written, found {url} ({error}); choose"
                " another"
            ) from error

    def send(self, record: Record) -> None:
        """See :meth:`.Sink.send`."""
        self._logged.log(record)

    def close(self) -> None:
        """End the file."""
        self._logged.close()
        self._writer.close()
