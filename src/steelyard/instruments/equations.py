"""Measurement equations over samples: forwards as they are stated, and backwards where they are
linear in what is sought.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields, replace
from functools import lru_cache

import casadi as ca
import numpy as np

from steelyard import rotations
from steelyard.arrays import Array
from steelyard.batch import Batched, Symbol, jacobians
from steelyard.errors import InputError
from steelyard.instruments.base import Instrument, Term
from steelyard.motion.state import State, state_of_pose, symbols
from steelyard.robot.model import Robot


def means(instrument: Instrument, m: int) -> dict[str, Array]:
    """Systematic errors as known beforehand, one array for each of :meth:`Instrument.terms`."""
    return {term.key: term.mean for term in instrument.terms(m)}


@lru_cache(maxsize=128)
def _stated_errors(instrument: Instrument, m: int) -> Mapping[str, Array]:
    """:func:`means` under the names of inputs; not to be changed."""
    return {f"term_{key}": value for key, value in means(instrument, m).items()}


def terms_behind(instrument: Instrument, quantity: str, robot: Robot) -> list[Term]:
    """Systematic errors that the reading of one quantity depends on."""
    values = {term.key: ca.SX.sym(term.key, term.size) for term in instrument.terms(robot.m)}
    reading = ca.SX(instrument.predict(symbols(robot.m), values, robot)[quantity])
    return [term for term in instrument.terms(robot.m) if ca.depends_on(reading, values[term.key])]


def predict(
    instrument: Instrument, robot: Robot, state: State, calibration: Mapping[str, Array]
) -> dict[str, Array]:
    """Noise-free readings of an instrument.

    Args:
        instrument: Any kind.
        robot: Its cables.
        state: Arrays over n samples (constant ones without the leading axis); None where it is not
            known.
        calibration: Systematic errors, one array for each of :meth:`Instrument.terms`.

    Returns:
        One array over n samples for each quantity that can be had from the known part of the state.
    """
    known = {
        f.name: getattr(state, f.name) for f in fields(State) if getattr(state, f.name) is not None
    }
    stretching = known.pop("stretching", None)
    if stretching is not None and instrument.is_cable_motion:
        # How long a cable is follows from what stretches it.
        known["tension"] = stretching
    errors = tuple((key, tuple(np.ravel(value).tolist())) for key, value in calibration.items())
    return _prediction(instrument, robot, tuple(known), errors)(**known)


@lru_cache(maxsize=64)
def _prediction(
    instrument: Instrument,
    robot: Robot,
    known: tuple[str, ...],
    errors: tuple[tuple[str, tuple[float, ...]], ...],
) -> Batched:
    """Those readings that follow from the known part of the state, for given systematic errors."""
    symbolic = symbols(robot.m, remembered="rolling" in known)
    readings = instrument.predict(symbolic, {key: ca.DM(value) for key, value in errors}, robot)
    unknown = [symbol for name, symbol in _parts(symbolic).items() if name not in known]
    possible = {
        name: ca.SX(value)
        for name, value in readings.items()
        if not any(u.numel() and ca.depends_on(ca.SX(value), ca.vec(u)) for u in unknown)
    }
    return Batched("predict", {key: getattr(symbolic, key) for key in known}, possible)


@lru_cache(maxsize=64)
def _term_columns_of(instrument: Instrument, quantity: str, robot: Robot) -> _Expression:
    state = symbols(robot.m)
    predicted, terms = _predicted(instrument, robot, (quantity,), state)
    return _expression(ca.jacobian(predicted, ca.vertcat(*terms.values())), state, terms)


def term_columns(
    instrument: Instrument, quantity: str, robot: Robot, state: State
) -> dict[str, Array]:
    """How the reading of one quantity follows the systematic errors, about their values known
    beforehand.

    Args:
        instrument: Any kind with systematic errors.
        quantity: One of its quantities, a vector of k numbers.
        robot: Its cables.
        state: Arrays over n samples; None where the reading does not depend on it.

    Returns:
        One derivative for each of :meth:`Instrument.terms`, shape (n, k, size).
    """
    part = _term_columns_of(instrument, quantity, robot)
    values = part.evaluate({**_stated_errors(instrument, robot.m), **vars(state)})
    sizes = {term.key: term.size for term in instrument.terms(robot.m)}
    columns = np.broadcast_to(values, (len(state.rotation), *values.shape[1:]))
    parts = np.split(columns, np.cumsum(list(sizes.values()))[:-1], axis=2)
    return dict(zip(sizes, parts, strict=True))


def solve_for(
    unknown: str,
    instrument: Instrument,
    robot: Robot,
    readings: Mapping[str, Array],
    given: Mapping[str, Array],
    calibration: Mapping[str, Array] | None = None,
) -> Array:
    """The part of the platform's state that gives the readings of an instrument, which must be
    linear in it, or nearly equal to it.

    Args:
        unknown: Name of a field of :class:`State`.
        instrument: Any kind.
        robot: Its cables.
        readings: Quantities that determine the unknown, arrays over n samples.
        given: Other fields of the state; all that the equation needs, and it may be more.
        calibration: Systematic errors, one array for each of :meth:`Instrument.terms`; None: as
            known beforehand.

    Returns:
        The unknown over n samples.

    Raises:
        InputError: The equation needs a part of the state that is not given.
    """
    form = _inversion(unknown, instrument, robot, tuple(readings), "rolling" in given)
    missing = [name for name in form.given if name not in given]
    if missing:
        raise InputError(
            f"instrument of kind '{instrument.kind}': expected the platform's"
            f" {' and '.join(missing)} beside its {' and '.join(readings).replace('_', ' ')}, found"
            " none; add a stream that tells it"
        )
    known = _stated_errors(instrument, robot.m)
    if calibration is not None:
        known = {f"term_{key}": value for key, value in calibration.items()}
    values = {**known, **given}
    measured = np.hstack(
        [_columns(np.asarray(value, dtype=np.float64)) for value in readings.values()]
    )
    if form.linear:
        solved = form.step(measured, values)
    else:
        # Readings in the unit of the unknown are where to begin.
        solved, close = measured, _CLOSE * float(np.abs(measured).max(initial=0.0))
        for _ in range(_STEPS):
            step = form.step(measured, {**values, unknown: solved})
            solved = solved + step
            if not np.abs(step).max(initial=0.0) > close:
                break
    return np.ascontiguousarray(
        solved.reshape(-1, 3, 3).transpose(0, 2, 1) if unknown == "rotation" else solved
    )


def _columns(values: Array) -> Array:
    """Vectors as they are, matrices column by column as CasADi orders them, shape (n, k)."""
    return values.transpose(0, 2, 1).reshape(len(values), -1) if values.ndim == 3 else values


_GEOMETRY = ("anchors", "attachments")
"""Fields of a state that say where the cables are fixed."""
_FIELDS = frozenset(f.name for f in fields(State))
_STEPS = 4
"""Of Newton's method for readings that are nearly linear in the unknown: two reach rounding."""
_CLOSE = 1e-12
"""A step so much smaller than the largest reading is the last one."""


