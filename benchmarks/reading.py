"""Prints how fast an hour of CSV is read, and in how much memory: `python benchmarks/reading.py`, or as part of run.py.

The reference is the bare call of the library that parses it, in the same run. Every reading is a process of its own; peak memory is
its resident set (VmHWM), of which the part that maps files, mostly the libraries, is printed beside. What is made to do harm follows.
"""

from __future__ import annotations

import gzip
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import polars as pl

from steelyard.errors import InputError
from steelyard.experiment.streams import Place, read_stream
from steelyard.instruments import Tension

CABLES, RATE, DURATION = 12, 1000, 3600  # -, [Hz], [s]
WINDOW = (1000.0, 1020.0)  # [s]
ARRAYS = (CABLES + 1) * RATE * DURATION * 8  # [B]
MIB = 1 << 20


def main(folder: Path) -> None:
    csv, packed, aligned = folder / "hour.csv", folder / "hour.csv.gz", folder / "aligned.txt"
    write_hour(csv)
    with csv.open("rb") as plain, gzip.open(packed, "wb", compresslevel=1) as out:
        while block := plain.read(MIB):
            out.write(block)
    with csv.open("rb") as plain, aligned.open("wb") as out:
        while block := plain.read(MIB):
            out.write(block.replace(b",", b"  "))
    size = csv.stat().st_size
    print(f"one hour at {RATE} Hz, {CABLES} cables: {size / MIB:.0f} MiB of CSV, {ARRAYS / MIB:.0f} MiB of arrays")
    bare = reading("bare", csv)
    show("polars.read_csv, the reference", bare, bare)
    show("read_stream", reading("stream", csv), bare)
    show(f"read_stream, a window of {WINDOW[1] - WINDOW[0]:g} s", reading("window", csv), bare)
    show("read_stream, packed by gzip", reading("stream", packed), bare)
    show("read_stream, aligned by blanks", reading("stream", aligned), bare)
    print("\nmade to do harm: size, time, peak memory, and what is said")
    for name, (ending, write) in HARM.items():
        path = folder / f"harm{ending}"
        write(path)
        found = reading("stream", path)
        print(
            f"{name:38} {path.stat().st_size / 1e6:7.1f} MB {found['seconds']:6.1f} s {found['peak']:6.0f} MiB  {found['said'][:90]}",
            flush=True,
        )
        path.unlink()


def write_hour(path: Path) -> None:
    """Write forces of an hour, some minutes at a time."""
    rng = np.random.default_rng(0)
    with path.open("wb") as file:
        for first in range(0, DURATION, 300):
            time_ = np.arange(first * RATE, (first + 300) * RATE) / RATE
            forces = {f"f{i + 1}": rng.normal(500, 100, len(time_)).round(4) for i in range(CABLES)}
            pl.DataFrame({"t": time_, **forces}).write_csv(file, include_header=first == 0)


def reading(what: str, path: Path) -> dict[str, float | str]:
    """Read a file in a process of its own, the second time, when it is in the memory of the system."""
    for _ in range(2):
        command = [sys.executable, __file__, what, str(path)]
        found = subprocess.run(command, capture_output=True, text=True, check=True)
    return json.loads(found.stdout)


def show(what: str, found: dict[str, float | str], bare: dict[str, float | str]) -> None:
    ratio, share = float(found["seconds"]) / float(bare["seconds"]), float(found["peak"]) * MIB / ARRAYS
    print(
        f"{what:34} {found['seconds']:6.2f} s = {ratio:4.2f} x reference (cpu {found['cpu']:5.2f} s)   peak {found['peak']:5.0f} MiB = {share:4.2f} x arrays, "
        f"{found['mapped']:3.0f} MiB of it files",
        flush=True,
    )


def read(what: str, path: Path) -> None:
    """What one process does: print time [s], processor time [s], peak memory and mapped files [MiB], and what was said."""
    start, said = time.perf_counter(), ""
    used = time.process_time()
    if what == "bare":
        pl.read_csv(path)
    else:
        try:
            span = WINDOW if what == "window" else None
            stream = read_stream(Place(path), Tension(kind="tension"), CABLES, static=False, span=span)
            assert stream.values["tension"].shape == (len(stream), CABLES)
        except InputError as error:
            said = str(error).replace(str(path.parent) + "/", "")
    seconds, cpu = time.perf_counter() - start, time.process_time() - used
    lines = Path("/proc/self/status").read_text().splitlines()
    status = {line.split(":")[0]: int(line.split()[1]) / 1024 for line in lines if line.endswith(" kB")}
    found = {"seconds": seconds, "cpu": cpu, "peak": status["VmHWM"], "mapped": status["RssFile"], "said": said}
    print(json.dumps(found))


def packed(*parts: tuple[bytes, int]):
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
    "500000 empty members": (".csv.gz", lambda path: path.write_bytes(gzip.compress(b"", mtime=0) * 500_000)),
    "10^5 columns": (".csv", lambda path: path.write_text(",".join(COLUMNS) + "\n" + ("0," * 99_999 + "0\n") * 50)),
    "header of 20 MB": (".csv", lambda path: path.write_bytes(b"n" * 20_000_000 + b"\n" + ROW)),
    "line of 100 MB": (".csv", lambda path: path.write_bytes(b"0," * 50_000_000)),
    "NUL bytes behind an hour": (".csv", lambda path: path.write_bytes(HEADER + ROW * 4_000_000 + b"\0" * 1_000_000)),
    "quotation marks that never close": (".csv", lambda path: path.write_bytes(HEADER + b'"' + ROW * 3_000_000)),
    "10^7 blank lines": (".csv", lambda path: path.write_bytes(b"\n" * 10_000_000)),
    "100 MB of text": (".csv", lambda path: path.write_bytes(b"some, text; without | numbers\n" * 3_400_000)),
    "20 MB of random bytes": (".csv", lambda path: path.write_bytes(np.random.default_rng(0).bytes(20_000_000))),
}

if __name__ == "__main__":
    if len(sys.argv) == 3:
        read(sys.argv[1], Path(sys.argv[2]))
    else:
        with tempfile.TemporaryDirectory() as temporary:
            main(Path(temporary))
