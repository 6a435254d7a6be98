"""The fence of the readers: formats in binary are read in a process with limits of time and memory.

What a library does with a damaged file is more than an exception can catch: it may fail, take too
long or ask for too much memory. In a process of its own that is a sentence. One that has read a
log without any error reads the next one too; after an error it is ended, so that no damaged file
can have a part in the numbers of another one.
"""

from __future__ import annotations

import atexit
import json
import os
import signal
import subprocess
import sys
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from threading import Timer
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.logs.log import Log, RowRange

VARIABLE = "STEELYARD_LIMITS"
"""Variable of the environment with other limits, so that processes begun from here have the
same."""
_WAITING = 10
"""Time by the clock, in units of that of the processor: for a reader that waits for something."""
_MOST_IDLE = 2
"""Processes that wait for the next log."""
_LONGEST_ANSWER = 1 << 26
"""Bytes of names and units."""
_CPU_LIMIT = -getattr(signal, "SIGXCPU", 0)


@dataclass(frozen=True)
class ReadingLimits:
    """What one request to a reader may take; the size of the file adds to both."""

    seconds: int = 6
    """Time of the processor [s]."""
    mebibytes: int = 768
    """Memory beyond that of the reader before any log [MiB]."""


def reading_limits() -> ReadingLimits:
    """The limits that hold: those of the environment, or else the usual ones.

    Raises:
        InputError: The variable of the environment does not hold two positive integers.
    """
    text = os.environ.get(VARIABLE)
    return limits_of(text, VARIABLE) if text else ReadingLimits()


def limits_of(text: str, where: str) -> ReadingLimits:
    """Limits as they are stated.

    Args:
        text: Seconds and MiB.
        where: Who states them, for the message.

    Raises:
        InputError: These are not two positive integers.
    """
    parts = text.split(",")
    whole = all(part.isascii() and part.isdigit() and len(part) < 8 for part in parts)
    if len(parts) != 2 or not whole or not all(map(int, parts)):
        raise InputError(
            f"{where}: expected seconds and MiB, two whole numbers of at least 1, found"
            f" {text[:40]!r}; state them as in 60,2048"
        )
    return ReadingLimits(int(parts[0]), int(parts[1]))


@contextmanager
def opened_in_fence(path: Path, topic: str | None) -> Iterator[Log]:
    """Open a log in another process.

    Args:
        path: Of the log.
        topic: Which of its topics or groups.

    Raises:
        InputError: The reader said so, failed, or hit a limit.
    """
    with _reader() as reader:
        about = reader.begin(path, {"topic": topic})
        yield Log(path, tuple(about["names"]), reader.load, about["units"])


def topics_in_fence(path: Path) -> list[str]:
    """Topics from which one has to be chosen; see :func:`opened_in_fence`."""
    with _reader() as reader:
        return list(reader.begin(path, {})["topics"])


_OTHER_END = "steelyard.logs.fenced_reader"
"""Module that the process runs."""


