r"""Normal equations of the border, with priors, and all that follows from them.

The border holds what acts on a whole recording: the ten linear parameters of the body and then
*every* calibration parameter of the experiment, the motion having been eliminated. Summed up once,
they answer all questions: which of the ten are identifiable, how well they are known, whether
stretches and runs agree, and whether the residual points at one number of the description (score
test [Rao1948]_).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce
from operator import add
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.identification.solve.border.directions import curvature, inverse_of, weak_directions
from steelyard.identification.solve.settings import FIT, FitSettings
from steelyard.inertia import TEN


@dataclass(frozen=True, eq=False)
class BorderEquations:
    """Normal equations of one run over the k columns of the border."""

    normal: Array
    """Shape (k, k)."""
    right: Array
    """Of the ten as they are and of the calibration parameters from present values, shape (k,)."""
    noise: Array
    """Mean product of the noise in the regressor with itself, summed over the samples: what a
    motion of nothing but noise would tell, shape (10, 10)."""
    freedom: float
    """Samples of six equations."""
    by_noise: Array | None = None
    """Part of ``normal`` that is due to noise in derivatives where the motion follows the forces,
    see :func:`solve`, shape (k, k); None: nothing."""

    def __add__(self, other: BorderEquations) -> BorderEquations:
        parts = [each.by_noise for each in (self, other) if each.by_noise is not None]
        return BorderEquations(
            self.normal + other.normal,
            self.right + other.right,
            self.noise + other.noise,
            self.freedom + other.freedom,
            reduce(add, parts) if parts else None,
        )

    @property
    def emptied(self) -> BorderEquations:
        """Of no reading."""
        normal, right, noise = map(np.zeros_like, (self.normal, self.right, self.noise))
        return BorderEquations(normal, right, noise, 0.0)


@dataclass(frozen=True, eq=False)
class BorderPrior:
    """What is known beforehand about the columns."""

    precision: Array
    """Shape (k, k); zero for the body unless something about it is known."""
    pull: Array
    """Precision times what is known, shape (k,)."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Solution of the border's equations."""

    value: Array
    """The ten as they are, calibration parameters from where they were linearised, shape (k,)."""
    covariance: Array
    """Shape (k, k); of the noise and the priors."""
    gain: Array
    """How estimates follow a change of the right-hand side, shape (k, k), zero where nothing is
    estimated."""
    projection: Array
    """The same, were the likelihood curved as the products of derivatives say: what makes a
    residual orthogonal to their columns."""
    estimated: NDArray[np.bool_]
    """Shape (k,); the others are known exactly."""
    noise_part: Array
    """Part of ``covariance`` that came from the data, shape (k, k)."""
    bias: Array
    """First-order bias by noise in the regressor that has been taken off, shape (k,)."""
    held: Array
    """What holds the directions of the bodies that are not identifiable, shape (k, k)."""
    held_pull: Array
    """Where it holds them, as a right-hand side, shape (k,)."""
    wide: Array
    """These directions in plausible length, columns of shape (k, u)."""
    spent: float
    """Degrees of freedom that were estimated from the data."""
    ratio: float = 1.0
    """Mean square of the whitened residuals of the forces, 1 where their noise is as stated."""
    inflation: Mapping[str, float] = field(default_factory=dict)
    """Why the covariance was enlarged, and by how much (factor of the variance)."""
    scores: Array = field(default_factory=lambda: np.zeros(0))
    """Columns with the residual, shape (k,)."""

    @property
    def attainable(self) -> Array:
        """Inverse of the information, with the plausible length of what is not identifiable, shape
        (k, k).
        """
        information = self.projection - self.projection @ self.held @ self.projection.T
        return np.asarray(information + self.wide @ self.wide.T)


@dataclass(frozen=True, eq=False)
class Blocks:
    """Normal equations of stretches of the runs, of which only the scores are wanted."""

    normal: Array
    """Shape (b, k, k)."""
    right: Array
    """Shape (b, k)."""
    run: NDArray[np.intp]
    """Number of the run of each, shape (b,)."""
    since: Array
    """When each begins, by the clock of its run [s], shape (b,)."""

    def scores(self, value: Array) -> Array:
        """Columns with the residual of a value, shape (b, k)."""
        return np.asarray(self.right - self.normal @ value)


class FurtherLoad(NamedTuple):
    """A body that is carried in place of the first: the sum of the first ten columns and of
    others.
    """

    columns: NDArray[np.intp]
    """Of what it is more than the first, shape (10,)."""
    value: Array
    """Of that where it was linearised, shape (10,)."""
    noise: Array
    """As :attr:`BorderEquations.noise`, of its runs, shape (10, 10)."""
    scale: Array
    """Plausible size of its ten, shape (10,)."""

    def change(self, size: int, own: NDArray[np.intp]) -> Array:
        """The border as it follows one with this load in place of the first, which is the sum of it
        and the negative difference then, shape (k, k).

        Args:
            size: Columns k.
            own: Of them those of the difference, shape (10,).
        """
        found = np.eye(size)
        found[np.arange(TEN), own] = 1.0
        found[own, own] = -1.0
        return found


