"""A robot file that was made of the files of another program."""

from __future__ import annotations

from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from textwrap import wrap
from typing import Any

from steelyard.files.yaml_file import to_yaml
from steelyard.imports.description import Convention
from steelyard.imports.sources import printable
from steelyard.robot.model import Robot

_WIDTH = 120
"""Characters of a line of the comment in the robot file."""
_LONGEST_PATH = 1000
"""Characters of a path in the result."""


@dataclass(frozen=True, eq=False)
class Imported:
    """A robot file, and how it came about."""

    format: str
    """Of the files."""
    files: tuple[Path, ...]
    values: dict[str, Any]
    """Of the robot file."""
    robot: Robot
    """What it describes."""
    convention: Convention | None
    """What the products of inertia of the files were taken for; None: they are zero, or there is no
    platform."""
    notes: tuple[str, ...]
    """What was taken for what, left out and assumed."""

    def __repr__(self) -> str:
        return "\n".join(
            [repr(self.robot), f"  from {self.format}", *(f"  - {note}" for note in self.notes)]
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain values, without those of the robot file."""
        body = self.robot.platform
        return {
            "name": self.robot.name,
            "format": self.format,
            "files": [printable(str(path), _LONGEST_PATH) for path in self.files],
            "cables": self.robot.m,
            "products": self.convention,
            "physical": None if body is None else body.is_physical,
            "notes": list(self.notes),
        }

    def to_text(self) -> str:
        """The robot file, with where it comes from at its top."""
        sources = [
            f"{printable(path.name)} (sha256 {sha256(path.read_bytes()).hexdigest()[:16]})"
            for path in self.files
        ]
        lines = wrap(f"From {' and '.join(sources)}, {self.format}, by steelyard import.", _WIDTH)
        for note in self.notes:
            lines += wrap(note, _WIDTH, initial_indent="- ", subsequent_indent="  ")
        return "".join(f"# {line}\n" for line in lines) + to_yaml(self.values)
