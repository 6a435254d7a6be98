"""Which directions of the ten the data tell: information of what is estimated beside them, and what
holds the rest.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_triangular

from steelyard.arrays import Array
from steelyard.identification.solve.settings import FIT, FitSettings
from steelyard.inertia import TEN

_MOST_BY_NOISE = 0.97
"""Part of the information that noise may be; what is known is beyond any use there."""
_NOTHING = 1e-6
"""Information in units of plausible sizes that changes nothing."""
_ROUNDED = 1e-13
"""Of the largest information, what its digits do not hold."""
_STRONG = 1e8
"""Information in units of plausible sizes that is as good as certain."""
_CLEAR = 4.0
"""Information of a motion in that of its noise, of which it contains as much again as it scatters,
that noise does not reach by chance."""


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


def inverse_of(matrix: Array, scale: Array) -> Array:
    """Inverse over the estimated columns, with the ten in units of their plausible size; the others
    in those of their own diagonal.
    """
    sizes = np.concatenate([scale, 1 / np.sqrt(np.maximum(np.abs(np.diag(matrix)[TEN:]), 1e-300))])
    return np.asarray(np.linalg.inv(matrix * np.outer(sizes, sizes)) * np.outer(sizes, sizes))


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
