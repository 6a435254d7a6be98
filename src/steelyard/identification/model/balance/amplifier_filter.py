"""The balance behind the first-order filter of a force amplifier.

Readings y are ``y + T dy/dt = f`` of the forces f before the filter, and these balance what moves
the body: ``M f = w``, with M by which readings pull at the platform as it stands then. Let F be the
filter, ``F[x] = integral of exp(-u) x(t - u T) du``. Both sides of ``M (y + T dy/dt) = w`` through
F are

    M y - T F[dM/dt y] - F[w] = 0,

since ``F[x + T dx/dt] = x`` for ``x = M y``. Nothing is approximated: not how fast a platform
rings, not how far it turns within T. No reading is differentiated, so that their noise stays what
it is: dM/dt is slow, and of its product with the noise the filter leaves nothing that matters.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_banded

from steelyard.arrays import Array

MEMORY = 8.0
"""How far back a filter is looked through, in its time constant: of what was before a
three-thousandth is left."""


@dataclass(frozen=True, eq=False)
class Panels:
    """Instants between readings, by which what a filter leaves of something smooth is integrated
    (Gauss and Legendre's quadrature).
    """

    nodes: Array
    """Ascending [s], shape (n, p); of the first reading at which there is nothing before, all the
    same."""
    weights: Array
    """Of the values there in the filter's at each reading, shape (n, p)."""
    later: Array
    """The same, times how long before the reading they are in the time constant: what the filter
    leaves of what it has left, shape (n, p)."""
    kept: Array
    """Part of the filter's value at the reading before, shape (n,)."""
    passed: Array
    """How long that is ago, in the time constant; none where nothing is kept; shape (n,)."""

    @classmethod
    def of(cls, times: Array, constant: float, smooth: float) -> Panels:
        """Between readings.

        Args:
            times: Ascending [s], shape (n,).
            constant: Time constant T of the filter [s].
            smooth: Time over which what is filtered is a polynomial [s].
        """
        since = np.diff(times, prepend=times[:1])
        length = np.minimum(since, MEMORY * constant)
        longest = float(length.max(initial=0.0))
        count = 3 + int(np.ceil(longest / smooth + longest / (2 * constant)))
        points, shares = np.polynomial.legendre.leggauss(count)
        ago = (length[:, None] / 2) * (1 - points)
        weights = (length[:, None] / 2) * shares * np.exp(-ago / constant) / constant
        later = weights * ago / constant
        beyond = since > length
        kept = np.where(beyond, 0.0, np.exp(-since / constant))
        passed = np.where(beyond, 0.0, since / constant)
        # What does not change is left as it is, to the last bit.
        for own, exact in ((weights, 1 - kept), (later, 1 - (1 + passed) * kept)):
            whole = own.sum(axis=1)
            own *= (exact / np.where(whole > 0, whole, 1.0))[:, None]
        return cls(times[:, None] - ago, weights, later, kept, passed)

    def filtered(self, values: Array, first: Array) -> tuple[Array, Array]:
        """What the filter leaves at the readings, and what it leaves of that, shape (n, k) each.

        Args:
            values: At the nodes, shape (n, p, k).
            first: Of the filter at the first reading, and of the filter of that, shape (2, k).
        """
        added = np.einsum("np,npk->nk", self.weights, values)
        later = np.einsum("np,npk->nk", self.later, values)
        return self._gone_on(added, later, first)

    def filtered_changes(self, rates: Array, first: Array) -> tuple[Array, Array]:
        """The same of what is constant between readings, shape (n, k) each.

        Args:
            rates: Before each reading, shape (n, k).
            first: See :meth:`filtered`.
        """
        kept, passed = self.kept[:, None], self.passed[:, None]
        added, later = rates * (1 - kept), rates * (1 - (1 + passed) * kept)
        return self._gone_on(added, later, first)

    def _gone_on(self, added: Array, later: Array, first: Array) -> tuple[Array, Array]:
        """From reading to reading."""
        once = _recursion(self.kept, added, first[0])
        later = later.copy()
        later[1:] += (self.kept * self.passed)[1:, None] * once[:-1]
        return once, _recursion(self.kept, later, first[1])


def rates_by_motion(times: Array, wrench: Array, by_reading: Array, readings: Array) -> Array:
    """How fast the wrench of readings changes because the platform moves and not because they do
    [N/s], [N m/s], between each reading and the one before, shape (n, 6); dM/dt y. The noise of the
    readings is not differentiated: it meets changes of M only.

    Args:
        times: Ascending [s], shape (n,).
        wrench: Of the readings, shape (n, 6).
        by_reading: M, how it follows them, shape (n, 6, r).
        readings: Shape (n, r).
    """
    found = np.zeros_like(wrench)
    if len(times) < 2:
        return found
    between = (by_reading[1:] + by_reading[:-1]) / 2
    turned = np.diff(wrench, axis=0) - np.einsum("nkr,nr->nk", between, np.diff(readings, axis=0))
    step = np.diff(times)[:, None]
    found[1:] = np.where(step > 0, turned / np.where(step > 0, step, 1.0), 0.0)
    found[0] = found[1]
    return found


def times_before(times: Array, start: float, constant: float) -> Array:
    """Times before the first of some, as far as a filter remembers and a motion is known, ascending
    [s], shape (b,).

    Args:
        times: Ascending [s], shape (n,).
        start: Of the motion [s].
        constant: Time constant of the filter [s].
    """
    usual = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    step = float(np.clip(usual, constant / 4, 2 * constant))
    count = int(np.ceil(MEMORY * constant / step))
    before = times[0] - step * np.arange(count, 0, -1)
    known = np.asarray(before[before >= start])
    if len(known) < count and times[0] > start:
        return np.concatenate([[start], known[known > start]])
    return known


def beginning(times: Array, values: Array, constant: float) -> Array:
    """What a filter has left of something when it is first looked at, and what of that, if it has
    always changed as it does there: ``x - T x'`` and ``x - 2 T x'``, shape (2, k).

    Args:
        times: Ascending [s], shape (n,).
        values: Shape (n, k).
        constant: Time constant T of the filter [s].
    """
    first = values[0]
    if len(times) < 2 or times[1] <= times[0]:
        return np.stack([first, first])
    behind = constant * (values[1] - first) / (times[1] - times[0])
    return np.stack([first - behind, first - 2 * behind])


def _recursion(kept: Array, added: Array, first: Array) -> Array:
    """``x[i] = kept[i] x[i - 1] + added[i]`` from the first one on, shape (n, k)."""
    right = added.copy()
    right[0] = first
    bands = np.ones((2, len(kept)))
    bands[1, :-1] = -kept[1:]
    return np.asarray(solve_banded((1, 0), bands, right, overwrite_b=True, check_finite=False))
