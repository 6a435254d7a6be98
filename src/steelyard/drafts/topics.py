"""Which topics or groups a log holds."""

from __future__ import annotations

import re
from contextlib import ExitStack
from pathlib import Path

from steelyard.errors import InputError
from steelyard.logs import mcap, ros1_bag, ros2_bag
from steelyard.logs.formats import ending_of, open_log
from steelyard.yaml_file import require_file

TREES = (".h5", ".hdf5", ".mat", ".tdms")
"""Endings of logs that hold groups of arrays."""
_GROUPS = re.compile(r"expected 'topic' to say which .* found (?P<names>.*); name one$")


def topics_of(path: Path) -> list[str | None]:
    """Topics of a recording of messages, or groups of a file of arrays; None alone: the log is one
    table.

    Raises:
        InputError: It is damaged or cut off, or has too many groups to name.
    """
    if not path.is_dir():
        require_file(path, "log")
    with ExitStack() as stack:
        if path.is_dir() or ending_of(path) == ".db3":
            return list(stack.enter_context(ros2_bag.opened(path)).topics)
        if ending_of(path) == ".bag":
            return list(stack.enter_context(ros1_bag.opened(path)).topics)
        if ending_of(path) == ".mcap":
            return list(mcap.recording_of(path, stack.enter_context(path.open("rb"))).topics)
        if ending_of(path) in TREES:
            return _groups(path)
    return [None]


def _groups(path: Path) -> list[str | None]:
    """Groups as the reader names them, which runs apart and tells no more; what is misread is no
    group and will be said.
    """
    try:
        with open_log(path):
            return [None]
    except InputError as error:
        match = _GROUPS.search(str(error))
        if match is None or match["names"].endswith("…"):
            raise
        return list(match["names"].split(", "))
