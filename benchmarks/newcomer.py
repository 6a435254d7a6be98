"""Ten tasks of somebody who uses steelyard for the first time: commands, seconds of CPU, and words that are
printed and have to be read. `python benchmarks/newcomer.py [TASK ...]`, tasks by their numbers.

The recordings are made first, and not counted; every command is a process of its own, on pipes.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from datetime import date
from pathlib import Path

from children import seconds_of_children

STEELYARD = [sys.executable, "-m", "steelyard"]

ARRAYS = """
import polars as pl
import steelyard as sy
of = {name: pl.read_csv(f"raw/{name}.csv") for name in ("cables", "imu", "tracker")}
experiment = sy.Experiment.from_frames(
    "cogiro",
    instruments={
        "cables": sy.Tension(noise=5),
        "imu": sy.Imu(position=[0.047, -0.039, 0.299]),
        "tracker": sy.Position(target=[0.098, 0.197, 1.1], noise=0.0005),
    },
    runs={"a": of},
    clocks={"cables": "recorder", "imu": "recorder"},
    sync="auto",
)
print(sy.identify(experiment).estimate)
"""


@dataclass(frozen=True)
class Task:
    """What somebody wants to have done."""

    what: str
    commands: tuple[str, ...]
    edits: tuple[tuple[str, str, str], ...] = ()
    """File, text, and what is written in its place, before the last command."""
    ends: int = 0
    """Exit status of the last command."""


_PLACES = (
    ("own.yaml", "# position: [0.0, 0.0, 0.0]", "position: [0.047, -0.039, 0.299]"),
    ("own.yaml", "# target: [0.0, 0.0, 0.0]", "target: [0.098, 0.197, 1.1]"),
)
TASKS = (
    Task(
        "raw CSVs to a checked result",
        (
            "init raw --robot cogiro --out own.yaml",
            "inspect own.yaml",
            "identify own.yaml --out own",
        ),
        _PLACES,
    ),
    Task("arrays to a verdict (16 lines of Python)", (f"python {ARRAYS}",)),
    Task(
        "a wrong unit to the right result",
        ("identify wrong/experiment.yaml", "identify wrong/experiment.yaml"),
        (("wrong/experiment.yaml", "scale: 0.001", "scale: 1"),),
    ),
    Task("result to controller", ("export result --out platform.st",)),
    Task(
        "a campaign of three recordings", ("campaign one two three --out campaign --jobs 1",), (), 0
    ),
    Task("a live replay", ("watch one/experiment.yaml --source replay:multisine@max --rate 1",)),
    Task("calibrate", ("calibrate one/experiment.yaml --out calibrated",)),
    Task(
        "design",
        ("design cogiro --duration 10 --budget 20 --processes 1 --out plan",),
    ),
    Task("compare two loads", ("compare result other",)),
    Task("report as PDF", ("report result --pdf",)),
)


def prepare(folder: Path) -> None:
    """Recordings and results that the tasks begin with."""
    for seed, name in enumerate(("one", "two", "three")):
        _run(folder, f"simulate cogiro --duration 12 --seed {seed} --out {name} --quiet")
    _run(folder, "simulate cogiro-cuboid --duration 12 --out cuboid --quiet")
    shutil.copytree(folder / "one" / "multisine", folder / "raw")
    shutil.copytree(folder / "one", folder / "wrong")
    path = folder / "wrong" / "experiment.yaml"
    _replaced(path, "  cables:\n", "  cables:\n    scale: 0.001\n")
    for name, out in (("one", "result"), ("cuboid", "other")):
        _run(folder, f"identify {name}/experiment.yaml --out {out} --quiet")


def _replaced(path: Path, old: str, new: str) -> None:
    text = path.read_text("utf-8")
    if old not in text:
        raise SystemExit(f"{path.name}: expected {old!r}, found none")
    path.write_text(text.replace(old, new, 1), "utf-8")


def _run(folder: Path, words: str) -> subprocess.CompletedProcess[str]:
    """One command in a folder; a text after ``python`` is a script."""
    script = words.startswith("python ")
    command = [sys.executable, "-c", words[7:]] if script else [*STEELYARD, *words.split()]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def done(task: Task, folder: Path) -> tuple[int, int, float, int]:
    """Commands, edited lines, CPU [s], words; ends where a command fails."""
    before, words, ended = seconds_of_children(), 0, None
    for i, command in enumerate(task.commands):
        if i == len(task.commands) - 1:
            for name, old, new in task.edits:
                _replaced(folder / name, old, new)
        ended = _run(folder, command)
        words += len(f"{ended.stdout} {ended.stderr}".split())
    if ended is None or ended.returncode != task.ends:
        raise SystemExit(f"{task.what}: {ended and (ended.stderr or ended.stdout)}")
    spent = seconds_of_children() - before
    return len(task.commands), len(task.edits), spent, words


def main(chosen: list[int]) -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        prepare(folder)
        print(f"{date.today().isoformat()}\n")
        print("| task | commands | lines edited | CPU [s] | words to read |")
        print("|---|---:|---:|---:|---:|")
        for i, task in enumerate(TASKS, 1):
            if chosen and i not in chosen:
                continue
            commands, edits, spent, words = done(task, folder)
            print(f"| {task.what} | {commands} | {edits} | {spent:.0f} | {words} |", flush=True)


if __name__ == "__main__":
    main([int(each) for each in sys.argv[1:]])
