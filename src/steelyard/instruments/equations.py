"""Measurement equations over samples: forwards as they are stated, and backwards where they are linear in what is sought."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields

import casadi as ca

from steelyard.arrays import Array
from steelyard.batch import Batched, Symbol
from steelyard.errors import InputError
from steelyard.instruments.base import Instrument, Term
from steelyard.motion.state import State, symbols
from steelyard.robot.model import Robot


def means(instrument: Instrument, m: int) -> dict[str, Array]:
    """Systematic errors as known beforehand, one array for each of :meth:`Instrument.terms`."""
    return {term.key: term.mean for term in instrument.terms(m)}


def terms_behind(instrument: Instrument, quantity: str, robot: Robot) -> list[Term]:
    """Systematic errors that the reading of one quantity depends on."""
    values = {term.key: ca.SX.sym(term.key, term.size) for term in instrument.terms(robot.m)}
    reading = ca.SX(instrument.predict(symbols(robot.m), values, robot)[quantity])
    return [term for term in instrument.terms(robot.m) if ca.depends_on(reading, values[term.key])]


def predict(instrument: Instrument, robot: Robot, state: State, calibration: Mapping[str, Array]) -> dict[str, Array]:
    """Noise-free readings of an instrument.

    Args:
        instrument: Any kind.
        robot: Its cables.
        state: Arrays over n samples (constant ones without the leading axis); None where it is not known.
        calibration: Systematic errors, one array for each of :meth:`Instrument.terms`.

    Returns:
        One array over n samples for each quantity that can be had from the known part of the state.
    """
    symbolic = symbols(robot.m)
    readings = instrument.predict(symbolic, {k: ca.DM(v) for k, v in calibration.items()}, robot)
    known = {f.name: getattr(state, f.name) for f in fields(State) if getattr(state, f.name) is not None}
    unknown = [getattr(symbolic, f.name) for f in fields(State) if f.name not in known]
    possible = {
        name: ca.SX(value)
        for name, value in readings.items()
        if not any(u.numel() and ca.depends_on(ca.SX(value), ca.vec(u)) for u in unknown)
    }
    return Batched("predict", {k: getattr(symbolic, k) for k in known}, possible)(**known)


def solve_for(
    unknown: str,
    instrument: Instrument,
    robot: Robot,
    readings: Mapping[str, Array],
    given: Mapping[str, Array],
) -> Array:
    """The part of the platform's state that gives the readings of an instrument, which must be linear in it.

    Args:
        unknown: Name of a field of :class:`State`.
        instrument: With its systematic errors at their means.
        robot: Its cables.
        readings: Quantities that determine the unknown, arrays over n samples.
        given: Other fields of the state; all that the equation needs, and it may be more.

    Returns:
        The unknown over n samples.

    Raises:
        InputError: The equation needs a part of the state that is not given.
    """
    state = symbols(robot.m)
    target = getattr(state, unknown)
    stated = instrument.predict(state, {k: ca.DM(v) for k, v in means(instrument, robot.m).items()}, robot)
    names = list(readings)
    predicted = ca.vertcat(*[ca.vec(stated[name]) for name in names])
    measured = {name: _symbol_like(name, stated[name]) for name in names}
    column = ca.vec(target)
    jacobian = ca.jacobian(predicted, column)
    at_zero = ca.substitute(predicted, column, ca.DM.zeros(column.numel()))
    difference = ca.vertcat(*[ca.vec(s) for s in measured.values()]) - at_zero
    solution = ca.reshape(ca.solve(jacobian, difference), *target.shape)
    inputs = {f"measured_{name}": symbol for name, symbol in measured.items()}
    needed = {
        f.name: getattr(state, f.name)
        for f in fields(State)
        if getattr(state, f.name).numel() and ca.depends_on(solution, ca.vec(getattr(state, f.name)))
    }
    missing = [name for name in needed if name not in given]
    if missing:
        raise InputError(
            f"instrument of kind '{instrument.kind}': expected the platform's {' and '.join(missing)} beside its "
            f"{' and '.join(names).replace('_', ' ')}, found none; add a stream that tells it"
        )
    solved = Batched("solve", {**inputs, **needed}, {unknown: solution})
    values = {f"measured_{name}": readings[name] for name in names}
    return solved(**values, **{name: given[name] for name in needed})[unknown]


def _symbol_like(name: str, expression: Symbol) -> Symbol:
    return ca.SX.sym(name, *expression.shape)
