"""Readings about a motion: what is measured beyond what is predicted, and its derivatives."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import casadi as ca

from steelyard import rotations
from steelyard.batch import Batched, Symbol, jacobians
from steelyard.instruments.base import Instrument
from steelyard.motion.state import state_of_pose
from steelyard.robot.model import Robot

GEOMETRY = ("anchors", "attachments")
"""Fields of a state that say where the cables are fixed."""


@lru_cache(maxsize=128)
def difference_of(
    instrument: Instrument, quantity: str, robot: Robot, asked: frozenset[str] | None = None
) -> tuple[Batched, dict[str, tuple[int, int]]]:
    """Residual of one quantity about a motion and those derivatives that are not zero, and
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
    fixed = {key: ca.SX.sym(key, 3 * robot.m) for key in GEOMETRY}
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


def _symbol_like(name: str, expression: Symbol) -> Symbol:
    return ca.SX.sym(name, *expression.shape)
