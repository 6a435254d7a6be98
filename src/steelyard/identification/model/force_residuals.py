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
from steelyard.estimates.quantiles import chi2_quantile
from steelyard.experiment.model import Experiment
from steelyard.identification.model.balance import (
    UNMODELLED,
    UNMODELLED_PARTS,
    Balance,
    Forces,
    balance_of,
    moving_body,
    unmodelled_processes,
)
from steelyard.identification.model.balance_equations import derivatives_of_balance
from steelyard.identification.model.calibration_parameters import (
    AIR,
    ATTACHED,
    DRAG,
    ROBOT,
    CalibrationValues,
    hose_keys,
)
from steelyard.identification.model.motion_residuals import (
    Border,
    Segment,
    Tally,
    limit,
    rate_along,
    reference_clocks,
    robust_weight,
    time_of,
)
from steelyard.identification.model.processes import Process
from steelyard.identification.model.segment import (
    POSE,
    Basis,
    Rows,
    covariance_of,
    motion_at,
    spread,
)
from steelyard.identification.model.sources import Source
from steelyard.inertia import TEN
from steelyard.instruments.base import TIME_CONSTANT, Instrument
from steelyard.instruments.equations import following, sensitivity
from steelyard.instruments.tension import PRESLIDING, rolled_along
from steelyard.robot.model import DIRECTIONS

BALANCE = "balance"
"""What the rows are of, beside the quantities of the instrument."""
_TRAVEL_STEP = 1e-6
"""Step of a travel that shows how friction follows it [m]."""
_ByParameters = Iterator[tuple[slice, Array]]
"""Where calibration parameters stand, and the derivative of the balance by them, shape (n, 6,
c)."""


@dataclass(frozen=True, eq=False)
class WhitenedBalance:
    """The balance at n samples, as rows of a least-squares problem."""

    at: Balance
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


@dataclass(frozen=True, eq=False)
class _BalancePoint:
    """Where the balance is linearised, and how it follows what it depends on."""

    experiment: Experiment
    segment: Segment
    force_samples: Forces
    calibration: CalibrationValues
    at: Balance
    local: Basis
    """Spline functions at its times."""
    motion: tuple[Array, Array, Array, Array]
    """Pose and its first three time derivatives, shape (n, 7) each."""
    derivatives: Mapping[str, Array]
    """See :func:`.derivatives_of_balance`."""

    @property
    def instrument(self) -> Instrument:
        """Of the forces."""
        return self.experiment.instruments[self.force_samples.name]

    @property
    def errors(self) -> dict[str, Array]:
        """Values of its systematic errors."""
        return self.calibration.of(self.force_samples.name, self.instrument, self.segment.run)


def force_residuals(
    experiment: Experiment,
    segment: Segment,
    force_samples: Forces,
    calibration: CalibrationValues,
    column_of: NDArray[np.intp],
    parameters: Array,
    factors: Mapping[Source, float],
    tally: Tally,
    held: Array | None = None,
) -> Iterator[Rows]:
    """Whitened balance of forces and motion, some samples at a time; arguments as of
    :func:`whitened_balance`.
    """
    for part in force_samples.parts():
        yield from whitened_balance(
            experiment, segment, part, calibration, column_of, parameters, factors, tally, held
        ).rows


