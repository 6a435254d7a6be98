"""What goes to a worker and what comes back: names of files to small results."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

Row = dict[str, Any]
"""Plain values by column."""


class Named(Protocol):
    """A task; it is sent to workers, so that it holds small plain values."""

    @property
    def name(self) -> str:
        """Unlike the others'."""

    @property
    def path(self) -> str:
        """What it is about."""

    @property
    def asked(self) -> str:
        """What is asked for, as one word."""


@dataclass(frozen=True)
class ExperimentTask:
    """One experiment to work on."""

    name: str
    """Of the experiment within its campaign; also the folder of its results."""
    path: str
    """Of the experiment file; or its URL."""
    folder: str
    """Where its results belong."""
    verb: str = "identify"
    """``identify`` or ``inspect``."""
    methods: tuple[str, ...] = ()
    """Names of them; none: the default ones."""
    reports: bool = False
    """Whether to write a report beside the estimate."""
    asked: str = "default"
    """What is asked for, as one word."""
    known: str = ""
    """Hash of the inputs that the rows which are there were made from; with the same one nothing is
    to be done. Empty: there are no such rows."""


@dataclass(frozen=True)
class Outcome:
    """What a worker has to say of a task."""

    rows: tuple[Row, ...] = ()
    unchanged: bool = False
    """Whether its rows were there already."""


@dataclass(frozen=True)
class Lost:
    """A task that no worker has ended."""

    reason: str
    """In words, for its row."""


TaskT = TypeVar("TaskT", bound=Named)
Work = Callable[[Any], Outcome]
"""From a task to its outcome: a function of a module, so that other processes find it. It raises
nothing."""


class Engine(Protocol):
    """Works on tasks somewhere."""

    def __call__(
        self, work: Work, tasks: Iterable[TaskT]
    ) -> Generator[tuple[TaskT, Outcome | Lost], None, None]:
        """Results in the order in which they end.

        Tasks are taken from the iterable when there is room for them. Closing the iterator before
        its end stops all work within seconds.

        Args:
            work: Done once for each task; again where its worker was killed.
            tasks: As many as there are.
        """
