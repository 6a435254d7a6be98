"""A file as plain values, and the errors of its keys: they name file, line and key."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from steelyard.display import steers
from steelyard.errors import InputError

_NAMES_IN_LOGS = {"columns", "units", "scale", "topic"}
"""Keys below which names of others stand, which may be anything and are shown escaped."""


@dataclass(frozen=True)
class YamlDocument:
    """A YAML file as plain values, with the lines they came from."""

    path: Path
    data: Any
    lines: dict[tuple[str | int, ...], int]

    def where(self, key: Sequence[str | int] = ()) -> str:
        """File, line and key for a message."""
        named = [part for part in key if part != ""]
        for length in range(len(named), -1, -1):
            line = self.lines.get(tuple(named[:length]))
            if line is not None and length:
                return f"{self.path}:{line}: '{_dotted(named)}'"
        return f"{self.path}: '{_dotted(named)}'" if named else f"{self.path}"

    def error(self, key: Sequence[str | int], message: str) -> InputError:
        """The error of one key."""
        return InputError(f"{self.where(key)}: {message}")


def require_printable(document: YamlDocument) -> None:
    """Refuse texts that steer a terminal or hide what they are, names first of all.

    Names reach terminals, pages and files of other programs, which is why they are looked at where
    they enter. Those of columns and topics belong to logs, and are shown escaped.

    Raises:
        InputError: A key or a text holds such a character.
    """
    _require_printable(document, document.data, ())


def _require_printable(document: YamlDocument, value: Any, key: tuple[str | int, ...]) -> None:
    """See :func:`require_printable`; for a part of a document."""
    if isinstance(value, dict):
        for name, inner in value.items():
            if name not in _NAMES_IN_LOGS:
                _require_printable(document, name, key)
                _require_printable(document, inner, (*key, name))
    elif isinstance(value, list):
        for i, inner in enumerate(value):
            _require_printable(document, inner, (*key, i))
    elif isinstance(value, str):
        hidden = next(filter(steers, value), None)
        if hidden is not None:
            raise document.error(
                key,
                f"expected text that can be printed, found the character U+{ord(hidden):04X};"
                " remove it",
            )


def _dotted(key: Sequence[str | int]) -> str:
    parts = [f"[{part}]" if isinstance(part, int) else f".{part}" for part in key]
    return "".join(parts).removeprefix(".")
