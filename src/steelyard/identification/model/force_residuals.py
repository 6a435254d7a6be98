"""What the forces say along a segment: the balance of wrenches at the times of the force readings,
linearised and whitened.

The readings enter through an implicit equation, *wrench of the cables less what moves the body is
zero*; the internal tension is free. It is solved for the readings that fulfil it with the least
correction in their 1-sigma, and linearised about these, not about the measured ones (Gauss-Helmert
[Helmert1872]_): the noise of a reading must not meet itself in its own derivative.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from steelyard.arrays import Array
from steelyard.batch import Batched, Symbol
from steelyard.dynamics import newton_euler, platform_regressor
from steelyard.experiment.model import Experiment
from steelyard.identification.model.balance_noise import BalanceNoise, UnmodelledWrench
from steelyard.identification.model.calibration_parameters import (
    DRAG,
    ROBOT,
    CalibrationValues,
)
from steelyard.identification.model.motion_residuals import (
    AT_ONCE,
    Border,
    Segment,
    Tally,
    limit,
    reference_clocks,
    robust_weight,
    time_of,
)
from steelyard.identification.model.segment import (
    POSE,
    Basis,
    Rows,
    covariance_of,
    motion_at,
    spread,
    values_at,
)
from steelyard.identification.model.sources import Source
from steelyard.inertia import TEN
from steelyard.instruments.base import TIME_CONSTANT
from steelyard.instruments.equations import following, sensitivity, solve_for
from steelyard.instruments.tension import PRESLIDING, rolled_along
from steelyard.motion.state import State, state_of_pose
from steelyard.robot.cable_inertia import cable_inertia_expression
from steelyard.robot.kinematics import cable_wrench, cables_at
from steelyard.robot.model import Robot

BALANCE = "balance"
"""What the rows are of, beside the quantities of the instrument."""
UNMODELLED = "unmodelled wrench"
"""Quantity of the platform: what acts on it and nothing explains."""
UNMODELLED_PARTS: Mapping[Source, slice] = {
    (ROBOT, "unmodelled force"): slice(0, 3),
    (ROBOT, "unmodelled torque"): slice(3, 6),
}
"""Processes that are parts of it -> where they stand in a wrench."""
_TRAVEL_STEP = 1e-6
"""Step of a travel that shows how friction follows it [m]."""
_LEFT_OUT = 1e2
"""1-sigma of a reading that is left out, in units of the largest reading: the balance goes on
without it."""


@dataclass(frozen=True, eq=False)
class Forces:
    """Readings of the force instrument within a segment."""

    name: str
    """Of the instrument."""
    time: Array
    """By its clock, moved to the common event [s]; of poses at rest their number; shape (n,)."""
    readings: Mapping[str, Array]
    """Quantity -> readings, r numbers a sample in all."""
    sigma: Array
    """1-sigma of single readings, shape (r,)."""
    left_out: NDArray[np.bool_]
    """Readings that stand alone against all others, shape (n, r)."""
    unmodelled: Array | None = None
    """1-sigma of the white part of the wrench that nothing explains, in units of its level [N],
    [N m], shape (6,); None: the readings explain every wrench within their noise."""

    def parts(self) -> Iterator[Forces]:
        """The same, some samples at a time: rows take much memory."""
        for start in range(0, len(self.time), AT_ONCE):
            own = slice(start, start + AT_ONCE)
            readings = {quantity: values[own] for quantity, values in self.readings.items()}
            yield replace(self, time=self.time[own], readings=readings, left_out=self.left_out[own])

    def sigmas(self, segment: Segment, factors: Mapping[Source, float]) -> Array:
        """1-sigma of every reading, shape (n, r)."""
        factor = np.concatenate(
            [
                np.full(v.shape[1], factors.get(segment.label(self.name, q), 1.0))
                for q, v in self.readings.items()
            ]
        )
        largest = np.concatenate(
            [np.abs(v).max(axis=0, initial=0.0) for v in self.readings.values()]
        )
        # So wide that no reading of it matters, however good the sensor was.
        without = _LEFT_OUT * np.maximum(self.sigma * factor, largest)
        return np.asarray(np.where(self.left_out, without, self.sigma * factor))


@dataclass(frozen=True, eq=False)
class Balance:
    """Forces against motion at n samples, as measured."""

    time: Array
    """Within the segment [s], shape (n,)."""
    motion: Mapping[str, Array]
    """Position, rotation, velocity, angular velocity and acceleration, specific force of the
    platform."""
    carried: Array
    """``tension`` or ``wrench`` of the fitted readings, shape (n, m) or (n, 6)."""
    asked: Array
    """The part of it that the body asks for: what nothing explains tells no gain."""
    wrench: Array
    """On the platform, of the measured readings [N], [N m], shape (n, 6)."""
    structure: Array | None
    """Shape (n, 6, m); None without cables."""
    left_over: Array
    """Wrench that the body does not explain [N], [N m], shape (n, 6)."""
    by_reading: Array
    """How it follows the readings, shape (n, 6, r)."""
    noise: BalanceNoise
    """Of what is left over."""
    disturbance: Array | None = None
    """Unmodelled wrench of the processes of the segment [N], [N m], shape (n, 6)."""
    by_disturbance: Array | None = None
    """How what is left over follows an unmodelled wrench, with the opposite sign, shape (n, 6, 6)."""

    @property
    def whitener(self) -> Array:
        """Matrices that make its noise white with unit variance, shape (n, 6, 6)."""
        return self.noise.whitener

    @cached_property
    def residual(self) -> Array:
        """What is left over, whitened, shape (n, 6)."""
        return np.asarray(np.einsum("nij,nj->ni", self.whitener, self.left_over))

    @cached_property
    def correction(self) -> Array:
        """Of the readings, and then of the unmodelled wrench where there is one, so that they
        balance, in their 1-sigma, shape (n, r) or (n, r + 6).
        """
        return self.noise.correction(self.residual)


@lru_cache(maxsize=16)
def _moved(heavy: Robot) -> Batched:
    """Motion, and the wrench that moves the body and drags the cables."""
    pose, rate, acceleration = (ca.SX.sym(name, 7) for name in ("pose", "rate", "acceleration"))
    gravity, parameters, drag = (
        ca.SX.sym("gravity", 3),
        ca.SX.sym("parameters", TEN),
        ca.SX.sym("drag"),
    )
    state = state_of_pose(pose, rate, acceleration, gravity)
    names = ("position", "rotation", "velocity", "omega", "alpha", "specific_force")
    moving = newton_euler(
        parameters, state.specific_force, state.omega, state.alpha
    ) - drag * _dragged(heavy, state, gravity)
    return Batched(
        "moved",
        {
            "pose": pose,
            "rate": rate,
            "acceleration": acceleration,
            "gravity": gravity,
            "parameters": parameters,
            "drag": drag,
        },
        {"wrench": moving, **{name: ca.densify(ca.SX(getattr(state, name))) for name in names}},
    )


def _dragged(robot: Robot, state: State, gravity: Symbol) -> Symbol:
    """Wrench of the inertia of the cables, as an expression of the state."""
    if not robot.m or not robot.cable.linear_density:
        return ca.SX.zeros(6)
    return cable_inertia_expression(
        robot,
        state.position,
        state.rotation,
        state.specific_force,
        state.omega,
        state.alpha,
        gravity,
    )


class _Geometry(NamedTuple):
    """Where the cables are fixed, as symbols."""

    anchors: Symbol
    attachments: Symbol

    @classmethod
    def of(cls, robot: Robot) -> _Geometry:
        return cls(ca.SX.sym("anchors", 3, robot.m), ca.SX.sym("attachments", 3, robot.m))


def _where(calibration: CalibrationValues) -> dict[str, Array]:
    """Values of the anchors and attachments, three numbers a cable."""
    places = calibration.calibration_parameters.places
    return {
        key + "s": calibration.values[places[ROBOT, key, None]] for key in ("anchor", "attachment")
    }


@lru_cache(maxsize=16)
def taut_structure(robot: Robot) -> Batched:
    """Structure matrix of straight cables."""
    position, rotation, fixed = (
        ca.SX.sym("position", 3),
        ca.SX.sym("rotation", 3, 3),
        _Geometry.of(robot),
    )
    tension = ca.SX.sym("tension", robot.m)
    wrench = cable_wrench(robot, position, rotation, tension, *fixed)
    return _batched(
        "taut",
        {"position": position, "rotation": rotation},
        fixed,
        {"structure": ca.jacobian(wrench, tension)},
    )


def _batched(
    name: str, inputs: dict[str, Symbol], fixed: _Geometry, outputs: dict[str, Symbol]
) -> Batched:
    """A function of anchors and attachments that stand in one row each, cable by cable."""
    flat = {key: ca.SX.sym(key, fixed.anchors.numel()) for key in ("anchors", "attachments")}
    matrices = [ca.reshape(each, 3, -1) for each in flat.values()]
    replaced = ca.substitute(list(outputs.values()), [fixed.anchors, fixed.attachments], matrices)
    return Batched(
        name, {**inputs, **flat}, dict(zip(outputs, map(ca.densify, replaced), strict=True))
    )


@lru_cache(maxsize=16)
def derivatives_of_balance(heavy: Robot) -> Batched:
    """Of the wrench of the cables less what moves the body, by everything; sag is of no account for
    these.
    """
    robot = heavy.with_straight_cables()
    pose, rate, acceleration = (ca.SX.sym(name, 7) for name in ("pose", "rate", "acceleration"))
    gravity, parameters, tension = (
        ca.SX.sym("gravity", 3),
        ca.SX.sym("parameters", TEN),
        ca.SX.sym("tension", robot.m),
    )
    fixed, drag = _Geometry.of(robot), ca.SX.sym("drag")
    state = state_of_pose(pose, rate, acceleration, gravity)
    wrench = -newton_euler(parameters, state.specific_force, state.omega, state.alpha)
    wrench += cable_wrench(robot, state.position, state.rotation, tension, *fixed)
    wrench += drag * _dragged(heavy, state, gravity)
    by: dict[str, Symbol] = {
        "by_drag": drag,
        "by_pose": pose,
        "by_rate": rate,
        "by_acceleration": acceleration,
        "by_gravity": gravity,
        "by_parameters": parameters,
        **(
            {"by_anchor": ca.vec(fixed.anchors), "by_attachment": ca.vec(fixed.attachments)}
            if robot.m
            else {}
        ),
    }
    outputs: dict[str, Symbol] = {
        key: ca.densify(ca.jacobian(wrench, symbol)) for key, symbol in by.items()
    }
    inputs = {
        "pose": pose,
        "rate": rate,
        "acceleration": acceleration,
        "gravity": gravity,
        "parameters": parameters,
        "drag": drag,
    }
    if not robot.m:
        return Batched("derivatives", inputs, outputs)
    return _batched("derivatives", {**inputs, "tension": tension}, fixed, outputs)


def _structure(
    robot: Robot, calibration: CalibrationValues, position: Array, rotation: Array, tension: Array
) -> Array:
    """Structure matrices; how an error of the geometry changes the sag is of no account, shape (n,
    6, m).
    """
    straight = robot.with_straight_cables()
    taut = taut_structure(straight)
    structure = taut(position=position, rotation=rotation, **_where(calibration))["structure"]
    if not robot.cable.linear_density:
        return structure
    as_stated = {"anchors": robot.anchors.ravel(), "attachments": robot.attachments.ravel()}
    sagging = cables_at(robot, position, rotation, tension).structure
    return np.asarray(
        structure + sagging - taut(position=position, rotation=rotation, **as_stated)["structure"]
    )


def balance_of(
    experiment: Experiment,
    segment: Segment,
    force_samples: Forces,
    calibration: CalibrationValues,
    parameters: Array,
    factors: Mapping[Source, float],
) -> Balance:
    """Forces against motion.

    Args:
        experiment: With robot and instruments.
        segment: With its motion.
        force_samples: Force readings within it.
        calibration: Present values of the systematic errors.
        parameters: The ten of :data:`steelyard.inertia.LINEAR_PARAMETERS`, shape (10,).
        factors: Quantity -> by how much its noise exceeds what the readings say.
    """
    robot, instrument = experiment.robot, experiment.instruments[force_samples.name]
    times = force_samples.time
    if not segment.static:
        times, *_ = time_of(
            experiment,
            segment,
            calibration,
            reference_clocks(experiment, calibration.calibration_parameters, segment),
            force_samples.name,
            times,
        )
    local = segment.basis(times)
    pose, rate, acceleration, _ = motion_at(local, segment.coefficients)
    found = _moved(robot)(
        pose=pose,
        rate=rate,
        acceleration=acceleration,
        gravity=calibration.gravity,
        parameters=parameters,
        drag=0.0 if segment.static else calibration.drag,
    )
    moving = found.pop("wrench")
    errors = calibration.of(force_samples.name, instrument, segment.run)
    unknown = instrument.measured_force
    assert unknown is not None  # it is the force instrument of a run
    if instrument.remembers:
        # At rest a roller takes nothing in the mean of all that it might hold.
        found["rolling"] = np.zeros((len(times), robot.m))
        if not segment.static:
            found["rolling"] = rolled_along(
                robot, found["position"], found["rotation"], float(np.squeeze(errors[PRESLIDING]))
            )
    carried = solve_for(unknown, instrument, robot, force_samples.readings, found, errors)
    structure = None
    if unknown == "tension":
        structure = _structure(robot, calibration, found["position"], found["rotation"], carried)
    wrench = carried if structure is None else np.einsum("nkm,nm->nk", structure, carried)
    solved, *_ = sensitivity(
        unknown,
        instrument,
        robot,
        tuple(force_samples.readings),
        {**found, unknown: carried},
        errors,
    )
    by_reading = np.broadcast_to(
        solved if structure is None else structure @ solved,
        (len(times), 6, force_samples.left_out.shape[1]),
    )
    solved = np.broadcast_to(solved, (len(times), *solved.shape[1:]))
    sigmas = force_samples.sigmas(segment, factors)
    disturbance = _disturbance(segment, local)
    shows, level = None, np.zeros(6)
    if force_samples.unmodelled is not None:
        level = factors.get(segment.label(ROBOT, UNMODELLED), 1.0) * force_samples.unmodelled
    if level.any() or disturbance is not None:
        carrying = (
            np.broadcast_to(np.eye(6), (len(times), 6, 6)) if structure is None else structure
        )
        shows = UnmodelledWrench.of(carrying, solved)
    white = None if shows is None or not level.any() else shows.wrench * level
    left_over = wrench - moving
    if shows is not None and disturbance is not None:
        left_over -= np.einsum("nij,nj->ni", shows.wrench, disturbance)
    noise = BalanceNoise.of(by_reading, sigmas, white)
    measured = Balance(
        times,
        found,
        carried,
        carried,
        wrench,
        structure,
        left_over,
        by_reading,
        noise,
        disturbance,
        None if shows is None else shows.wrench,
    )
    correction = measured.correction
    off = correction[:, : sigmas.shape[1]] * sigmas
    fitted = carried - np.einsum("nkr,nr->nk", solved, off)
    asked = fitted
    if shows is not None:
        unmodelled = np.zeros((len(times), 6)) if disturbance is None else disturbance
        if white is not None:
            unmodelled = unmodelled + correction[:, sigmas.shape[1] :] * level
        asked = fitted - np.einsum("nkr,nri,ni->nk", solved, shows.reading, unmodelled)
    return replace(measured, carried=fitted, asked=asked)


def _disturbance(segment: Segment, local: Basis, order: int = 0) -> Array | None:
    """Unmodelled wrench along a segment [N], [N m], or a derivative of it by time, shape (n, 6); None:
    there is none.
    """
    own = [each for each in segment.processes if each.source in UNMODELLED_PARTS]
    if not own:
        return None
    found = np.zeros((len(local.first), 6))
    for each in own:
        own_place = segment.process_places[each.source]
        values = values_at(local, segment.coefficients[:, own_place], order)
        found[:, UNMODELLED_PARTS[each.source]] = each.sizes * values
    return found


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
        return (
            tuple(own @ whitened for own in _origins(self.at))
            if len(self.rows) > 1
            else (whitened,)
        )


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
    calibration_parameters, robot, name = (
        calibration.calibration_parameters,
        experiment.robot,
        force_samples.name,
    )
    instrument = experiment.instruments[name]
    at = balance_of(experiment, segment, force_samples, calibration, parameters, factors)
    local = segment.basis(at.time)
    pose, rate, acceleration, jerk = motion_at(local, segment.coefficients)
    cables = {} if at.structure is None else {"tension": at.carried, **_where(calibration)}
    found = derivatives_of_balance(robot)(
        pose=pose,
        rate=rate,
        acceleration=acceleration,
        gravity=calibration.gravity,
        parameters=parameters,
        drag=0.0 if segment.static else calibration.drag,
        **cables,
    )
    unknown = "wrench" if at.structure is None else "tension"
    state, errors = (
        {**at.motion, unknown: at.asked},
        calibration.of(name, instrument, segment.run),
    )
    _, by_terms, by_rolling = sensitivity(
        unknown, instrument, robot, tuple(force_samples.readings), state, errors
    )
    by_terms = np.broadcast_to(
        by_terms if at.structure is None else at.structure @ by_terms,
        (len(at.time), 6, by_terms.shape[2]),
    )
    if by_rolling is not None and not segment.static:
        travel = float(np.squeeze(errors[PRESLIDING]))
        longer, shorter = (
            rolled_along(
                robot, at.motion["position"], at.motion["rotation"], travel + sign * _TRAVEL_STEP
            )
            for sign in (1, -1)
        )
        by_travel = (longer - shorter) / (2 * _TRAVEL_STEP)
        further = np.einsum("nkm,nm->nk", by_rolling, by_travel)
        extra = further if at.structure is None else np.einsum("nik,nk->ni", at.structure, further)
    by = (found["by_pose"], found["by_rate"], found["by_acceleration"])
    # How the rate and the weight of a cable change with an error of the geometry is of no account.
    moved = following(
        unknown,
        instrument,
        robot,
        tuple(force_samples.readings),
        (pose, rate),
        at.carried,
        errors,
        at.motion.get("rolling"),
    )
    if moved is not None and at.structure is not None:
        by = (by[0] + at.structure @ moved[0], by[1] + at.structure @ moved[1], by[2])
    n = len(at.time)
    border = Border(column_of, n, 6)
    border.extend(np.arange(TEN), found["by_parameters"])
    column = 0
    for term in instrument.terms(robot.m):
        border.put(
            calibration_parameters.place(name, term.key, segment.run),
            by_terms[:, :, column : column + term.size],
        )
        column += term.size
    if by_rolling is not None and not segment.static:
        place = calibration_parameters.place(name, PRESLIDING, segment.run)
        border.put(place, extra[:, :, None])
    border.put(calibration_parameters.places[ROBOT, "gravity", None], found["by_gravity"])
    for key in ("anchor", "attachment") if robot.m else ():
        border.put(calibration_parameters.places[ROBOT, key, None], found[f"by_{key}"])
    if not segment.static:
        _, clock, origin = time_of(
            experiment,
            segment,
            calibration,
            reference_clocks(experiment, calibration_parameters, segment),
            name,
            force_samples.time,
        )
        by_delay = -sum(
            np.einsum("nki,ni->nk", j, r)
            for j, r in zip(by, (rate, acceleration, jerk), strict=True)
        )
        changes = _disturbance(segment, local, 1)
        if changes is not None and at.by_disturbance is not None:
            by_delay += np.einsum("nij,nj->ni", at.by_disturbance, changes)
        by_delay = by_delay[:, :, None]
        if clock != origin:
            border.put(clock, by_delay)
            border.put(origin, -by_delay)
        border.put(calibration_parameters.place(name, TIME_CONSTANT, segment.run), by_delay)
        border.put(calibration_parameters.places[ROBOT, DRAG, None], found["by_drag"][:, :, None])
    by_errors, columns = border.collected()
    residual = at.residual
    if at.disturbance is not None:
        by = (_by_state(by[0], segment, at), *by[1:])
    by_motion = at.whitener @ spread(local, *by, block=segment.block)
    size = np.sqrt(np.sum(residual**2, axis=1))
    if held is not None:
        spread_of = np.eye(6) + covariance_of(held, by_motion, local.first, segment.block)
        size = np.sqrt(
            np.sum(residual * np.linalg.solve(spread_of, residual[:, :, None])[:, :, 0], axis=1)
        )
    weight = segment.holds(at.time) * robust_weight(size, 6)
    tally_forces(tally, segment, force_samples, at, weight, size)
    root = np.sqrt(weight)
    rows = Rows(
        local.first,
        root[:, None] * residual,
        root[:, None, None] * by_motion,
        root[:, None, None] * (at.whitener @ by_errors),
        columns,
        segment.label(name, BALANCE),
    )
    if force_samples.unmodelled is None:
        return WhitenedBalance(at, root, (rows,))
    return WhitenedBalance(at, root, tuple(_by_origin(rows, at, segment)))


def _by_state(by_pose: Array, segment: Segment, at: Balance) -> Array:
    """Derivative of the balance by pose and processes, shape (n, 6, block)."""
    found = np.zeros((*by_pose.shape[:2], segment.block))
    found[:, :, :POSE] = by_pose
    assert at.by_disturbance is not None
    for each in segment.processes:
        part = UNMODELLED_PARTS.get(each.source)
        if part is not None:
            place = segment.process_places[each.source]
            found[:, :, place] = -at.by_disturbance[:, :, part] * each.sizes
    return found


def _origins(at: Balance) -> tuple[Array, Array]:
    """Corrections of the readings and parts of the unmodelled wrench by whitened equations, shapes (n,
    r, 6) and (n, 6, 6).
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


