"""Campaigns of which something is killed at random, and whether their table is the undisturbed one."""

from __future__ import annotations

import os
import random
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import polars as pl
from recordings import write_small

METHOD = "two-step"
TARGETS = {"processes": ("worker", "client"), "dask": ("worker", "scheduler", "client")}
"""Engine -> what may be killed."""
PATIENCE = 240.0
"""Longer than any campaign here takes [s]."""
_JOURNAL = "campaign.rows.jsonl"


@dataclass(frozen=True)
class Killed:
    """What became of a campaign."""

    rows: int
    """In the journal when it was killed."""
    status: int
    """Of the disturbed campaign."""
    said: str
    again: int
    """How many experiments the second campaign found done."""
    lost: int
    """Rows that are not there in the end."""
    twice: int
    """Rows of one experiment and method beyond the first."""
    same: bool
    """Whether all numbers are those of the undisturbed campaign."""


def recordings_in(folder: Path, count: int) -> Path:
    """Experiments of four seconds."""
    for i in range(count):
        write_small(folder / f"e{i:03}")
    return folder


def table_of(folder: Path) -> pl.DataFrame:
    """Without what differs from one time to the next."""
    table = pl.read_parquet(folder / "campaign.parquet")
    return table.drop("seconds")


def campaign_of(data: Path, out: Path, *engine: str) -> subprocess.Popen[str]:
    """The verb, in a process of its own."""
    words = [sys.executable, "-m", "steelyard", "campaign", str(data), "--out", str(out)]
    return subprocess.Popen(
        [*words, "--method", METHOD, "--quiet", *engine],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def killed(engine: str, target: str, data: Path, out: Path, count: int, seed: int) -> Killed:
    """Kill something at random, do the same campaign again, and compare.

    Args:
        engine: Of :data:`TARGETS`.
        target: The same.
        data: Experiments, and beside it the folder ``whole`` of an undisturbed campaign.
        out: Folder of the disturbed one.
        count: Of the experiments.
        seed: Of the moment.
    """
    rng = random.Random(f"{engine} {target} {seed}")
    with _cluster(engine) as (options, victims):
        child = campaign_of(data, out, *options)
        wanted = rng.randrange(count)
        rows = _wait_for(out / _JOURNAL, wanted, child)
        time.sleep(rng.uniform(0.0, 0.3))
        victim = {"client": lambda: [child.pid], **victims(child)}[target]()
        if victim:
            with suppress(ProcessLookupError):
                os.kill(rng.choice(victim), signal.SIGKILL)
        _, said = child.communicate(timeout=PATIENCE)
    with _cluster(engine) as (options, _):
        again = campaign_of(data, out, *options, "--json")
        printed, error = again.communicate(timeout=PATIENCE)
    if again.returncode:
        raise AssertionError(f"the second campaign ended with {again.returncode}: {error}")
    whole, table = table_of(data.parent / "whole"), table_of(out)
    keys = table.select("experiment", "method")
    there = set(keys.rows())
    return Killed(
        rows,
        child.returncode,
        said.strip(),
        _unchanged(printed),
        len(set(whole.select("experiment", "method").rows()) - there),
        len(keys) - len(there),
        table.equals(whole),
    )


def _unchanged(printed: str) -> int:
    import json

    return int(json.loads(printed)["unchanged"])


def _wait_for(journal: Path, rows: int, child: subprocess.Popen[str]) -> int:
    """Until so many rows are there, or the campaign has ended; how many there are."""
    end = time.monotonic() + PATIENCE
    there = 0
    while time.monotonic() < end and child.poll() is None:
        with suppress(FileNotFoundError):
            there = journal.read_bytes().count(b"\n")
            if there >= rows:
                break
        time.sleep(0.02)
    return there


@contextmanager
def _cluster(engine: str) -> Iterator[tuple[tuple[str, ...], object]]:
    """Options of the verb, and a function of its process to what may be killed."""
    if engine == "processes":
        workers = lambda child: {"worker": lambda: _children(child.pid, "spawn_main")}  # noqa: E731
        yield ("--jobs", "2"), workers
        return
    with _dask() as (address, scheduler, nanny):
        yield (
            ("--scheduler", address),
            lambda child: {
                "worker": lambda: _children(nanny.pid, "spawn_main"),
                "scheduler": lambda: [scheduler.pid],
            },
        )


@contextmanager
def dask_cluster() -> Iterator[tuple[str, list[int]]]:
    """Address of a scheduler, and the processes of its two workers."""
    with _dask() as (address, _, nanny):
        yield address, _children(nanny.pid, "spawn_main")


@contextmanager
def _dask() -> Iterator[tuple[str, subprocess.Popen[bytes], subprocess.Popen[bytes]]]:
    """Address of a scheduler, its process, and that of the nanny of two workers."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        host, port = free.getsockname()
    address = f"tcp://{host}:{port}"
    code = "from distributed.cli.{0} import main; main()"

    def begun(program: str, words: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-c", code.format(program), *words.split(), "--no-dashboard"]
        return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    scheduler = begun("dask_scheduler", f"--host {host} --port {port}")
    nanny = begun("dask_worker", f"{address} --nworkers 2 --nthreads 1")
    try:
        _wait_for_workers(address)
        yield address, scheduler, nanny
    finally:
        workers = _children(nanny.pid, "")
        for process in (nanny, scheduler):
            process.kill()
            process.wait()
        for worker in workers:
            with suppress(ProcessLookupError):
                os.kill(worker, signal.SIGKILL)


def _wait_for_workers(address: str) -> None:
    from distributed import Client

    end = time.monotonic() + PATIENCE
    while True:
        try:
            with Client(address, timeout=2) as client:
                client.wait_for_workers(2, timeout=60)
            return
        except (OSError, TimeoutError):
            if time.monotonic() > end:
                raise


def _children(parent: int, word: str) -> list[int]:
    """Processes that a process has begun, with a word in their command."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            with suppress(OSError):
                status = (entry / "stat").read_text().rpartition(")")[2].split()
                command = (entry / "cmdline").read_text()
                if int(status[1]) == parent and word in command:
                    found.append(int(entry.name))
    return found
