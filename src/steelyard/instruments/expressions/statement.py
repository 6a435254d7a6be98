"""What an instrument states, in symbols, and expressions of it that know what they take."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import casadi as ca

from steelyard.arrays import Array
from steelyard.batch import Batched, Symbol
from steelyard.instruments.base import Instrument
from steelyard.motion.state import State
from steelyard.robot.model import Robot


@dataclass(frozen=True, eq=False)
class Expression:
    """An expression of some of the systematic errors and of the state."""

    batched: Batched
    inputs: tuple[str, ...]

    def evaluate(self, values: Mapping[str, Array]) -> Array:
        """Its value over n samples; of what is given, it takes its inputs."""
        return self.batched(**{name: values[name] for name in self.inputs})["value"]


def predicted_by(
    instrument: Instrument, robot: Robot, quantities: tuple[str, ...], state: State
) -> tuple[Symbol, dict[str, Symbol]]:
    """Readings of some quantities in one column, and the symbols of the systematic errors that they
    are stated with.
    """
    terms = {term.key: ca.SX.sym(term.key, term.size) for term in instrument.terms(robot.m)}
    stated = instrument.predict(state, terms, robot)
    return ca.SX(ca.vertcat(*[ca.vec(stated[name]) for name in quantities])), terms


def parts_of(state: State) -> dict[str, Symbol]:
    """Fields of a state that are there, by name."""
    found = {f.name: getattr(state, f.name) for f in fields(State)}
    return {name: symbol for name, symbol in found.items() if symbol is not None}


def expression_of(expression: Symbol, state: State, terms: Mapping[str, Symbol]) -> Expression:
    """An expression of a state and of the systematic errors that it is stated with."""
    dense = ca.densify(expression)
    inputs = inputs_of(dense, state, terms)
    return Expression(Batched("part", inputs, {"value": dense}), tuple(inputs))


def inputs_of(expression: Symbol, state: State, terms: Mapping[str, Symbol]) -> dict[str, Symbol]:
    """Those of the systematic errors, as ``term_…``, and of the parts of a state that stand in an
    expression; it is walked through once for all.
    """
    behind = {**{f"term_{key}": symbol for key, symbol in terms.items()}, **parts_of(state)}
    there = {each.element_hash() for each in ca.symvar(expression)}
    return {
        name: symbol
        for name, symbol in behind.items()
        if any(each.element_hash() in there for each in ca.symvar(symbol))
    }