@dataclass(frozen=True, eq=False)
class _Expression:
    """An expression of some of the systematic errors and of the state."""

    batched: Batched
    inputs: tuple[str, ...]

    def evaluate(self, values: Mapping[str, Array]) -> Array:
        return self.batched(**{name: values[name] for name in self.inputs})["value"]


def _parts(state: State) -> dict[str, Symbol]:
    """Fields of a state that are there, by name."""
    found = {f.name: getattr(state, f.name) for f in fields(State)}
    return {name: symbol for name, symbol in found.items() if symbol is not None}


def _taken(expression: Symbol, behind: Mapping[str, Symbol]) -> dict[str, Symbol]:
    """Those of some symbols that stand in an expression; it is walked through once for all."""
    there = {each.element_hash() for each in ca.symvar(expression)}
    return {
        name: symbol
        for name, symbol in behind.items()
        if any(each.element_hash() in there for each in ca.symvar(symbol))
    }


def _expression(expression: Symbol, state: State, terms: Mapping[str, Symbol]) -> _Expression:
    dense = ca.densify(expression)
    behind = {
        **{f"term_{key}": symbol for key, symbol in terms.items()},
        **_parts(state),
    }
    inputs = _taken(dense, behind)
    return _Expression(Batched("part", inputs, {"value": dense}), tuple(inputs))


