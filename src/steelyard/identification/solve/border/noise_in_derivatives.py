"""What a motion of nothing but noise would tell of body and calibration: the fitted motion has
noise, and so have the derivatives that are formed of it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.dynamics import platform_regressor
from steelyard.identification.model.balance import Balance, balance_of
from steelyard.identification.model.balance.linearised import by_body_and_readings
from steelyard.identification.model.fitted_motion import fitted_motion
from steelyard.identification.model.force_residuals import WhitenedBalance
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.segment import NormalEquations, Rows
from steelyard.identification.solve.fit_state import FitState, Task

_LOOKED_AT = 500
"""Samples that show how much noise the fitted motion has in the regressor."""


def regressor_noise(
    segment: Segment,
    balances: Sequence[Balance],
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
    count = sum(len(each.time) for each in balances)
    few = slice(None, None, -(-count // _LOOKED_AT))
    time = np.concatenate([each.time for each in balances])[few]
    whitener = np.concatenate([each.whitener for each in balances])[few]
    motion = {
        key: np.concatenate([each.motion[key] for each in balances])[few]
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
    balances: Iterable[WhitenedBalance],
    equations: NormalEquations,
) -> Array:
    """What a motion of nothing but noise would tell where the motion follows the forces, as far as
    motion and processes leave it, shape (k, k): what they take of the readings tells nothing of
    the body, whether it is signal or noise.
    """
    column_of = np.where(task.active, task.every_column, -1)
    found = LeftNoise.of(task, state, segment, equations, column_of)
    for each in balances:
        found.include(each)
    return found.left


@dataclass(eq=False)
class LeftNoise:
    """See :func:`left_noise`, summed up over the balances."""

    task: Task
    state: FitState
    segment: Segment
    equations: NormalEquations
    moved: Segment
    """The segment with a motion that is off by its noise."""
    column_of: NDArray[np.intp]
    """Column of each calibration parameter that is asked for; -1: it is not; shape (u,)."""
    by_noise: NormalEquations | None = None
    """Of derivatives that are off by as much."""

    @classmethod
    def of(
        cls,
        task: Task,
        state: FitState,
        segment: Segment,
        equations: NormalEquations,
        column_of: NDArray[np.intp],
    ) -> LeftNoise:
        """Of no balance yet; arguments as of :func:`left_noise`."""
        noise = equations.drawn(np.random.default_rng(0)).reshape(-1, segment.block)
        moved = replace(segment, coefficients=segment.coefficients + noise)
        return cls(task, state, segment, equations, moved, column_of)

    def include(self, balance: WhitenedBalance) -> None:
        """Add the balance at some samples."""
        task, state = self.task, self.state
        assert state.parameters is not None
        experiment, calibration = task.experiment, state.calibration
        off = balance_of(
            experiment, self.moved, balance.forces, calibration, state.parameters, state.factors
        )
        (there, columns), (here, _) = (
            by_body_and_readings(
                experiment,
                segment,
                balance.forces,
                calibration,
                state.parameters,
                at,
                self.column_of,
            )
            for segment, at in ((self.moved, off), (self.segment, balance.at))
        )
        white = balance.root[:, None, None] * (balance.at.whitener @ (there - here))
        rows = [
            replace(row, by_errors=own, columns=columns, label=None)
            for row, own in zip(balance.rows, balance.by_origin(white), strict=True)
        ]
        self._add(rows)

    def include_motion(self, here: Rows, there: Rows) -> None:
        """Add readings of the motion.

        Args:
            here: As they are linearised.
            there: The same with a motion that is off by its noise.
        """
        if here.by_errors.shape == there.by_errors.shape and here.by_errors.size:
            self._add([replace(here, by_errors=there.by_errors - here.by_errors, label=None)])

    def _add(self, rows: Sequence[Rows]) -> None:
        own = self.segment.equations(self.task.columns, rows)
        if self.by_noise is not None:
            own = replace(
                own, side=own.side + self.by_noise.side, corner=own.corner + self.by_noise.corner
            )
        self.by_noise = own

    @property
    def left(self) -> Array:
        """Shape (k, k)."""
        if self.by_noise is None:
            return np.zeros((self.task.columns, self.task.columns))
        found = np.zeros_like(self.by_noise.corner)
        noisy = np.flatnonzero(np.diag(self.by_noise.corner))
        own, side = np.ix_(noisy, noisy), self.by_noise.side[:, noisy]
        found[own] = self.by_noise.corner[own] - side.T @ self.equations.solve(side)
        return (found + found.T) / 2
