"""Dead weights on single force sensors: rows of a table, without time."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import ClassVar, Literal

import casadi as ca
import numpy as np

from steelyard.batch import Batched, Symbol
from steelyard.instruments.base import Calibration, Instrument, Prior, Quantity, Term, exact
from steelyard.instruments.noise import Sigma
from steelyard.motion.state import State
from steelyard.robot.model import Robot

SCALE = "scale"
"""Key of the factor on all masses of a set."""


class WeightCalibration(Calibration):
    """Systematic errors, 1-sigma."""

    scale: Prior = exact()
    """Factor on all masses of the set: how well its weights are known as a whole."""


class Weight(Instrument):
    """Readings of force sensors under dead weights, one cell at a time: the weight hangs at rest on
    the cell itself, with no roller in between, and nothing else pulls at it.

    What a cell reads then is what the instrument named by ``of`` says of it.
    """

    tabular: ClassVar[bool] = True

    kind: Literal["weight"]
    of: str
    """Name of the ``tension`` instrument whose cells bear the weights."""
    noise: Sigma | None = None
    """1-sigma of each reading [N]."""
    calibration: WeightCalibration = WeightCalibration()

    @property
    def calibrates(self) -> str | None:
        """See :class:`Instrument`."""
        return self.of

    def quantities(self, m: int) -> tuple[Quantity, ...]:
        """See :class:`Instrument`."""
        return (
            Quantity("cable", (("cable",),), "1", None),
            Quantity("mass", (("mass",),), "kg", None),
            Quantity("force", (("f",),), "N", self.noise),
        )

    def terms(self, m: int) -> tuple[Term, ...]:
        """See :class:`Instrument`."""
        return (Term(SCALE, 1, "1", self.calibration.scale, nominal=1.0),)

    def predict(
        self, state: State, calibration: Mapping[str, Symbol], robot: Robot
    ) -> dict[str, Symbol]:
        """Nothing: no state of the platform says what it reads, see :func:`cells_under_weights`."""
        return {}


def _under_weights(
    cells: Instrument, pulls: Symbol, calibration: Mapping[str, Symbol], robot: Robot
) -> Symbol:
    """What the cells read at rest, each with a pull of its own; their cables and the weight of
    these are not there, shape (m,).
    """
    none = ca.SX(3, 1)
    at_rest = State(
        position=ca.DM(robot.anchors.mean(axis=0)),
        rotation=ca.DM.eye(3),
        velocity=none,
        omega=none,
        specific_force=none,
        alpha=none,
        tension=pulls,
        wrench=None,
        gravity=ca.DM(robot.gravity),
    )
    return cells.predict(at_rest, calibration, robot.with_straight_cables())["tension"]


@lru_cache(maxsize=16)
def cells_under_weights(cells: Instrument, robot: Robot) -> Batched:
    """What force sensors read while nothing moves and a weight hangs on each, by their own
    measurement equation, and its derivatives.

    Args:
        cells: Of kind ``tension``.
        robot: Whose cells they are, of m cables.

    Returns:
        A function of ``pull`` (n, m), mass times gravity on each cell [N], and of ``errors`` (p,),
        all of :meth:`Instrument.terms` one after the other. It gives ``reading`` (n, m) [N],
        ``by_errors`` (n, m, p) and ``by_pull`` (n, m, m).
    """
    terms = cells.terms(robot.m)
    pull = ca.SX.sym("pull", robot.m)
    errors = ca.SX.sym("errors", sum(term.size for term in terms))
    ends = np.cumsum([term.size for term in terms])
    values = {t.key: errors[e - t.size : e] for t, e in zip(terms, ends.tolist(), strict=True)}
    reading = ca.SX(_under_weights(cells, pull, values, robot))
    return Batched(
        "cells_under_weights",
        {"pull": pull, "errors": errors},
        {
            "reading": reading,
            "by_errors": ca.jacobian(reading, errors),
            "by_pull": ca.jacobian(reading, pull),
        },
    )
