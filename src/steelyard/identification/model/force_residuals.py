"""What the forces say along a segment: the balance of wrenches at the times of the force readings,
linearised and whitened.

It is linearised about the readings that fulfil the balance, not about the measured ones
(Gauss-Helmert [Helmert1872]_): the noise of a reading must not meet itself in its own derivative.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.estimates.quantiles import chi2_quantile, chi2_tail
from steelyard.experiment.model import Experiment
from steelyard.identification.model.balance import (
    UNMODELLED,
    Balance,
    Forces,
    parts_of,
)
from steelyard.identification.model.balance.linearised import point_of
from steelyard.identification.model.balance.linearised_in_time import by_moving
from steelyard.identification.model.border import Border
from steelyard.identification.model.calibration_parameters import (
    ROBOT,
    CalibrationValues,
)
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.segment import (
    Rows,
    covariance_of,
)
from steelyard.identification.model.sources import Source
from steelyard.identification.tally import (
    Tally,
    limit,
    median,
    robust_weight,
)
from steelyard.inertia import TEN
from steelyard.robot.model import DIRECTIONS

BALANCE = "balance"
"""What the rows are of, beside the quantities of the instrument."""


@dataclass(frozen=True, eq=False)
class WhitenedBalance:
    """The balance at n samples, as rows of a least-squares problem."""

    at: Balance
    forces: Forces
    """Of these samples."""
    root: Array
    """Square root of the weight of each sample, shape (n,)."""
    rows: tuple[Rows, ...]
    """Of the readings, and of the unmodelled wrench where there is one."""

    def by_origin(self, whitened: Array) -> tuple[Array, ...]:
        """Whitened equations as the rows have them, shape (n, k, c) each.

        Args:
            whitened: Shape (n, 6, c).
        """
        if len(self.rows) == 1:
            return (whitened,)
        return tuple(own @ whitened for own in _origins(self.at))


def force_residuals(
    experiment: Experiment,
    segment: Segment,
    force_samples: Forces,
    calibration: CalibrationValues,
    column_of: NDArray[np.intp],
    parameters: Array,
    factors: Mapping[Source, float],
    tally: Tally | None,
    held: Array | None = None,
    *,
    wide: bool = False,
) -> Iterator[Rows]:
    """Whitened balance of forces and motion, some samples at a time; arguments as of
    :func:`whitened_balance`.
    """
    for part in parts_of(experiment, segment, force_samples, calibration):
        yield from whitened_balance(
            experiment,
            segment,
            part,
            calibration,
            column_of,
            parameters,
            factors,
            tally,
            held,
            wide=wide,
        ).rows


def whitened_balance(
    experiment: Experiment,
    segment: Segment,
    force_samples: Forces,
    calibration: CalibrationValues,
    column_of: NDArray[np.intp],
    parameters: Array,
    factors: Mapping[Source, float],
    tally: Tally | None,
    held: Array | None = None,
    *,
    narrow: bool = False,
    wide: bool = False,
) -> WhitenedBalance:
    """Balance of forces and motion with its derivatives, whitened; its first ten columns of the
    border are those of the body.

    Args:
        experiment: With robot and instruments.
        segment: With its motion.
        force_samples: Force readings within it.
        calibration: Present values of the systematic errors.
        column_of: Column of each systematic error in the border; -1: not there; shape (u,).
        parameters: The ten of :data:`steelyard.inertia.LINEAR_PARAMETERS`, shape (10,).
        factors: Quantity -> by how much its noise exceeds what the readings say.
        tally: Is added to; None: nothing is counted.
        held: Covariance of the motion's coefficients where it is held while forces are looked at,
            lower banded form, shape (42, N); None: it follows them.
        narrow: See :func:`.motion_residuals`.
        wide: Whether rows behind a filter may have more functions than the six that are not zero at
            a time.
    """
    asked = column_of if narrow else None
    point = point_of(experiment, segment, force_samples, calibration, parameters, factors, asked)
    at, by = point.at, point.by_motion()
    border = Border(column_of, len(at.time), DIRECTIONS)
    border.extend(np.arange(TEN), point.by_body(parameters))
    for place, derivative in chain(point.by_terms(), point.by_robot(), by_moving(point, by)):
        border.put(place, derivative)
    by_errors, columns = border.collected()
    first, by_coefficients = point.by_coefficients(by, wide=wide)
    by_coefficients = at.whitener @ by_coefficients
    size = at.size
    if held is not None:
        moved = covariance_of(held, by_coefficients, first, segment.block)
        whole = np.linalg.solve(np.eye(DIRECTIONS) + moved, at.residual[:, :, None])[:, :, 0]
        size = np.sqrt(np.sum(at.residual * whole, axis=1))
    weight = at.told * robust_weight(size, DIRECTIONS) * ~force_samples.touched
    if tally is not None:
        tally_forces(tally, segment, force_samples, at, weight, size)
    root = np.sqrt(weight)
    by_coefficients *= root[:, None, None]
    rows = Rows(
        first,
        root[:, None] * at.residual,
        by_coefficients,
        (root[:, None, None] * at.whitener) @ by_errors,
        columns,
        segment.label(force_samples.name, BALANCE),
    )
    if force_samples.unmodelled is None:
        return WhitenedBalance(at, force_samples, root, (rows,))
    if force_samples.guessed.all():
        # No reading is corrected: all of it is the unmodelled wrench.
        own = replace(rows, label=segment.label(ROBOT, UNMODELLED))
        return WhitenedBalance(at, force_samples, root, (own,))
    return WhitenedBalance(at, force_samples, root, tuple(_by_origin(rows, at, segment)))


def _origins(at: Balance) -> tuple[Array, Array]:
    """Corrections of the readings and parts of the unmodelled wrench by whitened equations, shapes
    (n, r, 6) and (n, 6, 6).
    """
    shares, count = at.noise.shares.transpose(0, 2, 1), at.noise.readings
    return shares[:, :count], shares[:, count:]


def _by_origin(rows: Rows, at: Balance, segment: Segment) -> Iterator[Rows]:
    """The same six equations as corrections of the readings and as parts of the unmodelled wrench,
    so that each tells its own level.
    """
    labels = rows.label, segment.label(ROBOT, UNMODELLED)
    for label, own in zip(labels, _origins(at), strict=True):
        yield replace(
            rows,
            residual=np.einsum("nki,ni->nk", own, rows.residual),
            by_motion=own @ rows.by_motion,
            by_errors=own @ rows.by_errors,
            label=label,
        )


def sample_weight(residual: Array) -> Array:
    """Weights that let no sample count for more than noise may do, and nothing where something else
    than the body pulls, shape (n,).
    """
    size = np.sqrt(np.sum(residual**2, axis=1))
    return robust_weight(size, 6)


def tally_forces(
    tally: Tally,
    segment: Segment,
    force_samples: Forces,
    at: Balance,
    weight: Array,
    size: Array,
) -> None:
    """Count the corrections of the readings and of the unmodelled wrench, quantity by quantity."""
    used_at_all = weight > 0
    usual = (
        median(size[used_at_all]) / np.sqrt(chi2_quantile(0.5, DIRECTIONS))
        if used_at_all.any()
        else 1.0
    )
    near = used_at_all & (size <= limit(6) * max(1.0, usual))
    farthest = float(np.max(size, where=used_at_all, initial=0.0)) / max(1.0, usual)
    rarest = float(chi2_tail(farthest**2, 6))
    # What touched the platform has a note of its own.
    free = ~force_samples.touched
    correction, decided = at.correction, at.noise.decided
    for quantity, own in force_samples.places.items():
        used = ~force_samples.left_out[:, own]
        label = segment.label(force_samples.name, quantity)
        _count(tally, label, correction[:, own] * used, decided[:, own] * used, weight, near)
        tally.far[label] += int(np.sum(~near & free)) + int(np.sum(~used & free[:, None]))
        tally.see(label, rarest)
    if force_samples.unmodelled is not None:
        label, rest = segment.label(ROBOT, UNMODELLED), at.noise.readings
        _count(tally, label, correction[:, rest:], decided[:, rest:], weight, near)
        tally.far[label] += int(np.sum(~near & free))
    tally.cost += float(np.sum(size**2 * weight * (2 - weight)))


def _count(
    tally: Tally,
    label: Source,
    correction: Array,
    decided: Array,
    weight: Array,
    near: NDArray[np.bool_],
) -> None:
    """Add corrections of one quantity to a tally, and how many equations they are of."""
    square, count = np.sum(correction**2, axis=1), np.sum(decided, axis=1)
    tally.square[label] = tally.square.get(label, 0.0) + float(np.sum(square[near]))
    tally.count[label] = tally.count.get(label, 0.0) + float(np.sum(count[near]))
    tally.far.setdefault(label, 0)
    whole, numbers = tally.held.get(label, (0.0, 0.0))
    tally.held[label] = (
        whole + float(square @ weight**2),
        numbers + float(np.sum(count[weight > 0])),
    )
