"""What a sink is."""

from __future__ import annotations

from typing import Protocol

from steelyard.live.record import Record


class Sink(Protocol):
    """Somewhere that estimates are sent to, one by one."""

    def send(self, record: Record) -> None:
        """Send one; what cannot be sent now is lost."""

    def close(self) -> None:
        """End the connection."""
