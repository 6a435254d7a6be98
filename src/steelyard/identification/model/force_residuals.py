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
    UNMODELLED_PARTS,
    Balance,
    Forces,
    balance_at,
    balance_times,
    moving_at,
    smoothed_by_filter,
    time_constant,
    unmodelled_processes,
)
from steelyard.identification.model.balance_equations import derivatives_of_balance
from steelyard.identification.model.calibration_parameters import (
    AIR,
    ATTACHED,
    DRAG,
    ROBOT,
    SWIVEL,
    CalibrationValues,
    hose_keys,
)
from steelyard.identification.model.motion_residuals import (
    Border,
    Carried,
    rate_along,
    reference_clocks,
    time_of,
)
from steelyard.identification.model.motion_segment import CarriedTensions, Segment
from steelyard.identification.model.processes import Process
from steelyard.identification.model.segment import (
    POSE,
    Basis,
    Rows,
    covariance_of,
    motion_at,
    spread,
)
from steelyard.identification.model.slopes import AROUND, slopes
from steelyard.identification.model.sources import Source
from steelyard.identification.tally import (
    Tally,
    limit,
    median,
    robust_weight,
)
from steelyard.inertia import TEN
from steelyard.instruments.base import TIME_CONSTANT, Instrument
from steelyard.instruments.equations import following, sensitivity
from steelyard.instruments.tension import GAINS, PRESLIDING, rolled_along
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
    tally: Tally | None,
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
    tally: Tally | None,
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
        tally: Is added to; None: nothing is counted.
        held: Covariance of the motion's coefficients where it is held while forces are looked at,
            lower banded form, shape (42, N); None: it follows them.
    """
    point = _point_of(experiment, segment, force_samples, calibration, parameters, factors)
    at, local = point.at, point.local
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
    if tally is not None:
        tally_forces(tally, segment, force_samples, at, weight, size)
    root = np.sqrt(weight)
    by_coefficients *= root[:, None, None]
    rows = Rows(
        local.first,
        root[:, None] * at.residual,
        by_coefficients,
        (root[:, None, None] * at.whitener) @ by_errors,
        columns,
        segment.label(force_samples.name, BALANCE),
    )
    if force_samples.unmodelled is None:
        return WhitenedBalance(at, root, (rows,))
    if force_samples.guessed.all():
        # No reading is corrected: all of it is the unmodelled wrench.
        own = replace(rows, label=segment.label(ROBOT, UNMODELLED))
        return WhitenedBalance(at, root, (own,))
    return WhitenedBalance(at, root, tuple(_by_origin(rows, at, segment)))


def _point_of(
    experiment: Experiment,
    segment: Segment,
    force_samples: Forces,
    calibration: CalibrationValues,
    parameters: Array,
    factors: Mapping[Source, float],
) -> _BalancePoint:
    """The balance linearised about where everything stands."""
    moving = moving_at(experiment, segment, force_samples, calibration, parameters)
    at = balance_at(moving, experiment, segment, force_samples, calibration, factors)
    cables = {} if at.structure is None else {"tension": at.carried, **calibration.geometry}
    return _BalancePoint(
        experiment,
        segment,
        force_samples,
        calibration,
        at,
        moving.local,
        motion_at(moving.local, segment.coefficients),
        derivatives_of_balance(experiment.robot, *calibration.pulling)(**moving.inputs, **cables),
    )


def carried_tensions(
    experiment: Experiment,
    segment: Segment,
    force_samples: Forces | None,
    calibration: CalibrationValues,
    column_of: NDArray[np.intp],
    parameters: Array | None,
    factors: Mapping[Source, float],
) -> Carried | None:
    """Tensions by which cables stretch: those of the readings, corrected so that they carry the moving
    body, and how they follow all that is fitted; None: no reading follows them.

    Readings r give tensions t and leave the wrench w of the balance over; the least correction of the
    readings takes K w from the tensions, so that t - K w changes with t and with w. What is left of
    the noise of r in t - K w is independent of w, which tells the body.

    Args:
        experiment: With robot and instruments.
        segment: With its motion.
        force_samples: Force readings within it; None: not looked at.
        calibration: Present values of the systematic errors.
        column_of: Column of each systematic error in the border; -1: not there; shape (u,).
        parameters: Of the body, whose ten columns are the first of the border, shape (10,); None:
            forces are not looked at.
        factors: Quantity -> by how much its noise exceeds what the readings say.
    """
    if not any(each.follows for each in segment.readings):
        return None
    if force_samples is None or parameters is None:
        return None
    forces, body = force_samples, parameters

    def at_times(times: Array) -> CarriedTensions:
        whole = balance_times(experiment, segment, forces, calibration)
        around = 0.0 if segment.static else AROUND
        first, last = np.searchsorted(whole, [times.min() - around, times.max() + around])
        part = forces.part(slice(max(0, int(first) - 1), int(last) + 2))
        point = _point_of(experiment, segment, part, calibration, body, factors)
        return _interpolated(_carried_of(point, column_of, body), point.at.time, times)

    return at_times


def _carried_of(
    point: _BalancePoint, column_of: NDArray[np.intp], parameters: Array
) -> CarriedTensions:
    """Tensions at the times of the force readings."""
    at, forces = point.at, point.force_samples
    n, m = at.measured.values.shape
    touched, unread = forces.touched, forces.guessed
    # Where something touches the platform, the readings know and the balance does not.
    sigmas = np.where(touched[:, None], forces.sigma, at.sigmas)
    by_reading = np.broadcast_to(at.measured.by_reading, (n, *at.measured.by_reading.shape[1:]))
    shares = at.noise.shares[:, :, : at.noise.readings].transpose(0, 2, 1)
    corrections = sigmas[:, :, None] * (shares @ at.whitener)
    if unread.any():
        corrections[:, unread] = at.noise.pulled
    K = by_reading @ corrections
    K[touched] = 0.0

    def following_balance(change: Array) -> Array:
        return -K @ change

    by = _by_motion(point)
    by_state = following_balance(_by_state(point, by[0]))
    by_rate, by_acceleration = (following_balance(each) for each in by[1:])
    moved = _followed_by_readings(point)
    if moved is not None:
        by_state[:, :, :POSE] += moved[0]
        by_rate = by_rate + moved[1]
    for each, place, own in _of_readings(point):
        by_state[:, :, place] -= by_reading[:, :, own] * each.sizes
    border, gains = Border(column_of, n, m), Border(column_of, n, m)
    border.extend(np.arange(TEN), following_balance(_by_body(point, parameters)))
    for place, own_gain in _by_gains(point):
        gains.put(place, own_gain)
    for place, change in _terms_of_readings(point, at.asked):
        by_wrench = at.measured.changes_of_wrench(change)
        border.put(place, change + following_balance(by_wrench))
    for place, derivative in _by_robot(point):
        border.put(place, following_balance(derivative))
    if not point.segment.static:
        drag = point.calibration.calibration_parameters.places[ROBOT, DRAG, None]
        border.put(drag, following_balance(point.derivatives["by_drag"][:, :, None]))
    by_border, columns = border.collected()
    noise = np.zeros((n, m, at.noise.parts.shape[2]))
    noise[:, :, : at.noise.readings] = by_reading * np.where(unread, 0.0, sigmas)[:, None, :]
    noise += following_balance(at.noise.parts)
    values = np.asarray(at.measured.values - np.einsum("nkj,nj->nk", K, at.left_over))
    return CarriedTensions(
        values,
        by_state,
        by_rate,
        by_acceleration,
        by_border,
        columns,
        noise,
        np.eye(m) + following_balance(at.measured.changes_of_wrench(np.eye(m)[None])),
        *gains.collected(),
        *_changes(point, values),
    )


def _changes(point: _BalancePoint, tension: Array) -> tuple[Array, Array, Array]:
    """How fast tensions change [N/s], how fast that does [N/s^2], and how fast they would change if
    what is fed left the stretch as it is [N/s], shape (n, m) each; none at rest.
    """
    if point.segment.static:
        still = np.zeros_like(tension)
        return still, still, still
    at, geometry = point.at, point.calibration.geometry
    anchors, attachments = (geometry[f"{key}s"].reshape(-1, 3) for key in ("anchor", "attachment"))
    turned = np.einsum("nij,mj->nmi", at.motion["rotation"], attachments)
    length = np.linalg.norm(anchors - at.motion["position"][:, None] - turned, axis=2)
    rate = slopes(at.time, tension)
    return rate, slopes(at.time, rate), tension * slopes(at.time, length) / length


def _interpolated(found: CarriedTensions, own: Array, times: Array) -> CarriedTensions:
    """At other times, linearly; before the first and after the last they are as at these, and do not
    follow the motion: what it does there does not change them.

    Readings that are more than the tensions have their noise in common: its variance counts as often
    as that.
    """
    left = np.clip(np.searchsorted(own, times, side="right") - 1, 0, max(0, len(own) - 2))
    right = np.minimum(left + 1, len(own) - 1)
    step = np.where(right > left, own[right] - own[left], 1.0)
    share = (times - own[left]) / step
    inside = (share >= 0.0) & (share <= 1.0) | (len(own) == 1)
    share = np.clip(share, 0.0, 1.0)

    def between(values: Array) -> Array:
        weight = share.reshape(-1, *([1] * (values.ndim - 1)))
        return np.asarray(values[left] * (1 - weight) + values[right] * weight)

    def by_motion(values: Array) -> Array:
        return between(values) * inside.reshape(-1, *([1] * (values.ndim - 1)))

    return CarriedTensions(
        between(found.values),
        by_motion(found.by_state),
        by_motion(found.by_rate),
        by_motion(found.by_acceleration),
        between(found.by_border),
        found.columns,
        between(found.noise) * np.sqrt(max(1.0, len(times) / len(own))),
        between(found.kept),
        between(found.by_gain),
        found.gains,
        by_motion(found.rate),
        by_motion(found.bend),
        by_motion(found.feed),
    )


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
    moved, structure = _followed_by_readings(point), point.at.structure
    if moved is not None and structure is not None:
        by_pose = by_pose + structure @ moved[0]
        by_rate = by_rate + structure @ moved[1]
    return by_pose, by_rate, by_acceleration


def _followed_by_readings(point: _BalancePoint) -> tuple[Array, Array] | None:
    """How tensions or wrench follow pose and rate for the same readings, shape (n, k, 7) each; None:
    they do not.
    """
    at, pose, rate = point.at, *point.motion[:2]
    return following(
        at.measured.quantity,
        point.instrument,
        point.experiment.robot,
        tuple(point.force_samples.readings),
        (pose, rate),
        at.carried,
        point.errors,
        at.motion.get("rolling"),
    )


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
    at = point.at
    changes = _terms_of_readings(point, at.asked)
    if at.structure is None or at.structure.shape[2] >= DIRECTIONS:
        for place, change in changes:
            yield place, at.measured.changes_of_wrench(change)
        return
    # What no cable carries is told in units of the readings too: it shrinks with the body where gains
    # grow, which else the likelihood would rise for.
    unit = np.diagonal(at.measured.by_reading, axis1=1, axis2=2)
    further = _terms_of_readings(point, at.asked + unit)
    for (place, change), (_, more) in zip(changes, further, strict=True):
        by_scale = np.mean(more - change, axis=1)
        shrinks = np.einsum("ni,nc->nic", at.uncarried, by_scale)
        yield place, at.measured.changes_of_wrench(change) - shrinks


def _terms_of_readings(point: _BalancePoint, values: Array) -> _ByParameters:
    """Derivatives of tensions or wrench by the systematic errors of the readings, shape (n, k, c).

    Args:
        point: Where the balance is linearised.
        values: Tensions or wrench, shape (n, k).
    """
    at, instrument, run = point.at, point.instrument, point.segment.run
    if not instrument.terms(point.experiment.robot.m):
        # Cables that nobody reads have no errors.
        return
    name, robot = point.force_samples.name, point.experiment.robot
    parameters = point.calibration.calibration_parameters
    unknown = at.measured.quantity
    _, by_terms, by_rolling = sensitivity(
        unknown,
        instrument,
        robot,
        tuple(point.force_samples.readings),
        {**at.motion, unknown: values},
        point.errors,
    )
    by_terms = np.broadcast_to(by_terms, (len(at.time), *by_terms.shape[1:]))
    column = 0
    for place in parameters.places_of(name, instrument, run).values():
        size = place.stop - place.start
        yield place, by_terms[:, :, column : column + size]
        column += size
    if by_rolling is None or point.segment.static:
        return
    travel = float(np.squeeze(point.errors[PRESLIDING]))
    position, rotation = at.motion["position"], at.motion["rotation"]
    longer = rolled_along(robot, position, rotation, travel + _TRAVEL_STEP)
    shorter = rolled_along(robot, position, rotation, travel - _TRAVEL_STEP)
    by_travel = (longer - shorter) / (2 * _TRAVEL_STEP)
    further = np.einsum("nkm,nm->nk", by_rolling, by_travel)
    yield parameters.place(name, PRESLIDING, run), further[:, :, None]


def _by_gains(point: _BalancePoint) -> _ByParameters:
    """Derivative of tensions by gains, of a newton of each, shape (n, m, g)."""
    places = point.calibration.calibration_parameters.places_of(
        point.force_samples.name, point.instrument, point.segment.run
    )
    gains, asked = [places[key] for key in GAINS if key in places], point.at.asked
    if not gains:
        return
    some = _terms_of_readings(point, asked)
    more = _terms_of_readings(point, asked + 1.0)
    for (place, change), (_, changed) in zip(some, more, strict=True):
        if place in gains:
            yield place, changed - change


def _by_robot(point: _BalancePoint) -> _ByParameters:
    """Derivatives of the balance by gravity, by the geometry of the cables, by what is carried more
    than the first load and by what else pulls at the platform.
    """
    parameters = point.calibration.calibration_parameters
    places = parameters.places
    keys = ("gravity", "anchor", "attachment") if point.experiment.robot.m else ("gravity",)
    for key in keys:
        yield places[ROBOT, key, None], point.derivatives[f"by_{key}"]
    load = parameters.place_of_load(point.segment.run)
    if load is not None:
        yield load, point.derivatives["by_parameters"]
    hoses = hose_keys(parameters)
    rubbing = point.calibration.swivel().size
    swivels = ((SWIVEL, rubbing),) if rubbing else ()
    beside = (
        ("by_attached", ATTACHED),
        ("by_air", AIR),
        ("by_hoses", hoses),
        ("by_swivel", swivels),
    )
    for name, parts in beside:
        column = 0
        for key, size in parts if point.experiment.robot.m or parts is hoses else ():
            derivative = point.derivatives[name][:, :, column : column + size]
            yield parameters.place(ROBOT, key, point.segment.run), derivative
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
    places = parameters.places_of(name, point.instrument, segment.run)
    if TIME_CONSTANT in places:
        yield places[TIME_CONSTANT], by_delay + _by_smoothing(point)
    yield parameters.places[ROBOT, DRAG, None], point.derivatives["by_drag"][:, :, None]


def _by_smoothing(point: _BalancePoint) -> Array:
    """Derivative of the balance by the time constant of a filter as far as it is no delay, shape (n,
    6, 1).
    """
    forces = point.force_samples
    if forces.changes is None:
        return np.zeros((len(forces.time), DIRECTIONS, 1))
    constant = time_constant(point.experiment, point.segment, forces, point.calibration)
    by_constant = smoothed_by_filter(forces.changes, constant, order=1)
    return np.asarray(-point.at.by_reading @ by_constant[:, :, None])


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
