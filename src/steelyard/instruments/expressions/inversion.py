"""Readings solved for a part of the state that they are linear in, or nearly equal to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import lru_cache

import casadi as ca
import numpy as np

from steelyard.arrays import Array
from steelyard.instruments.base import Instrument
from steelyard.instruments.expressions.statement import Expression, expression_of, predicted_by
from steelyard.motion.state import State, symbols
from steelyard.robot.model import Robot

_FIELDS = frozenset(f.name for f in fields(State))


@dataclass(frozen=True, eq=False)
class Inversion:
    """Readings as a function of the unknown: about zero where they are linear in it, else about
    present values of it.
    """

    inverse: Expression
    """Of the derivative by the unknown."""
    value: Expression
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


@lru_cache(maxsize=128)
def inversion_of(
    unknown: str,
    instrument: Instrument,
    robot: Robot,
    quantities: tuple[str, ...],
    remembered: bool = False,
) -> Inversion:
    """The equation of some quantities and its derivative by the unknown, inverted."""
    state = symbols(robot.m, remembered=remembered)
    predicted, terms = predicted_by(instrument, robot, quantities, state)
    column = ca.vec(getattr(state, unknown))
    slope = ca.jacobian(predicted, column)
    linear = not ca.depends_on(slope, column)
    value = ca.substitute(predicted, column, ca.DM.zeros(column.numel())) if linear else predicted
    return Inversion(
        expression_of(ca.inv(slope), state, terms), expression_of(value, state, terms), unknown
    )