def regressor_at(
    experiment: Experiment, segment: Segment, times: Array, calibration: CalibrationValues
) -> Array:
    """Regressor of the body along a motion, shape (n, 6, 10).

    Args:
        experiment: With its robot.
        segment: With its motion.
        times: Within the segment [s], shape (n,).
        calibration: Present values of the calibration parameters.
    """
    pose, rate, acceleration, _ = motion_at(segment.basis(times), segment.coefficients)
    motion = _moved(experiment.robot)(
        pose=pose,
        rate=rate,
        acceleration=acceleration,
        gravity=calibration.gravity,
        parameters=np.zeros(TEN),
        drag=0.0,
    )
    return platform_regressor(motion["specific_force"], motion["omega"], motion["alpha"])


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
        float(np.median(size[used_at_all])) / np.sqrt(chi2.ppf(0.5, 6))
        if used_at_all.any()
        else 1.0
    )
    near = used_at_all & (size <= limit(6) * max(1.0, usual))
    column = 0
    correction, decided = at.correction, at.noise.decided
    for quantity, values in force_samples.readings.items():
        own = slice(column, column + values.shape[1])
        column = own.stop
        used = ~force_samples.left_out[:, own]
        label = segment.label(force_samples.name, quantity)
        _count(tally, label, correction[:, own] * used, decided[:, own] * used, weight, near)
        tally.far[label] += int(np.sum(~used))
    if force_samples.unmodelled is not None:
        label = segment.label(ROBOT, UNMODELLED)
        _count(tally, label, correction[:, column:], decided[:, column:], weight, near)
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
