"""Text files of machines as lines with their numbers: G-code and configurations."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from steelyard.errors import InputError
from steelyard.files.regular_file import read_text

ENDINGS = (".g", ".gcode", ".cfg")


@dataclass(frozen=True)
class TextFile:
    """A file of lines."""

    path: Path
    lines: tuple[str, ...]

    def error(self, line: int, message: str) -> InputError:
        """The error of a line, from 1."""
        return InputError(f"{self.path}:{line}: {message}")

    def number(self, line: int, word: str) -> float:
        """A word of a line as a number.

        Raises:
            InputError: It is none.
        """
        try:
            value = float(word) if word.isascii() and "_" not in word else math.nan
        except ValueError:
            value = math.nan
        if not abs(value) < 1e9:
            raise self.error(line, f"expected a number [mm], found '{word[:60]}'; correct it")
        return value


def read_lines(path: Path) -> TextFile:
    """Read a text file.

    Raises:
        InputError: It is not there, too large, or no text.
    """
    return TextFile(path, tuple(read_text(path).splitlines()))
