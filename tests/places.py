"""Where the project and its recordings are: the one place that knows."""

from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "steelyard"
DATA = ROOT / "tests" / "data"
"""Recordings of another simulator, models of other programs, schemas (README.md there)."""
