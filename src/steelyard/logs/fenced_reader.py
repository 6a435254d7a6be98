"""The process within the fence: reads logs for :mod:`steelyard.logs.fence`, one after another."""

from __future__ import annotations

import json
import os
import signal
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.logs.formats import LogFormat, format_of
from steelyard.logs.log import Log, RowRange
from steelyard.logs.packages import damaged

_MEMORY_PER_BYTE = 24
"""Bytes that a request may take per byte of the file: recordings shrink to a tenth at best, and are
held twice."""
_MOST_KEPT = 256 << 20
"""Bytes that a process may have grown by and read another log."""


def serve() -> None:
    """Answer requests until the other end is closed."""
    # Ctrl-C is for the process that asked; it ends this one.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Libraries that print do so elsewhere.
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    at_first = _memory()
    for line in sys.stdin.buffer:
        _read_one(out, json.loads(line), at_first)


def _read_one(out: IO[bytes], request: Mapping[str, Any], at_first: int) -> None:
    """Open a log, and answer what is asked of it until it is closed."""
    path, limits = Path(request["path"]), request["limits"]
    form: LogFormat | None = None
    try:
        if request["folder"]:
            os.chdir(request["folder"])
        form = format_of(path)
        size = _size(path)
        _limit_memory((limits["mebibytes"] << 20) + _MEMORY_PER_BYTE * size)
        seconds = limits["seconds"] + size // form.bytes_per_second
        _limit_time(seconds)
        if "topic" not in request:
            _answer(out, {"topics": form.topics(path)})
            _answer_close(out, at_first)
            return
        with form.opened(path, request["topic"]) as log:
            _answer(out, {"names": log.names, "units": dict(log.units)})
            for line in sys.stdin.buffer:
                asked = json.loads(line)
                if "close" in asked:
                    break
                _limit_time(seconds)
                _answer_rows(out, log, asked)
        _answer(out, _reusable(at_first))
    except InputError as error:
        _answer(out, {"error": str(error)})
    # That it is installed was seen before: it finds no room.
    except (MemoryError, ImportError):
        _answer(out, {"memory": True})
    # What the libraries raise on damaged files is of any kind.
    except Exception as error:
        what = form.what if form else "a log"
        _answer(out, {"error": str(damaged(path, what, error, "one that is damaged or cut off"))})


def _answer_close(out: IO[bytes], at_first: int) -> None:
    """Answer the line that closes a log."""
    if sys.stdin.buffer.readline():
        _answer(out, _reusable(at_first))


def _reusable(at_first: int) -> dict[str, bool]:
    """Whether this process may read another log."""
    return {"reusable": _memory() - at_first < _MOST_KEPT}


def _size(path: Path) -> int:
    """Bytes of a log; of a folder, of the files in it."""
    if path.is_dir():
        return sum(each.stat().st_size for each in path.iterdir() if each.is_file())
    return path.stat().st_size


def _answer_rows(out: IO[bytes], log: Log, request: Mapping[str, Any]) -> None:
    """Columns of a part of a log, as :attr:`Log.load` gives them."""
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
        out.write(np.ascontiguousarray(values, dtype=np.float64).data)
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


def _memory() -> int:
    """Bytes of address space of this process; 0: the system does not say."""
    with suppress(ImportError, OSError):
        import resource

        return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    return 0


def _limit_memory(more: int) -> None:
    """Let this process take so many bytes more than it has."""
    has = _memory()
    if not has:  # other systems do not say, or keep no such limit
        return
    import resource

    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    limit = has + more
    resource.setrlimit(
        resource.RLIMIT_AS, (limit if hard == resource.RLIM_INFINITY else min(limit, hard), hard)
    )


if __name__ == "__main__":
    serve()
