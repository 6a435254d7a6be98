"""How what readings were solved for follows the motion, the readings and the systematic errors, by
the implicit function theorem.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import casadi as ca

from steelyard.batch import Batched
from steelyard.instruments.base import Instrument
from steelyard.instruments.expressions.statement import inputs_of, predicted_by
from steelyard.motion.state import state_of_pose, symbols
from steelyard.robot.model import Robot


@lru_cache(maxsize=64)
def following_of(
    unknown: str,
    instrument: Instrument,
    robot: Robot,
    quantities: tuple[str, ...],
    remembered: bool = False,
) -> Batched | None:
    """How the unknown follows pose and rate for the same readings; None where readings say the same
    whatever the motion.
    """
    pose, rate = ca.SX.sym("pose", 7), ca.SX.sym("rate", 7)
    symbolic = symbols(robot.m, remembered=remembered)
    sought = getattr(symbolic, unknown)
    state = replace(
        state_of_pose(pose, rate, ca.SX.zeros(7), ca.SX.zeros(3)),
        rolling=symbolic.rolling,
        **{unknown: sought},
    )
    predicted, terms = predicted_by(instrument, robot, quantities, state)
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


@lru_cache(maxsize=64)
def sensitivity_of(
    unknown: str,
    instrument: Instrument,
    robot: Robot,
    quantities: tuple[str, ...],
    remembered: bool = False,
    asked: frozenset[str] | None = None,
) -> tuple[Batched, list[str]]:
    """How the unknown follows readings, systematic errors and what the rollers remember, and which
    parts of state and ``term_…`` that takes.
    """
    state = symbols(robot.m, remembered=remembered)
    predicted, terms = predicted_by(instrument, robot, quantities, state)
    inverse = ca.inv(ca.jacobian(predicted, ca.vec(getattr(state, unknown))))
    own = [each for key, each in terms.items() if asked is None or key in asked]
    outputs = {
        "by_reading": ca.densify(inverse),
        "by_terms": ca.densify(-inverse @ ca.jacobian(predicted, ca.vertcat(*own))),
    }
    if state.rolling is not None:
        outputs["by_rolling"] = ca.densify(-inverse @ ca.jacobian(predicted, state.rolling))
    inputs = inputs_of(ca.veccat(*outputs.values()), state, terms)
    return Batched("sensitivity", inputs, outputs), list(inputs)
