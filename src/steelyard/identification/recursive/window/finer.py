"""A motion that goes on upon finer knots: what remains of its past is told in these.

At a knot a spline of degree d is its value and its first d - 1 derivatives, however far the knots
on either side are: the last coefficients on coarse knots and the first ones on fine knots are
linear functions of each other, and nothing of what was known is lost.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import BSpline

from steelyard.arrays import Array
from steelyard.identification.recursive.window.grid import KnotGrid
from steelyard.identification.recursive.window.past import Linear, Point, banded, dense
from steelyard.identification.recursive.window.window import Window
from steelyard.smoothing import DEGREE


def on_finer_knots(window: Window, intervals: int) -> Window:
    """The same motion on knots with so many intervals to a chunk.

    Args:
        window: All of whose chunks have passed.
        intervals: At least one.
    """
    assert window.past is not None
    assert not window.chunks
    grid = window.grid
    finer = replace(grid, spacing=grid.length / intervals, intervals=intervals)
    coarse, fine = (_derivatives(each, window.first) for each in (grid, finer))
    change = np.asarray(np.linalg.solve(fine, coarse), dtype=np.float64)
    return replace(
        window,
        grid=finer,
        motion=change @ window.motion,
        past=_told_by(window.past, change, grid.block),
    )


def _derivatives(grid: KnotGrid, number: int) -> Array:
    """Value and derivatives of the functions before a chunk at its beginning, order by order, shape
    (d, d).
    """
    start, _ = grid.span(number)
    functions = BSpline(grid.knots(number), np.eye(grid.functions), DEGREE)
    return np.array([functions(start, nu=order)[:DEGREE] for order in range(DEGREE)])


def _told_by(past: Linear, change: Array, block: int) -> Linear:
    """What remains of the past by other coefficients.

    Args:
        past: As it is.
        change: Coefficients by the present ones, shape (d, d).
        block: Coefficients of one function.
    """
    own, back = past.equations, np.kron(np.linalg.inv(change), np.eye(block))
    equations = replace(
        own,
        band=banded(back.T @ dense(own.band) @ back, len(own.band)),
        side=back.T @ own.side,
        motion_gradient=back.T @ own.motion_gradient,
        parts={},
    )
    return Linear(equations, Point(change @ past.at.motion, past.at.border))
