"""What a thread has received and nobody has looked at yet."""

from __future__ import annotations

import queue
import time
from collections import deque
from typing import Generic, TypeVar

Item = TypeVar("Item")


class Inbox(Generic[Item]):
    """Items and remarks from another thread; of more items than it has room for the oldest go,
    which is said.
    """

    def __init__(self, room: int) -> None:
        self._items: queue.Queue[Item] = queue.Queue(room)
        self._remarks: deque[str] = deque(maxlen=100)
        self._dropped = 0

    def put(self, item: Item) -> None:
        """Add one; of a single thread."""
        while True:
            try:
                self._items.put_nowait(item)
            except queue.Full:
                try:
                    self._items.get_nowait()
                    self._dropped += 1
                except queue.Empty:
                    continue
            else:
                return

    def say(self, remark: str) -> None:
        """Add what has happened to the connection, in words."""
        self._remarks.append(remark)

    def taken(self, seconds: float) -> tuple[list[Item], list[str]]:
        """All that is there, waited for at most so long [s], and what has happened."""
        until = time.monotonic() + seconds
        found: list[Item] = []
        most = self._items.maxsize
        while len(found) < most:
            left = until - time.monotonic()
            try:
                # Once something is there, nothing more is waited for than a moment.
                found.append(self._items.get(timeout=max(left, 1e-4)))
            except queue.Empty:
                break
            if left <= 0:
                break
        dropped, self._dropped = self._dropped, 0
        if dropped:
            self.say(f"{dropped} messages came faster than they were read and were dropped")
        remarks = []
        while self._remarks:
            remarks.append(self._remarks.popleft())
        return found, remarks
