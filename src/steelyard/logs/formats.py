"""The table of formats, and which of them a file is."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from steelyard.errors import InputError
from steelyard.logs import hdf5, matlab, mcap, npz, parquet, ros_bag, tdms, text
from steelyard.logs.log import MOST_COLUMNS, Log
from steelyard.logs.plain import told
from steelyard.yaml_file import require_file

Reader = Callable[[Path, str | None], AbstractContextManager[Log]]
"""Opens a log of one format: its path, and which of its topics, groups or messages."""

FORMATS: dict[str, Reader] = {
    ".csv": text.opened,
    ".txt": text.opened,
    ".tsv": text.opened,
    ".dat": text.opened,
    ".lvm": text.opened,
    ".csv.gz": text.opened,
    ".txt.gz": text.opened,
    ".tsv.gz": text.opened,
    ".dat.gz": text.opened,
    ".parquet": parquet.opened,
    ".mcap": mcap.opened,
    ".bag": ros_bag.opened,
    ".db3": ros_bag.opened,
    ".h5": hdf5.opened,
    ".hdf5": hdf5.opened,
    ".mat": matlab.opened,
    ".tdms": tdms.opened,
    ".npz": npz.opened,
}
"""Ending -> reader. A folder with a ``metadata.yaml`` is a ROS 2 bag."""

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
        path: Of a file, or of the folder of a ROS 2 bag; its ending tells the format.
        topic: Which of the topics (MCAP, ROS bags) or groups (HDF5, MATLAB structures, TDMS) it
            holds; None: it has but one.

    Yields:
        The log, readable within the block.

    Raises:
        InputError: It is not there, in none of the formats or damaged, or has no such topic.
    """
    with _reader(path)(path, topic) as log:
        if len(log.names) > MOST_COLUMNS:
            raise InputError(
                f"{path}: expected at most {MOST_COLUMNS} columns, found {len(log.names)}; check"
                " that rows are instants"
            )
        yield log


def _reader(path: Path) -> Reader:
    try:
        if (path / _BAG_FOLDER).is_file():
            return ros_bag.opened
    except (OSError, ValueError):
        pass
    require_file(path, "log")
    ending = ending_of(path)
    if ending is None:
        raise InputError(
            f"{path}: expected a log in one of the formats {', '.join(FORMATS)}, found"
            f" '{path.suffix}'; convert it to CSV"
        )
    with told(path), path.open("rb") as file:
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
