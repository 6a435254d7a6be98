"""Steelyard's least squares over bodies that can exist."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from peers.steelyard_files import identified

NAME = "steelyard, consistent"
DATA = "full"


def estimate(folder: Path) -> dict[str, Any]:
    """See `steelyard identify --method consistent`."""
    with tempfile.TemporaryDirectory() as scratch:
        return identified(folder, "consistent", Path(scratch))
