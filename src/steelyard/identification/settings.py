"""Numbers that decide how clocks of forces and motion are found, with the reason of each."""

from __future__ import annotations

from dataclasses import dataclass

from steelyard.clocks.settings import OFFSET, OffsetSettings


@dataclass(frozen=True)
class SynchronisationSettings:
    """How :func:`steelyard.identification.synchronisation.synchronise` finds the clocks of a run.

    ``benchmarks/clocks.py`` shows how near to the truth they come with these values.
    """

    offset: OffsetSettings = OFFSET
    """Of clocks against each other, and what the search for that of the forces shares with it:
    grid, overlap, correlation time, smoothing."""

    # Balance of forces and motion at a shift

    grid: float = 0.01
    """Of the motion [s]; between, it is straight enough."""
    most_scanned: int = 300
    """Force readings at each shift of the search."""
    sensor_offset: float = 0.01
    """1-sigma of the offset of a force sensor, as a part of the median reading: without it, weight
    and offsets of cables explain each other."""
    residual: float = 1.0
    """Residual that an offset of its 1-sigma is worth [N]."""
    ridge: float = 1e-9
    """Of the fit of a body whose ten the motion may not determine, as a part of their own
    information: rounding."""
    least_free: float = 0.2
    """Part of the independent instants that are degrees of freedom at least, however many
    coefficients there are."""

    # Which shift

    least_gain: float = 3.0
    """Log likelihood that forces and motion must share: odds of 20 to 1."""
    close_gain: float = 0.85
    """Part of the largest gain from which on a shift may win after refinement."""
    clearly_better: float = 0.1
    """Difference of the mean logarithm of residual variances by which one of these must win, or
    the motion is periodic."""
    long: float = 60.0
    """Recordings longer than that are not looked at at every shift, and not as a whole [s]."""
    beside: float = 0.5
    """Looked at beside a shift that the rough search has found [s]."""

    # Correction by the joint fit

    fits: int = 2
    """At most: a large correction shows others."""
    moved: float = 0.01
    """A correction of a clock after which the fit is made once more [s]."""
    informed: float = 0.5
    """1-sigma of a delay, in parts of its prior one, below which the fit says something of it."""


SYNCHRONISATION = SynchronisationSettings()
"""What is used where nothing is given."""
