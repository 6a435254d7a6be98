"""The Cramer-Rao bound: how well the body can be known from an experiment at all, whatever the method.

Motion, body and every systematic error are unknown together. The information of all readings at their own times is summed up, the
motion (a spline) and the systematic errors are eliminated (Schur complement), and what is left belongs to the body [Kay1993]_.
Priors of the systematic errors count as readings of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.batch import Batched
from steelyard.dynamics import newton_euler
from steelyard.experiment.model import Experiment, Run
from steelyard.identification.arc import Rows, accumulate, basis, motion_at, spread
from steelyard.identification.motion_rows import Arc, Tally, motion_rows, reference_clocks
from steelyard.identification.preparation import Samples
from steelyard.identification.regression import TEN
from steelyard.identification.study import Study
from steelyard.identification.unknowns import DRAG, ROBOT, Systematic, Unknowns, clock_of
from steelyard.inertia import BODY_PARAMETERS, body_jacobian
from steelyard.instruments.equations import sensitivity
from steelyard.motion.state import state_of_pose
from steelyard.robot.cable_inertia import dragging_wrench
from steelyard.robot.geometry import cable_wrench
from steelyard.robot.model import Robot


@dataclass(frozen=True, eq=False)
class Bound:
    """What can be known at best."""

    covariance: Array
    """Of the ten of :data:`steelyard.inertia.BODY_PARAMETERS`, shape (10, 10)."""
    systematic: Array
    """Of all systematic errors, shape (u, u)."""

    @property
    def standard_deviation(self) -> Array:
        """1-sigma of the ten, shape (10,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


@dataclass(frozen=True, eq=False)
class Forces:
    """Force readings within an arc."""

    time: Array
    """By the force instrument's clock, moved to the common event [s], shape (n,)."""
    tension: Array | None
    """About which the readings are linearised [N], shape (n, m); None for a wrench sensor."""
    sigma: Array
    """1-sigma of a reading, shape (r,)."""


def cramer_rao(
    experiment: Experiment,
    systematic: Systematic,
    arcs: Mapping[str, tuple[Arc, ...]],
    forces: Mapping[str, tuple[Forces, ...]],
    parameters: Array,
    *,
    known: Mapping[str, tuple[float, float]] | None = None,
    further: Array | float = 0.0,
) -> Bound:
    """Bound of the body's covariance.

    Args:
        experiment: Its instruments and calibration priors say what there is to know.
        systematic: Values about which to linearise.
        arcs: Run -> its arcs, with readings of the motion instruments and the motion itself.
        forces: Run -> force readings of each of these arcs.
        parameters: The ten of :data:`steelyard.inertia.LINEAR_PARAMETERS`, shape (10,).
        known: Body parameters known beforehand with their 1-sigma.
        further: Information on the ten and then all systematic errors from elsewhere (poses at rest), shape (10 + u, 10 + u).

    Raises:
        numpy.linalg.LinAlgError: The motion is not determined by the readings.
    """
    unknowns = systematic.unknowns
    active = unknowns.deviation > 0
    count = TEN + int(active.sum())
    matrix = np.zeros((count, count))
    matrix[TEN:, TEN:] = np.diag(1 / unknowns.deviation[active] ** 2)
    if isinstance(further, np.ndarray):
        wanted = np.concatenate([np.arange(TEN), TEN + np.flatnonzero(active)])
        matrix += further[np.ix_(wanted, wanted)]
    runs = {run.name: run for run in experiment.runs}
    for name, own in arcs.items():
        for arc, felt in zip(own, forces[name], strict=True):
            rows = _all_rows(experiment, runs[name], arc, felt, systematic, active, parameters)
            matrix += accumulate(len(arc.coefficients), count, rows).reduced()[0]
    J = body_jacobian(parameters)
    for parameter, (_, sigma) in (known or {}).items():
        row = J[BODY_PARAMETERS.index(parameter)] / max(sigma, 1e-9)
        matrix[:TEN, :TEN] += np.outer(row, row)
    scale = 1 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    inverse = np.linalg.pinv(matrix * np.outer(scale, scale), rcond=1e-15, hermitian=True) * np.outer(scale, scale)
    covariance = np.zeros((len(unknowns), len(unknowns)))
    covariance[np.ix_(active, active)] = inverse[TEN:, TEN:]
    return Bound(np.asarray(J @ inverse[:TEN, :TEN] @ J.T), covariance)


def attainable(found: Study) -> Bound | None:
    """Bound of a recorded experiment, about its own estimate; None where only a part of it has been looked at as a whole.

    Args:
        found: Its study.
    """
    experiment, systematic = found.experiment, found.systematic
    moving = [run for run in experiment.runs if not run.static and run.name not in found.held_out]
    arcs = {run.name: tuple(arc for arc in found.kinematics.arcs if arc.run == run.name) for run in moving}
    if found.part is not None or not all(arcs.values()):
        return None
    samples = {s.run: s for s in found.samples}
    forces = {run.name: tuple(_forces(found, run, samples[run.name], arc) for arc in arcs[run.name]) for run in moving}
    at_rest = [found.sums[run.name].normal for run in experiment.runs if run.static and run.name not in found.held_out]
    try:
        return cramer_rao(
            experiment,
            systematic,
            arcs,
            forces,
            found.parameters,
            known=experiment.known,
            further=sum(at_rest, start=0.0),
        )
    except np.linalg.LinAlgError:
        return None


def _forces(found: Study, run: Run, samples: Samples, arc: Arc) -> Forces:
    """Force readings within an arc, with the tensions that the samples show."""
    name = found.experiment.force_instrument(run)
    assert name is not None
    time = found.experiment.common_time(run, name, 0.0)
    complete = np.all([np.isfinite(v).all(axis=1) for v in run.streams[name].values.values()], axis=0)
    time = time[complete & (time >= arc.knots[0]) & (time <= arc.knots[-1])]
    tension = None
    if samples.tension is not None:
        tension = np.column_stack([np.interp(time, samples.time, column) for column in samples.tension.T])
    return Forces(time, tension, found.sigma[run.name])


def _all_rows(
    experiment: Experiment,
    run: Run,
    arc: Arc,
    felt: Forces,
    systematic: Systematic,
    active: NDArray[np.bool_],
    parameters: Array,
) -> Iterator[Rows]:
    column_of = np.where(active, TEN + np.cumsum(active) - 1, -1)
    yield from motion_rows(experiment, arc, systematic, column_of, {}, Tally())
    yield force_rows(experiment, run, arc, felt, systematic, active, parameters)


@lru_cache(maxsize=16)
def _unbalanced(heavy: Robot) -> Batched:
    """Wrench of the cables less what moves the body, with all its derivatives; sag is of no account for these."""
    robot = heavy.with_straight_cables()
    pose, rate, acceleration = (ca.SX.sym(name, 7) for name in ("pose", "rate", "acceleration"))
    gravity, parameters, tension = ca.SX.sym("gravity", 3), ca.SX.sym("parameters", TEN), ca.SX.sym("tension", robot.m)
    anchors, attachments = ca.SX.sym("anchors", 3, robot.m), ca.SX.sym("attachments", 3, robot.m)
    state = state_of_pose(pose, rate, acceleration, gravity)
    wrench = -newton_euler(parameters, state.specific_force, state.omega, state.alpha)
    wrench += cable_wrench(robot, state.position, state.rotation, tension, anchors, attachments)
    drag = ca.SX.sym("drag")
    wrench += drag * dragging_wrench(
        heavy, state.position, state.rotation, state.specific_force, state.omega, state.alpha, gravity
    )
    present = [ca.DM(robot.anchors).T, ca.DM(robot.attachments).T]
    by = {
        "by_drag": drag,
        "by_pose": pose,
        "by_rate": rate,
        "by_acceleration": acceleration,
        "by_gravity": gravity,
        "by_parameters": parameters,
        **(
            {"by_tension": tension, "by_anchor": ca.vec(anchors), "by_attachment": ca.vec(attachments)}
            if robot.m
            else {}
        ),
    }
    outputs = [ca.densify(ca.substitute(ca.jacobian(wrench, symbol), drag, 0.5)) for symbol in by.values()]
    if robot.m:
        outputs = ca.substitute(outputs, [anchors, attachments], present)
    inputs = {"pose": pose, "rate": rate, "acceleration": acceleration, "gravity": gravity, "parameters": parameters}
    return Batched(
        "unbalanced", {**inputs, **({"tension": tension} if robot.m else {})}, dict(zip(by, outputs, strict=True))
    )


def force_rows(
    experiment: Experiment,
    run: Run,
    arc: Arc,
    felt: Forces,
    systematic: Systematic,
    active: NDArray[np.bool_],
    parameters: Array,
) -> Rows:
    """Whitened balance of forces and motion at the times of the force readings, without residual.

    The internal tension is free: readings enter through the wrench that they exert, whitened with what their noise does to it.
    """
    unknowns: Unknowns = systematic.unknowns
    name = experiment.force_instrument(run)
    assert name is not None
    instrument = experiment.instruments[name]
    robot = experiment.robot.with_straight_cables()
    own = clock_of(experiment, name)
    references = reference_clocks(experiment, unknowns, arc)
    # The motion is told in the time of one of its own clocks; the forces may have another.
    reference = references.get(own, next(iter(references.values()), own))
    clock, origin = unknowns.place(own, "delay", run.name), unknowns.place(reference, "delay", run.name)
    delay = systematic.values[clock] - systematic.values[origin] + unknowns.mean[origin]
    times = np.clip(felt.time - delay[0], arc.knots[0], arc.knots[-1])
    local = basis(arc.knots, times)
    pose, rate, acceleration, jerk = motion_at(local, arc.coefficients)
    tension = {} if felt.tension is None else {"tension": felt.tension}
    found = _unbalanced(experiment.robot)(
        pose=pose, rate=rate, acceleration=acceleration, gravity=systematic.gravity, parameters=parameters, **tension
    )
    quantities = tuple(q.name for q in instrument.quantities(experiment.robot.m))
    n = len(times)
    state = {"tension": felt.tension} if felt.tension is not None else {"wrench": np.zeros((n, 6))}
    by_reading, by_errors = sensitivity(
        "tension" if felt.tension is not None else "wrench", instrument, robot, quantities, state,
        systematic.of(name, instrument, run.name),
    )  # fmt: skip
    by_reading = np.broadcast_to(by_reading, (n, *by_reading.shape[1:]))
    by_errors = np.broadcast_to(by_errors, (n, *by_errors.shape[1:]))
    if felt.tension is not None:
        by_reading, by_errors = found["by_tension"] @ by_reading, found["by_tension"] @ by_errors
    by = (found["by_pose"], found["by_rate"], found["by_acceleration"])
    columns = np.zeros((n, 6, TEN + len(unknowns)))
    columns[:, :, :TEN] = found["by_parameters"]
    column = 0
    for term in instrument.terms(experiment.robot.m):
        place = unknowns.place(name, term.key, run.name)
        columns[:, :, TEN + place.start : TEN + place.stop] += by_errors[:, :, column : column + term.size]
        column += term.size
    by_delay = -sum(np.einsum("nki,ni->nk", j, r) for j, r in zip(by, (rate, acceleration, jerk), strict=True))
    columns[:, :, TEN + clock.start] += by_delay
    columns[:, :, TEN + origin.start] -= by_delay
    columns[:, :, TEN + unknowns.places[ROBOT, DRAG, None].start] = found["by_drag"]
    for key in ("gravity", *(("anchor", "attachment") if robot.m else ())):
        place = unknowns.places[ROBOT, key, None]
        columns[:, :, TEN + place.start : TEN + place.stop] += found[f"by_{key}"]
    covariance = np.einsum("nkr,r,nlr->nkl", by_reading, felt.sigma**2, by_reading)
    L = np.linalg.inv(np.linalg.cholesky(covariance))
    wanted = np.concatenate([np.arange(TEN), TEN + np.flatnonzero(active)])
    return Rows(local.first, np.zeros((n, 6)), L @ spread(local, *by), L @ columns[:, :, wanted])
