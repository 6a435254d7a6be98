r"""Weighted least squares of the balance of wrenches, with priors, and all that follows from its
normal equations.

The columns of the rows are the ten linear parameters and then *every* systematic error of the
experiment. Summed up once, their normal matrix answers all questions: which of them to estimate,
what the others do to the result (consider covariance [Tapley2004]_), and whether the residual
points at one of them (score test [Rao1948]_).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, t

from steelyard.arrays import Array
from steelyard.identification.model.motion_residuals import robust_weight

TEN = 10
_BLOCK_SPACINGS = 5.0
"""Length of the blocks in which residuals may be correlated, in knot spacings of the filter."""
_MOST_BLOCKS = 100
LOUD = 4.0
"""A direction is told where its information is this many times what noise in the regressor alone
would give."""
_SIGNIFICANT = 0.95


@dataclass(frozen=True, eq=False)
class Rows:
    """Whitened rows of n samples of a run, k columns."""

    columns: Array
    """Shape (n, 6, k)."""
    instruments: Array
    """What the ten first columns are multiplied with: themselves, or instrumental variables, shape
    (n, 6, 10)."""
    target: Array
    """Shape (n, 6)."""
    noise: Array
    """Mean product of the noise in the ten first columns with itself, summed over the samples,
    shape (10, 10)."""
    shared: Array
    """Mean product of the noise in each column with that of the target, summed over the samples,
    shape (k,)."""
    block: NDArray[np.intp]
    """Number of the block of each sample, ascending, shape (n,)."""


@dataclass(frozen=True, eq=False)
class Sums:
    """Normal equations of one run over k columns."""

    normal: Array
    """Columns with columns, shape (k, k)."""
    crossed: Array
    """Instruments (and the other columns) with columns, shape (k, k); the same as ``normal`` in
    least squares."""
    squared: Array
    """Instruments with instruments, shape (k, k)."""
    right: Array
    """Instruments with target, shape (k,)."""
    plain_right: Array
    """Columns with target, shape (k,)."""
    square: float
    """Target with target."""
    noise: Array
    """Of the ten first columns, shape (10, 10)."""
    shared: Array
    """Mean product of the noise in each column with that of the target, shape (k,)."""
    freedom: float
    """Independent samples of six equations."""

    def __add__(self, other: Sums) -> Sums:
        return Sums(
            *(getattr(self, name) + getattr(other, name) for name in self.__dataclass_fields__)
        )

    def __sub__(self, other: Sums) -> Sums:
        return Sums(
            *(getattr(self, name) - getattr(other, name) for name in self.__dataclass_fields__)
        )


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known beforehand about the columns."""

    mean: Array
    """Of the systematic errors; of no account for the ten, shape (k,)."""
    precision: Array
    """Shape (k, k); zero for the body unless something about it is known."""
    pull: Array
    """Precision times what is known, shape (k,)."""
    covariance: Array
    """Of those columns that are not estimated, shape (k, k); zero where exact."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Result of a regression."""

    value: Array
    """All k, those not estimated at their means, shape (k,)."""
    covariance: Array
    """Shape (k, k); of the noise, the priors, and what was not estimated."""
    gain: Array
    """How estimates follow a change of ``right``, shape (k, k), zero where nothing is estimated."""
    estimated: NDArray[np.bool_]
    """Shape (k,)."""
    untold: Array
    """Directions of the ten that the data do not tell, columns of shape (10, u), of plausible
    length."""
    noise_part: Array
    """Part of ``covariance`` that came from the data, shape (k, k)."""
    bias: Array
    """First-order bias by noise in the regressor that has been taken off, shape (k,)."""
    ratio: float
    """Mean square of the whitened residuals, 1 where the noise is as stated."""
    spent: float
    """Degrees of freedom that were estimated from the data."""
    inflation: Mapping[str, float] = field(default_factory=dict)
    """Why the covariance was enlarged, and by how much (factor of the variance)."""
    residual_scores: Array = field(default_factory=lambda: np.zeros(0))
    """Columns with the residual, shape (k,)."""


@dataclass(frozen=True, eq=False)
class Blocks:
    """Normal equations of stretches of the runs, of which only the scores are wanted."""

    crossed: Array
    """Shape (b, k, k)."""
    right: Array
    """Shape (b, k)."""
    run: NDArray[np.intp]
    """Number of the run of each, shape (b,)."""

    def scores(self, value: Array) -> Array:
        """Instruments (and the other columns) with the residual of a value, shape (b, k)."""
        return np.asarray(self.right - self.crossed @ value)


