"""Readings that follow from what is known of the state, and their derivatives by the systematic
errors.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca

from steelyard.batch import Batched
from steelyard.instruments.base import Instrument
from steelyard.instruments.expressions.statement import (
    Expression,
    expression_of,
    parts_of,
    predicted_by,
)
from steelyard.motion.state import symbols
from steelyard.robot.model import Robot


@lru_cache(maxsize=64)
def prediction_of(
    instrument: Instrument,
    robot: Robot,
    known: tuple[str, ...],
    errors: tuple[tuple[str, tuple[float, ...]], ...],
) -> Batched:
    """Those readings that follow from the known part of the state, for given systematic errors."""
    symbolic = symbols(robot.m, remembered="rolling" in known)
    readings = instrument.predict(symbolic, {key: ca.DM(value) for key, value in errors}, robot)
    unknown = [symbol for name, symbol in parts_of(symbolic).items() if name not in known]
    possible = {
        name: ca.SX(value)
        for name, value in readings.items()
        if not any(u.numel() and ca.depends_on(ca.SX(value), ca.vec(u)) for u in unknown)
    }
    return Batched("predict", {key: getattr(symbolic, key) for key in known}, possible)


@lru_cache(maxsize=64)
def term_columns_of(instrument: Instrument, quantity: str, robot: Robot) -> Expression:
    """Derivatives of the reading of one quantity by all systematic errors, beside each other."""
    state = symbols(robot.m)
    predicted, terms = predicted_by(instrument, robot, (quantity,), state)
    return expression_of(ca.jacobian(predicted, ca.vertcat(*terms.values())), state, terms)
