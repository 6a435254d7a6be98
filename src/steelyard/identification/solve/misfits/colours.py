"""Whether residuals follow each other, and how: what asks for a process beside the motion."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_banded

from steelyard.arrays import Array
from steelyard.identification.model.balance import (
    UNMODELLED_PARTS,
    Forces,
    balance_of,
)
from steelyard.identification.model.motion_residuals import motion_residuals
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.sources import Source
from steelyard.identification.solve.fit_state import FitState, Task
from steelyard.identification.solve.settings import FitSettings
from steelyard.identification.tally import limit


class Colour(NamedTuple):
    """How the residuals of a quantity follow each other."""

    score: float
    """How surely they do, a standard normal number: the largest over axes and correlation times."""
    level: float
    """1-sigma of the process that does it, over all axes, in the unit of the residuals."""
    time: float
    """Its correlation time [s]."""


def colours(task: Task, state: FitState) -> dict[Source, Colour]:
    """What may be disturbed -> how its residuals follow each other."""
    sums: dict[Source, list[tuple[Array, Array]]] = {}
    for segment, forces in zip(state.segments, task.force_samples, strict=True):
        if segment.static:
            continue
        pieces = [*_of_motion(task, state, segment), *_of_forces(task, state, segment, forces)]
        for source, time, score, information in pieces:
            own = _correlation(time, score, information, task.settings)
            sums.setdefault(source, []).append(own)
    found = {}
    for source, each in sums.items():
        product = np.sum([products for products, _ in each], axis=0)
        variance = np.sum([variances for _, variances in each], axis=0)
        found[source] = _colour(product, variance, task.settings)
    return found


def _colour(product: Array, variance: Array, settings: FitSettings) -> Colour:
    """Of products of residuals and their variance where they are white, shape (t, k) each.

    Where the residuals have a process of this correlation time, its variance times the variance of
    the products is what these are in the mean.
    """
    score = product / np.sqrt(np.maximum(variance, 1e-300))
    best = int(np.argmax(np.max(score, axis=1)))
    square = float(np.sum(np.maximum(product[best], 0.0)) / max(np.sum(variance[best]), 1e-300))
    return Colour(float(np.max(score[best])), np.sqrt(square), settings.correlations[best])


def _of_motion(
    task: Task, state: FitState, segment: Segment
) -> Iterator[tuple[Source, Array, Array, Array]]:
    """Of every quantity of the motion instruments: times, residuals in units of their variance,
    information.
    """
    nothing = np.full(len(task.calibration_parameters), -1, dtype=np.intp)
    rows = motion_residuals(
        task.experiment, segment, state.calibration, nothing, state.factors, None
    )
    by_label: dict[Source, list[Array]] = {}
    for each in rows:
        if each.label is not None:
            by_label.setdefault(each.label, []).append(each.residual)
    for reading in segment.readings:
        if task.experiment.instruments[reading.source[0]].commanded:
            continue
        white = np.concatenate(by_label[segment.label(*reading.source)])
        near = np.abs(white) < limit(1)
        yield reading.source, reading.time, np.where(near, white, 0.0), near.astype(np.float64)


def _of_forces(
    task: Task, state: FitState, segment: Segment, forces: Forces | None
) -> Iterator[tuple[Source, Array, Array, Array]]:
    """The same of the tensions and of the wrench on the platform."""
    if forces is None or state.parameters is None:
        return
    at = balance_of(
        task.experiment, segment, forces, state.calibration, state.parameters, state.factors
    )
    use = at.told & (np.sum(at.residual**2, axis=1) < limit(6) ** 2)
    if at.structure is not None:
        correction, decided = at.correction * use[:, None], at.noise.decided * use[:, None]
        for quantity, own in forces.places.items():
            yield (forces.name, quantity), at.time, correction[:, own], decided[:, own]
    score = np.einsum("nji,nj->ni", at.whitener, at.residual) * use[:, None]
    information = np.sum(at.whitener**2, axis=1) * use[:, None]
    for source, part in UNMODELLED_PARTS.items():
        yield source, at.time, score[:, part], information[:, part]


def _correlation(
    time: Array, score: Array, information: Array, settings: FitSettings
) -> tuple[Array, Array]:
    """Products of a residual with what has been before it, exponentially forgotten, and their
    variance where it is white, for every correlation time and axis, shape (t, k) each.

    It is the derivative of the likelihood by the variance of a Gauss-Markov process, but for the
    products of every residual with itself [Rao1948]_.
    """
    step = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    products, variances = [], []
    for each in settings.correlations:
        kept = np.exp(-step / each)
        before, known = _remembered(score, kept), _remembered(information, kept**2)
        products.append(np.sum(score * before, axis=0))
        variances.append(np.sum(information * known, axis=0))
    return np.array(products), np.array(variances)


def _remembered(values: Array, kept: float) -> Array:
    """Of every instant, what those before leave, each step keeping so much of it, shape (n, k)."""
    band = np.ones((2, len(values)))
    band[1] = -kept
    drive = np.zeros_like(values)
    drive[1:] = kept * values[:-1]
    return np.asarray(solve_banded((1, 0), band, drive, check_finite=False))