class _ReaderProcess:
    """The other end of :mod:`steelyard.logs.fenced_reader`."""

    def __init__(self) -> None:
        # Nothing is imported from the working folder, which may be that of the log.
        command = [sys.executable, "-P", "-m", _OTHER_END]
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "POLARS_MAX_THREADS": "2", "OPENBLAS_NUM_THREADS": "1"},
        )
        self.path = Path()
        self.limits = ReadingLimits()
        self.clean = True
        """Whether nothing has gone wrong, so that another log may be read."""

    def begin(self, path: Path, request: Mapping[str, Any]) -> dict[str, Any]:
        """Begin with a log."""
        self.path, self.limits = path, reading_limits()
        folder = None
        with suppress(OSError):
            folder = os.getcwd()
        about = {"path": os.fspath(path), "folder": folder, "limits": asdict(self.limits)}
        return self.ask({**about, **request})

    def ask(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Send a request and read the line of the answer."""
        self.clean = False
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        line = b""
        with self._clock(), suppress(OSError):
            self.process.stdin.write(json.dumps(request).encode() + b"\n")
            self.process.stdin.flush()
            line = self.process.stdout.readline(_LONGEST_ANSWER)
        if not line.endswith(b"\n"):
            raise self._failed()
        answer: dict[str, Any] = json.loads(line)
        if answer.get("memory"):
            raise self._beyond(f"more than {self.limits.mebibytes} MiB of memory")
        if "error" in answer:
            raise InputError(answer["error"])
        self.clean = True
        return answer

    def load(
        self, names: Sequence[str], part: RowRange | None, rows: int | None
    ) -> dict[str, Array]:
        """See :attr:`Log.load`."""
        assert self.process.stdout is not None
        unique = list(dict.fromkeys(names))
        n = self.ask(
            {"names": unique, "part": None if part is None else asdict(part), "rows": rows}
        )["rows"]
        self.clean = False
        columns = {}
        with self._clock():
            for name in unique:
                content = self.process.stdout.read(8 * n)
                if len(content) < 8 * n:
                    raise self._failed()
                columns[name] = np.frombuffer(content, dtype=np.float64)
        self.clean = True
        return columns

    def end(self) -> None:
        """End the process."""
        with suppress(OSError):
            self.process.kill()
        for pipe in (self.process.stdin, self.process.stdout):
            with suppress(OSError):
                pipe.close() if pipe else None
        self.process.wait()

    def forget(self) -> None:
        """Let go of the process of the one that this one was forked from."""
        self.process.returncode = 0
        for pipe in (self.process.stdin, self.process.stdout):
            with suppress(OSError):
                pipe.close() if pipe else None

    @contextmanager
    def _clock(self) -> Iterator[None]:
        """End the process where it waits for something; its own limit is of the processor alone."""
        size = 0
        with suppress(OSError):
            size = self.path.stat().st_size
        timer = Timer(_WAITING * self.limits.seconds + size / 1e5, self.process.kill)
        timer.daemon = True
        timer.start()
        try:
            yield
        finally:
            timer.cancel()

    def _failed(self) -> InputError:
        """Why there is no answer, as far as the end of the process tells."""
        with suppress(OSError):
            self.process.kill()
        status = self.process.wait()
        if status == _CPU_LIMIT:
            return self._beyond(f"more than {self.limits.seconds} s of the processor")
        if status == -getattr(signal, "SIGKILL", 9):
            return self._beyond("more time, or more memory than the system has")
        return self._beyond(
            f"more than {self.limits.mebibytes} MiB of memory or on which its library fails"
            f" (status {status})"
        )

    def _beyond(self, what: str) -> InputError:
        return InputError(
            f"{self.path}: expected a log that can be read within {self.limits.seconds} s and"
            f" {self.limits.mebibytes} MiB and what its size adds, found one that takes {what};"
            " copy it again or check where it comes from, or allow more with --limits 60,2048"
            f" (seconds, MiB; elsewhere the variable {VARIABLE})"
        )


_idle: deque[_ReaderProcess] = deque()
"""Processes that have read a log and wait for the next. State of this process, as the processes
themselves are; to begin one for every log would cost more than to read it."""


@contextmanager
def _reader() -> Iterator[_ReaderProcess]:
    """A process that reads, for the time of the block."""
    reader = None
    while reader is None:
        try:
            # Taken by one thread alone.
            reader = _idle.pop()
        except IndexError:
            reader = _ReaderProcess()
        if reader.process.poll() is not None:
            reader.end()
            reader = None
    try:
        yield reader
        if reader.clean:
            with suppress(InputError):
                reader.clean = bool(reader.ask({"close": True})["reusable"])
    finally:
        # Also after an error elsewhere in the block: what the reader holds is unknown then.
        if sys.exc_info()[0] is None and reader.clean and len(_idle) < _MOST_IDLE:
            _idle.append(reader)
        else:
            reader.end()


def _end_all() -> None:
    while _idle:
        _idle.pop().end()


def _forget_all() -> None:
    while _idle:
        _idle.pop().forget()


atexit.register(_end_all)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_all)
