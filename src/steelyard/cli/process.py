"""How the process of the command line begins and ends."""

from __future__ import annotations

import io
import os
import signal
import sys

import click

from steelyard.display import printable
from steelyard.errors import SteelyardError

_LONGEST_WORD = 200
"""Characters: a path or a name may be as long as a file likes, the sentence around it must stay
readable."""
_KEPT_END = 20
"""Characters of a longer one that are shown of its end."""


def run_process(app: click.Group) -> None:
    """Run the command line and end with the exit status of the contract."""
    try:
        _run(app)
    except KeyboardInterrupt:
        # Also where it reaches us before the work has begun, or while an error is being said.
        _fail("interrupted; nothing was written", 130)


def _run(app: click.Group) -> None:
    """Run the verb; every error that is one of the user's ends in one sentence."""
    # Many small matrices: threads of the linear algebra cost more than they do. Before NumPy is
    # loaded, and only in this process.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # A polite kill unwinds like Ctrl-C, so that nothing half-written is left behind.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    if isinstance(sys.stdout, io.TextIOWrapper):
        # A terminal of few characters shows the others escaped.
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        status = app.main(standalone_mode=False)
        sys.exit(status if isinstance(status, int) else 0)
    except click.ClickException as error:
        _fail(_sentence(error), 2)
    except SteelyardError as error:
        _fail(error.on_command_line, 2)
    except (click.Abort, KeyboardInterrupt):
        _fail("interrupted; nothing was written", 130)
    except BrokenPipeError:
        # The reader of our output has gone; there is nobody left to tell.
        sys.stderr.close()
        sys.exit(1)
    except OSError as error:
        what = error.filename or "file"
        why = error.strerror or error
        _fail(f"{what}: cannot be read or written ({why}); check path and rights", 2)


def _sentence(error: click.ClickException) -> str:
    """What is wrong with the command line, and where its help is."""
    command = "steelyard"
    if isinstance(error, click.UsageError) and error.ctx:
        command = error.ctx.command_path
    text = error.format_message().rstrip(".?").replace(". ", "; ")
    return f"{text}; see '{command} --help'"


def _fail(message: str, status: int) -> None:
    """Say one line on stderr in which nothing of a file can steer the terminal, and end."""
    line = printable(" ".join(map(_shortened, message.split())))
    sys.stderr.write(f"steelyard: {line}\n")
    sys.exit(status)


def _shortened(word: str) -> str:
    return word if len(word) <= _LONGEST_WORD else f"{word[:_LONGEST_WORD]}…{word[-_KEPT_END:]}"