@dataclass(frozen=True, eq=False)
class _Inversion:
    """Readings as a function of the unknown: about zero where they are linear in it, else about
    present values of it.
    """

    inverse: _Expression
    """Of the derivative by the unknown."""
    value: _Expression
    unknown: str

    @property
    def linear(self) -> bool:
        """Whether the derivative does not depend on the unknown."""
        return self.unknown not in self.inverse.inputs

    @property
    def given(self) -> tuple[str, ...]:
        """Other parts of the state that it takes."""
        inputs = dict.fromkeys((*self.inverse.inputs, *self.value.inputs))
        return tuple(name for name in inputs if name in _FIELDS and name != self.unknown)

    def step(self, measured: Array, values: Mapping[str, Array]) -> Array:
        """What is to be added to zero, or to present values, so that the readings are as measured,
        shape (n, k).
        """
        value = self.value.evaluate(values)
        difference = measured - value.reshape(len(value), -1)
        inverse = self.inverse.evaluate(values)
        inverse = inverse.reshape(len(inverse), -1, measured.shape[1])
        # The matrix mostly depends on no sample; then it has been inverted once and not a million
        # times.
        step: Array = (
            difference @ inverse[0].T
            if len(inverse) == 1
            else np.einsum("nij,nj->ni", inverse, difference)
        )
        return step


def _predicted(
    instrument: Instrument, robot: Robot, quantities: tuple[str, ...], state: State
) -> tuple[Symbol, dict[str, Symbol]]:
    """Readings of some quantities in one column, and the symbols of the systematic errors that they
    are stated with.
    """
    terms = {term.key: ca.SX.sym(term.key, term.size) for term in instrument.terms(robot.m)}
    stated = instrument.predict(state, terms, robot)
    return ca.vertcat(*[ca.vec(stated[name]) for name in quantities]), terms


@lru_cache(maxsize=128)
def _inversion(
    unknown: str,
    instrument: Instrument,
    robot: Robot,
    quantities: tuple[str, ...],
    remembered: bool = False,
) -> _Inversion:
    """The equation of some quantities and its derivative by the unknown, inverted."""
    state = symbols(robot.m, remembered=remembered)
    predicted, terms = _predicted(instrument, robot, quantities, state)
    column = ca.vec(getattr(state, unknown))
    slope = ca.jacobian(predicted, column)
    linear = not ca.depends_on(slope, column)
    value = ca.substitute(predicted, column, ca.DM.zeros(column.numel())) if linear else predicted
    return _Inversion(
        _expression(ca.inv(slope), state, terms), _expression(value, state, terms), unknown
    )


def needed_for(
    unknown: str, instrument: Instrument, robot: Robot, quantities: tuple[str, ...]
) -> tuple[str, ...]:
    """Other parts of the state that :func:`solve_for` takes to find one from the readings of some
    quantities.
    """
    return _inversion(unknown, instrument, robot, quantities).given


def _symbol_like(name: str, expression: Symbol) -> Symbol:
    return ca.SX.sym(name, *expression.shape)


