"""Whether blocks of the residuals and runs scatter more than noise has them do, and a covariance
that is enlarged where they do.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.estimates.quantiles import chi2_quantile, student_quantile
from steelyard.identification.solve.border.normal_equations import Blocks, Solution
from steelyard.identification.solve.settings import FIT, FitSettings


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
