"""Derivatives of what instruments read at one instant of a commanded motion, as expressions: what
information is made of.

Composed of the measurement equations and of the balance of forces that the estimators linearise
(:func:`.difference_of`, :func:`.derivatives_of_balance`, :func:`.sensitivity_of`,
:func:`.following_of`); nothing is stated anew.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.batch import Batched, Symbol
from steelyard.dynamics import newton_euler
from steelyard.excitation.command.commanded_state import (
    COMMAND_WITH_JERK,
    motion_of,
    state_at,
    structure_at,
    tension_of,
)
from steelyard.excitation.information.linearisation_point import (
    ForceReadings,
    LinearisationPoint,
    MotionReadings,
    border_columns,
)
from steelyard.experiment.model import Experiment
from steelyard.identification.model.balance.equations import derivatives_of_balance
from steelyard.identification.model.calibration_parameters import (
    AIR,
    ATTACHED,
    DRAG,
    ROBOT,
    CalibrationParameters,
    CalibrationValues,
    clock_of,
)
from steelyard.identification.model.segment import POSE
from steelyard.inertia import TEN
from steelyard.instruments.base import TIME_CONSTANT
from steelyard.instruments.expressions.implicit import following_of, sensitivity_of
from steelyard.instruments.expressions.linearisation import difference_of
from steelyard.motion.state import State

BorderTerms = list[tuple[NDArray[np.intp], Symbol]]
"""Border parameters and derivatives by them, shape (k, number of these)."""


@dataclass(frozen=True, eq=False)
class InstrumentInformation:
    """One quantity of one instrument, or the balance of forces, at one instant of a command;
    whitened, k numbers.
    """

    name: str
    """Of the instrument."""
    columns: NDArray[np.intp]
    """Border parameters: the ten of the body, then the systematic errors that are uncertain, see
    :func:`.border_columns`; shape (c,)."""
    rate: float
    """Readings a second [Hz]."""
    rows: Batched
    """Of ``command``, shape (24,): ``by_motion`` and ``by_border``, row by row."""
    adjoint: Batched
    """Of ``command``, ``by_motion`` and ``by_border`` (weights of these): gradient of the weighted
    sum by the command, shape (24,)."""

    def derivatives(self, commands: Array) -> tuple[Array, Array]:
        """By pose, rate and acceleration one beside the other, shape (n, k, 21), and by border
        parameters, shape (n, k, c).

        Args:
            commands: Shape (n, 24).
        """
        found = self.rows(command=commands)
        n = len(commands)
        by_motion = found["by_motion"].reshape(n, -1, 3 * POSE)
        return by_motion, found["by_border"].reshape(n, by_motion.shape[1], -1)

    def gradient(self, commands: Array, by_motion: Array, by_border: Array) -> Array:
        """Gradient by the commands of the sum of weights times :meth:`derivatives`, shape (n, 24).

        Args:
            commands: Shape (n, 24).
            by_motion: Weights, shape (n, k, 21).
            by_border: Weights, shape (n, k, c).
        """
        n = len(commands)
        weights = {"by_motion": by_motion.reshape(n, -1), "by_border": by_border.reshape(n, -1)}
        return self.adjoint(command=commands, **weights)["gradient"]


def instrument_information(point: LinearisationPoint) -> Iterator[InstrumentInformation]:
    """All quantities of all instruments of a run, the balance of forces last."""
    command = ca.SX.sym("command", COMMAND_WITH_JERK)
    expressions = _RunExpressions(point, command, motion_of(command))
    for readings in point.motion_readings:
        yield _of_motion(expressions, readings)
    yield _of_forces(expressions, point.force_readings)


@dataclass(frozen=True, eq=False)
class _RunExpressions:
    """What all instruments of a run depend on."""

    point: LinearisationPoint
    command: Symbol
    """Shape (24,)."""
    motion: tuple[Symbol, Symbol, Symbol, Symbol]
    """Position over quaternion and its derivatives, shape (7,) each."""

    @property
    def experiment(self) -> Experiment:
        """With robot and instruments."""
        return self.point.experiment

    @property
    def calibration(self) -> CalibrationValues:
        """About which all is linearised."""
        return self.point.calibration

    @cached_property
    def state(self) -> State:
        """Without forces."""
        return state_at(self.motion, self.calibration.gravity)

    @cached_property
    def geometry(self) -> dict[str, Symbol]:
        """Anchors and attachments, three numbers a cable; nothing without cables."""
        if not self.experiment.robot.m:
            return {}
        return {key: ca.DM(value) for key, value in self.calibration.geometry.items()}

    @cached_property
    def structure(self) -> Symbol:
        """Of straight cables, shape (6, m)."""
        return structure_at(self.experiment.robot, self.state, self.geometry)

    @cached_property
    def wrench(self) -> Symbol:
        """That moves the body, shape (6,)."""
        return newton_euler(
            ca.DM(self.point.parameters),
            self.state.specific_force,
            self.state.omega,
            self.state.alpha,
        )

    @cached_property
    def tension(self) -> Symbol:
        """Of the cables, shape (m,)."""
        return tension_of(self.experiment.robot, self.structure, self.wrench, self.point.level)


def _of_motion(expressions: _RunExpressions, readings: MotionReadings) -> InstrumentInformation:
    """Of a quantity that depends on the motion."""
    name = readings.instrument
    instrument, robot = expressions.experiment.instruments[name], expressions.experiment.robot
    values = expressions.calibration.of(name, instrument, expressions.point.run.name)
    errors = ca.DM(np.concatenate(list(values.values()))) if values else ca.DM.zeros(1)
    batched, zero = difference_of(instrument, readings.quantity, robot)
    cables = {"tension": expressions.tension} if "tension" in batched.inputs else {}
    state = replace(expressions.state, **cables)
    if "anchors" in batched.inputs:
        cables |= expressions.geometry
    stated = {key: ca.DM(value) for key, value in values.items()}
    predicted = instrument.predict(state, stated, robot)[readings.quantity]
    pose, rate, acceleration, _ = expressions.motion
    found = batched.at(
        pose=pose,
        rate=rate,
        acceleration=acceleration,
        gravity=ca.DM(expressions.calibration.gravity),
        errors=errors,
        measured=ca.SX(predicted),
        **cables,
    )
    found = {**found, **{key: ca.SX.zeros(*shape) for key, shape in zero.items()}}
    by = [found["by_pose"], found["by_rate"], found["by_acceleration"]]
    border = [
        *_border(expressions, name, found["by_errors"], by, found["by_gravity"]),
        *_border_of_robot(expressions, found, anchor="by_anchors", attachment="by_attachments"),
    ]
    whitener = ca.DM.eye(by[0].shape[0]) / readings.sigma
    return _whitened(name, readings.rate, expressions, whitener, by, border)


def _of_forces(expressions: _RunExpressions, readings: ForceReadings) -> InstrumentInformation:
    """Of the balance of forces, solved for by the readings."""
    name = readings.instrument
    instrument, robot = expressions.experiment.instruments[name], expressions.experiment.robot
    cables = {**expressions.geometry, "tension": expressions.tension} if robot.m else {}
    pose, rate, acceleration, _ = expressions.motion
    found = derivatives_of_balance(robot, *expressions.calibration.pulling).at(
        pose=pose,
        rate=rate,
        acceleration=acceleration,
        gravity=ca.DM(expressions.calibration.gravity),
        parameters=ca.DM(expressions.point.parameters),
        weight=ca.DM(0.0),
        drag=ca.SX(expressions.calibration.drag),
        attached=ca.DM(expressions.calibration.of_robot(*ATTACHED)),
        air=ca.DM(expressions.calibration.of_robot(*AIR)),
        hoses=ca.DM(expressions.calibration.hoses),
        swivel=ca.DM(expressions.calibration.swivel()),
        **cables,
    )
    unknown = "tension" if robot.m else "wrench"
    batched, needed = sensitivity_of(unknown, instrument, robot, readings.quantities)
    own = expressions.calibration.of(name, instrument, expressions.point.run.name)
    terms = {f"term_{key}": ca.DM(value) for key, value in own.items()}
    carried = cables.get("tension", expressions.wrench)
    values = {**vars(expressions.state), unknown: carried, **terms}
    sensitive = batched.at(**{key: values[key] for key in needed})
    by_reading, by_terms = sensitive["by_reading"], sensitive["by_terms"]
    if robot.m:
        by_reading = expressions.structure @ by_reading
        by_terms = expressions.structure @ by_terms
    noise = by_reading @ ca.diag(ca.DM(readings.sigma))
    whitener = ca.inv(ca.chol(noise @ noise.T)).T
    by = [found["by_pose"], found["by_rate"], found["by_acceleration"]]
    follows = following_of(unknown, instrument, robot, readings.quantities)
    if follows is not None:
        moved = follows.at(**{**values, "pose": pose, "rate": rate})
        by[0] = by[0] + expressions.structure @ moved["by_pose"]
        by[1] = by[1] + expressions.structure @ moved["by_rate"]
    border = [
        (np.arange(TEN), found["by_parameters"]),
        *_border(expressions, name, by_terms, by, found["by_gravity"]),
    ]
    if robot.m:
        keys = {"anchor": "by_anchor", "attachment": "by_attachment", DRAG: "by_drag"}
        border += _border_of_robot(expressions, found, **keys)
    return _whitened(name, readings.rate, expressions, whitener, by, border)


def _border(
    expressions: _RunExpressions,
    name: str,
    by_terms: Symbol,
    by: Sequence[Symbol],
    by_gravity: Symbol,
) -> BorderTerms:
    """Derivatives by the systematic errors of an instrument that are uncertain, and their border
    parameters.
    """
    experiment, run = expressions.experiment, expressions.point.run
    calibration_parameters = expressions.calibration.calibration_parameters
    found = []
    column = 0
    for term in experiment.instruments[name].terms(calibration_parameters.m):
        place = calibration_parameters.place(name, term.key, run.name)
        found.append((place, by_terms[:, column : column + term.size]))
        column += term.size
    force = experiment.force_instrument(run)
    assert force is not None
    clock, reference = clock_of(experiment, name), clock_of(experiment, force)
    # A later clock reads an earlier instant; the motion is in the time of the forces.
    by_delay = -sum(each @ rate for each, rate in zip(by, expressions.motion[1:], strict=True))
    if name == force:
        found.append((calibration_parameters.place(name, TIME_CONSTANT, run.name), by_delay))
    if latency := calibration_parameters.place_of_latency(name):
        found.append((latency, by_delay))
    if clock != reference:
        found.append((calibration_parameters.place(clock, "delay", run.name), by_delay))
        found.append((calibration_parameters.place(reference, "delay", run.name), -by_delay))
    found.append((calibration_parameters.places[ROBOT, "gravity", None], by_gravity))
    return _uncertain(calibration_parameters, found)


def _border_of_robot(
    expressions: _RunExpressions, found: Mapping[str, Symbol], **keys: str
) -> BorderTerms:
    """The same of errors of the robot file: key -> name of the derivative."""
    calibration_parameters = expressions.calibration.calibration_parameters
    places = calibration_parameters.places
    border = [(places[ROBOT, key, None], found[by]) for key, by in keys.items()]
    return _uncertain(calibration_parameters, border)


def _uncertain(
    calibration_parameters: CalibrationParameters, border: Iterable[tuple[slice, Symbol]]
) -> BorderTerms:
    """Those of some derivatives by systematic errors that have a deviation."""
    kept = []
    column_of = border_columns(calibration_parameters)
    for place, each in border:
        use = np.flatnonzero(calibration_parameters.deviation[place] > 0)
        if len(use):
            kept.append((column_of[place.start + use], ca.SX(each)[:, use.tolist()]))
    return kept


def _whitened(
    name: str,
    rate: float,
    expressions: _RunExpressions,
    whitener: Symbol,
    by: Sequence[Symbol],
    border: BorderTerms,
) -> InstrumentInformation:
    """Functions of the command for whitened derivatives, and for the gradient of weighted sums of
    them.
    """
    columns = np.zeros(0, dtype=np.intp)
    if border:
        columns = np.concatenate([place for place, _ in border])
    none = ca.SX(whitener.shape[0], 0)
    rows = {
        "by_motion": whitener @ ca.horzcat(*by),
        "by_border": whitener @ ca.horzcat(none, *[each for _, each in border]),
    }
    # Row by row, as NumPy has them.
    columned = ca.cse([ca.densify(ca.vec(each.T)) for each in rows.values()])
    rows = dict(zip(rows, columned, strict=True))
    weights = {key: ca.SX.sym(key, each.numel()) for key, each in rows.items()}
    gradient = ca.jtimes(
        ca.veccat(*rows.values()), expressions.command, ca.veccat(*weights.values()), True
    )
    inputs = {"command": expressions.command}
    return InstrumentInformation(
        name,
        columns,
        rate,
        Batched("instrument", inputs, rows),
        Batched("gradient", {**inputs, **weights}, {"gradient": ca.cse(ca.densify(gradient))}),
    )