@lru_cache(maxsize=128)
def order_of(instrument: Instrument, quantity: str, robot: Robot) -> int:
    """Highest time derivative of the pose that a quantity depends on: 0, 1 or 2."""
    pose, rate, acceleration = (ca.SX.sym(name, 7) for name in ("pose", "rate", "acceleration"))
    state = state_of_pose(pose, rate, acceleration, ca.SX.sym("gravity", 3))
    state = replace(state, tension=ca.SX.sym("tension", robot.m))
    errors = {term.key: ca.SX.sym(term.key, term.size) for term in instrument.terms(robot.m)}
    predicted = ca.SX(instrument.predict(state, errors, robot)[quantity])
    if ca.depends_on(predicted, acceleration):
        return 2
    return 1 if ca.depends_on(predicted, rate) else 0


@lru_cache(maxsize=128)
def difference_of(
    instrument: Instrument, quantity: str, robot: Robot, asked: frozenset[str] | None = None
) -> tuple[Batched, dict[str, tuple[int, int]]]:
    """Expressions behind :func:`linearised`: residual and those derivatives that are not zero, and
    the shapes of those that are.

    Args:
        instrument: A kind that looks at the motion.
        quantity: One of its quantities.
        robot: Its cables.
        asked: Terms of the instrument and ``gravity``, ``anchors``, ``attachments`` by which there
            are derivatives, all others count as zero; None: all.
    """
    pose, rate, acceleration = (ca.SX.sym(name, 7) for name in ("pose", "rate", "acceleration"))
    gravity = ca.SX.sym("gravity", 3)
    terms = {term.key: ca.SX.sym(term.key, term.size) for term in instrument.terms(robot.m)}
    errors = ca.vertcat(*terms.values()) if terms else ca.SX.sym("none", 1)
    tension = ca.SX.sym("tension", robot.m)
    fixed = {key: ca.SX.sym(key, 3 * robot.m) for key in _GEOMETRY}
    state = replace(
        state_of_pose(pose, rate, acceleration, gravity),
        tension=tension,
        **{key: ca.reshape(each, 3, robot.m) for key, each in fixed.items()},
    )
    predicted = ca.SX(instrument.predict(state, terms, robot)[quantity])
    measured = _symbol_like("measured", predicted)
    residual = (
        rotations.log(predicted.T @ measured) if predicted.shape == (3, 3) else measured - predicted
    )
    own = [each for key, each in terms.items() if asked is None or key in asked]
    beside = {
        f"by_{key}": each
        for key, each in {"gravity": gravity, **fixed}.items()
        if asked is None or key in asked
    }
    derivatives = jacobians(
        residual,
        {
            "by_pose": pose,
            "by_rate": rate,
            "by_acceleration": acceleration,
            "by_errors": ca.vertcat(*own) if own or asked is not None else errors,
            "by_tension": tension,
            **beside,
        },
    )
    inputs = {
        "pose": pose,
        "rate": rate,
        "acceleration": acceleration,
        "gravity": gravity,
        "errors": errors,
        "measured": measured,
        **{
            key: each
            for key, each in {"tension": tension, **fixed}.items()
            if robot.m and ca.depends_on(predicted, each)
        },
    }
    there = {name: ca.densify(each) for name, each in derivatives.items() if each.nnz()}
    return (
        Batched("linearised", inputs, {"residual": residual, **there}),
        {name: each.shape for name, each in derivatives.items() if not each.nnz()},
    )


def without_effect(
    instrument: Instrument, quantity: str, robot: Robot, asked: frozenset[str] | None = None
) -> Collection[str]:
    """Names of the derivatives of :func:`linearised` that are zero whatever the motion."""
    return difference_of(instrument, quantity, robot, asked)[1].keys()


