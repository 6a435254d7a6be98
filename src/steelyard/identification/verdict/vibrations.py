"""Whether a sensor that scatters more than its stated noise is shaken by a drive or the frame.

What is wrong with its axes, signs, unit or clock follows the motion, and so does what it is then off
by. A vibration above all frequencies at which the platform moves does not: below, the sensor scatters
as stated, and a fit that takes all of it as noise is only more careful than it had to be.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.identification.model.sources import Source
from steelyard.identification.residuals import Residuals, of_motion
from steelyard.identification.solve.posterior import Posterior
from steelyard.identification.verdict.settings import VERDICT, VerdictSettings
from steelyard.instruments.equations import order_of
from steelyard.spectra import density

_MOST = 0.99
"""Part of what the motion makes of the readings, as a variance, below whose frequency it moves."""
_ABOVE = 2.0
"""Times that frequency, above which it does not."""
_FEWEST = 64
"""Samples of a run that show a spectrum."""


@dataclass(frozen=True)
class Vibration:
    """What shakes a sensor."""

    instrument: str
    quantity: str
    frequency: float
    """Of the largest line, between zero and half the rate of the samples [Hz]."""
    size: float
    """Root mean square of the residual on the worst axis."""
    unit: str

    def __str__(self) -> str:
        return (
            f"{self.quantity.replace('_', ' ')} of {self.instrument} is shaken, most at"
            f" {self.frequency:.3g} Hz (or what is sampled as that), by {self.size:.2g} {self.unit}"
            " (root mean square): faster than the platform moves, so that it is taken as noise;"
            " mount the sensor where drives shake it less, or filter before sampling"
        )


def vibrations(
    posterior: Posterior, settings: VerdictSettings = VERDICT
) -> dict[Source, Vibration]:
    """Rates and accelerations that scatter more than stated, but not at the frequencies of the motion.

    Args:
        posterior: What the estimate stands on.
        settings: Levels.
    """
    suspected = {
        source
        for source, ratio in posterior.motion_ratios.items()
        if ratio**2 > settings.twice and _is_inertial(posterior, source)
    }
    if not suspected or not posterior.motion_converged:
        return {}
    found: dict[Source, list[_Share]] = {source: [] for source in suspected}
    for each in of_motion(posterior, suspected):
        if not each.static:
            found[each.instrument, each.quantity] += _shares(posterior, each)
    return {
        source: _vibration(source, own)
        for source, own in found.items()
        if own
        and np.average([each.slow for each in own], weights=[each.length for each in own])
        < settings.twice
    }


@dataclass(frozen=True, eq=False)
class _Share:
    """What a residual has at the frequencies of the motion and above, in one run."""

    length: int
    """Samples."""
    slow: float
    """Density at the frequencies of the motion, over that of the stated noise."""
    frequency: float
    """Of the largest line above [Hz]."""
    density: float
    """There, over that of the stated noise."""
    size: float
    """Root mean square on the worst axis."""
    unit: str


def _is_inertial(posterior: Posterior, source: Source) -> bool:
    """Whether a quantity with a stated noise is a rate or an acceleration."""
    experiment, (name, quantity) = posterior.experiment, source
    instrument = experiment.instruments.get(name)
    if instrument is None:
        return False
    own = [q for q in instrument.quantities(experiment.robot.m) if q.name == quantity]
    return any(q.noise and not q.rotation for q in own) and (
        order_of(instrument, quantity, experiment.robot) > 0
    )


def _shares(posterior: Posterior, of: Residuals) -> Iterator[_Share]:
    """The spectrum of a run; none where it is too short, or nothing is above the motion."""
    there = np.isfinite(of.residual).all(axis=1)
    residual, time = of.residual[there], of.time[there]
    if len(time) < _FEWEST:
        return
    instrument = posterior.experiment.instruments[of.instrument]
    noise = instrument.quantity(of.quantity, posterior.experiment.robot.m).noise
    assert noise  # it is stated
    step = float(np.median(np.diff(time)))
    frequency, power = density(residual - residual.mean(axis=0), step, len(time))
    # White noise has twice its variance per half the rate of the samples.
    over_noise = power.mean(axis=1) / (2 * noise**2 * step)
    predicted = of.predicted[there]
    moved = np.cumsum(density(predicted - predicted.mean(axis=0), step, len(time))[1].sum(axis=1))
    slow = frequency <= _ABOVE * frequency[np.searchsorted(moved, _MOST * moved[-1])]
    if slow.all():
        return
    largest = int(np.argmax(np.where(slow, -np.inf, over_noise)))
    yield _Share(
        len(time),
        float(over_noise[slow].mean()),
        float(frequency[largest]),
        float(over_noise[largest]),
        float(np.sqrt((residual**2).mean(axis=0).max())),
        of.unit,
    )


def _vibration(source: Source, shares: Sequence[_Share]) -> Vibration:
    """All runs in one."""
    worst = max(shares, key=lambda each: each.density)
    size = max(each.size for each in shares)
    return Vibration(*source, worst.frequency, size, worst.unit)
