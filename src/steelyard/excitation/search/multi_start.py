"""Searches from several starts, in processes of their own."""

from __future__ import annotations

import multiprocessing
import queue
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
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
    processes: int = 1,
    progress: MultiStartProgress | None = None,
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
    report = progress or (lambda start, step, value: None)
    if processes == 1 or len(starts) == 1:
        found: list[SearchResult] = []
        for i, start in enumerate(starts):
            if not found or time.time() < until:
                found.append(_one(problem, i, start, steps, until, report))
        return found
    context = multiprocessing.get_context("spawn")
    with ExitStack() as stack:
        with _interrupts_ignored():
            manager = stack.enter_context(context.Manager())
            pool = stack.enter_context(context.Pool(min(processes, len(starts))))
        mailbox = manager.Queue()
        asked = [
            pool.apply_async(_posted, (problem, i, start, steps, until, mailbox))
            for i, start in enumerate(starts)
        ]
        while not all(each.ready() for each in asked):
            try:
                report(*mailbox.get(timeout=_POLL))
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


def _posted(
    problem: DesignProblem, i: int, start: Array, steps: int, until: float, mailbox: Any
) -> SearchResult | None:
    """One search in a process of its own, whose progress goes to a mailbox."""
    if i and time.time() >= until:
        return None
    return _one(problem, i, start, steps, until, lambda *news: mailbox.put(news))


def _one(
    problem: DesignProblem,
    i: int,
    start: Array,
    steps: int,
    until: float,
    report: MultiStartProgress,
) -> SearchResult:
    """One search, whose progress carries the number of its start."""
    return problem.search(
        start,
        steps=steps,
        seconds=until - time.time(),
        progress=lambda step, value: report(i, step, value),
    )
