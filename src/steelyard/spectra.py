"""Spectra of signals at even times, and convolutions by them.

SciPy's module of signals has these too; to import it takes longer than to identify a body, since it
brings all of its statistics along.
"""

from __future__ import annotations

import numpy as np

from steelyard.arrays import Array

_PARTS = 64
"""Of a signal, transformed at once."""


def density(values: Array, step: float, length: int, *, trend: bool = False) -> tuple[Array, Array]:
    """One-sided power spectral density by averaged periodograms of parts that overlap by half, each
    under a window of Hann [Welch1967]_.

    Args:
        values: At even times, shape (n, k).
        step: Between them [s].
        length: Samples of a part, n at most.
        trend: Whether a straight line is taken off every part first.

    Returns:
        Frequencies [Hz], shape (f,), and densities, unit squared per Hz, shape (f, k).
    """
    further = length - length // 2
    starts = np.arange(0, len(values) - length + 1, further)
    line = np.column_stack([np.ones(length), np.arange(length)])
    fit = np.linalg.pinv(line)
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(length) / length)
    power = np.zeros((length // 2 + 1, values.shape[1]))
    for begin in range(0, len(starts), _PARTS):
        own = starts[begin : begin + _PARTS, None] + np.arange(length)
        parts = values[own]  # shape (parts, length, k)
        if trend:
            parts = parts - line @ (fit @ parts)
        power += np.sum(np.abs(np.fft.rfft(window[:, None] * parts, axis=1)) ** 2, axis=0)
    power *= step / np.sum(window**2) / len(starts)
    # What is at negative frequencies too: all but zero and, of an even number, the highest.
    power[1 : (length + 1) // 2] *= 2
    return np.asarray(np.fft.rfftfreq(length, step), dtype=float), power


def convolved(one: Array, other: Array) -> Array:
    """Convolution of columns side by side, shape (n + n' - 1, k).

    Args:
        one: Shape (n, k).
        other: Shape (n', k).
    """
    count = len(one) + len(other) - 1
    # Lengths of which transforms are fast.
    above = 1 << max(3, (count - 1).bit_length())
    size = min(each for each in (5 * above // 8, 3 * above // 4, above) if each >= count)
    product = np.fft.rfft(one, size, axis=0) * np.fft.rfft(other, size, axis=0)
    return np.asarray(np.fft.irfft(product, size, axis=0)[:count])
