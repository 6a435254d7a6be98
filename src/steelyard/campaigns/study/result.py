"""What became of a study, as a value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from steelyard.arrays import Array
from steelyard.campaigns.rows import TABLE
from steelyard.campaigns.study.power import Rejections
from steelyard.campaigns.study.summary import MethodSummary
from steelyard.estimates.estimate import named

FORMAT = "steelyard-study/1"


@dataclass(frozen=True, eq=False)
class Study:
    """What became of many draws of one experiment."""

    what: str
    """Robot or experiment."""
    folder: Path
    """With ``study.json``, ``study.html`` and the rows of all draws in ``campaign.parquet``."""
    draws: int
    bootstrap: bool
    """Whether recordings were drawn, rather than simulated."""
    truth: Array | None
    """The ten that were simulated, shape (10,); None: they are not known."""
    methods: Mapping[str, MethodSummary]
    """The best method first."""
    problems: tuple[str, ...]
    """Draws without an estimate, with the reason."""
    rejections: tuple[Rejections, ...] = ()
    """How often each method rejects sound draws and, where they were asked for, each mistake; empty
    for a bootstrap."""

    @property
    def table(self) -> Path:
        """A row for each draw and method."""
        return self.folder / TABLE

    def to_dict(self) -> dict[str, Any]:
        """Plain values, as in ``study.json``."""
        return {
            "format": FORMAT,
            "of": self.what,
            "kind": "bootstrap" if self.bootstrap else "simulation",
            "draws": self.draws,
            "truth": None if self.truth is None else named(self.truth),
            "methods": {name: each.to_dict() for name, each in self.methods.items()},
            "rejections": [each.to_dict() for each in self.rejections],
            "problems": list(self.problems),
        }

    def __repr__(self) -> str:
        each = [f"{m.method} {m.accepted} of {m.count} accepted" for m in self.methods.values()]
        return f"Study of {self.what}: {self.draws} draws; {'; '.join(each) or 'no estimate'}"
