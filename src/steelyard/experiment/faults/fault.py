"""A fault of a stream: what is wrong with it, where and when."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Fault:
    """Something wrong with a stream itself, whatever it says of the motion."""

    kind: Literal[
        "gap",
        "dropped",
        "late",
        "repeated",
        "doubled",
        "spike",
        "stuck",
        "dead",
        "clipped",
        "held",
        "missing",
        "set",
    ]
    instrument: str
    channel: str
    """Quantity, with the number of the component where it has several that fail alone; empty: the
    whole stream."""
    start: float
    """On the clock of the stream [s]."""
    end: float
    """[s]"""
    count: int
    """Samples that it concerns; of gaps and dropped packets those that are not there."""
