"""Bags of ROS: files of ROS 1, folders and databases of ROS 2."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from steelyard.logs.log import Log
from steelyard.logs.messages import ros1_bag, ros2_bag
from steelyard.logs.messages.recording import Recording
from steelyard.logs.messages.topic_table import log_of_topic


@contextmanager
def opened(path: Path, topic: str | None) -> Iterator[Log]:
    """Open a topic of a bag.

    Raises:
        InputError: The bag is damaged or cut off, or has no such topic, or messages that cannot be
            read.
    """
    with _recording(path) as recording:
        yield log_of_topic(recording, topic)


def topics(path: Path) -> list[str]:
    """Topics of a bag.

    Raises:
        InputError: The bag is damaged or cut off.
    """
    with _recording(path) as recording:
        return list(recording.topics)


def _recording(path: Path) -> AbstractContextManager[Recording]:
    """The messages of a bag of either version."""
    is_of_ros1 = path.suffix.lower() == ".bag"
    return ros1_bag.opened(path) if is_of_ros1 else ros2_bag.opened(path)