def linearised(
    instrument: Instrument,
    quantity: str,
    robot: Robot,
    measured: Array,
    motion: tuple[Array, Array, Array],
    errors: Array,
    gravity: Array,
    tension: Array | None = None,
    geometry: Mapping[str, Array] | None = None,
    asked: frozenset[str] | None = None,
) -> dict[str, Array]:
    """Measurement equation of one quantity about a motion: what is measured beyond what is
    predicted, and its derivatives.

    Of a rotation the difference is the rotation vector on the right of the predicted one.

    Args:
        instrument: A kind that looks at the motion.
        quantity: One of its quantities, of k numbers.
        robot: Its cables.
        measured: Readings, shape (n, k) or (n, 3, 3).
        motion: Position [m] over quaternion, its first and second time derivative, shape (n, 7)
            each.
        errors: Systematic errors in the order of :meth:`Instrument.terms`, shape (e,).
        gravity: World frame [m/s^2], shape (3,).
        tension: Of the cables at the platform [N], shape (n, m), for instruments that look at them
            too.
        geometry: ``anchors`` in the world and ``attachments`` in the platform frame [m], three
            numbers a cable; None: those of the robot file.
        asked: See :func:`difference_of`.

    Returns:
        ``residual``, shape (n, k), and its derivatives ``by_pose``, ``by_rate``,
        ``by_acceleration``, shape (n, k, 7), ``by_errors``, shape (n, k, e), of the terms that are
        asked for, ``by_gravity``, shape (n, k, 3), ``by_tension``, shape (n, k, m), ``by_anchors``
        and ``by_attachments``, shape (n, k, 3 m), where they are asked for.
    """
    pose, rate, acceleration = motion
    batched, zero = difference_of(instrument, quantity, robot, asked)
    if geometry is None:
        geometry = {key: getattr(robot, key).ravel() for key in _GEOMETRY}
    looked_at = {} if tension is None else {"tension": tension}
    if "anchors" in batched.inputs:
        looked_at |= geometry
    found = batched(
        pose=pose,
        rate=rate,
        acceleration=acceleration,
        errors=errors,
        gravity=gravity,
        measured=measured,
        **looked_at,
    )
    n = len(found["residual"])
    return {**found, **{name: np.broadcast_to(0.0, (n, *shape)) for name, shape in zero.items()}}


@lru_cache(maxsize=64)
def following_of(
    unknown: str,
    instrument: Instrument,
    robot: Robot,
    quantities: tuple[str, ...],
    remembered: bool = False,
) -> Batched | None:
    """Expressions behind :func:`following`; None where readings say the same whatever the
    motion.
    """
    pose, rate = ca.SX.sym("pose", 7), ca.SX.sym("rate", 7)
    symbolic = symbols(robot.m, remembered=remembered)
    sought = getattr(symbolic, unknown)
    state = replace(
        state_of_pose(pose, rate, ca.SX.zeros(7), ca.SX.zeros(3)),
        rolling=symbolic.rolling,
        **{unknown: sought},
    )
    predicted, terms = _predicted(instrument, robot, quantities, state)
    moved = {"by_pose": ca.jacobian(predicted, pose), "by_rate": ca.jacobian(predicted, rate)}
    if not any(each.nnz() for each in moved.values()):
        return None
    inverse = ca.inv(ca.jacobian(predicted, ca.vec(sought)))
    outputs = [ca.densify(-inverse @ each) for each in moved.values()]
    inputs = {
        "pose": pose,
        "rate": rate,
        unknown: sought,
        **({"rolling": state.rolling} if remembered else {}),
        **{f"term_{key}": each for key, each in terms.items()},
    }
    return Batched("following", inputs, dict(zip(moved, ca.cse(outputs), strict=True)))


def following(
    unknown: str,
    instrument: Instrument,
    robot: Robot,
    quantities: tuple[str, ...],
    motion: tuple[Array, Array],
    found: Array,
    calibration: Mapping[str, Array],
    rolling: Array | None = None,
) -> tuple[Array, Array] | None:
    """How what :func:`solve_for` gives follows the motion for the same readings, by the implicit
    function theorem.

    Args:
        unknown: Name of a field of :class:`State`, of k numbers.
        instrument: Any kind that feels forces.
        robot: Its cables.
        quantities: That determine the unknown.
        motion: Position [m] over quaternion and its time derivative, shape (n, 7) each.
        found: The unknown, shape (n, k).
        calibration: Systematic errors, one array for each of :meth:`Instrument.terms`.
        rolling: What the rollers remember of the motion, shape (n, m); None: nothing.

    Returns:
        Derivative by pose and by rate, shape (n, k, 7) each; None where it does not follow.
    """
    batched = following_of(unknown, instrument, robot, quantities, rolling is not None)
    if batched is None:
        return None
    errors = {f"term_{key}": value for key, value in calibration.items()}
    given = {unknown: found, **({} if rolling is None else {"rolling": rolling})}
    values = batched(pose=motion[0], rate=motion[1], **given, **errors)
    return values["by_pose"], values["by_rate"]


