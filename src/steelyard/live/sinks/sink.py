"""What a sink is."""

from __future__ import annotations

from typing import Protocol


class Sink(Protocol):
    """Somewhere that estimates are sent to, one line of JSON each."""

    def send(self, text: str) -> None:
        """Send one; what cannot be sent now is lost."""

    def close(self) -> None:
        """End the connection."""
