"""Time and memory of `steelyard identify` by the length of the recording, up to ten minutes.

`python benchmarks/length_scaling.py`.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from hour import RATES, write_long

LENGTHS = (20.0, 60.0, 180.0, 600.0)
FAST = RATES
PAPER = {"cables": 25.0, "imu": 25.0, "tracker": 238.0}
REFERENCE = [
    sys.executable,
    "-c",
    "import casadi, numpy, polars, pydantic, scipy.interpolate, scipy.integrate",
]
LONGEST, LARGEST, EXPONENT = 90.0, 2048.0, 1.1
"""Limits for ten minutes [s], [MiB], and for the growth."""
WHOLE, SOLVER = 3.5, 1.0
"""Limits for 20 s with the rates of the paper [s]."""
TIMED = """
import os
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import time
from steelyard.cli import main
from steelyard.identification.solve import joint_study
spent, solve = [], joint_study.fit
def fit(*given):
    start = time.perf_counter()
    try:
        return solve(*given)
    finally:
        spent.append(time.perf_counter() - start)
joint_study.fit = fit
try:
    main()
finally:
    print("\\n" + str(sum(spent)))
"""
"""`steelyard` as it is, which says in the end how long its solver took [s]."""


@dataclass(frozen=True)
class Taken:
    """What a whole process took."""

    wall: float
    """[s]"""
    solver: float
    """[s]"""
    peak: float
    """[MiB]"""
    output: str


def taken(command: list[str], folder: Path) -> Taken:
    """Run a command that says in its last line how long its solver took."""
    with (folder / "output").open("w+") as output:
        start = time.perf_counter()
        child = subprocess.Popen(command, stdout=output)
        _, status, usage = os.wait4(child.pid, 0)
        wall = time.perf_counter() - start
        child.returncode = os.waitstatus_to_exitcode(status)
        output.seek(0)
        *lines, solver = output.read().splitlines()
    # 3: the estimate was made but not accepted.
    if child.returncode not in {0, 3}:
        raise RuntimeError(f"{' '.join(command)} ended with {child.returncode}")
    return Taken(wall, float(solver), usage.ru_maxrss / 1024, "\n".join(lines))


def lengths() -> None:
    """Time and memory of `steelyard identify` by the length of the recording."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        reference = statistics.median(_bare_import() for _ in range(3))
        print(f"{'bare import of the libraries':44}{reference:8.2f} s")
        print(
            f"{'recording, method':44}{'whole':>10}{'over bare':>11}{'solver':>10}{'peak':>12} "
            " fits"
        )
        default = _shown(folder, 20.0, PAPER, [], reference, repeat=3)
        print(f"{'  limits':44}{WHOLE:8.2f} s{'':11}{SOLVER:8.2f} s")
        _shown(folder, 20.0, PAPER, ["--method", "maximum-likelihood"], reference, repeat=3)
        by_length = {
            length: _shown(
                folder,
                length,
                FAST,
                ["--method", "maximum-likelihood"],
                reference,
                repeat=3 if length < 100 else 1,
            )
            for length in LENGTHS
        }
        print(f"{'  limits for 600 s':44}{LONGEST:8.2f} s{'':21}{LARGEST:8.0f} MiB")
        long = [length for length in LENGTHS if length >= 60]
        growth = {
            what: float(
                np.polyfit(
                    np.log(long), np.log([getattr(by_length[each], what) for each in long]), 1
                )[0]
            )
            for what in ("wall", "solver", "peak")
        }
        print(
            f"exponent of growth from 60 to 600 s: whole process {growth['wall']:.2f}, solver"
            f" {growth['solver']:.2f}, memory {growth['peak']:.2f}   limit {EXPONENT}"
        )
        last = by_length[LENGTHS[-1]]
        kept = {
            "20 s whole": default.wall < WHOLE,
            "20 s solver": default.solver < SOLVER,
            "600 s whole": last.wall < LONGEST,
            "600 s memory": last.peak < LARGEST,
            "growth": growth["wall"] < EXPONENT,
        }
        print(", ".join(f"{what}: {'within' if each else 'BEYOND'}" for what, each in kept.items()))


def _bare_import() -> float:
    start = time.perf_counter()
    subprocess.run(REFERENCE, check=True)
    return time.perf_counter() - start


def _shown(
    folder: Path,
    length: float,
    rates: Mapping[str, float],
    options: list[str],
    reference: float,
    *,
    repeat: int,
) -> Taken:
    """Median by wall time of several runs, printed."""
    place = folder / f"{length:.0f}-{rates['cables']:.0f}"
    if not place.exists():
        # In a process of its own: what this one holds would count as the memory of its children.
        writer = get_context("spawn").Process(target=write_long, args=(place, length, rates))
        writer.start()
        writer.join()
    command = [
        sys.executable,
        "-c",
        TIMED,
        "identify",
        str(place / "experiment.yaml"),
        *options,
        "--quiet",
        "--json",
    ]
    one = sorted((taken(command, folder) for _ in range(repeat)), key=lambda each: each.wall)[
        repeat // 2
    ]
    found = json.loads(one.output)["estimates"]["maximum-likelihood"]
    what = (
        f"{length:.0f} s at {', '.join(f'{rate:.0f}' for rate in rates.values())} Hz,"
        f" {'ML' if options else 'default'}"
    )
    solver = found["details"]["solver"]
    verdict = (
        "accepted"
        if found["verdict"]["accepted"]
        else f"rejected: {found['verdict']['reasons'][0][:90]}"
    )
    print(
        f"{what:44}{one.wall:8.2f} s{one.wall / reference:9.1f} x{one.solver:8.2f} s{one.peak:8.0f}"
        f" MiB  {solver['steps']} steps in the last,"
        f" {'' if solver['converged'] else 'not '}converged, {verdict}",
        flush=True,
    )
    return one


if __name__ == "__main__":
    lengths()