def sums_of(rows: Rows, weight: Array, freedom: float, run: int) -> tuple[Sums, Blocks]:
    """Sum rows up, as a whole and block by block.

    Args:
        rows: Of one run.
        weight: Of each sample, shape (n,).
        freedom: See :class:`Sums`.
        run: Number of the run.
    """
    k = rows.columns.shape[2]
    root = np.sqrt(weight)[:, None]
    A = rows.columns * root[:, :, None]
    b = rows.target * root
    Z = A
    if rows.instruments is not rows.columns:
        Z = A.copy()
        Z[:, :, :TEN] = rows.instruments * root[:, :, None]
    edges = np.flatnonzero(
        np.diff(rows.block, prepend=rows.block[0] - 1, append=rows.block[-1] + 1)
    )
    crossed, right = np.empty((len(edges) - 1, k, k)), np.empty((len(edges) - 1, k))
    for i, (start, end) in enumerate(pairwise(edges)):
        z = Z[start:end].reshape(-1, k)
        crossed[i], right[i] = z.T @ A[start:end].reshape(-1, k), z.T @ b[start:end].ravel()
    total, toward = crossed.sum(axis=0), right.sum(axis=0)
    own = Z is A
    flat_a, flat_z, flat_b = A.reshape(-1, k), Z.reshape(-1, k), b.ravel()
    sums = Sums(
        normal=total if own else flat_a.T @ flat_a,
        crossed=total,
        squared=total if own else flat_z.T @ flat_z,
        right=toward,
        plain_right=toward if own else flat_a.T @ flat_b,
        square=float(flat_b @ flat_b),
        noise=rows.noise * float(np.mean(weight)),
        shared=rows.shared * float(np.mean(weight)),
        freedom=freedom,
    )
    return sums, Blocks(crossed, right, np.full(len(right), run, dtype=np.intp))


def solve(
    sums: Sums,
    prior: Prior,
    estimated: NDArray[np.bool_],
    scale: Array,
    *,
    correct: bool,
    loud: float = LOUD,
) -> Solution:
    """Estimate some of the columns.

    Args:
        sums: Of all runs.
        prior: Of all columns.
        estimated: Which to estimate, shape (k,); the ten are.
        scale: Plausible size of the ten, shape (10,).
        correct: Whether to take off the first-order bias by noise in the regressor.
        loud: See :data:`LOUD`.
    """
    k = len(estimated)
    use = np.flatnonzero(estimated)
    normal = sums.normal[np.ix_(use, use)] + prior.precision[np.ix_(use, use)]
    hidden, untold = _untold(normal, loud * sums.noise, scale)
    # Directions that are not told are held; their uncertainty is that of what is plausible.
    held = np.zeros((len(use), len(use)))
    held[:TEN, :TEN] = hidden
    attenuation = np.zeros((len(use), len(use)))
    attenuation[:TEN, :TEN] = sums.noise
    matrix = sums.crossed[np.ix_(use, use)] + prior.precision[np.ix_(use, use)] + held
    # A column that is made of the readings has their noise in common with the target.
    right = (sums.right - sums.shared - sums.crossed[:, ~estimated] @ prior.mean[~estimated])[use]
    right = right + prior.pull[use]
    inverse = _inverse(matrix, scale)
    value = prior.mean.copy()
    plain = inverse @ right
    bias = np.zeros(k)
    if correct:
        inverse = _inverse(matrix - _kept(attenuation, untold), scale)
        bias[use] = plain - inverse @ right
    value[use] = inverse @ right
    gain = np.zeros((k, k))
    gain[np.ix_(use, use)] = inverse
    noise_part = gain @ sums.squared @ gain.T
    covariance = (
        noise_part + gain @ np.where(np.outer(estimated, estimated), prior.precision, 0.0) @ gain.T
    )
    # What is not estimated passes its own uncertainty on.
    passed = -gain @ sums.crossed[:, ~estimated]
    passed[~estimated] += np.eye(int((~estimated).sum()))
    covariance = covariance + passed @ prior.covariance[np.ix_(~estimated, ~estimated)] @ passed.T
    covariance = covariance + np.outer(bias, bias)
    wide = np.zeros((k, untold.shape[1]))
    wide[:TEN] = untold
    covariance = covariance + wide @ wide.T
    residual = sums.square - 2 * value @ sums.plain_right + value @ sums.normal @ value
    spent = float(np.trace(inverse @ sums.normal[np.ix_(use, use)]))
    return Solution(
        value=value,
        covariance=(covariance + covariance.T) / 2,
        gain=gain,
        estimated=estimated,
        untold=untold,
        noise_part=noise_part,
        bias=bias,
        ratio=float(residual) / max(6 * sums.freedom - spent, 1.0),
        spent=spent,
        residual_scores=sums.plain_right
        - sums.shared
        - sums.normal @ value
        + _padded(sums.noise @ value[:TEN], k) * correct,
    )


def _padded(ten: Array, k: int) -> Array:
    return np.concatenate([ten, np.zeros(k - TEN)])


def _inverse(matrix: Array, scale: Array) -> Array:
    """Inverse with the ten in units of their plausible size; the others in those of their own
    diagonal.
    """
    sizes = np.concatenate([scale, 1 / np.sqrt(np.maximum(np.abs(np.diag(matrix)[TEN:]), 1e-300))])
    return np.asarray(np.linalg.inv(matrix * np.outer(sizes, sizes)) * np.outer(sizes, sizes))


