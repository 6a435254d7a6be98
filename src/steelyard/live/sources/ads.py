"""``ads://HOST/NETID[:PORT]``: variables of a Beckhoff controller; it reconnects by itself."""

from __future__ import annotations

import re
import threading
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from steelyard.errors import InputError
from steelyard.live.sources.inbox import Inbox
from steelyard.live.sources.nodes import NodeName, NodeValue
from steelyard.live.sources.source import library

_ADDRESS = re.compile(r"ads://([\w.\-]+)/(\d{1,3}(?:\.\d{1,3}){5})(?::(\d{1,5}))?")
_PORT = 851
"""Of the first PLC of TwinCAT 3."""
_WAIT, _LONGEST_WAIT = 0.1, 10.0
"""First and longest wait before connecting again [s]."""
_ALIVE = 0.5
"""How often it is asked whether the controller is still there [s]."""
_KEPT = 1_000_000
"""Values that wait to be read, at most."""
_END = 10.0
"""How long a call of the library may take to end [s]; its thread ends with the process then."""
_EPOCH = 116_444_736_000_000_000
"""1970 in units of 100 ns since 1601, as controllers count."""


def pyads() -> Any:
    """The package."""

    def load() -> Any:
        import pyads

        return pyads

    return library("pyads", load)


class AdsReader:
    """Variables that a controller tells in every cycle, REAL or LREAL, watched by a thread."""

    def __init__(self, url: str, names: Sequence[NodeName]) -> None:
        found = _ADDRESS.fullmatch(url)
        if found is None:
            raise InputError(
                f"--source: expected ads://HOST/NETID:PORT such as"
                f" ads://192.168.0.10/192.168.0.10.1.1:851, found '{url}'; correct it"
            )
        self._package = pyads()
        host, net, port = found.groups()
        self._url, self._names = url, tuple(names)
        self._plc = self._package.Connection(net, int(port or _PORT), host)
        self._inbox = Inbox[NodeValue](_KEPT)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._kept_up, name="ads", daemon=True)
        self._thread.start()

    def values(self, seconds: float) -> tuple[list[NodeValue], list[str]]:
        """See :meth:`.NodeReader.values`."""
        return self._inbox.taken(seconds)

    def close(self) -> None:
        """End the connection."""
        self._stop.set()
        self._thread.join(_END)

    def _kept_up(self) -> None:
        """Connect again and again, with growing waits, until it is closed."""
        wait, said = _WAIT, ""
        while not self._stop.is_set():
            connected = False
            handles: list[tuple[int, int]] = []
            try:
                self._plc.open()
                self._plc.read_state()
                self._subscribe(handles)
                connected, wait, said = True, _WAIT, ""
                self._inbox.say(f"{self._url}: connected")
                while not self._stop.wait(_ALIVE):
                    self._plc.read_state()
            except (self._package.ADSError, OSError, RuntimeError, ValueError) as error:
                what = "connection lost" if connected else "no connection"
                text = f"{self._url}: {what} ({error})"
                if text != said:
                    self._inbox.say(f"{text}, connecting again")
                said = f"{self._url}: no connection ({error})" if connected else text
            finally:
                for pair in handles:
                    with suppress(Exception):
                        self._plc.del_device_notification(*pair)
                with suppress(Exception):
                    self._plc.close()
            self._stop.wait(wait)
            wait = min(2 * wait, _LONGEST_WAIT)

    def _subscribe(self, handles: list[tuple[int, int]]) -> None:
        """Ask for every variable in every cycle; what it was before is passed over."""
        for name in self._names:
            symbol = self._plc.get_symbol(name.node)
            kind, place = symbol.plc_type, (symbol.index_group, symbol.index_offset)
            if kind not in (self._package.PLCTYPE_REAL, self._package.PLCTYPE_LREAL):
                raise ValueError(f"expected a REAL or LREAL, found another type in {name.node}")
            length = 4 if kind is self._package.PLCTYPE_REAL else 8
            attributes = self._package.NotificationAttrib(
                length, self._package.ADSTRANS_SERVERCYCLE, max_delay=0.0, cycle_time=0.0
            )
            pair = self._plc.add_device_notification(place, attributes, self._told(name, kind))
            handles.append(pair)

    def _told(self, name: NodeName, kind: Any) -> Any:
        """What is done with a value of a variable."""

        def came(notification: Any, _data: Any) -> None:
            _, stamp, value = self._plc.parse_notification(
                notification, kind, timestamp_as_filetime=True
            )
            self._inbox.put(NodeValue(name, (stamp - _EPOCH) / 1e7, value))

        return came
