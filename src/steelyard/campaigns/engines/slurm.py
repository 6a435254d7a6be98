"""Job arrays of SLURM, through submitit."""

from __future__ import annotations

import shutil
import time
from collections.abc import Generator, Iterable, Iterator
from dataclasses import dataclass, field
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import Any

from steelyard.campaigns.tasks import Lost, Outcome, TaskT, Work
from steelyard.errors import InputError
from steelyard.processes.workers import ONE_THREAD

_POLL = 2.0
"""How often the state of jobs is asked for [s]."""
_OPTIONS = ("array", "tasks", "time", "mem_gb")
"""Options with a name of their own; all others are submitit's, such as partition or account."""


@dataclass(frozen=True)
class SlurmOptions:
    """What is asked of SLURM."""

    array: int = 500
    """Jobs in one array, and thereby at a time."""
    tasks: int = 1
    """Experiments for one job; a job that is killed costs what it has not sent back."""
    time: int = 60
    """Limit of a job [min]."""
    mem_gb: int = 4
    """[GB]"""
    further: dict[str, str] = field(default_factory=dict)
    """Such as partition, account, qos, constraint."""

    @classmethod
    def of(cls, text: str) -> SlurmOptions:
        """Read ``partition=short,time=30``.

        Raises:
            InputError: It is not of this form.
        """
        own: dict[str, int] = {}
        further: dict[str, str] = {}
        for entry in filter(None, (part.strip() for part in text.split(","))):
            key, equals, value = entry.partition("=")
            if not equals or not key.isidentifier() or not value:
                raise InputError(
                    "--slurm: expected options as 'partition=short,time=30', found"
                    f" '{entry}'; correct it"
                )
            if key not in _OPTIONS:
                further[key] = value
            elif value.isdecimal() and int(value) > 0:
                own[key] = int(value)
            else:
                raise InputError(
                    f"--slurm: expected a whole number above 0 for {key}, found '{value}'; correct"
                    " it"
                )
        return cls(**own, further=further)


@dataclass(frozen=True)
class Slurm:
    """Job arrays, one after the other."""

    options: SlurmOptions
    folder: Path
    """Where submitit keeps what jobs are given and what they print; all nodes must see it."""
    cluster: str = "slurm"
    """``local``: processes of this machine in place of SLURM, to try it."""
    poll: float = _POLL
    """[s]"""

    def __call__(
        self, work: Work, tasks: Iterable[TaskT]
    ) -> Generator[tuple[TaskT, Outcome | Lost], None, None]:
        """Results as they end; a task whose job was killed is tried once more in a job of its
        own.
        """
        executor = _executor(self)
        rest = iter(tasks)
        while parts := list(_parts(rest, self.options)):
            again: list[TaskT] = []
            for part, found in self._array(executor, work, parts):
                if found is None:
                    again += part
                else:
                    yield from zip(part, found, strict=True)
            for part, found in self._array(executor, work, [[task] for task in again]):
                lost = Lost("its job was killed twice (time or memory, perhaps)")
                yield part[0], lost if found is None else found[0]

    def _array(
        self, executor: Any, work: Work, parts: list[list[TaskT]]
    ) -> Iterator[tuple[list[TaskT], list[Outcome] | None]]:
        """Outcomes of one job array as its jobs end; None: the job was killed."""
        if not parts:
            return
        jobs = executor.map_array(_each, [work] * len(parts), parts)
        waiting = list(zip(jobs, parts, strict=True))
        try:
            while waiting:
                ended = [pair for pair in waiting if pair[0].done()]
                waiting = [pair for pair in waiting if pair not in ended]
                for job, part in ended:
                    yield part, job.result() if job.exception() is None else None
                if not ended:
                    time.sleep(self.poll)
        finally:
            for job, _ in waiting:
                job.cancel()


def _parts(tasks: Iterator[TaskT], options: SlurmOptions) -> Iterator[list[TaskT]]:
    """Tasks of the jobs of one array."""
    for _ in range(options.array):
        part = list(islice(tasks, options.tasks))
        if not part:
            return
        yield part


def _each(work: Work, tasks: list[Any]) -> list[Outcome]:
    """In a job."""
    return [work(task) for task in tasks]


def _executor(engine: Slurm) -> Any:
    """Of submitit.

    Raises:
        InputError: It or SLURM is not there, or does not take the options.
    """
    import submitit

    options = engine.options
    executor = submitit.AutoExecutor(folder=engine.folder, cluster=engine.cluster)
    exports = [f"export {name}={value}" for name, value in ONE_THREAD.items()]
    try:
        executor.update_parameters(
            timeout_min=options.time,
            mem_gb=options.mem_gb,
            cpus_per_task=1,
            slurm_array_parallelism=options.array,
            slurm_setup=exports,
            **{f"slurm_{key}": value for key, value in options.further.items()},
        )
    except (NameError, TypeError, ValueError) as error:
        names = ", ".join(options.further)
        raise InputError(
            f"--slurm: expected options that SLURM has, found {names} ({error}); correct them"
        ) from error
    return executor


def require_slurm() -> None:
    """Raise InputError unless submitit and SLURM are there."""
    if find_spec("submitit") is None:
        raise InputError(
            "--slurm: expected the package submitit, found it missing; install it with: pip install"
            ' "steelyard[slurm]"'
        )
    if shutil.which("sbatch") is None:
        raise InputError(
            "--slurm: expected the command sbatch of SLURM on this machine, found none; log in to a"
            " machine of the cluster, or use --jobs"
        )
