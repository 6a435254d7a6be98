"""Levels of the search for the offsets of clocks, with unit, reason and source each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class SmoothingSettings:
    """How signals are made smooth functions of time."""

    finest: float = 0.02
    """Least spacing of knots [s]: it passes 25 Hz, which is all that a platform on cables does."""
    widest: float = 0.5
    """Largest spacing of knots [s]: it passes 1 Hz, which any motion worth recording has."""
    candidates: int = 7
    """Spacings that are compared, in geometric order."""
    bridged: float = 0.1
    """Spacing across which samples may be missing when the spacing is judged [s]: uneven sampling
    alone makes no gap."""
    fewest: int = 10
    """Samples of a signal that is used at all."""

    def spacings(self, finest: float) -> list[float]:
        """Spacings to compare [s], ascending, that are no finer than samples determine."""
        least = max(self.finest, finest)
        spacings = np.geomspace(least, max(least, self.widest), self.candidates)
        return [float(spacing) for spacing in spacings]


SMOOTHING = SmoothingSettings()


@dataclass(frozen=True)
class SearchSettings:
    """How all shifts between two clocks are looked at."""

    smoothing: SmoothingSettings = SMOOTHING
    """Of the signals."""
    step: float = 0.04
    """Of the grid of shifts [s]: well below the periods of the motion, above those of samples."""
    most_steps: int = 100_000
    """Of the grid; it is coarser for long recordings, so that memory does not grow with them."""
    correlation_time: float = 0.2
    """After which a motion is independent of what it was [s]: counts degrees of freedom."""
    per_regressor: float = 3.0
    """Independent instants for each coefficient, so that it is determined."""
    least_overlap: float = 0.4
    """Part of the shorter recording; what overlaps less was not recorded together."""
    fewest: int = 10
    """Instants of a regression."""
    zero_gain: float = 0.7
    """Part of the largest gain from which on the shift 0 is a candidate: clocks are often set
    alike."""
    distinct: float = 0.3
    """Difference of shifts that are different ones [s]: below it they are one peak."""


SEARCH = SearchSettings()


@dataclass(frozen=True)
class ShiftSettings:
    """How a shift is refined to a fraction of a sample."""

    smoothing: SmoothingSettings = SMOOTHING
    """Of the signals."""
    reach: float = 0.3
    """Beside the first guess [s]: several steps of the grid of the search."""
    grid: int = 41
    """Shifts within the reach that are evaluated before the minimum is refined."""
    block: float = 0.5
    """Length of the blocks of residuals that count as independent for the uncertainty [s]."""
    least_free: float = 0.25
    """Part of the blocks that are degrees of freedom at least, however many coefficients there
    are."""
    correlation_time: float = 0.1
    """After which a motion is independent of what it was [s]; finer than in the search, since all
    samples are used."""
    per_coefficient: float = 3.0
    """Independent instants for each coefficient of the clock's own regressors; with fewer, lever
    arms alone would fit the readings."""
    rounding: float = 1e-7
    """Residual of noise-free readings in units of how far they vary: a seventh digit is worth
    nothing."""
    difference: float = 1e-3
    """Step of numerical derivatives by the shift [s]."""


SHIFT = ShiftSettings()


@dataclass(frozen=True)
class OffsetSettings:
    """When the offset and the drift of a clock count as found."""

    search: SearchSettings = SEARCH
    """Of the candidates."""
    shift: ShiftSettings = SHIFT
    """Of their refinement."""
    least_gain: float = 8.0
    """Log likelihood that two clocks must share against none: odds of 3000 to 1, for thousands of
    shifts that were tried."""
    tried: int = 3
    """Candidates of the search that are refined."""
    close_gain: float = 0.7
    """Part of the largest gain from which on a candidate may win after refinement."""
    equal_gain: float = 0.9
    """Part of it from which on a candidate is as likely."""
    clearly_better: float = 0.2
    """Difference of the mean logarithm of residual variances by which one of these must win, or
    the motion is periodic."""
    distinct: float = 0.3
    """Difference of shifts that are different ones [s]."""
    part: float = 40.0
    """Length of the part of a recording that is refined at once [s]: drift shifts it by less than a
    millisecond, and it has motion enough."""
    most_parts: int = 6
    """Parts that show a drift."""
    largest_sigma: float = 0.05
    """1-sigma beyond which an offset is not known [s]: the joint fit starts from it and converges
    from there."""
    least_drift: float = 5e-6
    """Least drift that is reported: half a millisecond in two minutes."""
    largest_drift: float = 2e-4
    """No quartz of an instrument is worse (data sheets state 1e-4 at most)."""
    significant: float = 4.0
    """Standard deviations by which a drift must differ from zero."""


OFFSET = OffsetSettings()
