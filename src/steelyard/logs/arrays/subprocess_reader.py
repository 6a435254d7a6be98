"""Readers that run in a subprocess: what their libraries do with a damaged file is more than an
exception can catch.

A process of its own may fail, take too long or ask for too much memory; here that is a sentence.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import IO, Any, Protocol

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.logs.arrays.nested import Arrays
from steelyard.logs.log import Log, RowRange
from steelyard.logs.packages import damaged

_SECONDS, _BYTES_PER_SECOND = 6, 5_000_000
"""Time of the processor for a request, and for what must be unpacked at the slowest."""
_MEMORY, _MEMORY_PER_BYTE = 768 << 20, 8
"""Bytes that a request may take, and beyond that per byte of the file."""


class ArraysModule(Protocol):
    """A module that calls :func:`serve` when it is run."""

    __name__: str
    WHAT: str
    """The format, with an article."""

    def require(self, path: Path) -> None:
        """Raise InputError unless the library that reads the file is installed."""


@contextmanager
def opened_in_subprocess(module: ArraysModule, path: Path, topic: str | None) -> Iterator[Log]:
    """Open a log in a subprocess.

    Args:
        module: Of the format.
        path: Of the log.
        topic: Which of its groups.

    Raises:
        InputError: The reader said so, or it failed.
    """
    with _started(module, path) as reader:
        about = reader.ask({"path": os.fspath(path), "topic": topic})
        yield Log(path, tuple(about["names"]), reader.load, about["units"])


def topics_in_subprocess(module: ArraysModule, path: Path) -> list[str]:
    """Groups from which one has to be chosen; see :func:`opened_in_subprocess`."""
    with _started(module, path) as reader:
        return list(reader.ask({"path": os.fspath(path)})["topics"])


@contextmanager
def _started(module: ArraysModule, path: Path) -> Iterator[_Subprocess]:
    """A subprocess that runs a module, and ends with the block."""
    module.require(path)
    # Nothing is imported from the working folder, which may be that of the log.
    command = [sys.executable, "-P", "-m", module.__name__]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as process:
        try:
            yield _Subprocess(process, path, module.WHAT)
        finally:
            with suppress(OSError):
                process.stdin.close() if process.stdin else None
            process.kill()


class _Subprocess:
    """The other end of :func:`serve`."""

    def __init__(self, process: subprocess.Popen[bytes], path: Path, what: str) -> None:
        self.process, self.path, self.what = process, path, what

    def ask(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Send a request and read the line of the answer."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        line = b""
        with suppress(OSError):
            self.process.stdin.write(json.dumps(request).encode() + b"\n")
            self.process.stdin.flush()
            line = self.process.stdout.readline()
        if not line.endswith(b"\n"):
            raise self._failed()
        answer: dict[str, Any] = json.loads(line)
        if "error" in answer:
            raise InputError(answer["error"])
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
        columns = {}
        for name in unique:
            content = self.process.stdout.read(8 * n)
            if len(content) < 8 * n:
                raise self._failed()
            columns[name] = np.frombuffer(content, dtype=np.float64)
        return columns

    def _failed(self) -> InputError:
        self.process.kill()
        return InputError(
            f"{self.path}: expected {self.what}, found one that cannot be read within"
            f" {_MEMORY >> 20} MiB and {_SECONDS} s and what its size adds, or on which its library"
            f" fails (status {self.process.wait()}); copy it again, or check where it comes from"
        )


def serve(
    arrays_in: Callable[[Path, str | None], AbstractContextManager[Arrays]], what: str
) -> None:
    """Answer the requests of :func:`opened_in_subprocess` and :func:`topics_in_subprocess`; the
    body of a module that is run.

    Args:
        arrays_in: Opens a file; the topic that is wanted, None: any.
        what: The format, with an article.
    """
    # Libraries that print do so elsewhere.
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    request = json.loads(sys.stdin.buffer.readline())
    path = Path(request["path"])
    try:
        size = path.stat().st_size
        _limit_memory(_MEMORY + _MEMORY_PER_BYTE * size)
        _limit_time(_SECONDS + size // _BYTES_PER_SECOND)
        with arrays_in(path, request.get("topic")) as arrays:
            if "topic" not in request:
                _answer(out, {"topics": arrays.topics()})
                return
            log = arrays.log(request["topic"])
            _answer(out, {"names": log.names, "units": dict(log.units)})
            for line in sys.stdin.buffer:
                _limit_time(_SECONDS + size // _BYTES_PER_SECOND)
                _answer_rows(out, log, json.loads(line))
    except InputError as error:
        _answer(out, {"error": str(error)})
    # What the libraries raise on damaged files is of any kind.
    except Exception as error:
        sentence = damaged(path, what, error, "one that is damaged or cut off")
        _answer(out, {"error": str(sentence)})


def _answer_rows(out: IO[bytes], log: Log, request: Mapping[str, Any]) -> None:
    """Columns of a part of a log, as :meth:`_Subprocess.load` asks for them."""
    part = RowRange(**request["part"]) if request["part"] else None
    try:
        columns = log.load(request["names"], part, request["rows"])
    except InputError as error:
        _answer(out, {"error": str(error)})
        return
    rows = len(next(iter(columns.values()), ()))
    _answer(out, {"rows": rows}, [columns[name] for name in request["names"]])


def _answer(out: IO[bytes], message: Mapping[str, Any], columns: Sequence[Array] = ()) -> None:
    """A message on a line of its own, and the bytes of columns behind it."""
    out.write(json.dumps(message).encode() + b"\n")
    for values in columns:
        out.write(np.ascontiguousarray(values, dtype=np.float64).tobytes())
    out.flush()


def _limit_time(seconds: int) -> None:
    """End this process when it has taken so many seconds from now on."""
    try:
        import resource
    except ImportError:  # Windows has no such limits
        return
    used = resource.getrusage(resource.RUSAGE_SELF)
    _, hard = resource.getrlimit(resource.RLIMIT_CPU)
    limit = int(used.ru_utime + used.ru_stime) + 1 + seconds
    resource.setrlimit(
        resource.RLIMIT_CPU, (limit if hard == resource.RLIM_INFINITY else min(limit, hard), hard)
    )
    resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))


def _limit_memory(more: int) -> None:
    """Let this process take so many bytes more than it has."""
    try:
        import resource

        pages = int(Path("/proc/self/statm").read_text().split()[0])
    except (ImportError, OSError):  # other systems do not say, or keep no such limit
        return
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    limit = pages * resource.getpagesize() + more
    resource.setrlimit(
        resource.RLIMIT_AS, (limit if hard == resource.RLIM_INFINITY else min(limit, hard), hard)
    )
