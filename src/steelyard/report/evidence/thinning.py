"""How much of readings and motions a report keeps."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array


@dataclass(frozen=True)
class Thinning:
    """Bounds, so that the page of an hour is as large as that of a minute."""

    most_runs: int = 8
    """Runs of which readings and motion are kept."""
    most_numbers: int = 200_000
    """In all traces together: a page of about a megabyte."""
    fewest_points: int = 60
    """Of a trace, however many there are: a picture still shows its shape."""
    most_points: int = 2000
    """Of a trace: two for each column of pixels of a screen."""
    most_instants: int = 600
    """Of a motion that is replayed."""
    instants_per_second: float = 20.0
    """Of a motion that is replayed [Hz]: smooth to the eye."""
    outlying: float = 5.0
    """[1-sigma] A residual beyond it is counted as an outlier: chance gives one in two million."""
    spectrum_segments: int = 8
    """Parts of a recording that a spectrum is the mean of (Welch): its scatter is a third."""
    shortest_segment: int = 64
    """Samples of such a part, at least: thirty frequencies."""
    longest_segment: int = 512
    """Samples of such a part, at most."""
    fewest_intervals: int = 32
    """Sampling intervals that a spectrum needs."""
    most_missing: float = 0.1
    """Part of the samples that may be left out where a spectrum is drawn: zeros in their place
    distort it by no more."""
    jitter: float = 0.5
    """Part of the sampling interval by which nine in ten intervals may differ from the middle one
    where a spectrum is drawn."""


THINNING = Thinning()
"""The default."""


def thinned(size: Array, most: int) -> NDArray[np.intp]:
    """Places to keep of n samples: of each stretch its first one and the one that stands out most,
    in order.

    Args:
        size: How far each channel stands out, shape (n, k).
        most: How many to keep about.
    """
    n = len(size)
    if n <= most:
        return np.arange(n)
    edges = np.linspace(0, n, max(1, most // 2) + 1).astype(int)
    largest = size.max(axis=1)
    out = [first + int(np.argmax(largest[first:last])) for first, last in pairwise(edges)]
    return np.unique(np.concatenate([edges[:-1], out, [n - 1]]))


def evenly(n: int, most: int) -> NDArray[np.intp]:
    """Places to keep of n samples: about so many at even distances, with the first and the last."""
    return np.unique(np.linspace(0, n - 1, min(n, most)).astype(int))


def rounded(values: Array, digits: int) -> list[float]:
    """Numbers of so many digits."""
    return [float(f"{v:.{digits}g}") for v in values]
