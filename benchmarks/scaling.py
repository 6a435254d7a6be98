"""What a campaign costs beyond its experiments: `scaling.py [COUNT [METHOD]]`, with two processes and
with two workers of Dask.

One recording of 20 s (CoGiRo, sensors of the paper) stands under COUNT names. The reference is the CPU time
that the work itself takes, one experiment after the other in one process. On a machine with two free
cores wall time over half of that is what counts; where others compute, the CPU time of all processes over
that of the work is what can be said (it leaves out only what workers wait).
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from children import seconds_of_children

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from killed_campaigns import dask_cluster

from steelyard.campaigns.tasks import ExperimentTask
from steelyard.campaigns.work import work_on
from steelyard.processes.workers import ONE_THREAD
from steelyard.simulation.simulate import simulate

SAMPLE = 40
"""Experiments of which the reference is measured; the others are the same."""


def recorded(folder: Path, count: int) -> Path:
    """The same recording under many names."""
    first = folder / "e0000"
    simulate("cogiro", "multisine", duration=20.0, seed=1).write(first)
    for i in range(1, count):
        shutil.copytree(first, folder / f"e{i:04}", copy_function=os.link)
    return folder


def alone(data: Path, out: Path, method: str, count: int) -> float:
    """CPU time of the work of all [s], begun when everything is loaded."""
    names = sorted(path.name for path in data.iterdir())
    tasks = [
        ExperimentTask(n, str(data / n / "experiment.yaml"), str(out / n), methods=(method,))
        for n in names[: 1 + min(SAMPLE, count)]
    ]
    work_on(tasks[0])
    start = time.process_time()
    for task in tasks[1:]:
        work_on(task)
    return (time.process_time() - start) * count / max(1, len(tasks) - 1)


def timed(data: Path, out: Path, method: str, *engine: str) -> tuple[float, float]:
    """Wall and CPU time of a campaign and of the processes that it begins [s]."""
    words = ["campaign", str(data), "--out", str(out), "--method", method, "--quiet", *engine]
    before, start = seconds_of_children(), time.perf_counter()
    subprocess.run(
        [sys.executable, "-m", "steelyard", *words], stdout=subprocess.DEVNULL, check=True
    )
    wall = time.perf_counter() - start
    return wall, seconds_of_children() - before


def cpu_of(processes: list[int]) -> float:
    """CPU time of processes that run [s]."""
    ticks = 0
    for process in processes:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
        ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")


def main(count: int, method: str) -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as temporary:
        top = Path(temporary)
        data = recorded(top / "data", count)
        work = alone(data, top / "alone", method, count)
        print(f"{count} recordings of 20 s by {method}: {work:.1f} s of CPU one after the other")
        print(
            "\n| engine | wall over half of that | CPU over that | overhead for each [ms of CPU] |"
            "\n|---|---:|---:|---:|"
        )

        def show(engine: str, wall: float, cpu: float) -> None:
            each = 1e3 * (cpu - work) / count
            print(
                f"| {engine} | {wall / (work / 2):.2f} | {cpu / work:.3f} | {each:.0f} |",
                flush=True,
            )

        show("--jobs 2", *timed(data, top / "processes", method, "--jobs", "2"))
        with dask_cluster() as (address, workers):
            before = cpu_of(workers)
            wall, cpu = timed(data, top / "dask", method, "--scheduler", address)
            show("Dask, 2 workers", wall, cpu + cpu_of(workers) - before)


if __name__ == "__main__":
    os.environ.update(ONE_THREAD)
    main(
        int(sys.argv[1]) if len(sys.argv) > 1 else 500,
        sys.argv[2] if len(sys.argv) > 2 else "two-step",
    )
