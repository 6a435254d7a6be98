"""``mqtt://[USER:PASSWORD@]HOST[:PORT]/TOPIC``: a message to a broker for every estimate."""

from __future__ import annotations

from steelyard.live.record import Record
from steelyard.live.sources.mqtt import mqtt_client


class MqttSink:
    """A publisher of one topic; it reconnects by itself."""

    def __init__(self, url: str) -> None:
        self._client, host, port, self._topic = mqtt_client(url)
        self._client.connect_async(host, port)
        self._client.loop_start()

    def send(self, record: Record) -> None:
        """See :meth:`.Sink.send`."""
        self._client.publish(self._topic, record.line)

    def close(self) -> None:
        """End the connection."""
        self._client.disconnect()
        self._client.loop_stop()
