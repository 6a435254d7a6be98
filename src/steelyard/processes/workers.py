"""Processes that work beside this one, and end with it."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from typing import Any

from steelyard.errors import InputError

ONE_THREAD = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
}
"""Environment of a worker: many small matrices, and as many workers as there are cores."""


@contextmanager
def worker_processes(jobs: int) -> Iterator[ProcessPoolExecutor]:
    """So many processes that end with the block, whatever they are doing."""
    # Not forked: threads of the libraries that this process has loaded would be cut in two.
    context = multiprocessing.get_context("spawn")
    before = set(multiprocessing.active_children())
    with _environment():
        pool = ProcessPoolExecutor(jobs, mp_context=context, initializer=_begin)
        try:
            yield pool
        finally:
            for child in set(multiprocessing.active_children()) - before:
                child.kill()
            pool.shutdown(wait=True, cancel_futures=True)


def result_of(future: Future[Any]) -> Any:
    """What a process has found.

    Raises:
        InputError: It was killed.
    """
    try:
        return future.result()
    except BrokenProcessPool:
        raise InputError(
            "--jobs: expected processes that work to the end, found that one was killed (out of"
            " memory, perhaps); choose a smaller number"
        ) from None


@contextmanager
def _environment() -> Iterator[None]:
    """The environment of workers, which they inherit when they begin: libraries read it before
    anything of ours runs.
    """
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _begin() -> None:
    """Of a worker: Ctrl-C, which reaches every process of a terminal, is for the one that asked;
    where that is gone, so is this one.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_follow_parent, daemon=True).start()


def _follow_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        with suppress(OSError):
            parent.join()
        os._exit(1)
