"""Cables of a swinging platform that hang slack for a while, though nobody reads them.

A cable that would have to push is slack. While it is, and where it comes taut again with a jerk that
no spline follows, the motion is not as sure as its readings: what these stretches say of the body
is biased, towards a lower centre of gravity by up to some 1-sigma. They are left out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array, stretches
from steelyard.identification.model.balance import Balance, Forces
from steelyard.identification.solve.settings import FIT, FitSettings


def slack_cables(at: Balance, forces: Forces, settings: FitSettings = FIT) -> NDArray[np.bool_]:
    """Whether each cable is slack, shape (n, m); none is where forces are read.

    Args:
        at: The balance about a first body.
        forces: Its forces.
        settings: With the tension that is none.
    """
    tension: Array = at.carried
    if not forces.guessed.all() or len(tension) < 2:
        return np.zeros(tension.shape, dtype=bool)
    usual = float(np.median(np.sum(np.abs(tension), axis=1)))
    return np.asarray(tension < settings.slack * usual)


def around(
    time: Array, slack: NDArray[np.bool_], settings: FitSettings = FIT
) -> tuple[tuple[float, float], ...]:
    """Stretches in which a cable is slack, with what is not sure before and after [s].

    Args:
        time: Of the samples [s], shape (n,).
        slack: Whether each cable is slack, shape (n, m).
        settings: With the margin.
    """
    margin = settings.slack_margin
    return tuple(
        (float(time[first]) - margin, float(time[last - 1]) + margin)
        for first, last in stretches(np.asarray(slack.any(axis=1)))
    )


def in_words(run: str, slack: NDArray[np.bool_], left_out: float) -> str:
    """A sentence on the slack cables of a run.

    Args:
        run: Its name.
        slack: Whether each cable is slack, shape (n, m).
        left_out: Part of the run that is left out for it.
    """
    shares = 100 * slack.mean(axis=0)
    found = [f"cable {i + 1} for {max(shares[i], 1.0):.0f} %" for i in np.flatnonzero(shares > 0)]
    return (
        f"run '{run}': cables hang slack or nearly so ({', '.join(found)} of the time); these"
        f" moments and what is just before and after them, {100 * left_out:.0f} % of the run, do not"
        " count: push less, or hang the platform where all its cables pull"
    )
