"""Searches from several starts, in processes of their own."""

from __future__ import annotations

import multiprocessing
import queue
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any

from steelyard.arrays import Array
from steelyard.excitation.search.design_problem import DesignProblem, SearchResult

MultiStartProgress = Callable[[int, int, float], None]
"""Is given the number of the start, of the step, and the logarithm of the norm reached there."""
_POLL = 0.1
"""How long the parent waits for progress before it checks whether all searches have ended [s]."""


def multi_start(
    problem: DesignProblem,
    starts: Sequence[Array],
    *,
    steps: int,
    until: float,
    processes: int,
    progress: MultiStartProgress,
) -> list[SearchResult]:
    """Search from every start; what has not begun when the time is up is left out.

    Args:
        problem: What is optimised.
        starts: Free coefficients to begin with.
        steps: At most, of each search.
        until: When all ends, by :func:`time.time` [s].
        processes: At a time; 1: this one alone.
        progress: Is given every iterate.
    """
    searches = _Searches(problem, starts, steps, until)
    if processes == 1 or len(starts) == 1:
        found = [searches.result(i, progress) for i in range(len(starts))]
        return [each for each in found if each is not None]
    context = multiprocessing.get_context("spawn")
    with ExitStack() as stack:
        with _interrupts_ignored():
            manager = stack.enter_context(context.Manager())
            pool = stack.enter_context(context.Pool(min(processes, len(starts))))
        mailbox = manager.Queue()
        asked = [pool.apply_async(searches.posted, (i, mailbox)) for i in range(len(starts))]
        while not all(each.ready() for each in asked):
            try:
                progress(*mailbox.get(timeout=_POLL))
            except queue.Empty:
                continue
        return [each for post in asked if (each := post.get()) is not None]


@contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """What begins meanwhile does not hear Ctrl-C, which reaches every process of a terminal: the
    one that asked ends the others.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@dataclass(frozen=True, eq=False)
class _Searches:
    """What the searches from all starts have in common; see :func:`multi_start`."""

    problem: DesignProblem
    starts: Sequence[Array]
    steps: int
    until: float

    def result(self, i: int, report: MultiStartProgress) -> SearchResult | None:
        """Search from a start; None: the time is up, and it is not the first one."""
        if i and time.time() >= self.until:
            return None
        return self.problem.search(
            self.starts[i],
            steps=self.steps,
            seconds=self.until - time.time(),
            progress=lambda step, value: report(i, step, value),
        )

    def posted(self, i: int, mailbox: Any) -> SearchResult | None:
        """The same in a process of its own, whose progress goes to a mailbox."""
        return self.result(i, lambda *news: mailbox.put(news))
