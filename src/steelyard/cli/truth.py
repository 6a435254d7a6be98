"""The true body that a simulation leaves beside its experiment."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from steelyard.inertia import Inertia

TRUTH = "truth.json"
LARGEST_TRUTH = 1 << 24
"""[bytes]; a larger file was written by something else."""


def known_truth(folder: Path) -> Inertia | None:
    """The true body; None where there is none that can be read."""
    from steelyard.inertia import Inertia

    path = folder / TRUTH
    try:
        if not path.is_file() or path.stat().st_size > LARGEST_TRUTH:
            return None
        return Inertia.from_dict(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return None
