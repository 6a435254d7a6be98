"""Prints how fast an hour of CSV is read, and in how much memory: `python benchmarks/reading.py`,
or as part of run.py.

The reference is the bare call of the library that parses it, in the same run. Every reading is a
process of its own; peak memory is its resident set (VmHWM), of which the part that maps files,
mostly the libraries, is printed beside. What is made to do harm follows.
"""

from __future__ import annotations

import gzip
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from steelyard.errors import InputError
from steelyard.experiment.streams.place import StreamPlace
from steelyard.experiment.streams.read_stream import read_stream
from steelyard.instruments import Tension

CABLES, RATE, DURATION = 12, 1000, 3600  # -, [Hz], [s]
WINDOW = (1000.0, 1020.0)  # [s]
ARRAYS = (CABLES + 1) * RATE * DURATION * 8  # [B]
MIB = 1 << 20


def main(folder: Path) -> None:
    csv = folder / "hour.csv"
    write_hour(csv)
    print(
        f"one hour at {RATE} Hz, {CABLES} cables: {csv.stat().st_size / MIB:.0f} MiB of CSV,"
        f" {ARRAYS / MIB:.0f} MiB of arrays"
    )
    bare = median("bare", csv)
    show("polars.read_csv, the reference", bare, bare)
    show("read_stream", median("stream", csv), bare)
    show(f"read_stream, a window of {WINDOW[1] - WINDOW[0]:g} s", median("window", csv), bare)
    for name, path in variants(csv):
        show(f"read_stream, {name}", median("stream", path), bare)
        path.unlink()
    print("\nmade to do harm: size, time, peak memory, and what is said")
    for name, (ending, write) in HARM.items():
        path = folder / f"harm{ending}"
        write(path)
        found = reading("stream", path)
        size = path.stat().st_size / 1e6
        print(
            f"{name:34} {size:6.1f} MB {found['seconds']:6.1f} s {found['peak']:6.0f} MiB  "
            f" {found['said'][:100]}",
            flush=True,
        )
        path.unlink()


def variants(csv: Path) -> Iterator[tuple[str, Path]]:
    """The same table as others write it, one after the other."""
    for name, ending, opened, change in [
        ("packed by gzip", ".csv.gz", lambda path: gzip.GzipFile(path, "wb", 1), lambda text: text),
        (
            "aligned by blanks",
            ".txt",
            lambda path: path.open("wb"),
            lambda text: text.replace(b",", b"  "),
        ),
        (
            "decimal commas",
            ".csv",
            lambda path: path.open("wb"),
            lambda text: text.replace(b",", b";").replace(b".", b","),
        ),
        (
            "in quotes",
            ".csv",
            lambda path: path.open("wb"),
            lambda text: text.replace(b",", b'","').replace(b"\n", b'"\n"'),
        ),
    ]:
        path = csv.with_name(f"variant{ending}")
        with csv.open("rb") as plain, opened(path) as out:
            out.write(b'"' if name == "in quotes" else b"")
            while block := plain.read(MIB):
                out.write(change(block))
            out.write(b'"\n' if name == "in quotes" else b"")
        yield name, path
    path = csv.with_suffix(".parquet")
    pl.read_csv(csv).write_parquet(path)
    yield "Parquet", path


def write_hour(path: Path) -> None:
    """Write forces of an hour, some minutes at a time."""
    rng = np.random.default_rng(0)
    with path.open("wb") as file:
        for first in range(0, DURATION, 300):
            time_ = np.arange(first * RATE, (first + 300) * RATE) / RATE
            forces = {f"f{i + 1}": rng.normal(500, 100, len(time_)).round(4) for i in range(CABLES)}
            pl.DataFrame({"t": time_, **forces}).write_csv(file, include_header=first == 0)


def reading(what: str, path: Path) -> dict[str, Any]:
    """Read a file in a process of its own."""
    command = [sys.executable, __file__, what, str(path)]
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


def median(what: str, path: Path) -> dict[str, Any]:
    """That of three readings, once the file is in the memory of the system."""
    reading(what, path)
    return sorted((reading(what, path) for _ in range(3)), key=lambda found: found["seconds"])[1]


