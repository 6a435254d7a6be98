"""Whether a sensor that scatters more than its stated noise is shaken by a drive or the frame, or
hums with the mains.

What is wrong with its axes, signs, unit or clock follows the motion, and so does what it is then
off by. A vibration above all frequencies at which the platform moves does not: below, the sensor
scatters as stated, and a fit that takes all of it as noise is only more careful than it had to be.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.identification.model.sources import Source
from steelyard.identification.residuals import PLATFORM, Residuals, of_forces, of_motion
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
    of_forces: bool = False
    """Whether it is a force instrument, whose residual is a wrench on the platform."""

    def __str__(self) -> str:
        what = f"{self.quantity.replace('_', ' ')} of {self.instrument}"
        large = (
            f"{self.frequency:.3g} Hz (or what is sampled as that), by {self.size:.2g} {self.unit}"
        )
        because = "faster than the platform moves, so that it is taken as noise"
        if self.of_forces:
            return (
                f"{what} hums, most at {large} on the platform (root mean square): {because}; look"
                " after shielding, earth and supply of the sensors, or filter before sampling"
            )
        return (
            f"{what} is shaken, most at {large} (root mean square): {because};"
            " mount the sensor where drives shake it less, or filter before sampling"
        )


def vibrations(
    posterior: Posterior, settings: VerdictSettings = VERDICT
) -> dict[Source, Vibration]:
    """Forces, rates and accelerations that scatter more than stated, but not at the frequencies of
    the motion.

    Args:
        posterior: What the estimate stands on.
        settings: Levels.
    """
    if not posterior.motion_converged:
        return {}
    return {**_of_motion(posterior, settings), **_of_forces(posterior, settings)}


def _of_motion(posterior: Posterior, settings: VerdictSettings) -> dict[Source, Vibration]:
    """Of rates and accelerations."""
    suspected = {
        source
        for source, ratio in posterior.motion_ratios.items()
        if ratio**2 > settings.twice and _is_inertial(posterior, source)
    }
    if not suspected:
        return {}
    found: dict[Source, list[_Share]] = {source: [] for source in suspected}
    for each in of_motion(posterior, suspected):
        source = each.instrument, each.quantity
        found[source] += _shares(each, np.full(3, _noise(posterior, source)))
    return {
        source: _vibration(source, own)
        for source, own in found.items()
        if own and _slow(own) < settings.twice
    }


def _of_forces(posterior: Posterior, settings: VerdictSettings) -> dict[Source, Vibration]:
    """Of the quantities of the force instruments, by the wrench that they leave over."""
    ratio = posterior.solution.ratio
    if not posterior.stated or ratio <= settings.twice:
        return {}
    shares: dict[str, list[_Share]] = {}
    sources: set[Source] = set()
    for each in of_forces(posterior):
        if each.instrument != PLATFORM:
            sources.add((each.instrument, each.quantity))
        elif each.sigma is not None and each.run not in posterior.held_out:
            # As large as the fit has found the noise to be: the ratio is what that is of the
            # stated.
            shares.setdefault(each.quantity, []).extend(_shares(each, each.sigma / np.sqrt(ratio)))
    every = [share for own in shares.values() for share in own]
    if not every or _slow(every) >= settings.twice:
        return {}
    shown = shares["force"] or shares["torque"]
    return {source: _vibration(source, shown, of_forces=True) for source in sorted(sources)}


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


def _noise(posterior: Posterior, source: Source) -> float:
    """Stated 1-sigma of a quantity."""
    experiment, (name, quantity) = posterior.experiment, source
    noise = experiment.instruments[name].quantity(quantity, experiment.robot.m).noise
    assert noise  # it is stated
    return noise


def _shares(of: Residuals, noise: Array) -> Iterator[_Share]:
    """The spectrum of a run; none where it is too short, or nothing is above the motion.

    Args:
        of: Of a quantity in a run.
        noise: 1-sigma of each channel as stated, shape (k,).
    """
    there = np.isfinite(of.residual).all(axis=1) & ~of.left_out.any(axis=1)
    if of.static or there.sum() < _FEWEST:
        return
    residual, time = of.residual[there] / noise, of.time[there]
    step = float(np.median(np.diff(time)))
    frequency, power = density(residual - residual.mean(axis=0), step, len(time))
    # White noise has twice its variance per half the rate of the samples.
    over_noise = power.mean(axis=1) / (2 * step)
    predicted = of.predicted[there] / noise
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
        float(np.sqrt((of.residual[there] ** 2).mean(axis=0).max())),
        of.unit,
    )


def _slow(shares: Sequence[_Share]) -> float:
    """Density at the frequencies of the motion over all runs, over that of the stated noise."""
    weights = [each.length for each in shares]
    return float(np.average([each.slow for each in shares], weights=weights))


def _vibration(source: Source, shares: Sequence[_Share], *, of_forces: bool = False) -> Vibration:
    """All runs in one."""
    worst = max(shares, key=lambda each: each.density)
    size = max(each.size for each in shares)
    return Vibration(*source, worst.frequency, size, worst.unit, of_forces)
