"""What one segment says about the border: its readings, linearised and whitened, with the motion
eliminated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.dynamics import platform_regressor
from steelyard.identification.model.balance import Balance, Forces, regressor_at
from steelyard.identification.model.fitted_motion import fitted_motion
from steelyard.identification.model.force_residuals import (
    WhitenedBalance,
    carried_tensions,
    whitened_balance,
)
from steelyard.identification.model.motion_residuals import Segment, Tally, motion_residuals
from steelyard.identification.model.segment import Label, NormalEquations, Rows
from steelyard.identification.model.sources import Source
from steelyard.identification.solve.fit_state import FitState, Task
from steelyard.identification.solve.normal_equations import Blocks, BorderEquations
from steelyard.identification.solve.settings import FitSettings
from steelyard.inertia import TEN

_LOOKED_AT = 500
"""Samples that show how much noise the fitted motion has in the regressor."""


@dataclass(frozen=True, eq=False)
class SegmentEquations:
    """One segment with its equations."""

    segment: Segment
    force_samples: Forces
    balances: tuple[Balance, ...]
    """Some samples at a time."""
    weight: Array
    """Of every sample, shape (n,)."""
    equations: BorderEquations
    blocks: Blocks
    by_source: Mapping[Source, Array]
    """Quantity -> part of the normal matrix that its readings bring, shape (k, k)."""
    covariance: Array
    """Of the coefficients of the motion, lower banded form, shape (42, N)."""
    followed: Array
    """How these follow the border, with the opposite sign, shape (N, k)."""
    tally: Tally
    """Of the residuals."""
    spent: Mapping[Label, float]
    """What rows are of -> degrees of freedom that the motion takes of them."""


def border_of(task: Task) -> int:
    """Columns of the border: the ten and every calibration parameter, estimated or not."""
    return TEN + len(task.calibration_parameters)


def whitened_rows(
    task: Task,
    state: FitState,
    segment: Segment,
    forces: Forces,
    motion: Array | None = None,
    *,
    looked_at: bool = True,
    tally: Tally | None = None,
) -> tuple[tuple[WhitenedBalance, ...], list[Rows]]:
    """The balance of a segment, some samples at a time, and all of its rows, with derivatives by
    every column of the border.

    Args:
        task: What is fitted.
        state: Where to linearise, with a body.
        segment: One of its segments.
        forces: Of it.
        motion: Covariance of its coefficients where it is held, lower banded form, shape (42, N);
            None: it follows the forces.
        looked_at: Whether its forces count.
        tally: Is added to.
    """
    assert state.parameters is not None
    column_of = TEN + np.arange(len(task.calibration_parameters), dtype=np.intp)
    shared = task.experiment, segment
    tally = Tally() if tally is None else tally
    balances = tuple(
        whitened_balance(
            *shared,
            part,
            state.calibration,
            column_of,
            state.parameters,
            state.factors,
            tally,
            motion,
        )
        for part in forces.parts()
    )
    carried = None
    if motion is None:
        carried = carried_tensions(
            *shared, forces, state.calibration, column_of, state.parameters, state.factors
        )
    own = motion_residuals(*shared, state.calibration, column_of, state.factors, tally, carried)
    rows = list(own)
    if looked_at:
        rows += [part for each in balances for part in each.rows]
    return balances, rows


def segment_equations(
    task: Task,
    state: FitState,
    segment: Segment,
    forces: Forces,
    motion: Array | None,
    *,
    run: int,
    looked_at: bool = True,
) -> SegmentEquations:
    """Equations of one segment over all columns of the border.

    Args:
        task: What is fitted.
        state: Where to linearise, with a body.
        segment: One of its segments.
        forces: Of it.
        motion: Covariance of its coefficients where it is held, lower banded form, shape (42, N);
            None: it follows the forces.
        run: Number of its run.
        looked_at: Whether its forces count.

    Raises:
        numpy.linalg.LinAlgError: The motion is not determined.
    """
    assert state.parameters is not None
    tally = Tally()
    balances, rows = whitened_rows(
        task, state, segment, forces, motion, looked_at=looked_at, tally=tally
    )
    every = segment.smooth(segment.equations(border_of(task), rows))
    normal, gradient = every.reduced()
    at = absolute(state)
    covariance = every.inverse if motion is None else motion
    noise = np.zeros((TEN, TEN))
    if looked_at and not segment.static:
        noise = (
            left_noise(task, state, segment, balances, every)
            if motion is None
            else _regressor_noise(segment, balances, covariance, len(at), state.calibration.gravity)
        )
    freedom = float(np.sum(~forces.touched)) * looked_at
    equations = BorderEquations(normal, gradient + normal @ at, noise, freedom)
    number = _number(segment, task.settings)
    square, right, by_source = by_stretches(segment, rows, every, number)
    blocks = Blocks(square, right + square @ at, np.full(len(square), run, dtype=np.intp))
    return SegmentEquations(
        segment,
        forces,
        tuple(each.at for each in balances),
        np.concatenate([each.root**2 for each in balances]),
        equations,
        blocks,
        by_source,
        covariance,
        every.followed,
        tally,
        every.spent(),
    )


def absolute(state: FitState) -> Array:
    """The ten as they are and nothing for the calibration parameters, which are counted from where
    they are, shape (k,).
    """
    assert state.parameters is not None
    return np.concatenate([state.parameters, np.zeros_like(state.calibration.values)])


def _regressor_noise(
    segment: Segment,
    balances: Sequence[WhitenedBalance],
    covariance: Array,
    border: int,
    gravity: Array,
) -> Array:
    """Mean product of the noise in the regressor with itself, summed over the samples: what a
    motion of nothing but noise would tell, shape (10, 10).

    A direction of the ten is identifiable where its information exceeds it. (Where nothing turns it
    has a third of that, for what the motion takes of it; in a single move from rest to rest, which
    tells the moments to a quarter, twice as much.)
    """
    count = sum(len(each.at.time) for each in balances)
    few = slice(None, None, -(-count // _LOOKED_AT))
    time = np.concatenate([each.at.time for each in balances])[few]
    whitener = np.concatenate([each.at.whitener for each in balances])[few]
    motion = {
        key: np.concatenate([each.at.motion[key] for each in balances])[few]
        for key in ("specific_force", "omega", "alpha")
    }
    followed = np.zeros((covariance.shape[1], border))
    nothing = np.zeros((border, border))
    sigma = fitted_motion(segment, covariance, followed, nothing, time).sigma
    level = {name: float(np.sqrt(np.mean(each**2))) for name, each in sigma.items()}
    by_tilt = np.linalg.norm(gravity) * level["rotation"]
    noisy = {
        "omega": level["angular_velocity"],
        "alpha": level["angular_acceleration"],
        "specific_force": float(np.hypot(level["acceleration"], by_tilt)),
    }
    rng = np.random.default_rng(0)
    moved = {key: rng.standard_normal(each.shape) * noisy[key] for key, each in motion.items()}
    there, back = (
        platform_regressor(*(motion[key] + sign * each for key, each in moved.items()))
        for sign in (1, -1)
    )
    white = whitener @ (there - back) / 2
    return np.asarray(np.einsum("nki,nkj->ij", white, white) * count / len(white))


def left_noise(
    task: Task,
    state: FitState,
    segment: Segment,
    balances: Sequence[WhitenedBalance],
    equations: NormalEquations,
) -> Array:
    """What a motion of nothing but noise would tell where the motion follows the forces, as far as
    motion and processes leave it, shape (10, 10): what they take of the readings tells nothing of
    the body, whether it is signal or noise.
    """
    noise = equations.drawn(np.random.default_rng(0)).reshape(-1, segment.block)
    moved = replace(segment, coefficients=segment.coefficients + noise)
    rows = []
    for each in balances:
        there, here = (
            regressor_at(task.experiment, one, each.at.time, state.calibration)
            for one in (moved, segment)
        )
        root = each.root[:, None, None]
        for row, own in zip(
            each.rows, each.by_origin(root * (each.at.whitener @ (there - here))), strict=True
        ):
            rows.append(replace(row, by_errors=own, columns=np.arange(TEN)))
    by_noise = segment.equations(TEN, rows)
    left = by_noise.corner - by_noise.side.T @ equations.solve(by_noise.side)
    return task.settings.beyond_noise * left


def _number(segment: Segment, settings: FitSettings) -> NDArray[np.intp]:
    """Which stretch of a segment each instant belongs to, an instant being what depends on the same
    coefficients.
    """
    instants = (
        len(segment.coefficients)
        if segment.static
        else len(segment.coefficients) - segment.width // segment.block + 1
    )
    length = float(segment.knots[-1] - segment.knots[0])
    spacing = length / max(instants, 1)
    if segment.static:
        count = min(instants, settings.most_blocks)
    else:
        block = max(settings.block, settings.block_spacings * spacing)
        count = int(np.clip(length / block, 1, settings.most_blocks))
    return np.arange(instants) * count // instants


def by_stretches(
    segment: Segment, rows: Sequence[Rows], equations: NormalEquations, number: NDArray[np.intp]
) -> tuple[Array, Array, dict[Source, Array]]:
    """What stretches of a segment say about the border once the motion has followed, matrices of
    shape (s, k, k) and right-hand sides of shape (s, k), and the matrices' sum by the quantities
    that are read.

    Args:
        segment: With its motion.
        rows: Its readings.
        equations: Of the motion, which may be known from more than these.
        number: Of the stretch that each instant belongs to.
    """
    count, border = int(number[-1]) + 1, equations.side.shape[1]
    normal, right = np.zeros((count, border, border)), np.zeros((count, border))
    by_source: dict[Source, Array] = {}
    for part in rows:
        if part.label is None:
            continue
        of_source = by_source.setdefault(part.label, np.zeros((border, border)))
        columns = np.arange(border) if part.columns is None else part.columns
        order = np.argsort(part.first, kind="stable")
        edges = np.searchsorted(part.first[order], np.arange(len(number) + 1))
        for i in np.flatnonzero(np.diff(edges)):
            own = order[edges[i] : edges[i + 1]]
            motion = part.by_motion[own].reshape(-1, segment.width)
            E = -motion @ equations.followed[i * segment.block : i * segment.block + segment.width]
            E[:, columns] += part.by_errors[own].reshape(-1, len(columns))
            square = E.T @ E
            normal[number[i]] += square
            of_source += square
            right[number[i]] -= E.T @ part.residual[own].ravel()
    return normal, right, by_source
