"""Steelyard's least squares with all systematic errors."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from peers.steelyard_files import identified

NAME = "steelyard, least-squares"
DATA = "full"


def estimate(folder: Path) -> dict[str, Any]:
    """See `steelyard identify --method least-squares`."""
    with tempfile.TemporaryDirectory() as scratch:
        return identified(folder, "least-squares", Path(scratch))