def summed(parts: Sequence[BorderEquations]) -> BorderEquations:
    """Normal equations of several runs."""
    return reduce(add, parts)


def solve(
    equations: BorderEquations,
    prior: BorderPrior,
    estimated: NDArray[np.bool_],
    scale: Array,
    bias: Array | None = None,
    settings: FitSettings = FIT,
    loads: Sequence[FurtherLoad] = (),
) -> Solution:
    """Estimate body and calibration parameters.

    The products of derivatives contain those of their noise, N. A motion that follows the forces
    has its noise in residual and derivatives alike, which takes the same from the curvature of the
    likelihood: the scores have the variance I that the products say, but the likelihood is curved
    by I - N only, so that the covariance is (I - N)^-1 I (I - N)^-1 [Fuller1987]_. Where the motion
    is lively N is nothing beside I.

    Args:
        equations: Of all runs.
        prior: Of all columns.
        estimated: Which to estimate, shape (k,); the ten are.
        scale: Plausible size of the ten, shape (10,).
        bias: What noise in the regressor does to the right-hand side in the mean, with the opposite
            sign, shape (k,); None: nothing.
        settings: With what is identifiable.
        loads: Further ones, where there are several.
    """
    k = len(estimated)
    use = np.flatnonzero(estimated)
    own = np.ix_(use, use)
    normal = equations.normal[own] + prior.precision[own]
    by_noise = None if equations.by_noise is None else equations.by_noise[own]
    curved = curvature(normal, by_noise, scale)
    held, wide = weak_directions(normal, equations.noise, scale, settings, curved=curved)
    # Directions that are not identifiable are held; their uncertainty is that of what is plausible.
    holding, held_pull = np.zeros((k, k)), np.zeros(k)
    holding[:TEN, :TEN] = held
    every = [_at(np.arange(TEN), wide, k)]
    for each in loads:
        own_held, own_wide = _of_load(normal, curved, use, each, settings)
        of_both = np.concatenate([np.arange(TEN), each.columns])
        holding[np.ix_(of_both, of_both)] += np.tile(own_held, (2, 2))
        held_pull[of_both] -= np.tile(own_held @ each.value, 2)
        every.append(_at(each.columns, own_wide, k))
    wide = np.hstack(every)
    taken_off = np.zeros(k) if bias is None else bias
    projection = np.zeros((k, k))
    projection[own] = inverse_of(normal + holding[own], scale)
    right = equations.right + taken_off
    value = projection @ (right + prior.pull + held_pull)
    gain = projection
    if curved is not normal:
        gain = np.zeros((k, k))
        gain[own] = inverse_of(curved + holding[own], scale)
    noise_part = gain @ equations.normal @ gain.T
    covariance = noise_part + gain @ prior.precision @ gain.T
    shift = gain @ taken_off
    covariance = covariance + np.outer(shift, shift) + wide @ wide.T
    return Solution(
        value=value,
        covariance=(covariance + covariance.T) / 2,
        gain=gain,
        projection=projection,
        estimated=estimated,
        noise_part=noise_part,
        bias=shift,
        held=holding,
        held_pull=held_pull,
        wide=wide,
        spent=float(np.trace(projection @ equations.normal)),
        scores=right - equations.normal @ value,
    )


def _at(places: NDArray[np.intp], directions: Array, size: int) -> Array:
    """Directions of a body as directions of the border, shape (k, u)."""
    found = np.zeros((size, directions.shape[1]))
    found[places] = directions
    return found


def _of_load(
    normal: Array,
    curved: Array,
    use: NDArray[np.intp],
    load: FurtherLoad,
    settings: FitSettings,
) -> tuple[Array, Array]:
    """:func:`weak_directions` of a further load.

    Args:
        normal: Of the estimated columns with their priors.
        curved: See :func:`curvature`.
        use: Which columns these are.
        load: Whose directions.
        settings: With what is identifiable.
    """
    change = load.change(len(use), np.searchsorted(use, load.columns))
    seen, bent = (change.T @ each @ change for each in (normal, curved))
    return weak_directions(seen, load.noise, load.scale, settings, curved=bent)


def together(parts: Sequence[Blocks]) -> Blocks:
    """Blocks of several runs."""
    return Blocks(
        np.concatenate([each.normal for each in parts]),
        np.concatenate([each.right for each in parts]),
        np.concatenate([each.run for each in parts]),
        np.concatenate([each.since for each in parts]),
    )
