"""What one segment says about the border: its readings, linearised and whitened, with the motion
eliminated.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.identification.model.balance import Balance, Forces, parts_of
from steelyard.identification.model.force_residuals import (
    WhitenedBalance,
    whitened_balance,
)
from steelyard.identification.model.motion_residuals import motion_residuals
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.segment import Label, Rows
from steelyard.identification.model.sources import Source
from steelyard.identification.model.tensions.carried import carried_tensions
from steelyard.identification.solve.border.noise_in_derivatives import LeftNoise, regressor_noise
from steelyard.identification.solve.border.normal_equations import Blocks, BorderEquations
from steelyard.identification.solve.border.stretches import beginnings, by_stretches, numbers_of
from steelyard.identification.solve.fit_state import FitState, Task
from steelyard.identification.tally import Tally
from steelyard.inertia import TEN

_KEPT = 8192
"""Samples of a segment whose rows are kept from one time to the next: they take 10 KiB of memory
each, and to make them anew takes little longer where there are many."""


class BalanceCourse(NamedTuple):
    """What is kept of a balance of many: forces and motion along a window of a long recording."""

    time: Array
    """Within the segment [s], shape (n,)."""
    motion: Mapping[str, Array]
    """As of :class:`.Balance`."""
    wrench: Array
    """On the platform, of the measured readings [N], [N m], shape (n, 6)."""
    carried: Array
    """Tension, or wrench, of the corrected readings, shape (n, m) or (n, 6)."""
    told: NDArray[np.bool_]
    """Samples of which the motion is known, shape (n,)."""

    @classmethod
    def of(cls, at: Balance | BalanceCourse) -> BalanceCourse:
        """Of a balance, or of what is kept of one."""
        return cls(at.time, at.motion, at.wrench, at.carried, at.told)


@dataclass(frozen=True, eq=False)
class SegmentEquations:
    """One segment with its equations."""

    segment: Segment
    force_samples: Forces
    balances: tuple[Balance | BalanceCourse, ...]
    """Some samples at a time; of windows of a long recording what is kept of them."""
    weight: Array
    """Of every sample, shape (n,)."""
    equations: BorderEquations
    blocks: Blocks
    by_source: Mapping[Source, Array]
    """Quantity -> part of the normal matrix that its readings bring, shape (k, k)."""
    covariance: Array
    """Of the coefficients of the motion, lower banded form, shape (42, N)."""
    followed: Array
    """How these follow the border, with the opposite sign, shape (N, k); of windows of a long
    recording, of which there are many, by what is estimated, shape (N, e)."""
    tally: Tally
    """Of the residuals."""
    spent: Mapping[Label, float]
    """What rows are of -> degrees of freedom that the motion takes of them."""
    border: Array | None = None
    """The ten and all calibration parameters by which the motion is as it is, shape (k,); None:
    those of the fit."""

    def moved_to(self, border: Array) -> SegmentEquations:
        """With the motion as it follows from other values of the border, shape (k,)."""
        if self.border is None:
            return self
        step = self.followed @ (border - self.border)
        coefficients = self.segment.coefficients - step.reshape(-1, self.segment.block)
        segment = replace(self.segment, coefficients=coefficients)
        return replace(self, segment=segment, border=border)


def whitened_rows(
    task: Task,
    state: FitState,
    segment: Segment,
    forces: Forces,
    tally: Tally | None = None,
    *,
    border: Literal["all", "estimated", "held"] = "all",
) -> tuple[tuple[WhitenedBalance, ...], list[Rows]]:
    """The balance of a segment, some samples at a time, and all of its rows, with derivatives by
    every column of the border.

    Args:
        task: What is fitted.
        state: Where to linearise, with a body.
        segment: One of its segments, which is not long.
        forces: Of it.
        tally: Is added to; None: nothing is counted.
        border: Derivatives by all of its columns; by those that are estimated, which are few; or by
            none, where the motion alone follows.
    """
    column_of = task.every_column
    if border != "all":
        column_of = np.where(task.active & (border == "estimated"), column_of, -1)
    linearised = _RowsOfSegment(
        task, state, segment, forces, None, True, column_of, narrow=border != "all"
    )
    balances = tuple(linearised.of_forces(tally))
    rows = [*linearised.of_motion(tally), *chain(*(each.rows for each in balances))]
    return balances, [each.without_border for each in rows] if border == "held" else rows


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
    of_forces, of_motion = Tally(), Tally()
    column_of = task.every_column
    linearised = _RowsOfSegment(
        task, state, segment, forces, motion, looked_at, column_of, wide=motion is None
    )
    balances = list[Balance]()
    weight = list[Array]()

    def first_pass() -> Iterator[Rows]:
        yield from linearised.of_motion(of_motion)
        for each in linearised.of_forces(of_forces):
            balances.append(each.at)
            weight.append(each.root**2)
            yield from linearised.counted(each)

    every = segment.smooth(segment.equations(task.columns, first_pass()))
    normal, gradient = every.reduced()
    at = absolute(state)
    covariance = every.inverse if motion is None else motion
    noise = None
    if motion is None and looked_at and not segment.static:
        noise = LeftNoise.of(task, state, segment, every, column_of)

    def second_pass() -> Iterator[Rows]:
        if noise is None:
            yield from linearised.of_motion(None)
        else:
            off = replace(linearised, segment=noise.moved, kept={})
            for here, there in zip(linearised.of_motion(None), off.of_motion(None), strict=True):
                noise.include_motion(here, there)
                yield here
        for each in linearised.of_forces(None):
            if noise is not None:
                noise.include(each)
            yield from linearised.counted(each)

    number = numbers_of(segment, task.settings)
    square, right, by_source = by_stretches(segment, second_pass(), every, number)
    left, by_noise = np.zeros((TEN, TEN)), None
    if noise is not None:
        by_noise = noise.left
        left = task.settings.beyond_noise * by_noise[:TEN, :TEN]
    elif looked_at and not segment.static:
        left = regressor_noise(segment, balances, covariance, len(at), state.calibration.gravity)
    freedom = float(np.sum(~forces.touched)) * looked_at
    equations = BorderEquations(normal, gradient + normal @ at, left, freedom, by_noise)
    blocks = Blocks(
        square,
        right + square @ at,
        np.full(len(square), run, dtype=np.intp),
        beginnings(segment, number),
    )
    of_forces.include(of_motion)
    return SegmentEquations(
        segment,
        forces,
        tuple(balances),
        np.concatenate(weight),
        equations,
        blocks,
        by_source,
        covariance,
        every.followed,
        of_forces,
        every.spent(),
    )


@dataclass(frozen=True, eq=False)
class _RowsOfSegment:
    """All rows of a segment, as often as they are asked for: those of a long recording are made
    anew each time, for all of them together take more memory than anything else.
    """

    task: Task
    state: FitState
    segment: Segment
    forces: Forces
    motion: Array | None
    """See :func:`segment_equations`."""
    looked_at: bool
    column_of: NDArray[np.intp]
    """Column of each calibration parameter; -1: there is none; shape (u,)."""
    narrow: bool = False
    """See :func:`.motion_residuals`."""
    wide: bool = False
    """See :func:`.whitened_balance`."""
    kept: dict[str, Sequence[Any]] = field(default_factory=dict)
    """What a segment of few samples has been asked for already."""

    def of_motion(self, tally: Tally | None) -> Iterable[Rows]:
        """Of the motion instruments, and what holds the motion.

        Args:
            tally: Is added to, the first time; None: nothing is counted.
        """
        state, task, column_of = self.state, self.task, self.column_of
        carried = None
        if self.motion is None:
            carried = carried_tensions(
                task.experiment,
                self.segment,
                self.forces,
                state.calibration,
                column_of,
                state.parameters,
                state.factors,
                narrow=self.narrow,
            )
        rows = partial(
            motion_residuals,
            task.experiment,
            self.segment,
            state.calibration,
            column_of,
            state.factors,
            tally,
            carried,
            narrow=self.narrow,
        )
        return self._once("motion", rows)

    def of_forces(self, tally: Tally | None) -> Iterable[WhitenedBalance]:
        """The balance, some samples at a time.

        Args:
            tally: Is added to, the first time; None: nothing is counted.
        """
        task, state = self.task, self.state
        assert state.parameters is not None
        column_of, parameters = self.column_of, state.parameters

        def rows() -> Iterator[WhitenedBalance]:
            for part in parts_of(task.experiment, self.segment, self.forces, state.calibration):
                yield whitened_balance(
                    task.experiment,
                    self.segment,
                    part,
                    state.calibration,
                    column_of,
                    parameters,
                    state.factors,
                    tally,
                    self.motion,
                    narrow=self.narrow,
                    wide=self.wide,
                )

        return self._once("forces", rows)

    def counted(self, balance: WhitenedBalance) -> tuple[Rows, ...]:
        """Rows of the balance that count."""
        return balance.rows if self.looked_at else ()

    def _once(self, name: str, make: Callable[[], Iterator[Any]]) -> Iterable[Any]:
        """What is made, kept where it is little."""
        lengths = [len(self.forces.time), *(len(each.time) for each in self.segment.readings)]
        if max(lengths) > _KEPT:
            return make()
        if name not in self.kept:
            self.kept[name] = list(make())
        return self.kept[name]


def absolute(state: FitState) -> Array:
    """The ten as they are and nothing for the calibration parameters, which are counted from where
    they are, shape (k,).
    """
    assert state.parameters is not None
    return np.concatenate([state.parameters, np.zeros_like(state.calibration.values)])