def whitened_balance(
    experiment: Experiment,
    segment: Segment,
    force_samples: Forces,
    calibration: CalibrationValues,
    column_of: NDArray[np.intp],
    parameters: Array,
    factors: Mapping[Source, float],
    tally: Tally,
    held: Array | None = None,
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
        tally: Is added to.
        held: Covariance of the motion's coefficients where it is held while forces are looked at,
            lower banded form, shape (42, N); None: it follows them.
    """
    at = balance_of(experiment, segment, force_samples, calibration, parameters, factors)
    local = segment.basis(at.time)
    inputs = moving_body(segment, local, calibration, parameters)
    cables = {} if at.structure is None else {"tension": at.carried, **calibration.geometry}
    point = _BalancePoint(
        experiment,
        segment,
        force_samples,
        calibration,
        at,
        local,
        motion_at(local, segment.coefficients),
        derivatives_of_balance(experiment.robot, len(experiment.surroundings.attached))(
            **inputs, **cables
        ),
    )
    by = _by_motion(point)
    border = Border(column_of, len(at.time), DIRECTIONS)
    border.extend(np.arange(TEN), _by_body(point, parameters))
    for place, derivative in chain(_by_terms(point), _by_robot(point), _by_moving(point, by)):
        border.put(place, derivative)
    by_errors, columns = border.collected()
    by_coefficients = at.whitener @ spread(
        local, _by_state(point, by[0]), *by[1:], block=segment.block
    )
    size = at.size
    if held is not None:
        moved = covariance_of(held, by_coefficients, local.first, segment.block)
        whole = np.linalg.solve(np.eye(DIRECTIONS) + moved, at.residual[:, :, None])[:, :, 0]
        size = np.sqrt(np.sum(at.residual * whole, axis=1))
    weight = segment.holds(at.time) * robust_weight(size, DIRECTIONS) * ~force_samples.touched
    tally_forces(tally, segment, force_samples, at, weight, size)
    root = np.sqrt(weight)
    rows = Rows(
        local.first,
        root[:, None] * at.residual,
        root[:, None, None] * by_coefficients,
        root[:, None, None] * (at.whitener @ by_errors),
        columns,
        segment.label(force_samples.name, BALANCE),
    )
    if force_samples.unmodelled is None:
        return WhitenedBalance(at, root, (rows,))
    return WhitenedBalance(at, root, tuple(_by_origin(rows, at, segment)))


def _by_body(point: _BalancePoint, parameters: Array) -> Array:
    """Derivative of the balance by the ten parameters, shape (n, 6, 10).

    Where no cable has a sensor, it is told in multiples of the mass, and so is what is left of it: a
    body that shrinks would shrink its residual, and the likelihood would rise for nothing.
    """
    found = point.derivatives["by_parameters"]
    if not point.force_samples.guessed.all():
        return found
    found = found.copy()
    found[:, :, 0] -= point.at.left_over / parameters[0]
    return found


def _by_motion(point: _BalancePoint) -> tuple[Array, Array, Array]:
    """Derivatives of the balance by pose, rate and acceleration, shape (n, 6, 7) each.

    How the rate and the weight of a cable change with an error of the geometry is of no account.
    """
    names = ("by_pose", "by_rate", "by_acceleration")
    by_pose, by_rate, by_acceleration = (point.derivatives[name] for name in names)
    at, pose, rate = point.at, *point.motion[:2]
    moved = following(
        at.measured.quantity,
        point.instrument,
        point.experiment.robot,
        tuple(point.force_samples.readings),
        (pose, rate),
        at.carried,
        point.errors,
        at.motion.get("rolling"),
    )
    if moved is not None and at.structure is not None:
        by_pose = by_pose + at.structure @ moved[0]
        by_rate = by_rate + at.structure @ moved[1]
    return by_pose, by_rate, by_acceleration


def _by_state(point: _BalancePoint, by_pose: Array) -> Array:
    """Derivative of the balance by the pose and by the processes beside it, shape (n, 6, block)."""
    segment = point.segment
    found = np.zeros((*by_pose.shape[:2], segment.block))
    found[:, :, :POSE] = by_pose
    for each in segment.processes:
        part = UNMODELLED_PARTS.get(each.source)
        if part is not None:
            place = segment.process_places[each.source]
            found[:, :, place] = -point.at.measured.unmodelled.wrench[:, :, part] * each.sizes
    for each, place, own in _of_readings(point):
        found[:, :, place] = -point.at.by_reading[:, :, own] * each.sizes
    return found


def _of_readings(point: _BalancePoint) -> Iterator[tuple[Process, slice, slice]]:
    """Processes that are added to the readings, where their coefficients stand, and which readings
    these are.
    """
    for quantity, own in point.force_samples.places.items():
        for each, place in point.segment.processes_of((point.force_samples.name, quantity)):
            yield each, place, own


def _by_terms(point: _BalancePoint) -> _ByParameters:
    """Derivatives of the balance by the systematic errors of the readings."""
    at, instrument, run = point.at, point.instrument, point.segment.run
    name, robot = point.force_samples.name, point.experiment.robot
    parameters = point.calibration.calibration_parameters
    unknown = at.measured.quantity
    _, by_terms, by_rolling = sensitivity(
        unknown,
        instrument,
        robot,
        tuple(point.force_samples.readings),
        {**at.motion, unknown: at.asked},
        point.errors,
    )
    by_terms = at.measured.changes_of_wrench(by_terms)
    column = 0
    for term in instrument.terms(robot.m):
        own = by_terms[:, :, column : column + term.size]
        yield parameters.place(name, term.key, run), own
        column += term.size
    if by_rolling is None or point.segment.static:
        return
    travel = float(np.squeeze(point.errors[PRESLIDING]))
    position, rotation = at.motion["position"], at.motion["rotation"]
    longer = rolled_along(robot, position, rotation, travel + _TRAVEL_STEP)
    shorter = rolled_along(robot, position, rotation, travel - _TRAVEL_STEP)
    by_travel = (longer - shorter) / (2 * _TRAVEL_STEP)
    further = at.measured.as_wrench(np.einsum("nkm,nm->nk", by_rolling, by_travel))
    yield parameters.place(name, PRESLIDING, run), further[:, :, None]


def _by_robot(point: _BalancePoint) -> _ByParameters:
    """Derivatives of the balance by gravity, by the geometry of the cables, by what is carried more
    than the first load and by what else pulls at the platform.
    """
    places = point.calibration.calibration_parameters.places
    keys = ("gravity", "anchor", "attachment") if point.experiment.robot.m else ("gravity",)
    for key in keys:
        yield places[ROBOT, key, None], point.derivatives[f"by_{key}"]
    load = point.calibration.calibration_parameters.place_of_load(point.segment.run)
    if load is not None:
        yield load, point.derivatives["by_parameters"]
    hoses = hose_keys(point.calibration.calibration_parameters)
    for name, parts in (("by_attached", ATTACHED), ("by_air", AIR), ("by_hoses", hoses)):
        column = 0
        for key, size in parts if point.experiment.robot.m or parts is hoses else ():
            derivative = point.derivatives[name][:, :, column : column + size]
            yield places[ROBOT, key, None], derivative
            column += size


def _by_moving(point: _BalancePoint, by: tuple[Array, Array, Array]) -> _ByParameters:
    """Derivatives of the balance by what matters in motion only: delays of the clocks, the time
    constant of a filter, the inertia of the cables.
    """
    segment, name = point.segment, point.force_samples.name
    if segment.static:
        return
    parameters = point.calibration.calibration_parameters
    _, clock, origin = time_of(
        point.experiment,
        segment,
        point.calibration,
        reference_clocks(point.experiment, parameters, segment),
        name,
        point.force_samples.time,
    )
    by_delay = -rate_along(by, point.motion)
    changes = unmodelled_processes(segment, point.local, 1)
    if changes.any():
        by_delay += np.einsum("nij,nj->ni", point.at.measured.unmodelled.wrench, changes)
    for each, _, own in _of_readings(point):
        rate = segment.disturbance(each, point.local, 1)
        by_delay += np.einsum("nij,nj->ni", point.at.by_reading[:, :, own], rate)
    by_delay = by_delay[:, :, None]
    if clock != origin:
        yield clock, by_delay
        yield origin, -by_delay
    if any(term.key == TIME_CONSTANT for term in point.instrument.terms(point.experiment.robot.m)):
        yield parameters.place(name, TIME_CONSTANT, segment.run), by_delay
    yield parameters.places[ROBOT, DRAG, None], point.derivatives["by_drag"][:, :, None]


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
        float(np.median(size[used_at_all])) / np.sqrt(chi2_quantile(0.5, 6))
        if used_at_all.any()
        else 1.0
    )
    near = used_at_all & (size <= limit(6) * max(1.0, usual))
    correction, decided = at.correction, at.noise.decided
    for quantity, own in force_samples.places.items():
        used = ~force_samples.left_out[:, own]
        label = segment.label(force_samples.name, quantity)
        _count(tally, label, correction[:, own] * used, decided[:, own] * used, weight, near)
        tally.far[label] += int(np.sum(~used))
    if force_samples.unmodelled is not None:
        label, rest = segment.label(ROBOT, UNMODELLED), at.noise.readings
        _count(tally, label, correction[:, rest:], decided[:, rest:], weight, near)
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
    tally.far[label] = tally.far.get(label, 0) + int(np.sum(~near))
    whole, numbers = tally.held.get(label, (0.0, 0.0))
    tally.held[label] = (
        whole + float(square @ weight**2),
        numbers + float(np.sum(count[weight > 0])),
    )
