"""The paper's two steps [Tempel2017], by steelyard's code."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from peers.steelyard_files import identified

NAME = "the paper's two steps"
DATA = "full"


def estimate(folder: Path) -> dict[str, Any]:
    """See `steelyard identify --method two-step`."""
    with tempfile.TemporaryDirectory() as scratch:
        return identified(folder, "two-step", Path(scratch))