def _untold(normal: Array, noise: Array, scale: Array) -> tuple[Array, Array]:
    """What holds the directions of the ten that the data do not tell, and these directions, in
    plausible length.

    Args:
        normal: Of the estimated columns with their priors.
        noise: Of the ten, as much of it as must be exceeded.
        scale: Plausible size of the ten.
    """
    others = normal[TEN:, TEN:]
    information = normal[:TEN, :TEN]
    if len(others):
        size = 1 / np.sqrt(np.maximum(np.diag(others), 1e-300))
        solved = np.linalg.solve(others * np.outer(size, size), normal[TEN:, :TEN] * size[:, None])
        information = information - (normal[:TEN, TEN:] * size) @ solved
    scaled = information * np.outer(scale, scale)
    values, vectors = np.linalg.eigh((scaled + scaled.T) / 2)
    loud = np.einsum("ij,ik,kj->j", vectors, noise * np.outer(scale, scale), vectors)
    hidden = (values < loud) | (values < 1e-12 * values[-1]) | (values < _LEAST_INFORMATION)
    directions = vectors[:, hidden]
    strength = max(1.0, float(values[-1])) * 1e3
    held = (directions * strength) @ directions.T / np.outer(scale, scale)
    return held, scale[:, None] * directions


_LEAST_INFORMATION = 0.25
"""A direction known no better than to twice its plausible size is not told."""


def _kept(attenuation: Array, untold: Array) -> Array:
    """Noise in the regressor along the directions that are told."""
    if not untold.shape[1]:
        return attenuation
    basis, _ = np.linalg.qr(untold)
    project = np.eye(len(attenuation))
    project[:TEN, :TEN] -= basis @ basis.T
    return np.asarray(project @ attenuation @ project)


def robust_weights(residual: Array) -> Array:
    """Weights that let no sample count for more than noise may do [Huber1964]_.

    Args:
        residual: Whitened with a level that most samples keep to, shape (n, 6).

    Returns:
        Shape (n,), 1 for all but outliers.
    """
    size = np.sqrt(np.sum(residual**2, axis=1))
    return robust_weight(size, 6)


def enlarged(
    solution: Solution, blocks: Blocks, told: NDArray[np.bool_], freedom: float
) -> Solution:
    """Enlarge the covariance where residuals are larger, more coloured or more different between
    runs than noise is.

    Blocks within the runs, and runs, are taken as independent; how much more they scatter than
    white noise would have them do is pooled over the parameters [Liang1986]_, so that few blocks
    tell it. A factor within what chance gives is left at one.

    Args:
        solution: Without it.
        blocks: Of its residuals.
        told: Which of the ten the data tell, shape (10,).
        freedom: Independent samples of six equations.
    """
    part = np.flatnonzero(told)
    if not len(part):
        return solution
    expected = solution.noise_part[np.ix_(part, part)]
    scale = 1 / np.sqrt(np.diag(expected))
    whiten = (
        np.linalg.inv(
            np.linalg.cholesky(expected * np.outer(scale, scale) + 1e-9 * np.eye(len(part)))
        )
        * scale
    )
    spent = max(0.1, 1 - solution.spent / (6 * freedom))
    moved = blocks.scores(solution.value) @ solution.gain[part].T @ whiten.T
    runs = np.unique(blocks.run)
    found: dict[str, float] = {}
    if solution.ratio > 1:
        found["noise"] = _chance(solution.ratio, 6 * freedom - solution.spent)
    found["blocks"] = _scatter(moved, spent)
    if len(runs) > 1:
        by_run = np.array([moved[blocks.run == run].sum(axis=0) for run in runs])
        freedom_of_runs = (len(runs) - 1) * len(part)
        few = (t.ppf(0.975, freedom_of_runs) / t.ppf(0.975, 1e9)) ** 2
        factor = _scatter(by_run, spent)
        found["runs"] = factor * few if factor > 1 else 1.0
    name, factor = max(found.items(), key=lambda item: item[1])
    covariance = solution.covariance + max(0.0, factor - 1) * solution.noise_part
    return replace(solution, covariance=covariance, inflation={name: factor} if factor > 1 else {})


def _scatter(moved: Array, spent: float) -> float:
    """Mean square of independent, whitened contributions over what it should be; 1 within
    chance.
    """
    count = len(moved)
    if count < 2:
        return 1.0
    centred = moved - moved.mean(axis=0)
    factor = float(np.sum(centred**2)) * count / (count - 1) / moved.shape[1] / spent
    return _chance(factor, (count - 1) * moved.shape[1])


def _chance(factor: float, freedom: float) -> float:
    return factor if factor > chi2.ppf(_SIGNIFICANT, freedom) / freedom else 1.0


def block_numbers(time: Array, spacing: float) -> NDArray[np.intp]:
    """Number of the block of each sample, ascending; poses at rest are blocks of their own as far
    as there may be so many.
    """
    n = len(time)
    if not spacing:
        return np.arange(n) * min(n, _MOST_BLOCKS) // n
    length = max(_BLOCK_SPACINGS * spacing, float(time[-1] - time[0]) / _MOST_BLOCKS)
    return np.asarray((time - time[0]) // length, dtype=np.intp)


def together(parts: Sequence[Blocks]) -> Blocks:
    """Blocks of several runs."""
    return Blocks(
        *(np.concatenate([getattr(p, name) for p in parts]) for name in ("crossed", "right", "run"))
    )
