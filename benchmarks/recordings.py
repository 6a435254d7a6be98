"""The one place that finds recordings with truth: those of the tests, and more beside the project
where they are."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from steelyard.arrays import Array
from steelyard.estimates.estimate import Estimate
from steelyard.inertia import Inertia

SHARED = Path(__file__).parents[2] / "shared" / "data"
"""What may lie beside the project."""
_PLACES = (
    SHARED / "elastic-cogiro",
    Path(__file__).parents[1] / "tests" / "data",
)


def recordings() -> Iterator[tuple[str, Path, Inertia]]:
    """Name, experiment file and true body of every recording of the first place that exists."""
    folder = next(place for place in _PLACES if (place / "truth.json").exists())
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    for name in sorted(truth):
        path = folder / name / "experiment.yaml"
        if path.exists():
            yield name, path, Inertia.from_dict(truth[name])


def chi_square(estimate: Estimate, truth: Array) -> float:
    """Of the ten, or of those that are known."""
    known = np.isfinite(estimate.value)
    sigma = estimate.standard_deviation[known]
    scaled = (estimate.value - truth)[known] / sigma
    block = estimate.covariance[np.ix_(known, known)] / np.outer(sigma, sigma)
    return float(scaled @ np.linalg.pinv(block, hermitian=True) @ scaled)
