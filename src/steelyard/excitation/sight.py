"""What instruments would say at one instant of a commanded motion, as expressions: the derivatives
that information is made of.

Composed of the measurement equations and of the balance of forces that the estimators linearise;
nothing is stated anew.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from steelyard import rotations
from steelyard.arrays import Array
from steelyard.batch import Batched, Symbol
from steelyard.dynamics import newton_euler
from steelyard.excitation.course import SIX
from steelyard.experiment.model import Experiment, Run
from steelyard.identification.model.calibration_parameters import (
    DRAG,
    ROBOT,
    Calibration,
    CalibrationParameters,
    clock_of,
)
from steelyard.identification.model.force_residuals import derivatives_of_balance, taut_structure
from steelyard.identification.model.segment import POSE
from steelyard.identification.solve.joint_study import Joint
from steelyard.identification.solve.normal_equations import TEN
from steelyard.instruments.equations import difference_of, following_of, sensitivity_of
from steelyard.motion.state import State, state_of_pose
from steelyard.robot.model import Robot

INSTANT = 4 * SIX
"""Numbers in a command at one instant: the pose and its first three time derivatives."""
AT = 3 * SIX
"""The same without the last derivative."""
_ORDERS = 4


@dataclass(frozen=True, eq=False)
class Sight:
    """One quantity of one instrument, or the balance of forces, at one instant of a command;
    whitened, k numbers.
    """

    name: str
    """Of the instrument."""
    columns: NDArray[np.intp]
    """Border parameters: the ten of the body, then the systematic errors that are uncertain, see
    :func:`columns_of`; shape (c,)."""
    rate: float
    """Readings a second [Hz]."""
    rows: Batched
    """Of ``command``, shape (24,): ``by_motion`` and ``by_border``, row by row."""
    slopes: Batched
    """Of ``command``, ``by_motion`` and ``by_border`` (weights of these): derivative of the
    weighted sum by the command, shape (24,)."""

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

    def slope(self, commands: Array, by_motion: Array, by_border: Array) -> Array:
        """Derivative by the commands of the sum of weights times :meth:`derivatives`, shape (n,
        24).

        Args:
            commands: Shape (n, 24).
            by_motion: Weights, shape (n, k, 21).
            by_border: Weights, shape (n, k, c).
        """
        n = len(commands)
        weights = {"by_motion": by_motion.reshape(n, -1), "by_border": by_border.reshape(n, -1)}
        return self.slopes(command=commands, **weights)["slope"]


def motion_of(command: Symbol) -> tuple[Symbol, Symbol, Symbol, Symbol]:
    """Position over quaternion of a commanded pose, and its first three time derivatives, shape
    (7,) each.
    """
    six = [command[SIX * k : SIX * (k + 1)] for k in range(_ORDERS)]
    place = ca.SX.sym("place", SIX)
    pose = ca.vertcat(place[:3], rotations.quaternion_of_rpy(place[3:]))
    series = [pose]
    steps = [place, *(ca.SX.sym(f"d{k}", SIX) for k in range(1, _ORDERS))]
    for _ in range(_ORDERS - 1):
        series.append(ca.jtimes(series[-1], ca.vertcat(*steps[:-1]), ca.vertcat(*steps[1:])))
    found = ca.substitute(series, steps, six)
    return found[0], found[1], found[2], found[3]


def state_at(motion: Sequence[Symbol], gravity: Array) -> State:
    """State, without forces, of a pose and its derivatives, which may be expressions."""
    symbols = [ca.SX.sym(name, POSE) for name in ("pose", "rate", "acceleration")]
    general = state_of_pose(symbols[0], symbols[1], symbols[2], ca.DM(gravity))
    names = ("position", "rotation", "velocity", "omega", "alpha", "specific_force")
    found = ca.substitute(
        [ca.SX(getattr(general, name)) for name in names], symbols, list(motion[:3])
    )
    return replace(general, **dict(zip(names, found, strict=True)))


def commanded_state(command: Symbol, gravity: Array) -> State:
    """State, without forces, of a command of pose, rate and acceleration, shape (18,)."""
    return state_at(motion_of(ca.vertcat(command, ca.SX.zeros(INSTANT - AT))), gravity)


def structure_at(
    robot: Robot, state: State, geometry: Mapping[str, Symbol] | None = None
) -> Symbol:
    """Structure matrix of straight cables in a state, shape (6, m).

    Args:
        robot: With cables.
        state: Position and rotation of it.
        geometry: ``anchors`` and ``attachments``, three numbers a cable; None: those of the robot
            file.
    """
    taut = taut_structure(robot.with_straight_cables())
    fixed = geometry or {
        "anchors": ca.DM(robot.anchors.ravel()),
        "attachments": ca.DM(robot.attachments.ravel()),
    }
    return taut.at(position=state.position, rotation=state.rotation, **fixed)["structure"]


def hanging_wrench(ten: Symbol, state: State, gravity: Array) -> Symbol:
    """Wrench that holds a body at rest in the attitude of a state, in P [N], [N m], shape (6,).

    Args:
        ten: Its linear parameters, shape (10,).
        state: Rotation of it.
        gravity: World frame [m/s^2], shape (3,).
    """
    return newton_euler(ten, -state.rotation.T @ ca.DM(gravity), ca.SX.zeros(3), ca.SX.zeros(3))


def tension_of(robot: Robot, structure: Symbol, wrench: Symbol, level: Symbol | float) -> Symbol:
    """Tensions of a wrench nearest to a level, in closed form [Pott2009]_, shape (m,)."""
    even = ca.DM.ones(robot.m) * level
    return even + structure.T @ ca.solve(structure @ structure.T, wrench - structure @ even)


@dataclass(frozen=True, eq=False)
class View:
    """Who looks at a run, and the values about which all is linearised."""

    experiment: Experiment
    run: Run
    calibration: Calibration
    parameters: Array
    """The ten of the body, shape (10,)."""
    level: float
    """Tension that the cables are held near to [N]."""
    readers: tuple[tuple[str, str, float, float], ...]
    """Instrument, quantity, 1-sigma of a reading and readings a second of all that looks at the
    motion."""
    forces: tuple[str, tuple[str, ...], Array, float]
    """The force instrument: its name, quantities, 1-sigma of its numbers, readings a second."""

    @classmethod
    def of(cls, rehearsed: Joint, run: Run, level: float) -> View:
        """As an estimator had it in a rehearsal."""
        state = rehearsed.fit.state
        assert state.parameters is not None
        segment, force_samples = next(
            (a, f)
            for a, f in zip(state.segments, rehearsed.force_samples, strict=True)
            if a.run == run.name
        )

        def rate(time: Array) -> float:
            return (len(time) - 1) / float(time[-1] - time[0])

        readers = tuple(
            (*r.source, r.sigma * state.factors.get(segment.label(*r.source), 1.0), rate(r.time))
            for r in segment.readings
        )
        forces = (
            force_samples.name,
            tuple(force_samples.readings),
            force_samples.sigma,
            rate(force_samples.time),
        )
        return cls(
            rehearsed.study.experiment,
            run,
            state.calibration,
            state.parameters,
            level,
            readers,
            forces,
        )


def sights(view: View) -> Iterator[Sight]:
    """All that is seen in a run."""
    command = ca.SX.sym("command", INSTANT)
    known = _Known(view, command, motion_of(command))
    for reader in view.readers:
        yield _motion_sight(known, *reader)
    yield _force_sight(known, *view.forces)


def columns_of(calibration_parameters: CalibrationParameters) -> NDArray[np.intp]:
    """Border parameter of each systematic error, after the ten of the body; -1: it is known
    exactly; shape (u,).
    """
    uncertain = calibration_parameters.deviation > 0
    return np.where(uncertain, TEN + np.cumsum(uncertain) - 1, -1)


def border_of(calibration_parameters: CalibrationParameters) -> Array:
    """What is known beforehand of the border parameters: the priors of the systematic errors, shape
    (b, b).
    """
    uncertain = calibration_parameters.deviation[calibration_parameters.deviation > 0]
    return np.diag(np.concatenate([np.zeros(TEN), uncertain**-2.0]))


@dataclass(frozen=True, eq=False)
class _Known:
    """What all sights of a run have in common."""

    view: View
    command: Symbol
    motion: tuple[Symbol, Symbol, Symbol, Symbol]

    @property
    def experiment(self) -> Experiment:
        """With robot and instruments."""
        return self.view.experiment

    @property
    def calibration(self) -> Calibration:
        """About which all is linearised."""
        return self.view.calibration

    @cached_property
    def state(self) -> State:
        """Without forces."""
        return state_at(self.motion, self.calibration.gravity)

    @cached_property
    def geometry(self) -> dict[str, Symbol]:
        """Anchors and attachments, three numbers a cable; nothing without cables."""
        if not self.experiment.robot.m:
            return {}
        places = self.calibration.calibration_parameters.places
        return {
            key + "s": ca.DM(self.calibration.values[places[ROBOT, key, None]])
            for key in ("anchor", "attachment")
        }

    @cached_property
    def structure(self) -> Symbol:
        """Of straight cables."""
        return structure_at(self.experiment.robot, self.state, self.geometry)

    @cached_property
    def wrench(self) -> Symbol:
        """That moves the body."""
        return newton_euler(
            ca.DM(self.view.parameters),
            self.state.specific_force,
            self.state.omega,
            self.state.alpha,
        )

    @cached_property
    def tension(self) -> Symbol:
        """Of the cables."""
        return tension_of(self.experiment.robot, self.structure, self.wrench, self.view.level)


def _motion_sight(known: _Known, name: str, quantity: str, sigma: float, rate: float) -> Sight:
    instrument, robot = known.experiment.instruments[name], known.experiment.robot
    values = known.calibration.of(name, instrument, known.view.run.name)
    errors = ca.DM(np.concatenate(list(values.values()))) if values else ca.DM.zeros(1)
    batched, zero = difference_of(instrument, quantity, robot)
    cables = {"tension": known.tension} if "tension" in batched.inputs else {}
    state = replace(known.state, **cables)
    predicted = instrument.predict(
        state, {key: ca.DM(value) for key, value in values.items()}, robot
    )[quantity]
    pose, rate_, acceleration, _ = known.motion
    found = batched.at(
        pose=pose,
        rate=rate_,
        acceleration=acceleration,
        gravity=ca.DM(known.calibration.gravity),
        errors=errors,
        measured=ca.SX(predicted),
        **cables,
    )
    found = {**found, **{key: ca.SX.zeros(*shape) for key, shape in zero.items()}}
    by = [found["by_pose"], found["by_rate"], found["by_acceleration"]]
    border = _border(known, name, found["by_errors"], by, found["by_gravity"])
    return _sight(name, known, ca.DM.eye(by[0].shape[0]) / sigma, by, border, rate)


def _force_sight(
    known: _Known, name: str, quantities: tuple[str, ...], sigma: Array, rate: float
) -> Sight:
    instrument, robot = known.experiment.instruments[name], known.experiment.robot
    calibration_parameters = known.calibration.calibration_parameters
    cables = {**known.geometry, "tension": known.tension} if robot.m else {}
    pose, rate_, acceleration, _ = known.motion
    found = derivatives_of_balance(robot).at(
        pose=pose,
        rate=rate_,
        acceleration=acceleration,
        gravity=ca.DM(known.calibration.gravity),
        parameters=ca.DM(known.view.parameters),
        drag=ca.SX(known.calibration.drag),
        **cables,
    )
    unknown = "tension" if robot.m else "wrench"
    batched, needed = sensitivity_of(unknown, instrument, robot, quantities)
    values = {
        f"term_{k}": ca.DM(v)
        for k, v in known.calibration.of(name, instrument, known.view.run.name).items()
    }
    there = {**vars(known.state), unknown: cables.get("tension", known.wrench), **values}
    sensitive = batched.at(**{key: there[key] for key in needed})
    by_reading, by_terms = sensitive["by_reading"], sensitive["by_terms"]
    if robot.m:
        by_reading, by_terms = known.structure @ by_reading, known.structure @ by_terms
    noise = by_reading @ ca.diag(ca.DM(sigma))
    whitener = ca.inv(ca.chol(noise @ noise.T)).T
    by = [found["by_pose"], found["by_rate"], found["by_acceleration"]]
    follows = following_of(unknown, instrument, robot, quantities)
    if follows is not None:
        moved = follows.at(**{**there, "pose": pose, "rate": rate_})
        by = [
            by[0] + known.structure @ moved["by_pose"],
            by[1] + known.structure @ moved["by_rate"],
            by[2],
        ]
    border = [
        (np.arange(TEN), found["by_parameters"]),
        *_border(known, name, by_terms, by, found["by_gravity"]),
    ]
    if robot.m:
        border += _uncertain(
            calibration_parameters,
            [
                (calibration_parameters.places[ROBOT, "anchor", None], found["by_anchor"]),
                (calibration_parameters.places[ROBOT, "attachment", None], found["by_attachment"]),
                (calibration_parameters.places[ROBOT, DRAG, None], found["by_drag"]),
            ],
        )
    return _sight(name, known, whitener, by, border, rate)


Border = list[tuple[NDArray[np.intp], Symbol]]


def _border(
    known: _Known, name: str, by_terms: Symbol, by: Sequence[Symbol], by_gravity: Symbol
) -> Border:
    """Derivatives by the systematic errors of an instrument that are uncertain, and their
    places.
    """
    experiment, run, calibration_parameters = (
        known.experiment,
        known.view.run,
        known.calibration.calibration_parameters,
    )
    found, column = [], 0
    for term in experiment.instruments[name].terms(calibration_parameters.m):
        found.append(
            (
                calibration_parameters.place(name, term.key, run.name),
                by_terms[:, column : column + term.size],
            )
        )
        column += term.size
    force = experiment.force_instrument(run)
    assert force is not None
    clock = clock_of(experiment, name)
    if clock != clock_of(experiment, force):
        # A later clock looks at an earlier instant; the motion is told in the time of the forces.
        by_delay = -sum(each @ rate for each, rate in zip(by, known.motion[1:], strict=True))
        found.append((calibration_parameters.place(clock, "delay", run.name), by_delay))
        found.append(
            (
                calibration_parameters.place(clock_of(experiment, force), "delay", run.name),
                -by_delay,
            )
        )
    found.append((calibration_parameters.places[ROBOT, "gravity", None], by_gravity))
    return _uncertain(calibration_parameters, found)


def _uncertain(
    calibration_parameters: CalibrationParameters, border: Iterable[tuple[slice, Symbol]]
) -> Border:
    kept = []
    column_of = columns_of(calibration_parameters)
    for place, each in border:
        use = np.flatnonzero(calibration_parameters.deviation[place] > 0)
        if len(use):
            kept.append((column_of[place.start + use], ca.SX(each)[:, use.tolist()]))
    return kept


def _sight(
    name: str, known: _Known, whitener: Symbol, by: Sequence[Symbol], border: Border, rate: float
) -> Sight:
    k = whitener.shape[0]
    columns = (
        np.concatenate([place for place, _ in border]) if border else np.zeros(0, dtype=np.intp)
    )
    together = {
        "by_motion": whitener @ ca.horzcat(*by),
        "by_border": whitener @ ca.horzcat(ca.SX(k, 0), *[each for _, each in border]),
    }
    # Row by row, as NumPy has them.
    together = dict(
        zip(
            together,
            ca.cse([ca.densify(ca.vec(each.T)) for each in together.values()]),
            strict=True,
        )
    )
    weights = {key: ca.SX.sym(key, each.numel()) for key, each in together.items()}
    slope = ca.jtimes(
        ca.veccat(*together.values()), known.command, ca.veccat(*weights.values()), True
    )
    return Sight(
        name,
        columns,
        rate,
        Batched("sight", {"command": known.command}, together),
        Batched(
            "slopes", {"command": known.command, **weights}, {"slope": ca.cse(ca.densify(slope))}
        ),
    )
