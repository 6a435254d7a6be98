"""What leaving out a pose, or a stretch of a motion, would change: how well the geometry predicts
lengths that it was not fitted to.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.identification.model.balance import Forces
from steelyard.identification.model.force_residuals import force_residuals
from steelyard.identification.model.motion_residuals import AT_ONCE, motion_residuals
from steelyard.identification.model.motion_segment import Reading, Segment
from steelyard.identification.model.segment import NormalEquations, Rows
from steelyard.identification.model.tensions.carried import carried_tensions
from steelyard.identification.solve.fit_state import Fit, Task
from steelyard.identification.solve.newton_step import border_prior

STRETCHES = 10
"""Into which a motion is cut, of equal length."""


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Residuals of lengths that were predicted from all other readings."""

    run: str
    instrument: str
    part: NDArray[np.intp]
    """Number of the pose or of the stretch of each row, from 0, shape (n,)."""
    residual: Array
    """Measured less predicted [m], of a stretch their root mean square, NaN where nothing was read,
    shape (n, m)."""
    static: bool
    """Whether the parts are poses at rest."""


@dataclass(frozen=True, eq=False)
class _Followed:
    """Rows of a segment once its motion has followed the border."""

    rows: Rows
    part: NDArray[np.intp]
    """Which of the parts that are left out each sample belongs to, shape (n,)."""
    by_border: Array
    """Shape (n, k, b)."""
    reading: Reading | None
    """Whose they are; None: forces."""
    samples: slice
    """Of the reading."""


def leaving_out(task: Task, found: Fit) -> list[LeftOut]:
    """Residuals of lengths about the geometry that all other poses and stretches tell: pose and
    motion themselves are fitted to their readings again, the geometry is not.

    First order in the change, and exact in that up to the two ends of a stretch.

    Args:
        task: What was fitted.
        found: How.
    """
    state = found.state
    information = np.sum([each.reduced()[0] for each in found.equations], axis=0)
    information = information + border_prior(task, state)[0]
    scale = 1 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    result: list[LeftOut] = []
    for segment, forces, equations in zip(
        state.segments, task.force_samples, found.equations, strict=True
    ):
        followed = list(_followed(task, found, segment, forces, equations))
        moved: dict[int, Array] = {}
        for part in np.unique(np.concatenate([each.part for each in followed])):
            E = np.concatenate([_flat(each.by_border[each.part == part]) for each in followed])
            e = np.concatenate([each.rows.residual[each.part == part].ravel() for each in followed])
            others = (information - E.T @ E) * np.outer(scale, scale)
            step, *_ = np.linalg.lstsq(others, scale * (E.T @ e), rcond=1e-12)
            moved[int(part)] = scale * step
        result += _of_lengths(task, found, segment, followed, moved)
    return result


def _of_lengths(
    task: Task,
    found: Fit,
    segment: Segment,
    followed: list[_Followed],
    moved: dict[int, Array],
) -> Iterator[LeftOut]:
    """What lengths of a segment are off about the border that each part has not told."""
    off: dict[str, list[tuple[NDArray[np.intp], Array]]] = {}
    for each in followed:
        if each.reading is None:
            continue
        name, what = each.reading.source
        if not task.experiment.instruments[name].is_cable_motion:
            continue
        step = np.array([moved[int(part)] for part in each.part])
        residual = each.rows.residual + np.einsum("nkb,nb->nk", each.by_border, step)
        sigma = each.reading.sigma * found.state.factors.get(segment.label(name, what), 1.0)
        there = np.isfinite(each.reading.values[each.samples])
        off.setdefault(name, []).append((each.part, np.where(there, residual * sigma, np.nan)))
    for name, parts in off.items():
        part = np.concatenate([number for number, _ in parts])
        residual = np.concatenate([own for _, own in parts])
        if segment.static:
            yield LeftOut(segment.run, name, part, residual, static=True)
            continue
        numbers = np.unique(part)
        yield LeftOut(
            segment.run,
            name,
            numbers,
            np.array([root_mean_square(residual[part == each]) for each in numbers]),
            static=False,
        )


def root_mean_square(residual: Array) -> Array:
    """Of every column, NaN where it has no number, shape (m,).

    Args:
        residual: Shape (n, m).
    """
    there = np.isfinite(residual)
    count = there.sum(axis=0)
    square = np.sum(np.where(there, residual, 0.0) ** 2, axis=0)
    return np.asarray(np.where(count > 0, np.sqrt(square / np.maximum(count, 1)), np.nan))


def _followed(
    task: Task, found: Fit, segment: Segment, forces: Forces | None, equations: NormalEquations
) -> Iterator[_Followed]:
    """Rows of all readings of a segment."""
    state, column_of = found.state, task.column_of(found.state)
    shared = task.experiment, segment
    instants = len(segment.coefficients) - segment.width // segment.block + 1
    parts = instants if segment.static else min(STRETCHES, instants)
    of_instant = np.arange(instants) * parts // instants

    def seen(rows: Rows, reading: Reading | None, samples: slice) -> _Followed:
        by_border = np.zeros((*rows.residual.shape, equations.side.shape[1]))
        columns = np.arange(by_border.shape[2]) if rows.columns is None else rows.columns
        by_border[:, :, columns] = rows.by_errors
        for first in np.unique(rows.first):
            own, start = rows.first == first, first * segment.block
            by_border[own] -= (
                rows.by_motion[own] @ equations.followed[start : start + segment.width]
            )
        return _Followed(rows, of_instant[rows.first], by_border, reading, samples)

    carried = carried_tensions(
        *shared, forces, state.calibration, column_of, state.parameters, state.factors
    )
    motion = motion_residuals(*shared, state.calibration, column_of, state.factors, None, carried)
    for reading in segment.readings:
        for start in range(0, len(reading.time), AT_ONCE):
            yield seen(next(motion), reading, slice(start, start + AT_ONCE))
    if forces is not None and state.parameters is not None:
        for rows in force_residuals(
            *shared,
            forces,
            state.calibration,
            column_of,
            state.parameters,
            state.factors,
            None,
        ):
            yield seen(rows, None, slice(None))


def _flat(by_border: Array) -> Array:
    """One row for each number, shape (n k, b)."""
    n, k, border = by_border.shape
    return by_border.reshape(n * k, border)
