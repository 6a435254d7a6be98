r"""Normal equations of the border, with priors, and all that follows from them.

The border holds what acts on a whole recording: the ten linear parameters of the body and then
*every* calibration parameter of the experiment, the motion having been eliminated. Summed up once,
they answer all questions: which of the ten are identifiable, how well they are known, whether
stretches and runs agree, and whether the residual points at one number of the description (score
test [Rao1948]_).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from operator import add
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from steelyard.arrays import Array
from steelyard.estimates.quantiles import chi2_quantile, student_quantile
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
    """Mean product of the noise in the regressor with itself, summed over the samples: what a motion
    of nothing but noise would tell, shape (10, 10)."""
    freedom: float
    """Samples of six equations."""
    by_noise: Array | None = None
    """Part of ``normal`` that is due to noise in derivatives where the motion follows the forces, see
    :func:`solve`, shape (k, k); None: nothing."""

    def __add__(self, other: BorderEquations) -> BorderEquations:
        parts = [each.by_noise for each in (self, other) if each.by_noise is not None]
        return BorderEquations(
            self.normal + other.normal,
            self.right + other.right,
            self.noise + other.noise,
            self.freedom + other.freedom,
            reduce(add, parts) if parts else None,
        )


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
    """The same, were the likelihood curved as the products of derivatives say: what makes a residual
    orthogonal to their columns."""
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
        """Inverse of the information, with the plausible length of what is not identifiable, shape (k,
        k).
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

    def scores(self, value: Array) -> Array:
        """Columns with the residual of a value, shape (b, k)."""
        return np.asarray(self.right - self.normal @ value)


class FurtherLoad(NamedTuple):
    """A body that is carried in place of the first: the sum of the first ten columns and of others."""

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

    The products of derivatives contain those of their noise, N. A motion that follows the forces has
    its noise in residual and derivatives alike, which takes the same from the curvature of the
    likelihood: the scores have the variance I that the products say, but the likelihood is curved by
    I - N only, so that the covariance is (I - N)^-1 I (I - N)^-1 [Fuller1987]_. Where the motion is
    lively N is nothing beside I.

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


_MOST_BY_NOISE = 0.97
"""Part of the information that noise may be; what is known is beyond any use there."""
_NOTHING = 1e-6
"""Information in units of plausible sizes that changes nothing."""
_ROUNDED = 1e-13
"""Of the largest information, what its digits do not hold."""


def curvature(normal: Array, by_noise: Array | None, scale: Array) -> Array:
    """Of the likelihood in the mean, see :func:`solve`: positive in all directions, shape (u, u).

    Args:
        normal: Of the estimated columns with their priors.
        by_noise: What of it is due to noise in the derivatives; None: nothing.
        scale: Plausible size of the ten.
    """
    if by_noise is None:
        return normal
    sizes = np.concatenate([scale, 1 / np.sqrt(np.maximum(np.diag(normal)[TEN:], 1e-300))])
    unit = np.outer(sizes, sizes)
    whole = normal * unit
    least = max(_NOTHING, _ROUNDED * float(np.max(np.diag(whole))))
    lower = np.linalg.cholesky(whole + least * np.eye(len(sizes)))
    half = solve_triangular(lower, by_noise * unit, lower=True)
    part, directions = np.linalg.eigh(solve_triangular(lower, half.T, lower=True))
    taken = lower @ (directions * np.sqrt(np.clip(part, 0.0, _MOST_BY_NOISE)))
    return np.asarray(normal - taken @ taken.T / unit)


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


def inverse_of(matrix: Array, scale: Array) -> Array:
    """Inverse over the estimated columns, with the ten in units of their plausible size; the others in those of their own
    diagonal.
    """
    sizes = np.concatenate([scale, 1 / np.sqrt(np.maximum(np.abs(np.diag(matrix)[TEN:]), 1e-300))])
    return np.asarray(np.linalg.inv(matrix * np.outer(sizes, sizes)) * np.outer(sizes, sizes))


_STRONG = 1e8
"""Information in units of plausible sizes that is as good as certain."""
_CLEAR = 4.0
"""Information of a motion in that of its noise, of which it contains as much again as it scatters, that
noise does not reach by chance."""


def weak_directions(
    normal: Array,
    noise: Array,
    scale: Array,
    settings: FitSettings = FIT,
    least: float | None = None,
    *,
    curved: Array | None = None,
) -> tuple[Array, Array]:
    """What holds the directions of the ten that the data do not tell, shape (10, 10), and these
    directions in plausible length, columns of shape (10, u).

    Args:
        normal: Of the estimated columns with their priors.
        noise: Of the ten, which must be exceeded.
        scale: Plausible size of the ten.
        settings: With what is identifiable.
        least: Information in units of plausible sizes below which a direction is weak; None: one
            that is not identifiable.
        curved: See :func:`curvature`; None: all of it.
    """
    scaled = _information(normal, normal if curved is None else curved) * np.outer(scale, scale)
    # By the covariance with a unit of information more: what is known exactly must not drown what
    # the readings tell, as it would beside it in one matrix.
    left, vectors = np.linalg.eigh(_inverse(np.eye(TEN) + (scaled + scaled.T) / 2))
    values = 1 / np.clip(left, 1e-300, None) - 1
    # What noise tells is before anything else is uncertain. Where that hides what the motion tells,
    # the motion has to stand far above the noise likewise.
    alone, by_noise = (
        np.einsum("ij,ik,kj->j", vectors, each * np.outer(scale, scale), vectors)
        for each in (normal[:TEN, :TEN], noise)
    )
    enough = settings.least_information if least is None else least
    of_noise = (values < by_noise) & (alone < _CLEAR * by_noise)
    weak = (left > 0) & ((values < enough) | of_noise)
    directions = vectors[:, weak]
    best = float(np.clip(values[left > 0], 1.0, _STRONG).max(initial=1.0))
    held = (directions * (best * settings.held)) @ directions.T / np.outer(scale, scale)
    return held, scale[:, None] * directions


