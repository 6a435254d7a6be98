"""``opc.tcp://HOST:PORT``: an OPC UA server with a node for every number."""

from __future__ import annotations

import asyncio
import math
import threading
from datetime import UTC, datetime
from typing import Any

from steelyard.errors import InputError
from steelyard.inertia import BODY_PARAMETERS
from steelyard.live.record import Record
from steelyard.live.sources.opcua import asyncua
from steelyard.live.sources.source import host_and_port

NAMESPACE = "urn:steelyard:watch"
_NUMBERS = ("t", *BODY_PARAMETERS, *(f"sigma_{name}" for name in BODY_PARAMETERS))
"""Nodes of type Double."""
_PATIENCE = 10.0
"""How long the server may take to begin and to end [s]."""


class OpcUaSink:
    """A server in a thread of its own. Its nodes may be read and not written; what the data do not
    tell has the status BadNoData.
    """

    def __init__(self, url: str) -> None:
        package = asyncua()
        host, port = host_and_port(url, "opc.tcp://HOST:PORT")
        self._ua = package.ua
        self._nodes: dict[str, Any] = {}
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="opc ua", daemon=True)
        self._thread.start()
        try:
            self._server = self._done(self._started(package, f"opc.tcp://{host}:{port}"))
        except (OSError, package.ua.UaError) as error:
            self._ended()
            raise InputError(
                f"--publish: expected an address of this machine, found {url} ({error}); choose"
                " another"
            ) from error

    def send(self, record: Record) -> None:
        """See :meth:`.Sink.send`."""
        self._done(self._written(record))

    def close(self) -> None:
        """End the server."""
        self._done(self._server.stop())
        self._ended()

    def _done(self, task: Any) -> Any:
        return asyncio.run_coroutine_threadsafe(task, self._loop).result(_PATIENCE)

    def _ended(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(_PATIENCE)
        if not self._thread.is_alive():
            self._loop.close()

    async def _started(self, package: Any, url: str) -> Any:
        """The server, with nodes that have no values yet."""
        server = package.Server()
        await server.init()
        server.set_endpoint(url)
        server.set_server_name("steelyard")
        server.set_security_policy([package.ua.SecurityPolicyType.NoSecurity])
        space = await server.register_namespace(NAMESPACE)
        home = await server.nodes.objects.add_object(
            package.ua.NodeId("steelyard", space), package.ua.QualifiedName("steelyard", space)
        )
        kinds = package.ua.VariantType
        wanted = dict.fromkeys(_NUMBERS, kinds.Double) | {
            "load": kinds.String,
            "accepted": kinds.Boolean,
            "reasons": kinds.String,
        }
        for name, kind in wanted.items():
            empty = {kinds.Double: 0.0, kinds.String: "", kinds.Boolean: False}[kind]
            self._nodes[name] = await home.add_variable(
                package.ua.NodeId(name, space),
                package.ua.QualifiedName(name, space),
                empty,
                varianttype=kind,
            )
            await self._write(name, None, kind, datetime.now(UTC))
        try:
            await server.start()
        except BaseException:
            await server.stop()
            raise
        return server

    async def _written(self, record: Record) -> None:
        """All numbers of one instant, with one time stamp."""
        now, kinds = datetime.now(UTC), self._ua.VariantType
        for name, value in record.numbers().items():
            await self._write(name, None if math.isnan(value) else value, kinds.Double, now)
        await self._write("load", record.load, kinds.String, now)
        await self._write("accepted", record.accepted, kinds.Boolean, now)
        await self._write("reasons", "; ".join(record.reasons), kinds.String, now)

    async def _write(self, name: str, value: Any, kind: Any, stamp: datetime) -> None:
        """One value; None has a status that says so."""
        ua = self._ua
        code = ua.StatusCodes.Good if value is not None else ua.StatusCodes.BadNoData
        variant = ua.Variant(value, kind) if value is not None else ua.Variant()
        await self._nodes[name].write_value(
            ua.DataValue(variant, ua.StatusCode(code), SourceTimestamp=stamp, ServerTimestamp=stamp)
        )
