"""Cables of a swinging platform that hang slack for a while, though nobody reads them.

A cable that would have to push is slack. While it is, and where it comes taut again with a jerk
that no spline follows, the motion is not as sure as its readings: what these stretches say of the
body is biased, towards a lower centre of gravity by up to some 1-sigma. They are left out.

A motion tells a tension to a hundredth or two of them all, so that a cable which pulls less may be
slack as well as not: it is left out, and not said to be slack.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array, stretches
from steelyard.identification.model.balance import Balance, Forces
from steelyard.identification.solve.settings import FIT, FitSettings


@dataclass(frozen=True, eq=False)
class SlackCables:
    """Cables of a run that pull next to nothing for a while, or hang slack."""

    run: str
    shares: Array
    """Part of the time that each does, shape (m,)."""
    left_out: float
    """Part of the run that is left out for it."""

    def __str__(self) -> str:
        found = [f"cable {i + 1} for {_part(self.shares[i])}" for i in np.flatnonzero(self.shares)]
        return (
            f"run '{self.run}': cables pull next to nothing or hang slack ({', '.join(found)} of"
            " the time); these moments and what is just before and after them,"
            f" {_part(self.left_out)} of the run, do not count: push less, or hang the platform"
            " where all its cables pull"
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain values, cables counted from 1."""
        shares = {str(i + 1): float(self.shares[i]) for i in np.flatnonzero(self.shares)}
        return {"run": self.run, "cables": shares, "left_out": self.left_out}


def _part(share: float) -> str:
    """A part of a whole in words."""
    return f"{100 * share:.0f} %" if share >= 0.01 else "less than 1 %"


def slack_cables(at: Balance, forces: Forces, settings: FitSettings = FIT) -> NDArray[np.bool_]:
    """Whether each cable may be slack, shape (n, m); none is where forces are read.

    Args:
        at: The balance about a first body.
        forces: Its forces.
        settings: With the tension that is none.
    """
    if not forces.guessed.all():
        return np.zeros(at.carried.shape, dtype=bool)
    return below(at.carried, settings)


def below(tension: Array, settings: FitSettings = FIT) -> NDArray[np.bool_]:
    """Whether each cable pulls so little, or pushes, that it may be slack, shape (n, m).

    Args:
        tension: That a motion asks for [N], shape (n, m).
        settings: With the tension that is none.
    """
    if len(tension) < 2:
        return np.zeros(tension.shape, dtype=bool)
    usual = float(np.median(np.sum(np.abs(tension), axis=1)))
    # The outermost knots too, which tell tensions worse than others: a cable that is slack there
    # would count.
    return np.asarray(tension < settings.slack * usual)


def around(
    time: Array, slack: NDArray[np.bool_], settings: FitSettings = FIT
) -> tuple[tuple[float, float], ...]:
    """Stretches in which a cable may be slack, with what is not sure before and after [s].

    Args:
        time: Of the samples [s], shape (n,).
        slack: Whether each cable may be, shape (n, m).
        settings: With the margin.
    """
    margin = settings.slack_margin
    return tuple(
        (float(time[first]) - margin, float(time[last - 1]) + margin)
        for first, last in stretches(np.asarray(slack.any(axis=1)))
    )
