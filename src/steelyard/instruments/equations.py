"""Measurement equations over samples: forwards as they are stated, backwards where they are linear
in what is sought, about a motion, and how what was found backwards follows all that it was found
from.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import lru_cache

import casadi as ca
import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.instruments.base import Instrument, Term
from steelyard.instruments.expressions.implicit import following_of, sensitivity_of
from steelyard.instruments.expressions.inversion import inversion_of
from steelyard.instruments.expressions.linearisation import GEOMETRY, difference_of
from steelyard.instruments.expressions.prediction import prediction_of, term_columns_of
from steelyard.instruments.expressions.statement import parts_of, predicted_by
from steelyard.motion.state import State, state_of_pose, symbols
from steelyard.robot.model import Robot


def means(instrument: Instrument, m: int) -> dict[str, Array]:
    """Systematic errors as known beforehand, one array for each of :meth:`Instrument.terms`."""
    return {term.key: term.mean for term in instrument.terms(m)}


@lru_cache(maxsize=128)
def _stated_errors(instrument: Instrument, m: int) -> Mapping[str, Array]:
    """:func:`means` under the names of inputs; not to be changed."""
    return _errors(means(instrument, m))


def _errors(calibration: Mapping[str, Array]) -> dict[str, Array]:
    """Systematic errors under the names of inputs."""
    return {f"term_{key}": value for key, value in calibration.items()}


def terms_behind(instrument: Instrument, quantity: str, robot: Robot) -> list[Term]:
    """Systematic errors that the reading of one quantity depends on."""
    reading, errors = predicted_by(instrument, robot, (quantity,), symbols(robot.m))
    return [term for term in instrument.terms(robot.m) if ca.depends_on(reading, errors[term.key])]


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
    known = parts_of(state)
    stretching = known.pop("stretching", None)
    if stretching is not None and instrument.is_cable_motion:
        # How long a cable is follows from what stretches it.
        known["tension"] = stretching
    errors = tuple((key, tuple(np.ravel(value).tolist())) for key, value in calibration.items())
    return prediction_of(instrument, robot, tuple(known), errors)(**known)


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
    part = term_columns_of(instrument, quantity, robot)
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
    form = inversion_of(unknown, instrument, robot, tuple(readings), "rolling" in given)
    missing = [name for name in form.given if name not in given]
    if missing:
        raise InputError(
            f"instrument of kind '{instrument.kind}': expected the platform's"
            f" {' and '.join(missing)} beside its {' and '.join(readings).replace('_', ' ')}, found"
            " none; add a stream that tells it"
        )
    known = _stated_errors(instrument, robot.m) if calibration is None else _errors(calibration)
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


_STEPS = 4
"""Of Newton's method for readings that are nearly linear in the unknown: two reach rounding."""
_CLOSE = 1e-12
"""A step so much smaller than the largest reading is the last one."""


def needed_for(
    unknown: str, instrument: Instrument, robot: Robot, quantities: tuple[str, ...]
) -> tuple[str, ...]:
    """Other parts of the state that :func:`solve_for` takes to find one from the readings of some
    quantities.
    """
    return inversion_of(unknown, instrument, robot, quantities).given


@lru_cache(maxsize=128)
def order_of(instrument: Instrument, quantity: str, robot: Robot) -> int:
    """Highest time derivative of the pose that a quantity depends on: 0, 1 or 2."""
    pose, rate, acceleration = (ca.SX.sym(name, 7) for name in ("pose", "rate", "acceleration"))
    state = state_of_pose(pose, rate, acceleration, ca.SX.sym("gravity", 3))
    state = replace(state, tension=ca.SX.sym("tension", robot.m))
    predicted, _ = predicted_by(instrument, robot, (quantity,), state)
    if ca.depends_on(predicted, acceleration):
        return 2
    return 1 if ca.depends_on(predicted, rate) else 0


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
        geometry = {key: getattr(robot, key).ravel() for key in GEOMETRY}
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
    given = {unknown: found, **({} if rolling is None else {"rolling": rolling})}
    values = batched(pose=motion[0], rate=motion[1], **given, **_errors(calibration))
    return values["by_pose"], values["by_rate"]


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
        Derivative by the readings, shape (n, k, k), by the systematic errors, shape (n, k, e), and
        by what the rollers remember, shape (n, k, m), where that is part of the state.
    """
    batched, inputs = sensitivity_of(
        unknown, instrument, robot, quantities, "rolling" in state, asked
    )
    given = {**_errors(calibration), **state}
    values = batched(**{name: given[name] for name in inputs})
    return values["by_reading"], values["by_terms"], values.get("by_rolling")


def follows_readings(
    unknown: str,
    instrument: Instrument,
    robot: Robot,
    quantities: tuple[str, ...],
    state: Mapping[str, Array],
    calibration: Mapping[str, Array],
) -> Array:
    """How what :func:`solve_for` gives follows the readings alone, shape (n, k, k), or (1, k, k)
    where it is the same for all samples; arguments as of :func:`sensitivity`.
    """
    form = inversion_of(unknown, instrument, robot, quantities, "rolling" in state).inverse
    k = state[unknown].shape[1]
    # Of one cable a column, which has no axis of its own.
    return form.evaluate({**_errors(calibration), **state}).reshape(-1, k, k)
