"""Libraries that are not installed with the package itself, and names from files in messages."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.util import find_spec
from itertools import islice
from pathlib import Path

from steelyard.errors import InputError

MOST_LISTED = 20
"""Names of a file in one message."""
_LONGEST = 80
"""Characters of a name from a file in a message."""


def require_package(path: Path, package: str, module: str, what: str) -> None:
    """Raise InputError unless the library that reads a format is installed.

    Args:
        path: Of the log.
        package: Name of the library, as it is installed.
        module: Name of the library, as it is imported.
        what: Files it reads.
    """
    if find_spec(module) is None:
        raise InputError(
            f"{path}: reading {what} files needs the package {package}; install it with: pip"
            ' install "steelyard[all]"'
        )


def shown(text: str, longest: int = _LONGEST) -> str:
    """Text from a file on one line of a message: it may hold anything, such as codes that steer a
    terminal.
    """
    printable = "".join(
        letter if letter.isprintable() else "\ufffd" for letter in text[: longest + 1]
    )
    return printable if len(printable) <= longest else printable[: longest - 1] + "…"


def damaged(
    path: Path, expected: str, error: Exception | str, found: str = "one that is damaged"
) -> InputError:
    """The error of a file that its reader cannot make sense of.

    Args:
        path: Of the file.
        expected: The format, with an article.
        error: What went wrong; the message has its first line.
        found: What the file is instead.
    """
    reason = (str(error).splitlines() or [""])[0] or type(error).__name__
    return InputError(
        f"{path}: expected {expected}, found {found} ({shown(reason, 120).rstrip('.')}); copy it"
        " again"
    )


def listed(names: Iterable[str]) -> str:
    """The first names of a file, for messages."""
    first = [shown(name) for name in islice(names, MOST_LISTED + 1)]
    return (", ".join(first[:MOST_LISTED]) + (", …" if len(first) > MOST_LISTED else "")) or "none"
