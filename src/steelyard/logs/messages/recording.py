"""Messages of a recording: what every format with topics gives to the table of one of them."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

Values = dict[str, float]
"""Numbers of a message by name; nested fields with dots, elements of lists with brackets."""
Decoder = Callable[[bytes], Values]
"""Reads the numbers of a message; raises ValueError or struct.error for what is no message of its
type."""


class Message(NamedTuple):
    """A message as it was recorded."""

    received: int
    """[ns]."""
    published: int | None
    """[ns]; None: the format has no such time."""
    channel: int
    """Which decoder reads it."""
    data: bytes


class Interval(NamedTuple):
    """When messages were received; both ends belong to it."""

    start: int
    """[ns]."""
    end: int
    """[ns]."""

    def overlaps(self, other: Interval) -> bool:
        """Whether a time is in both."""
        return self.start <= other.end and other.start <= self.end

    def __contains__(self, received: object) -> bool:
        return isinstance(received, int) and self.start <= received <= self.end


@dataclass(frozen=True, eq=False)
class Recording:
    """Messages of several topics."""

    path: Path
    topics: Mapping[str, str]
    """Topic -> type of its messages."""
    interval: Interval | None
    """From the first message of any topic to the last; None: there are none, or it is not known."""
    messages: Callable[[str, Interval | None], Iterator[Message]]
    """Those of a topic that were received within an interval (None: all), in this order. What is
    outside of it is skipped without being unpacked, as far as the format has an index."""
    size: int
    """Bytes of all sections, unpacked."""
    bytes_read: Callable[[], int]
    """Unpacked so far."""
    decoder: Callable[[int], Decoder]
    """Of a channel; raises InputError if its messages cannot be read, and ValueError if their type
    cannot."""


class FileSection(NamedTuple):
    """A part of a file that is read as a whole."""

    interval: Interval
    """Of its messages."""
    read: Callable[[], Iterable[Message]]


def in_time_order(
    pieces: Iterable[FileSection], within: Interval | None = None
) -> Iterator[Message]:
    """Messages of pieces of a file that may overlap in time, with no more pieces in memory than
    overlap.

    Args:
        pieces: In any order.
        within: When the messages were received; None: at any time.
    """
    # The next message of every piece that has begun, and those behind it.
    begun: list[tuple[int, int, Message, Iterator[Message]]] = []
    wanted = [piece for piece in pieces if within is None or piece.interval.overlaps(within)]
    in_order = sorted(wanted, key=lambda piece: piece.interval.start)
    for number, piece in enumerate(in_order):
        messages = sorted(piece.read(), key=lambda message: message.received)
        if within is not None:
            messages = [message for message in messages if message.received in within]
        _begin(begun, number, iter(messages))
        is_last = number + 1 == len(in_order)
        until = math.inf if is_last else in_order[number + 1].interval.start
        while begun and begun[0][0] < until:
            _, first, message, behind = heapq.heappop(begun)
            yield message
            _begin(begun, first, behind)


def _begin(
    begun: list[tuple[int, int, Message, Iterator[Message]]],
    number: int,
    messages: Iterator[Message],
) -> None:
    message = next(messages, None)
    if message is not None:
        heapq.heappush(begun, (message.received, number, message, messages))


def spanned(intervals: Iterable[Interval | None]) -> Interval | None:
    """From the beginning of the first interval to the end of the last; None: there are none, or one
    of them is not known.
    """
    known = list(intervals)
    if not known or None in known:
        return None
    return Interval(
        min(interval.start for interval in known if interval),
        max(interval.end for interval in known if interval),
    )
