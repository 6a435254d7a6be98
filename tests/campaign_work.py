"""Work that other processes find by name: it sleeps, kills its worker, or says who it is."""

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

from steelyard.campaigns.tasks import Outcome


@dataclass(frozen=True)
class Chore:
    name: str
    marks: str = ""
    """Folder in which a file is left for every time that it is begun."""
    kills: int = 0
    """How often it kills its worker."""
    seconds: float = 0.0
    path: str = ""
    asked: str = ""


def begun(chore):
    return len(list(Path(chore.marks).glob(f"{chore.name}.*")))


def do(chore):
    if chore.marks:
        times = begun(chore)
        (Path(chore.marks) / f"{chore.name}.{times}").touch()
        if times < chore.kills:
            os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(chore.seconds)
    threads = os.environ.get("OPENBLAS_NUM_THREADS")
    return Outcome(({"name": chore.name, "pid": os.getpid(), "threads": threads},))


def fail(chore):
    raise RuntimeError(f"{chore.name} cannot be done")


def here(work, tasks):
    """An engine: this process."""
    for task in tasks:
        yield task, work(task)
