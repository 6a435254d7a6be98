"""What leaving out a pose would change: how well the geometry predicts lengths that it was not fitted
to.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.identification.model.motion_residuals import (
    Reading,
    Segment,
    Tally,
    motion_residuals,
)
from steelyard.identification.model.segment import Rows
from steelyard.identification.solve.fit_state import Fit, Task

_SAME = 1e-9
"""Part of the largest effect of a pose on its readings below which one is none: the length of the
quaternion."""


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Residuals of lengths that were predicted from all other readings."""

    run: str
    instrument: str
    pose: NDArray[np.intp]
    """Number of the pose of each row, from 0, shape (n,)."""
    residual: Array
    """Measured less predicted [m], NaN where nothing was read, shape (n, m)."""


def leaving_out(task: Task, found: Fit) -> list[LeftOut]:
    """Residuals of lengths in each pose about the geometry that all other poses tell: the pose
    itself is fitted to its readings again, the geometry is not.

    Args:
        task: What was fitted.
        found: How, without a body.
    """
    state = found.state
    border = task.border(state)
    total = task.calibration_parameters.precision[np.ix_(task.active, task.active)].copy()
    poses = []
    for segment in state.segments:
        parts = [(each, _rows_of(task, found, segment, each)) for each in segment.readings]
        for number in range(len(segment.coefficients)):
            own = [(reading, _of_pose(rows, number, border)) for reading, rows in parts]
            A = np.concatenate([pose for _, (_, pose, _) in own])
            B = np.concatenate([errors for _, (_, _, errors) in own])
            e = np.concatenate([residual for _, (residual, _, _) in own])
            # The length of the quaternion is no reading, and is held.
            left = np.linalg.svd(A, full_matrices=True)
            rank = int(np.sum(1e-9 * max(float(left.S.max(initial=0.0)), 1e-300) < left.S))
            across = left.U[:, rank:]
            told = across.T @ B
            total += told.T @ told
            poses.append((segment, number, own, across, told, across.T @ e))
    found_rows: dict[tuple[str, str], list[tuple[int, Array]]] = {}
    scale = 1 / np.sqrt(np.maximum(np.diag(total), 1e-300))
    for segment, number, own, across, told, e in poses:
        others = (total - told.T @ told) * np.outer(scale, scale)
        moved = scale * np.linalg.solve(others, scale * (told.T @ e))
        residual = across @ (e + told @ moved)
        start = 0
        for reading, (size, _, _) in own:
            part = residual[start : start + len(size)]
            start += len(size)
            if not task.experiment.instruments[reading.source[0]].is_cable_motion or not len(part):
                continue
            sigma = reading.sigma * state.factors.get(segment.label(*reading.source), 1.0)
            i = int(np.flatnonzero(reading.time.astype(int) == number)[0])
            there = np.isfinite(reading.values[i])
            off = np.where(there, part * sigma, np.nan)
            found_rows.setdefault((segment.run, reading.source[0]), []).append((number, off))
    return [
        LeftOut(
            run, name, np.array([n for n, _ in rows], dtype=np.intp), np.array([r for _, r in rows])
        )
        for (run, name), rows in found_rows.items()
    ]


def _of_pose(rows: Rows, number: int, border: int) -> tuple[Array, Array, Array]:
    """Residual, and derivatives by the pose and by the border, of the rows of one pose."""
    own = np.flatnonzero(rows.first == number)
    residual = rows.residual[own].reshape(-1)
    pose = rows.by_motion[own].reshape(len(residual), rows.by_motion.shape[2])
    errors = np.zeros((len(residual), border))
    columns = np.arange(rows.by_errors.shape[2]) if rows.columns is None else rows.columns
    errors[:, columns] = rows.by_errors[own].reshape(len(residual), len(columns))
    return residual, pose, errors


def _rows_of(task: Task, found: Fit, segment: Segment, reading: Reading) -> Rows:
    """Rows of one reading about the end."""
    state = found.state
    alone = replace(segment, readings=(reading,))
    rows = motion_residuals(
        task.experiment, alone, state.calibration, task.column_of(state), state.factors, Tally()
    )
    return next(iter(rows))
