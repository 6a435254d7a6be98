"""How the process of the command line begins and ends."""

from __future__ import annotations

import io
import os
import re
import sys

import click

from steelyard.cli.interruption import INTERRUPTED, TERMINATED, interruptible
from steelyard.cli.printing import in_lines
from steelyard.display import printable
from steelyard.errors import InputError, SteelyardError

_LONGEST_WORD = 200
"""Characters: a path or a name may be as long as a file likes, the sentence around it must stay
readable."""
_LEAST_MEMORY = 1900 << 20
"""Bytes of address space (ulimit -v): with less, what computes ends or waits in its own ways, which
nothing here can catch."""
_NO_MEMORY = (
    "memory: expected enough for these recordings, found that it is used up; allow more (ulimit"
    " -v), or take shorter recordings"
)
_KEPT_END = 20
"""Characters of a longer one that are shown of its end."""


def run_process(app: click.Group) -> None:
    """Run the command line and end with the exit status of the contract."""
    try:
        _run(app)
    except KeyboardInterrupt:
        # Also where it reaches us before the work has begun, or while an error is being said.
        _fail("interrupted; nothing was written", INTERRUPTED)


def _run(app: click.Group) -> None:
    """Run the verb; every error that is one of the user's ends in one sentence."""
    # Many small matrices: threads of the linear algebra cost more than they do. Before NumPy is
    # loaded, and only in this process.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if isinstance(sys.stdout, io.TextIOWrapper):
        # A terminal of few characters shows the others escaped.
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        _require_memory()
        with interruptible():
            status = _status(app)
            # A disk that is full is said here, not while Python ends.
            sys.stdout.flush()
        sys.exit(status)
    except click.ClickException as error:
        _fail(_sentence(error), 2)
    except SteelyardError as error:
        _fail(error.on_command_line, 2)
    except (click.Abort, KeyboardInterrupt):
        _fail("interrupted; nothing was written", INTERRUPTED)
    except MemoryError:
        _fail(_NO_MEMORY, 2)
    except ImportError as error:
        # A library that finds no place for itself.
        if "map segment" not in str(error) and "allocate memory" not in str(error):
            raise
        _fail(_NO_MEMORY, 2)
    except BrokenPipeError:
        # The reader of our output has gone; there is nobody left to tell.
        sys.stderr.close()
        sys.exit(1)
    except OSError as error:
        # Files say their names; what has none is the stream that results are printed to.
        what = error.filename or "standard output"
        why = error.strerror or error
        _fail(f"{what}: cannot be read or written ({why}); check path and rights", 2)


def _status(app: click.Group) -> int:
    """Run the verb; the exit status that it asks for.

    Raises:
        SystemExit: A polite kill has come.
    """
    try:
        status = app.main(standalone_mode=False)
    except SystemExit as end:
        if not isinstance(end.code, int) or end.code == TERMINATED:
            raise
        status = end.code
    return status if isinstance(status, int) else 0


def _require_memory() -> None:
    """Raise SteelyardError where a limit is too low for what a verb loads; help needs nothing."""
    if {"-h", "--help", "--version"} & set(sys.argv) or len(sys.argv) < 2:
        return
    try:
        import resource
    except ImportError:  # Windows has no such limits
        return
    allowed = resource.getrlimit(resource.RLIMIT_AS)[0]
    if allowed != resource.RLIM_INFINITY and allowed < _LEAST_MEMORY:
        raise InputError(
            f"memory: expected at least {_LEAST_MEMORY >> 20} MiB of address space, found a limit"
            f" of {allowed >> 20} MiB; raise it with: ulimit -v unlimited"
        )


def _sentence(error: click.ClickException) -> str:
    """What is wrong with the command line, and where its help is."""
    command = "steelyard"
    if isinstance(error, click.UsageError) and error.ctx:
        command = error.ctx.command_path
    text = error.format_message().rstrip(".?")
    text = re.sub(r"\. (\w)", lambda begin: f"; {begin[1].lower()}", text)
    return f"{text}; see '{command} --help'"


def _fail(message: str, status: int) -> None:
    """Say one line on stderr in which nothing of a file can steer the terminal, and end."""
    line = f"steelyard: {printable(' '.join(map(_shortened, message.split())))}"
    sys.stderr.write(f"{in_lines(line, sys.stderr)}\n")
    sys.exit(status)


def _shortened(word: str) -> str:
    return word if len(word) <= _LONGEST_WORD else f"{word[:_LONGEST_WORD]}…{word[-_KEPT_END:]}"
