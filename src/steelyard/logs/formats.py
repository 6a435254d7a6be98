"""The table of formats, and which of them a file is."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path

from steelyard.errors import InputError
from steelyard.logs import parquet
from steelyard.logs.arrays import hdf5, matlab, npz, tdms
from steelyard.logs.log import MOST_COLUMNS, Log
from steelyard.logs.messages import mcap, ros_bag
from steelyard.logs.text import reader as text
from steelyard.logs.text.plain import readable
from steelyard.yaml_file import require_file


@dataclass(frozen=True)
class LogFormat:
    """How logs of one format are read."""

    opened: Callable[[Path, str | None], AbstractContextManager[Log]]
    """Opens a log: its path, and which of its topics, groups or structures."""
    topics: Callable[[Path], list[str]]
    """Those of which one has to be chosen; none: the log is one table."""


def _one_table(path: Path) -> list[str]:
    """Topics of a format that has none."""
    return []


_TEXT = LogFormat(text.opened, _one_table)
_BAG = LogFormat(ros_bag.opened, ros_bag.topics)
_HDF5 = LogFormat(hdf5.opened, hdf5.topics)

FORMATS: dict[str, LogFormat] = {
    ".csv": _TEXT,
    ".txt": _TEXT,
    ".tsv": _TEXT,
    ".dat": _TEXT,
    ".lvm": _TEXT,
    ".csv.gz": _TEXT,
    ".txt.gz": _TEXT,
    ".tsv.gz": _TEXT,
    ".dat.gz": _TEXT,
    ".parquet": LogFormat(parquet.opened, _one_table),
    ".mcap": LogFormat(mcap.opened, mcap.topics),
    ".bag": _BAG,
    ".db3": _BAG,
    ".h5": _HDF5,
    ".hdf5": _HDF5,
    ".mat": LogFormat(matlab.opened, matlab.topics),
    ".tdms": LogFormat(tdms.opened, tdms.topics),
    ".npz": LogFormat(npz.opened, _one_table),
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


def _format(path: Path) -> LogFormat:
    """The format of a log by its ending, if the file begins as such files do."""
    try:
        if (path / _BAG_FOLDER).is_file():
            return _BAG
    except (OSError, ValueError):
        pass
    require_file(path, "log")
    ending = ending_of(path)
    if ending is None:
        raise InputError(
            f"{path}: expected a log in one of the formats {', '.join(FORMATS)}, found"
            f" '{path.suffix}'; convert it to CSV"
        )
    with readable(path), path.open("rb") as file:
        beginning = file.read(16)
    for magic, endings in _BEGINNINGS.items():
        if beginning.startswith(magic) and ending not in endings:
            raise InputError(
                f"{path}: expected a {ending} file, found one that begins as {' or '.join(endings)}"
                " do; correct its ending"
            )
    return FORMATS[ending]


def ending_of(path: Path) -> str | None:
    """Ending of a path as the table of formats has it; None: of no format."""
    name = path.name.lower()
    return max((ending for ending in FORMATS if name.endswith(ending)), key=len, default=None)
