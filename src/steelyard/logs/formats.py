"""The table of formats, and which of them a file is."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from steelyard.errors import InputError
from steelyard.logs import parquet
from steelyard.logs.arrays import hdf5, matlab, npz, tdms
from steelyard.logs.arrays.subprocess_reader import opened_in_subprocess, topics_in_subprocess
from steelyard.logs.log import MOST_COLUMNS, Log
from steelyard.logs.messages import mcap, ros1_bag, ros2_bag
from steelyard.logs.messages.recording import Recording
from steelyard.logs.messages.topic_table import log_of_topic
from steelyard.logs.text import reader as text
from steelyard.logs.text.plain import readable
from steelyard.plugins.provided import provided
from steelyard.yaml_file import require_file


@dataclass(frozen=True)
class LogFormat:
    """How logs of one format are read."""

    opened: Callable[[Path, str | None], AbstractContextManager[Log]]
    """Opens a log: its path, and which of its topics, groups or structures."""
    topics: Callable[[Path], list[str]]
    """Those of which one has to be chosen; none: the log is one table."""


def _one_table(what: str, opened: Callable[[Path], AbstractContextManager[Log]]) -> LogFormat:
    """A format whose files are one table each, so that no topic can be named."""

    def without_topic(path: Path, topic: str | None) -> AbstractContextManager[Log]:
        if topic is not None:
            raise InputError(
                f"{path}: expected no 'topic' for a {what} file, found '{topic}'; leave it out"
            )
        return opened(path)

    return LogFormat(without_topic, lambda path: [])


def _messages(recorded: Callable[[Path], AbstractContextManager[Recording]]) -> LogFormat:
    """A format of recorded messages, whose topics are a table each."""

    @contextmanager
    def opened(path: Path, topic: str | None) -> Iterator[Log]:
        with recorded(path) as recording:
            yield log_of_topic(recording, topic)

    def topics(path: Path) -> list[str]:
        with recorded(path) as recording:
            return list(recording.topics)

    return LogFormat(opened, topics)


_TEXT = _one_table("text", text.opened)
_ROS2_BAG = _messages(ros2_bag.opened)
_HDF5 = LogFormat(partial(opened_in_subprocess, hdf5), partial(topics_in_subprocess, hdf5))

FORMATS: dict[str, LogFormat] = {
    **dict.fromkeys((".csv", ".txt", ".tsv", ".dat", ".lvm"), _TEXT),
    **dict.fromkeys((".csv.gz", ".txt.gz", ".tsv.gz", ".dat.gz"), _TEXT),
    ".parquet": _one_table("Parquet", parquet.opened),
    ".mcap": _messages(mcap.opened),
    ".bag": _messages(ros1_bag.opened),
    ".db3": _ROS2_BAG,
    ".h5": _HDF5,
    ".hdf5": _HDF5,
    ".mat": LogFormat(partial(opened_in_subprocess, matlab), partial(topics_in_subprocess, matlab)),
    ".tdms": LogFormat(partial(opened_in_subprocess, tdms), lambda path: []),
    ".npz": _one_table("NumPy", npz.opened),
}
"""Ending -> format. A folder with a ``metadata.yaml`` is a ROS 2 bag."""

_BAG_FOLDER = "metadata.yaml"

_BEGINNINGS: dict[bytes, tuple[str, ...]] = {
    b"PAR1": (".parquet",),
    b"\x89MCAP0\r\n": (".mcap",),
    b"#ROSBAG V": (".bag",),
    b"SQLite format 3\x00": (".db3",),
    b"\x89HDF\r\n\x1a\n": (".h5", ".hdf5", ".mat"),
    b"MATLAB ": (".mat",),
    b"TDSm": (".tdms",),
    b"PK\x03\x04": (".npz",),
    b"\x1f\x8b": (".csv.gz", ".txt.gz", ".tsv.gz", ".dat.gz"),
}
"""How files of these endings begin; text begins otherwise."""
_LONGEST_BEGINNING = max(map(len, _BEGINNINGS))
"""Bytes."""


@contextmanager
def open_log(path: Path, topic: str | None = None) -> Iterator[Log]:
    """Open a log of any format.

    Args:
        path: Of a file, or of the folder of a ROS 2 bag; its ending says the format.
        topic: Which of the topics (MCAP, ROS bags) or groups (HDF5, MATLAB structures, TDMS) it
            holds; None: it has but one.

    Yields:
        The log, readable within the block.

    Raises:
        InputError: It is not there, in none of the formats or damaged, or has no such topic.
    """
    with _format(path).opened(path, topic) as log:
        if len(log.names) > MOST_COLUMNS:
            raise InputError(
                f"{path}: expected at most {MOST_COLUMNS} columns, found {len(log.names)}; check"
                " that rows are instants"
            )
        yield log


def topics(path: Path) -> list[str]:
    """Topics, groups or structures of a log of any format, of which one has to be chosen.

    Args:
        path: Of a file, or of the folder of a ROS 2 bag; its ending says the format.

    Returns:
        Their names, as :func:`open_log` takes them; none: the log is one table.

    Raises:
        InputError: It is not there, in none of the formats or damaged.
    """
    return _format(path).topics(path)


def ending_of(path: Path) -> str | None:
    """Ending of a path as the table of formats has it; None: of no format."""
    name = path.name.lower()
    return max((ending for ending in FORMATS if name.endswith(ending)), key=len, default=None)


def _format(path: Path) -> LogFormat:
    """The format of a log by its ending, if the file begins as such files do."""
    try:
        if (path / _BAG_FOLDER).is_file():
            return _ROS2_BAG
    except (OSError, ValueError):
        pass
    require_file(path, "log")
    # Never opened: pipes of the kernel are files of no size, and wait.
    if not path.stat().st_size:
        raise InputError(
            f"{path}: expected a log, found an empty file, with no columns; record or copy it again"
        )
    ending = ending_of(path)
    if ending is None:
        opened = provided("logs", path.suffix.lower().removeprefix("."))
        if opened is not None:
            return _one_table(f"'{path.suffix}'", opened)
        raise InputError(
            f"{path}: expected a log in one of the formats {', '.join(FORMATS)}, found"
            f" '{path.suffix}'; convert it to CSV"
        )
    _check_beginning(path, ending)
    return FORMATS[ending]


def _check_beginning(path: Path, ending: str) -> None:
    """Refuse a file that begins as those of other endings do."""
    with readable(path), path.open("rb") as file:
        beginning = file.read(_LONGEST_BEGINNING)
    for magic, endings in _BEGINNINGS.items():
        if beginning.startswith(magic) and ending not in endings:
            raise InputError(
                f"{path}: expected a {ending} file, found one that begins as {' or '.join(endings)}"
                " do; correct its ending"
            )