@lru_cache(maxsize=64)
def sensitivity_of(
    unknown: str,
    instrument: Instrument,
    robot: Robot,
    quantities: tuple[str, ...],
    remembered: bool = False,
    asked: frozenset[str] | None = None,
) -> tuple[Batched, list[str]]:
    """Expressions behind :func:`sensitivity`, and which parts of state and ``term_…`` they take."""
    state = symbols(robot.m, remembered=remembered)
    predicted, terms = _predicted(instrument, robot, quantities, state)
    inverse = ca.inv(ca.jacobian(predicted, ca.vec(getattr(state, unknown))))
    own = [each for key, each in terms.items() if asked is None or key in asked]
    outputs = {
        "by_reading": ca.densify(inverse),
        "by_terms": ca.densify(-inverse @ ca.jacobian(predicted, ca.vertcat(*own))),
    }
    if state.rolling is not None:
        outputs["by_rolling"] = ca.densify(-inverse @ ca.jacobian(predicted, state.rolling))
    behind = {
        **{f"term_{key}": symbol for key, symbol in terms.items()},
        **_parts(state),
    }
    inputs = _taken(ca.veccat(*outputs.values()), behind)
    return Batched("sensitivity", inputs, outputs), list(inputs)


def sensitivity(
    unknown: str,
    instrument: Instrument,
    robot: Robot,
    quantities: tuple[str, ...],
    state: Mapping[str, Array],
    calibration: Mapping[str, Array],
    asked: frozenset[str] | None = None,
) -> tuple[Array, Array, Array | None]:
    """How what :func:`solve_for` gives follows the readings and the systematic errors, by the
    implicit function theorem.

    Args:
        unknown: Name of a field of :class:`State`, of k numbers.
        instrument: Any kind.
        robot: Its cables.
        quantities: That determine the unknown.
        state: Fields of the state over n samples, the unknown among them.
        calibration: Systematic errors, one array for each of :meth:`Instrument.terms`, e numbers in
            all.
        asked: Those by which there are derivatives; None: all.

    Returns:
        Derivative by the readings, shape (n, k, k), by the systematic errors, shape (n, k, e), and by
        what the rollers remember, shape (n, k, m), where that is part of the state.
    """
    batched, inputs = sensitivity_of(
        unknown, instrument, robot, quantities, "rolling" in state, asked
    )
    errors = {
        name: calibration[name.removeprefix("term_")] for name in inputs if name.startswith("term_")
    }
    values = batched(**errors, **{name: state[name] for name in inputs if name in _FIELDS})
    return values["by_reading"], values["by_terms"], values.get("by_rolling")


def follows_readings(
    unknown: str,
    instrument: Instrument,
    robot: Robot,
    quantities: tuple[str, ...],
    state: Mapping[str, Array],
    calibration: Mapping[str, Array],
) -> Array:
    """How what :func:`solve_for` gives follows the readings alone, shape (n, k, k), or (1, k, k) where
    it is the same for all samples; arguments as of :func:`sensitivity`.
    """
    form = _inversion(unknown, instrument, robot, quantities, "rolling" in state).inverse
    terms = {f"term_{key}": value for key, value in calibration.items()}
    k = state[unknown].shape[1]
    # Of one cable a column, which has no axis of its own.
    return form.evaluate({**terms, **state}).reshape(-1, k, k)
