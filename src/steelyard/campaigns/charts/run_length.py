"""How many sound recordings a CUSUM chart passes before a false alarm, and the decision interval
for a given number.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr

_NODES = 96
"""Of the quadrature: the run length changes by less than 1e-6 of itself with twice as many."""
_LOWEST, _HIGHEST = 1e-3, 40.0
"""Decision intervals that are searched [sigmas]."""


@cache
def run_length(allowance: float, interval: float, shift: float = 0.0) -> float:
    """Average run length of a one-sided CUSUM chart that begins at zero: recordings until
    S = max(0, S + z - k) exceeds h, for normal z of unit variance.

    The integral equation of [Page1954]_, by Gauss-Legendre quadrature.

    Args:
        allowance: k [sigmas].
        interval: h [sigmas].
        shift: Mean of z; 0: nothing has changed.
    """
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    s = np.concatenate([[0.0], (nodes + 1) * interval / 2])
    # From s (rows) to t (columns), or to zero, which has a probability of its own.
    step = s[None, 1:] - s[:, None] + allowance - shift
    density = np.exp(-(step**2) / 2) / np.sqrt(2 * np.pi) * weights * interval / 2
    stays = np.column_stack([ndtr(allowance - shift - s), density])
    return float(np.linalg.solve(np.eye(len(s)) - stays, np.ones(len(s)))[0])


@cache
def decision_interval(allowance: float, length: float) -> float:
    """The decision interval h of a one-sided chart with a given average run length [sigmas].

    Args:
        allowance: k [sigmas].
        length: Recordings between two false alarms, on average; at most some 1e10.
    """
    return float(
        brentq(lambda h: np.log(run_length(allowance, h) / length), _LOWEST, _interval(allowance))
    )


def _interval(allowance: float) -> float:
    """An interval that is longer than any that is asked for: run lengths above 1e11 are lost in
    rounding.
    """
    found = 1.0
    while found < _HIGHEST and run_length(allowance, found) < 1e11:
        found *= 1.2
    return found