def _information(normal: Array, curved: Array) -> Array:
    """Inverse of the covariance of the ten, all else being estimated beside, shape (10, 10).

    Args:
        normal: Of the estimated columns with their priors.
        curved: See :func:`curvature`.
    """
    information = curved[:TEN, :TEN]
    # How the ten move with a score of any column, but for that information.
    scores = np.eye(len(normal))[:TEN]
    if len(normal) > TEN:
        size = 1 / np.sqrt(np.maximum(np.diag(curved)[TEN:], 1e-300))
        others = curved[TEN:, TEN:] * np.outer(size, size)
        solved = size[:, None] * np.linalg.solve(others, curved[TEN:, :TEN] * size[:, None])
        information = information - curved[:TEN, TEN:] @ solved
        scores = np.hstack([np.eye(TEN), -solved.T])
    if curved is normal:
        return information
    variance = scores @ normal @ scores.T
    return np.asarray(information @ np.linalg.solve(variance, information))


def _inverse(matrix: Array) -> Array:
    """Of a positive definite matrix whose parts differ by many orders."""
    size = 1 / np.sqrt(np.diag(matrix))
    inverse = size[:, None] * np.linalg.inv(matrix * np.outer(size, size)) * size
    return np.asarray((inverse + inverse.T) / 2)


def enlarged(
    solution: Solution,
    blocks: Blocks,
    identifiable: NDArray[np.bool_],
    freedom: float,
    settings: FitSettings = FIT,
) -> Solution:
    """Enlarge the covariance where residuals are larger, more coloured or more different between
    runs than noise is.

    Blocks within the runs, and runs, are taken as independent; how much more they scatter than
    white noise would have them do is pooled over the parameters [Liang1986]_, so that few blocks
    tell it. A factor within what chance gives is left at one.

    Args:
        solution: Without it.
        blocks: Of its residuals.
        identifiable: Which of the ten the data tell, shape (10,).
        freedom: Samples of six equations.
        settings: With what is chance.
    """
    part = np.flatnonzero(identifiable)
    if not len(part):
        return solution
    own = np.ix_(part, part)
    whiten = _whitening(solution.noise_part[own], solution.covariance[own], settings)
    if not whiten.size:
        return solution
    moved = blocks.scores(solution.value) @ solution.gain[part].T @ whiten.T
    runs = np.unique(blocks.run)
    found = {"blocks": _scatter(moved, settings)}
    if solution.ratio > 1:
        found["noise"] = _beyond_chance(solution.ratio, 6 * freedom, settings)
    if len(runs) > 1:
        by_run = np.array([moved[blocks.run == run].sum(axis=0) for run in runs])
        freedom_of_runs = (len(runs) - 1) * len(whiten)
        few = (student_quantile(0.975, freedom_of_runs) / student_quantile(0.975, 1e9)) ** 2
        factor = _scatter(by_run, settings)
        found["runs"] = factor * few if factor > 1 else 1.0
    name, factor = max(found.items(), key=lambda item: item[1])
    covariance = solution.covariance + max(0.0, factor - 1) * solution.noise_part
    return replace(solution, covariance=covariance, inflation={name: factor} if factor > 1 else {})


def _whitening(noise: Array, covariance: Array, settings: FitSettings) -> Array:
    """What makes the part of some parameters that is due to noise white, in the directions of which
    the readings tell something, shape (d, p): beside what is known without them their noise is
    nothing in the others, and what is left there is the curvature of the model.

    Args:
        noise: Covariance that is due to noise, shape (p, p).
        covariance: The whole of it, shape (p, p).
        settings: With what is something.
    """
    scale = 1 / np.sqrt(np.diag(covariance))
    size = np.outer(scale, scale)
    lower = np.linalg.cholesky(covariance * size + 1e-9 * np.eye(len(scale)))
    half = np.linalg.solve(lower, noise * size)
    share, directions = np.linalg.eigh(np.linalg.solve(lower, half.T))
    told = share > settings.tells
    found = np.linalg.solve(lower, np.diag(scale))
    return np.asarray(directions[:, told].T @ found / np.sqrt(share[told])[:, None])


def _scatter(moved: Array, settings: FitSettings) -> float:
    """Mean square of independent, whitened contributions over what it should be; 1 within
    chance.
    """
    count = len(moved)
    if count < 2:
        return 1.0
    centred = moved - moved.mean(axis=0)
    factor = float(np.sum(centred**2)) * count / (count - 1) / moved.shape[1]
    return _beyond_chance(factor, (count - 1) * moved.shape[1], settings)


def _beyond_chance(factor: float, freedom: float, settings: FitSettings) -> float:
    """A mean square over what it should be; 1 within chance."""
    return factor if factor > chi2_quantile(settings.significant, freedom) / freedom else 1.0


def together(parts: Sequence[Blocks]) -> Blocks:
    """Blocks of several runs."""
    return Blocks(
        np.concatenate([each.normal for each in parts]),
        np.concatenate([each.right for each in parts]),
        np.concatenate([each.run for each in parts]),
    )
