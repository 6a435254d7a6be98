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
from steelyard.dynamics import platform_regressor
from steelyard.identification.model.balance import Balance, Forces, balance_of, parts_of
from steelyard.identification.model.balance.linearised import by_body_and_readings
from steelyard.identification.model.carried_tensions import carried_tensions
from steelyard.identification.model.fitted_motion import fitted_motion
from steelyard.identification.model.force_residuals import (
    WhitenedBalance,
    whitened_balance,
)
from steelyard.identification.model.motion_residuals import AT_ONCE, motion_residuals
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.segment import Label, NormalEquations, Rows
from steelyard.identification.model.sources import Source
from steelyard.identification.solve.fit_state import FitState, Task
from steelyard.identification.solve.normal_equations import Blocks, BorderEquations
from steelyard.identification.solve.settings import FitSettings
from steelyard.identification.tally import Tally
from steelyard.inertia import TEN

_ROWS_AT_ONCE = 2048
"""Rows of a stretch whose product is formed at once: enough that the sums are little beside it."""
_LOOKED_AT = 500
"""Samples that show how much noise the fitted motion has in the regressor."""


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
    structure: Array | None
    """Shape (n, 6, m); None without cables."""

    @classmethod
    def of(cls, at: Balance | BalanceCourse) -> BalanceCourse:
        """Of a balance, or of what is kept of one."""
        return cls(at.time, at.motion, at.wrench, at.carried, at.structure)


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


def border_of(task: Task) -> int:
    """Columns of the border: the ten and every calibration parameter, estimated or not."""
    return TEN + len(task.calibration_parameters)


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
    column_of = _every_column(task)
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
    column_of = _every_column(task)
    linearised = _RowsOfSegment(task, state, segment, forces, motion, looked_at, column_of)
    balances = list[Balance]()
    weight = list[Array]()

    def first_pass() -> Iterator[Rows]:
        yield from linearised.of_motion(of_motion)
        for each in linearised.of_forces(of_forces):
            balances.append(each.at)
            weight.append(each.root**2)
            yield from linearised.counted(each)

    every = segment.smooth(segment.equations(border_of(task), first_pass()))
    normal, gradient = every.reduced()
    at = absolute(state)
    covariance = every.inverse if motion is None else motion
    noise = None
    if motion is None and looked_at and not segment.static:
        noise = _LeftNoise.of(task, state, segment, every, column_of)

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

    number = _number(segment, task.settings)
    square, right, by_source = by_stretches(segment, second_pass(), every, number)
    left, by_noise = np.zeros((TEN, TEN)), None
    if noise is not None:
        by_noise = noise.left
        left = task.settings.beyond_noise * by_noise[:TEN, :TEN]
    elif looked_at and not segment.static:
        left = _regressor_noise(segment, balances, covariance, len(at), state.calibration.gravity)
    freedom = float(np.sum(~forces.touched)) * looked_at
    equations = BorderEquations(normal, gradient + normal @ at, left, freedom, by_noise)
    blocks = Blocks(square, right + square @ at, np.full(len(square), run, dtype=np.intp))
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
    """All rows of a segment, as often as they are asked for: those of a long recording are made anew
    each time, for all of them together take more memory than anything else.
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
                )

        return self._once("forces", rows)

    def counted(self, balance: WhitenedBalance) -> tuple[Rows, ...]:
        """Rows of the balance that count."""
        return balance.rows if self.looked_at else ()

    def _once(self, name: str, make: Callable[[], Iterator[Any]]) -> Iterable[Any]:
        """What is made, kept where it is little."""
        lengths = [len(self.forces.time), *(len(each.time) for each in self.segment.readings)]
        if max(lengths) > AT_ONCE:
            return make()
        if name not in self.kept:
            self.kept[name] = list(make())
        return self.kept[name]


def _every_column(task: Task) -> NDArray[np.intp]:
    """Column of every calibration parameter, estimated or not, shape (u,)."""
    return TEN + np.arange(len(task.calibration_parameters), dtype=np.intp)


def absolute(state: FitState) -> Array:
    """The ten as they are and nothing for the calibration parameters, which are counted from where
    they are, shape (k,).
    """
    assert state.parameters is not None
    return np.concatenate([state.parameters, np.zeros_like(state.calibration.values)])


def _regressor_noise(
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
    column_of = np.where(task.active, _every_column(task), -1)
    found = _LeftNoise.of(task, state, segment, equations, column_of)
    for each in balances:
        found.include(each)
    return found.left


@dataclass(eq=False)
class _LeftNoise:
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
    ) -> _LeftNoise:
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
        own = self.segment.equations(border_of(self.task), rows)
        if self.by_noise is not None:
            own = replace(
                own, side=own.side + self.by_noise.side, corner=own.corner + self.by_noise.corner
            )
        self.by_noise = own

    @property
    def left(self) -> Array:
        """Shape (k, k)."""
        if self.by_noise is None:
            return np.zeros((border_of(self.task), border_of(self.task)))
        found = np.zeros_like(self.by_noise.corner)
        noisy = np.flatnonzero(np.diag(self.by_noise.corner))
        own, side = np.ix_(noisy, noisy), self.by_noise.side[:, noisy]
        found[own] = self.by_noise.corner[own] - side.T @ self.equations.solve(side)
        return (found + found.T) / 2


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
    segment: Segment, rows: Iterable[Rows], equations: NormalEquations, number: NDArray[np.intp]
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
        each = part.residual.shape[1]
        for stretch, instants in _together(number, np.diff(edges) * each):
            samples = order[edges[instants[0]] : edges[instants[-1] + 1]]
            E = np.empty((len(samples) * each, border))
            for i in instants:
                own = order[edges[i] : edges[i + 1]]
                begin = (edges[i] - edges[instants[0]]) * each
                motion = part.by_motion[own].reshape(-1, segment.width)
                start = i * segment.block
                followed = equations.followed[start : start + segment.width]
                np.matmul(-motion, followed, out=E[begin : begin + len(own) * each])
            E[:, columns] += part.by_errors[samples].reshape(-1, len(columns))
            square = E.T @ E
            normal[stretch] += square
            of_source += square
            right[stretch] -= E.T @ part.residual[samples].ravel()
    return normal, right, by_source


def _together(number: NDArray[np.intp], rows: NDArray[np.intp]) -> Iterator[tuple[int, list[int]]]:
    """Stretches, and instants of each that are taken at once: those that have rows, as far as these
    are not too many.

    Args:
        number: Of the stretch that each instant belongs to.
        rows: Of each instant.
    """
    found, held = list[int](), 0
    for i in np.flatnonzero(rows):
        if found and (number[i] != number[found[0]] or held + rows[i] > _ROWS_AT_ONCE):
            yield int(number[found[0]]), found
            found, held = [], 0
        found.append(int(i))
        held += int(rows[i])
    if found:
        yield int(number[found[0]]), found
