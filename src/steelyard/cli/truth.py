"""The true bodies that a simulation leaves beside its experiment."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from steelyard.inertia import Inertia

TRUTH = "truth.json"
LARGEST_TRUTH = 1 << 24
"""[bytes]; a larger file was written by something else."""


def known_truth(folder: Path) -> Inertia | None:
    """The true body; None where there is none that can be read."""
    return _body(_written(folder))


def known_truth_of_loads(folder: Path) -> dict[str, Inertia]:
    """The true bodies of several loads by name; empty where there are none that can be read."""
    values = _written(folder)
    loads = values.get("loads") if isinstance(values, dict) else None
    bodies = {name: _body(each) for name, each in loads.items()} if isinstance(loads, dict) else {}
    return {name: body for name, body in bodies.items() if body is not None}


def _written(folder: Path) -> Any:
    """What the file says; None where there is none that can be read."""
    path = folder / TRUTH
    try:
        if not path.is_file() or path.stat().st_size > LARGEST_TRUTH:
            return None
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None


def _body(values: Any) -> Inertia | None:
    """A body; None where the values are none of one."""
    from steelyard.inertia import Inertia

    try:
        return Inertia.from_dict(values)
    except (ValueError, KeyError, TypeError, OverflowError):
        return None
