"""``mqtt://[USER:PASSWORD@]HOST[:PORT]/TOPIC``: messages of a broker; it reconnects by itself."""

from __future__ import annotations

from typing import Any
from urllib.parse import unquote, urlsplit

from steelyard.errors import InputError
from steelyard.live.sources.inbox import Inbox
from steelyard.live.sources.source import library

_PORT = 1883
_WAIT, _LONGEST_WAIT = 1, 30
"""First and longest wait before connecting again [s]."""
_KEPT = 100_000
"""Messages that wait to be read, at most: then the oldest are dropped."""


def mqtt_client(url: str) -> tuple[Any, str, int, str]:
    """A client that is not connected yet, host, port and topic of an address.

    Raises:
        InputError: It is no such address, or the package is not installed.
    """

    def load() -> Any:
        from paho.mqtt import client

        return client

    paho: Any = library("paho-mqtt", load)
    try:
        # A topic may have the wildcards # and +; neither a fragment nor a query is meant.
        parts = urlsplit(url.replace("#", "%23").replace("?", "%3F"))
        host, port, topic = parts.hostname, parts.port or _PORT, unquote(parts.path.lstrip("/"))
    except ValueError:
        host, port, topic = None, 0, ""
    if not host or not topic:
        raise InputError(
            f"expected mqtt://HOST:PORT/TOPIC, found '{url}'; give the host of the broker and a"
            " topic"
        )
    client = paho.Client(paho.CallbackAPIVersion.VERSION2)
    client.reconnect_delay_set(_WAIT, _LONGEST_WAIT)
    if parts.username:
        client.username_pw_set(unquote(parts.username), unquote(parts.password or ""))
    return client, host, port, topic


class MqttTransport:
    """A subscriber of one topic, which may have wildcards."""

    def __init__(self, url: str) -> None:
        self._client, host, port, topic = mqtt_client(url)
        self._inbox = inbox = Inbox[bytes](_KEPT)
        where = f"mqtt://{host}:{port}/{topic}"

        def connected(client: Any, *_: Any) -> None:
            client.subscribe(topic)
            inbox.say(f"{where}: connected")

        def lost(*_: Any) -> None:
            inbox.say(f"{where}: connection lost, connecting again")

        def came(_client: Any, _data: Any, message: Any) -> None:
            inbox.put(bytes(message.payload))

        self._client.on_connect = connected
        self._client.on_disconnect = lost
        self._client.on_message = came
        self._client.connect_async(host, port)
        self._client.loop_start()

    def messages(self, seconds: float) -> tuple[list[bytes], list[str]]:
        """See :meth:`.Transport.messages`."""
        return self._inbox.taken(seconds)

    def close(self) -> None:
        """End the connection."""
        self._client.disconnect()
        self._client.loop_stop()
