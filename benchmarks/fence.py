"""How long logs are read with and without the process with limits: ``python benchmarks/fence.py [SAMPLES]``.

Cables, an IMU and a tracker in every format that is read in such a process; each is read by turns, all
columns of all topics, with a process that waits for its next log. Medians by the clock.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import log_files

from steelyard.logs.fence import opened_in_fence
from steelyard.logs.formats import FORMATS, format_of

TURNS = 9
WRITTEN = {
    "recording.mcap": log_files.write_mcap_ros2,
    "recording.bag": log_files.write_bag,
    "recording.h5": log_files.write_hdf5,
    "recording.mat": log_files.write_mat,
    "recording.tdms": log_files.write_tdms,
}


def read(path: Path, topics: list[str | None], *, fenced: bool) -> float:
    """Time of a reading [s]."""
    begun = time.perf_counter()
    for topic in topics:
        with (opened_in_fence if fenced else format_of(path).opened)(path, topic) as log:
            # Without topics the cables alone: columns of one length.
            names = log.names if topic else [n for n in log.names if n.startswith("cables")]
            log.load(names, None, None)
    return time.perf_counter() - begun


def main(count: int) -> None:
    """Print the table."""
    print("| log | MiB | read here [s] | with limits [s] | more |\n|---|---:|---:|---:|---:|")
    found = log_files.streams(count)
    with tempfile.TemporaryDirectory() as folder:
        for name, write in WRITTEN.items():
            path = Path(folder) / name
            write(path, found)
            topics = list(FORMATS[path.suffix].topics(path)) or [None]
            read(path, topics, fenced=True)
            turns = [
                [read(path, topics, fenced=fenced) for fenced in (False, True)]
                for _ in range(TURNS)
            ]
            here, with_limits = np.median(turns, axis=0)
            size = path.stat().st_size / (1 << 20)
            print(
                f"| {path.suffix} | {size:.1f} | {here:.3f} | {with_limits:.3f} |"
                f" {with_limits / here - 1:+.0%} |",
                flush=True,
            )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 20_000)
