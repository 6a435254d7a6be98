"""Steelyard's default: motion, body and all systematic errors at once."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from peers.steelyard_files import identified

NAME = "steelyard, maximum-likelihood"
DATA = "full"


def estimate(folder: Path) -> dict[str, Any]:
    """See `steelyard identify --method maximum-likelihood`."""
    with tempfile.TemporaryDirectory() as scratch:
        return identified(folder, "maximum-likelihood", Path(scratch))
