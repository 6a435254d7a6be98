"""Levels and tolerances by which estimates are compared."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ComparisonSettings:
    """When differences are said to be significant, and when numbers are rounding."""

    usual: float = 2.0
    """[sigmas] Chance exceeds them once in twenty times: below them estimates agree."""
    significant: float = 3.0
    """[sigmas] Chance exceeds them once in 370 times: above them estimates disagree, a payload has
    a mass, and a body that can exist further away is no explanation."""
    least_p: float = 1e-99
    """Chance; smaller ones are shown as this: they say nothing more."""
    no_direction: float = 1e-12
    """Variance of a combination of parameters, in units of their sigmas, below which it is
    rounding: four digits above that of double precision."""
    nested: float = 1e-6
    """The same for a difference of covariances, which are approximations themselves."""
    same: float = 1e-9
    """Part by which two exact numbers may differ: files are written with fewer digits than double
    precision has."""


SETTINGS = ComparisonSettings()
"""The default."""
