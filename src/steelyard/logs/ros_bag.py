"""Bags of ROS: files of ROS 1, folders and databases of ROS 2."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from steelyard.logs import ros1_bag, ros2_bag
from steelyard.logs.log import Log
from steelyard.logs.messages import log_of_topic


@contextmanager
def opened(path: Path, topic: str | None) -> Iterator[Log]:
    """Open a topic of a bag.

    Raises:
        InputError: The bag is damaged or cut off, or has no such topic, or messages that cannot be
            read.
    """
    open_bag = ros1_bag.opened if path.suffix.lower() == ".bag" else ros2_bag.opened
    with open_bag(path) as recording:
        yield log_of_topic(recording, topic)
