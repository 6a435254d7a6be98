"""Steelyard's default on what the other peers get: a body on a wrench sensor."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from peers.steelyard_files import identified

NAME = "steelyard, maximum-likelihood"
DATA = "platform"


def estimate(folder: Path) -> dict[str, Any]:
    """See `steelyard identify --method maximum-likelihood`."""
    with tempfile.TemporaryDirectory() as scratch:
        return identified(folder, "maximum-likelihood", Path(scratch), wrench=True)
