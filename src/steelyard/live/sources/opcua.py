"""``opc.tcp://HOST:PORT[/PATH]``: a subscription of an OPC UA server; it reconnects by itself."""

from __future__ import annotations

import asyncio
import logging
import math
import threading
from collections.abc import Sequence
from contextlib import aclosing, suppress
from datetime import UTC, datetime
from typing import Any

from steelyard.errors import InputError
from steelyard.live.sources.inbox import Inbox
from steelyard.live.sources.nodes import NodeName, NodeValue
from steelyard.live.sources.source import host_and_port, library

_WAIT, _LONGEST_WAIT = 0.1, 10.0
"""First and longest wait before connecting again [s]."""
_PUBLISHED = 20.0
"""How often the server is asked to send what is new [ms]."""
_QUEUE = 10_000
"""Values of a node that the server is asked to keep until then."""
_KEPT = 1_000_000
"""Values that wait to be read, at most."""
_ALIVE = 0.5
"""How often it is asked whether the server is still there [s]."""
_PATIENCE = 4.0
"""How long an answer is waited for [s]."""


def asyncua() -> Any:
    """The package, without its own remarks on lost connections."""

    def load() -> Any:
        import asyncua

        # Lost connections are said in our words; its own would go to stderr as tracebacks.
        logging.getLogger("asyncua").addHandler(logging.NullHandler())
        return asyncua

    return library("asyncua", load)


def seconds_of(stamp: datetime | None) -> float:
    """Seconds since 1970 of a time stamp; NaN where there is none."""
    if stamp is None:
        return math.nan
    return (stamp if stamp.tzinfo else stamp.replace(tzinfo=UTC)).timestamp()


class OpcUaReader:
    """Nodes of a server that are subscribed to, in a thread of their own."""

    def __init__(self, url: str, names: Sequence[NodeName]) -> None:
        package = asyncua()
        host_and_port(url, "opc.tcp://HOST:PORT")
        self._url, self._names = url, tuple(names)
        self._ids = []
        for each in names:
            try:
                self._ids.append(package.ua.NodeId.from_string(each.node))
            except (package.ua.UaError, ValueError) as error:
                raise InputError(
                    f"instruments.{each.instrument}.nodes.{each.column}: expected a node id such as"
                    f" ns=2;s=force1, found '{each.node}'; correct it"
                ) from error
        self._inbox = Inbox[NodeValue](_KEPT)
        self._loop = asyncio.new_event_loop()
        self._stop = asyncio.Event()
        self._thread = threading.Thread(target=self._run, name="opc ua", daemon=True)
        self._thread.start()

    def values(self, seconds: float) -> tuple[list[NodeValue], list[str]]:
        """See :meth:`.NodeReader.values`."""
        return self._inbox.taken(seconds)

    def close(self) -> None:
        """End the connection."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._stop.set)
            # Its last calls wait so long for an answer.
            self._thread.join(3 * _PATIENCE)
            if not self._thread.is_alive():
                self._loop.close()

    def _run(self) -> None:
        self._loop.run_until_complete(self._kept_up())

    async def _kept_up(self) -> None:
        """Connect again and again, with growing waits, until it is closed."""
        wait, said = _WAIT, ""
        while not self._stop.is_set():
            connected = False
            try:
                async with aclosing(self._connected()) as alive:
                    async for _ in alive:
                        if not connected:
                            connected, wait, said = True, _WAIT, ""
                            self._inbox.say(f"{self._url}: connected")
                        if await self._stopped_within(_ALIVE):
                            return
            except Exception as error:
                # Whatever a server may do wrong: it is said, and tried again.
                why = str(error) or type(error).__name__
                lost = f"{self._url}: {'connection lost' if connected else 'no connection'} ({why})"
                if lost != said:
                    self._inbox.say(f"{lost}, connecting again")
                said = f"{self._url}: no connection ({why})" if connected else lost
            if await self._stopped_within(wait):
                return
            wait = min(2 * wait, _LONGEST_WAIT)

    async def _stopped_within(self, seconds: float) -> bool:
        with suppress(TimeoutError):
            await asyncio.wait_for(self._stop.wait(), seconds)
        return self._stop.is_set()

    async def _connected(self) -> Any:
        """A subscription, yielded again whenever the server has shown that it is there."""
        client = asyncua().Client(self._url, timeout=_PATIENCE, watchdog_intervall=1e6)
        await client.connect()
        try:
            subscription = await client.create_subscription(_PUBLISHED, self._handler())
            results = await subscription.create_monitored_items(self._requests())
            wrong = [
                name.node
                for name, result in zip(self._names, results, strict=True)
                if not isinstance(result, int)
            ]
            if wrong:
                raise ConnectionError(f"the server has no nodes {', '.join(wrong)}")
            while True:
                await asyncio.wait_for(client.nodes.server_state.read_value(), _PATIENCE)
                yield
        finally:
            with suppress(Exception):
                await asyncio.wait_for(client.disconnect(), _PATIENCE)

    def _handler(self) -> Any:
        """What is done with a value that comes: the first of each node was there before."""
        names, inbox = self._names, self._inbox
        first = set(range(len(names)))

        class Changes:
            def datachange_notification(self, node: Any, value: Any, data: Any) -> None:
                """A value, in the order of the server."""
                number = data.subscription_data.client_handle
                if number in first:
                    first.remove(number)
                    return
                told = data.monitored_item.Value
                good = told.StatusCode is None or told.StatusCode.is_good()
                time = seconds_of(told.SourceTimestamp)
                inbox.put(NodeValue(names[number], time, value if good else None))

            def status_change_notification(self, status: Any) -> None:
                """The end of a subscription shows as a lost connection."""

        return Changes()

    def _requests(self) -> list[Any]:
        """One for each node: every value with another time stamp, though it may be the same."""
        ua = asyncua().ua
        requests = []
        for number, node in enumerate(self._ids):
            item = ua.ReadValueId(NodeId=node, AttributeId=ua.AttributeIds.Value)
            change = ua.DataChangeFilter(Trigger=ua.DataChangeTrigger.StatusValueTimestamp)
            asked = ua.MonitoringParameters(
                ClientHandle=number,
                SamplingInterval=0.0,
                Filter=change,
                QueueSize=_QUEUE,
                DiscardOldest=True,
            )
            requests.append(
                ua.MonitoredItemCreateRequest(
                    ItemToMonitor=item,
                    MonitoringMode=ua.MonitoringMode.Reporting,
                    RequestedParameters=asked,
                )
            )
        return requests
