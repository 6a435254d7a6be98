"""Force readings that something else than the body has made: a sensor that spikes, a hand on the
platform.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array, joined_stretches, stretches
from steelyard.identification.model.balance import Balance, Forces
from steelyard.identification.solve.settings import FIT, FitSettings
from steelyard.identification.tally import limit


@dataclass(frozen=True, eq=False)
class StandingOut:
    """What was found in the forces of one segment."""

    force_samples: Forces
    """With what is left out."""
    contacts: tuple[tuple[float, float], ...]
    """Beginning and end of what touched the platform [s]."""
    spikes: tuple[tuple[float, int], ...]
    """Time [s] and number of the reading."""
    changed: bool


def look(
    at: Balance, force_samples: Forces, sigmas: Array, settings: FitSettings = FIT
) -> StandingOut:
    """Find readings that stand alone, then stretches in which none alone explains what is left
    over.

    Args:
        at: The balance about a fit.
        force_samples: Its forces.
        sigmas: 1-sigma of every reading, shape (n, r).
        settings: With what stands out.
    """
    size = at.size
    # How much of a correction stays in the reading itself; the rest goes to those that share its
    # direction.
    count = at.noise.readings
    own, correction = at.noise.decided[:, :count], at.correction[:, :count]
    alone = np.where(force_samples.left_out, 0.0, correction / np.sqrt(np.maximum(own, 1e-12)))
    worst, largest, rest = farthest(np.abs(alone), size)
    left_out = force_samples.left_out.copy()
    # Readings that explain all that is left over are their sensors' own; the others go on.
    spikes = (largest > settings.alone) & (rest < limit(5))
    spikes &= ~_in_a_row(spikes, worst, 2 * settings.contact_samples)
    left_out[np.flatnonzero(spikes), worst[spikes]] = True
    already = force_samples.touched
    large = (size > limit(6)) & ~spikes & ~already
    found = _contacts(at.time, large, settings)
    # What one reading explains while something touches is no spike of its sensor.
    whole = _grown(at.time, found, (large | spikes) & ~already, settings)
    for each in (whole, found, []):
        touched, contacts = np.zeros(len(size), dtype=bool), []
        for first, last in each:
            start = float(at.time[first]) - settings.contact_margin
            end = float(at.time[last - 1]) + settings.contact_margin
            touched |= (at.time >= start) & (at.time <= end)
            contacts.append((start, end))
        if (touched | already).mean() <= settings.most_cut:
            break
    left_out[touched] = True
    return StandingOut(
        force_samples=replace(force_samples, left_out=left_out),
        contacts=tuple(contacts),
        spikes=tuple((float(at.time[i]), int(worst[i])) for i in np.flatnonzero(spikes & ~touched)),
        changed=bool(np.any(left_out != force_samples.left_out)),
    )


def farthest(alone: Array, size: Array) -> tuple[NDArray[np.intp], Array, Array]:
    """Of every sample the reading that is off farthest, how far it is, and what is left of the
    sample without it, shape (n,) each.

    Args:
        alone: How far every reading is off by itself, in its own 1-sigma, shape (n, r).
        size: Length of the residual of every sample, shape (n,).
    """
    worst = np.argmax(alone, axis=1)
    largest = alone[np.arange(len(worst)), worst]
    return worst, largest, np.sqrt(np.maximum(size**2 - largest**2, 0.0))


def _in_a_row(spikes: NDArray[np.bool_], worst: NDArray[np.intp], many: int) -> NDArray[np.bool_]:
    """Spikes of which many follow each other in different sensors: that is no sensor's doing."""
    found = np.zeros_like(spikes)
    for first, last in stretches(spikes):
        if last - first >= many and len(set(worst[first:last])) > 1:
            found[first:last] = True
    return found


def _contacts(
    time: Array, large: NDArray[np.bool_], settings: FitSettings
) -> list[tuple[int, int]]:
    """Stretches with several large residuals close to each other: first sample, and the one behind
    the last.
    """
    return [
        (first, last)
        for first, last in joined_stretches(time, large, settings.contact_pause)
        if np.count_nonzero(large[first:last]) >= settings.contact_samples
    ]


def _grown(
    time: Array, found: Sequence[tuple[int, int]], off: NDArray[np.bool_], settings: FitSettings
) -> list[tuple[int, int]]:
    """Stretches with what is off before and behind them, as far as most samples are; those that
    meet as one.

    Args:
        time: Of all samples [s], shape (n,).
        found: First sample, and the one behind the last.
        off: Which samples are off, shape (n,).
        settings: With the longest pause within a contact.
    """
    inside = np.zeros(len(time), dtype=bool)
    for first, last in found:
        inside[first - _mostly(off[:first][::-1]) : last + _mostly(off[last:])] = True
    return joined_stretches(time, inside, settings.contact_pause)


def _mostly(off: NDArray[np.bool_]) -> int:
    """How many samples from the first one on are off as a rule, shape (n,)."""
    many = np.arange(1, len(off) + 1)
    return int(np.max(many[off & (2 * np.cumsum(off) > many)], initial=0))