def show(what: str, found: dict[str, Any], bare: dict[str, Any]) -> None:
    ratio, share = found["seconds"] / bare["seconds"], found["peak"] * MIB / ARRAYS
    print(
        f"{what:34} {found['seconds']:6.2f} s = {ratio:4.2f} x reference (cpu {found['cpu']:5.2f}"
        f" s)   peak {found['peak']:5.0f} MiB = {share:4.2f} x arrays, {found['mapped']:3.0f} MiB"
        " of it files",
        flush=True,
    )


def read(what: str, path: Path) -> None:
    """What one process does: print time [s], processor time [s], peak memory and mapped files
    [MiB], and what was said."""
    start, said = time.perf_counter(), ""
    used = time.process_time()
    if what == "bare":
        pl.read_csv(path)
    else:
        try:
            span = WINDOW if what == "window" else None
            stream = read_stream(
                StreamPlace(path), Tension(kind="tension"), CABLES, static=False, span=span
            )
            assert stream.values["tension"].shape == (len(stream), CABLES)
        except InputError as error:
            said = str(error).replace(str(path.parent) + "/", "")
    seconds, cpu = time.perf_counter() - start, time.process_time() - used
    lines = Path("/proc/self/status").read_text().splitlines()
    status = {
        line.split(":")[0]: int(line.split()[1]) / 1024 for line in lines if line.endswith(" kB")
    }
    found = {
        "seconds": seconds,
        "cpu": cpu,
        "peak": status["VmHWM"],
        "mapped": status["RssFile"],
        "said": said,
    }
    print(json.dumps(found))


def packed(*parts: tuple[bytes, int]) -> Callable[[Path], None]:
    """Writer of a gzip file of parts that are there again and again."""

    def write(path: Path) -> None:
        with gzip.open(path, "wb", compresslevel=9) as file:
            for text, times in parts:
                block = text * max(1, min(times, MIB // len(text)))
                for _ in range(times * len(text) // len(block)):
                    file.write(block)

    return write


HEADER = ("t," + ",".join(f"f{i + 1}" for i in range(CABLES)) + "\n").encode()
ROW = ("0" + ",0" * CABLES + "\n").encode()
COLUMNS = [f"c{i}" for i in range(100_000)]
HARM = {
    "10 GB of rows": (".csv.gz", packed((HEADER, 1), (ROW, 10_000_000_000 // len(ROW)))),
    "2 GB of one line": (".csv.gz", packed((b"0,", 1_000_000_000))),
    "2 GB of newlines": (".csv.gz", packed((HEADER, 1), (b"\n", 2_000_000_000))),
    "2 GB of comments": (".csv.gz", packed((HEADER, 1), (ROW, 9), (b"#\n", 1_000_000_000))),
    "500000 empty members": (
        ".csv.gz",
        lambda path: path.write_bytes(gzip.compress(b"", mtime=0) * 500_000),
    ),
    "10^5 columns": (
        ".csv",
        lambda path: path.write_text(",".join(COLUMNS) + "\n" + ("0," * 99_999 + "0\n") * 50),
    ),
    "header of 20 MB": (".csv", lambda path: path.write_bytes(b"n" * 20_000_000 + b"\n" + ROW)),
    "line of 100 MB": (".csv", lambda path: path.write_bytes(b"0," * 50_000_000)),
    "NUL bytes behind an hour": (
        ".csv",
        lambda path: path.write_bytes(HEADER + ROW * 4_000_000 + b"\0" * 1_000_000),
    ),
    "quotation marks that never close": (
        ".csv",
        lambda path: path.write_bytes(HEADER + b'"' + ROW * 3_000_000),
    ),
    "10^7 blank lines": (".csv", lambda path: path.write_bytes(b"\n" * 10_000_000)),
    "100 MB of text": (
        ".csv",
        lambda path: path.write_bytes(b"some, text; without | numbers\n" * 3_400_000),
    ),
    "20 MB of random bytes": (
        ".csv",
        lambda path: path.write_bytes(np.random.default_rng(0).bytes(20_000_000)),
    ),
}

if __name__ == "__main__":
    if len(sys.argv) == 3:
        read(sys.argv[1], Path(sys.argv[2]))
    else:
        with tempfile.TemporaryDirectory() as temporary:
            main(Path(temporary))
