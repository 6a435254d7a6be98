"""Processes on this machine, by the standard library: nothing to install.

joblib's loky processes would do the same; they were not taken because they add two packages and
nothing that is needed here.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from itertools import islice

from steelyard.campaigns.tasks import Lost, Outcome, TaskT, Work
from steelyard.processes.workers import worker_processes

_KILLED = (
    "its worker process was killed twice while nothing else ran beside it (out of memory, perhaps)"
)


@dataclass(frozen=True)
class Processes:
    """So many processes at a time."""

    jobs: int

    def __call__(
        self, work: Work, tasks: Iterable[TaskT]
    ) -> Generator[tuple[TaskT, Outcome | Lost], None, None]:
        """Results as they end; where a worker is killed, what was under way is done again, one by
        one and alone.
        """
        rest = iter(tasks)
        while True:
            suspects: list[TaskT] = []
            yield from _until_broken(work, rest, self.jobs, suspects)
            if not suspects:
                return
            for task in suspects:
                yield from _alone(work, task)


def _alone(work: Work, task: TaskT) -> Generator[tuple[TaskT, Outcome | Lost], None, None]:
    """One task with nothing beside it, twice at most: which of those under way has killed the first
    worker is not known, nor whether it had begun.
    """
    for _ in range(2):
        again: list[TaskT] = []
        yield from _until_broken(work, iter([task]), 1, again)
        if not again:
            return
    yield task, Lost(_KILLED)


def _until_broken(
    work: Work, tasks: Iterator[TaskT], jobs: int, suspects: list[TaskT]
) -> Generator[tuple[TaskT, Outcome | Lost], None, None]:
    """Results until all is done or a worker is killed; then ``suspects`` has what was under way."""
    running: dict[Future[Outcome], TaskT] = {}
    with worker_processes(jobs) as pool:
        while True:
            # One more than there are processes: none of them waits for the next.
            for task in islice(tasks, jobs + 1 - len(running)):
                try:
                    running[pool.submit(work, task)] = task
                except BrokenProcessPool:
                    suspects.append(task)
                    break
            if not running:
                return
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                task = running.pop(future)
                error = future.exception()
                if isinstance(error, BrokenProcessPool):
                    suspects.append(task)
                elif error is not None:
                    yield task, Lost(f"{type(error).__name__}: {error}")
                else:
                    yield task, future.result()
            if suspects:
                suspects.extend(running.values())
                return
