"""The table of formats, and which of them a file is."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from steelyard.errors import InputError
from steelyard.files.regular_file import require_file
from steelyard.logs import parquet
from steelyard.logs.arrays import hdf5, matlab, npz, tdms
from steelyard.logs.arrays.nested import Arrays
from steelyard.logs.fence import opened_in_fence, topics_in_fence
from steelyard.logs.log import MOST_COLUMNS, Log
from steelyard.logs.messages import mcap, ros1_bag, ros2_bag
from steelyard.logs.messages.recording import Recording
from steelyard.logs.messages.topic_table import log_of_topic
from steelyard.logs.text import reader as text
from steelyard.logs.text.plain import readable
from steelyard.plugins.provided import provided


@dataclass(frozen=True)
class LogFormat:
    """How logs of one format are read."""

    opened: Callable[[Path, str | None], AbstractContextManager[Log]]
    """Opens a log: its path, and which of its topics, groups or structures."""
    topics: Callable[[Path], list[str]]
    """Those of which one has to be chosen; none: the log is one table."""
    what: str = "a log"
    """The format, with an article."""
    require: Callable[[Path], None] | None = None
    """Raises InputError unless the library that reads the file is installed; None: it always is."""
    fenced: bool = True
    """Whether it is read in a process with limits."""
    bytes_per_second: int = 5_000_000
    """Of the file, at the slowest: what its size adds to the limit of time."""


def _one_table(
    what: str, opened: Callable[[Path], AbstractContextManager[Log]], *, fenced: bool = True
) -> LogFormat:
    """A format whose files are one table each, so that no topic can be named."""

    def without_topic(path: Path, topic: str | None) -> AbstractContextManager[Log]:
        if topic is not None:
            raise InputError(
                f"{path}: expected no 'topic' for a {what} file, found '{topic}'; leave it out"
            )
        return opened(path)

    return LogFormat(without_topic, lambda path: [], f"a {what} file", fenced=fenced)


def _messages(
    what: str,
    recorded: Callable[[Path], AbstractContextManager[Recording]],
    require: Callable[[Path], None],
) -> LogFormat:
    """A format of recorded messages, whose topics are a table each."""

    @contextmanager
    def opened(path: Path, topic: str | None) -> Iterator[Log]:
        with recorded(path) as recording:
            yield log_of_topic(recording, topic)

    def topics(path: Path) -> list[str]:
        with recorded(path) as recording:
            return list(recording.topics)

    return LogFormat(opened, topics, what, require, bytes_per_second=_PACKED_MESSAGES)


def _arrays(
    what: str,
    arrays_in: Callable[[Path, str | None], AbstractContextManager[Arrays]],
    require: Callable[[Path], None],
) -> LogFormat:
    """A format of arrays, in groups."""

    @contextmanager
    def opened(path: Path, topic: str | None) -> Iterator[Log]:
        with arrays_in(path, topic) as arrays:
            yield arrays.log(topic)

    def topics(path: Path) -> list[str]:
        with arrays_in(path, None) as arrays:
            return arrays.topics()

    return LogFormat(opened, topics, what, require)


_PACKED_MESSAGES = 250_000
"""Bytes of a file of messages that are read in a second at the slowest, packed to a tenth."""
# Its own reader bounds time and memory by the size of the file, and small files are many.
_TEXT = _one_table("text", text.opened, fenced=False)
_ROS2_BAG = _messages("a ROS 2 bag", ros2_bag.opened, ros2_bag.require)
_HDF5 = _arrays(hdf5.WHAT, hdf5.arrays_here, hdf5.require)

FORMATS: dict[str, LogFormat] = {
    **dict.fromkeys((".csv", ".txt", ".tsv", ".dat", ".lvm"), _TEXT),
    **dict.fromkeys((".csv.gz", ".txt.gz", ".tsv.gz", ".dat.gz"), _TEXT),
    ".parquet": _one_table("Parquet", parquet.opened, fenced=False),
    ".mcap": _messages("an MCAP file", mcap.opened, mcap.require),
    ".bag": _messages("a ROS bag", ros1_bag.opened, ros1_bag.require),
    ".db3": _ROS2_BAG,
    ".h5": _HDF5,
    ".hdf5": _HDF5,
    ".mat": _arrays(matlab.WHAT, matlab.arrays_here, matlab.require),
    ".tdms": replace(_arrays(tdms.WHAT, tdms.arrays_here, tdms.require), topics=lambda path: []),
    ".npz": _one_table("NumPy", npz.opened, fenced=False),
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
    form = format_of(path)
    if form.require is not None:
        form.require(path)
    opened = opened_in_fence if form.fenced else form.opened
    with opened(path, topic) as log:
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
    form = format_of(path)
    if form.require is not None:
        form.require(path)
    return topics_in_fence(path) if form.fenced else form.topics(path)


def ending_of(path: Path) -> str | None:
    """Ending of a path as the table of formats has it; None: of no format."""
    name = path.name.lower()
    return max((ending for ending in FORMATS if name.endswith(ending)), key=len, default=None)


def format_of(path: Path) -> LogFormat:
    """The format of a log by its ending, if the file begins as such files do; it reads in this
    process, without the fence.

    Raises:
        InputError: The log is not there, in none of the formats, or begins as another one does.
    """
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
            return _one_table(f"'{path.suffix}'", opened, fenced=False)
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
