"""An estimate among others: its name, and where it comes from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from steelyard.estimates.estimate import Estimate


@dataclass(frozen=True, eq=False)
class NamedEstimate:
    """An estimate among others."""

    name: str
    """Short and unlike the others'."""
    estimate: Estimate
    experiment: str = ""
    """Name of the experiment; empty: not known."""
    source: str = ""
    """Estimates of equal sources are made from the same recordings: the path of their file; empty:
    of its own."""
    correlated: bool = True
    """Whether the covariance is known, and not the 1-sigmas alone."""

    def to_dict(self) -> dict[str, Any]:
        """Plain values: what a comparison says of one of its estimates."""
        estimate = self.estimate.to_dict()
        return {
            "name": self.name,
            "experiment": self.experiment,
            "method": self.estimate.method,
            "file": self.source,
            "mass": estimate["mass"],
            "center_of_gravity": estimate["center_of_gravity"],
            "inertia": estimate["inertia"],
            "standard_deviation": estimate["standard_deviation"],
            "accepted": self.estimate.verdict.accepted,
        }


def same_source(first: NamedEstimate, second: NamedEstimate) -> bool:
    """Whether two estimates stand on the same recordings."""
    return bool(first.source) and first.source == second.source
