"""Levels of the control charts, with their reasons."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ChartSettings:
    """How soon a change is seen, and how seldom one is seen that is none."""

    allowances: tuple[float, ...] = (0.5, 2.0)
    """What each recording may deviate before it counts, in sigmas, chart by chart: half of the
    change that a chart sees soonest. A change of 4 sigmas is seen by the next recording or the one
    after, one of a single sigma by some thirty."""
    recordings_per_alarm: float = 1e6
    """Sound recordings between two false alarms, on average, of all charts together."""
    scatter: float = 1e-3
    """Probability below which the scatter between recordings is not that of the stated sigma, over
    all parameters."""


CHARTS = ChartSettings()
