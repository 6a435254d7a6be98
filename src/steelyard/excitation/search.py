"""The search for the best course: a nonlinear programme for IPOPT [Waechter2006]_, with exact first
derivatives.

Everything is evaluated at fixed instants. The objective needs the whole motion, the demands only
the commands of one instant each, so that their derivatives are sparse.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from scipy.sparse import coo_array

from steelyard.arrays import Array
from steelyard.excitation.course import Along, Course
from steelyard.excitation.criterion import Criterion
from steelyard.excitation.demands import Demands
from steelyard.excitation.information import Outlook, Seen
from steelyard.excitation.ringing import Ringing
from steelyard.excitation.sight import AT

_PER_INTERVAL = 5
"""Instants between two knots of the course at which its demands are held."""
_CLOSE = 0.995
"""What demands may reach at these instants: between them they may be a little more."""
_ABOUT = 0.01
"""By how much the demands may be exceeded where a search is broken off; the motion is made smaller
afterwards."""
_TOLERANCE = 1e-3
_SETTLED, _SETTLED_STEPS = 2e-3, 6
"""Change of the objective, relative to it, that is no progress any more, and in how many steps in a
row."""
_MEMORY = 20
"""Steps that IPOPT remembers for second derivatives."""

Told = Callable[[int, float], None]
"""Is told the number of the step and the norm reached."""


@dataclass(frozen=True, eq=False)
class Found:
    """Where a search ended."""

    x: Array
    """Free coefficients of the course."""
    value: float
    """Logarithm of the norm of the criterion there."""
    excess: float
    """By how much the worst demand exceeds 1 there."""
    kept: Array | None
    """The best point on the way that keeps the demands, about; where the search was broken off it
    may be better."""
    steps: int
    in_time: bool
    """Whether it ended by itself."""


@dataclass(frozen=True, eq=False)
class Problem:
    """What is to be best, and what it has to keep to."""

    course: Course
    outlook: Outlook
    criterion: Criterion
    demands: Demands
    ringing: Ringing | None

    @cached_property
    def _looked(self) -> Along:
        return self.course.at(self.outlook.times)

    @cached_property
    def _held(self) -> Along:
        return self.course.at(self.course.instants(_PER_INTERVAL))

    @cached_property
    def _rung(self) -> Along:
        assert self.ringing is not None
        return self.course.at(self.ringing.times)

    def information(self, x: Array) -> tuple[Array, Seen]:
        """Of a course, shape (b, b)."""
        return self.outlook.information(self._looked.commands(x))

    def objective(self, x: Array) -> tuple[float, Callable[[], Array]]:
        """Logarithm of the norm of the criterion, and its derivative when asked for, shape (6
        f,).
        """
        information, seen = self.information(x)
        value, weight = self.criterion.value(information)
        return value, lambda: self._looked.gathered(self.outlook.slope(seen, weight))

    def constraints(self, x: Array) -> tuple[Array, coo_array]:
        """Numbers that must be at most 1, shape (g,), and their derivative, sparse, shape (g, 6
        f).
        """
        held = self._held
        commands = held.commands(x)[:, :AT]
        demanded, slope = self.demands.linearised(commands)
        values = [demanded.ravel()]
        n, g = demanded.shape
        columns, there = held.pattern
        slopes = held.spread(slope)
        there = np.broadcast_to(there[:, None, :], slopes.shape)
        rows = np.broadcast_to(np.arange(n * g).reshape(n, g, 1), slopes.shape)[there]
        entries = [(rows, np.broadcast_to(columns[:, None, :], slopes.shape)[there], slopes[there])]
        if self.ringing is not None:
            along = self._rung
            ringing, slope = self.ringing.value(along.commands(x)[:, :AT])
            values.append(np.array([ringing]))
            entries.append(
                (
                    np.full(self.course.size, n * g),
                    np.arange(self.course.size),
                    along.gathered(slope),
                )
            )
        i, j, v = (np.concatenate(parts) for parts in zip(*entries, strict=True))
        total = np.concatenate(values)
        return total, coo_array((v, (i, j)), shape=(len(total), self.course.size))

    def search(
        self, start: Array, *, steps: int, seconds: float, told: Told | None = None
    ) -> Found:
        """Improve a course.

        Args:
            start: Free coefficients; they need not be feasible.
            steps: At most.
            seconds: At most; then what has been reached is the answer.
            told: Is told of the progress.
        """
        evaluated = _Evaluated(self, start, told or (lambda step, value: None))
        x = ca.MX.sym("x", self.course.size)
        count = evaluated.at(start).constraints.shape[0]
        pieces = [
            _Objective(evaluated),
            _Slope(evaluated),
            _Constraints(evaluated),
            _Jacobian(evaluated),
        ]
        options = {
            "print_time": False,
            "grad_f": _with_parameters("nlp_grad_f", x, [pieces[0](x), pieces[1](x)]),
            "jac_g": _with_parameters("nlp_jac_g", x, [pieces[2](x), pieces[3](x)]),
            "no_nlp_grad": True,
            "error_on_fail": False,
            "ipopt": {
                "print_level": 0,
                "sb": "yes",
                "hessian_approximation": "limited-memory",
                "limited_memory_max_history": _MEMORY,
                "mu_strategy": "adaptive",
                "tol": _TOLERANCE,
                "acceptable_tol": 1e3 * _TOLERANCE,
                "acceptable_constr_viol_tol": _TOLERANCE,
                "acceptable_obj_change_tol": _SETTLED,
                "acceptable_iter": _SETTLED_STEPS,
                "max_iter": steps,
                "max_wall_time": max(seconds, 0.1),
            },
        }
        solver = ca.nlpsol(
            "design", "ipopt", {"x": x, "f": pieces[0](x), "g": pieces[2](x)}, options
        )
        found = solver(x0=start, lbg=-np.inf, ubg=np.full(count, _CLOSE))
        status = solver.stats()
        end = np.asarray(found["x"]).ravel()
        end = end if np.isfinite(end).all() else start
        point = evaluated.at(end)
        return Found(
            end,
            point.value,
            float(point.constraints.max() - 1),
            evaluated.best,
            int(status["iter_count"]),
            "time" not in str(status["return_status"]).lower(),
        )


def _with_parameters(name: str, x: Any, outputs: Sequence[Any]) -> Any:
    """A function of the form that the solver asks derivatives in."""
    return ca.Function(name, [x, ca.MX.sym("p", 0)], list(outputs))


@dataclass
class _Point:
    value: float
    slope: Callable[[], Array]
    constraints: Array
    jacobian: coo_array


class _Evaluated:
    """The problem at the last point, which the solver asks about piece by piece."""

    def __init__(self, problem: Problem, start: Array, told: Told) -> None:
        self.problem, self.start, self._told = problem, start, told
        self._key = b""
        self._point: _Point | None = None
        self._slope: Array | None = None
        self.slopes = 0
        self.best: Array | None = None
        """Of all points that keep the demands, about."""
        self._least = np.inf

    def at(self, x: Any) -> _Point:
        x = np.asarray(x, dtype=np.float64).ravel()
        if self._point is None or x.tobytes() != self._key:
            self._point = _Point(*self.problem.objective(x), *self.problem.constraints(x))
            self._key, self._slope = x.tobytes(), None
        return self._point

    def slope(self, x: Any) -> Array:
        point = self.at(x)
        if self._slope is None:
            self._slope = point.slope()
            self.slopes += 1
            self._told(self.slopes, point.value)
            if point.value < self._least and point.constraints.max() <= 1 + _ABOUT:
                self.best, self._least = np.array(x, dtype=np.float64).ravel(), point.value
        return self._slope


class _Piece(ca.Callback):
    """One part of the problem as a function of the free coefficients."""

    called = "piece"

    def __init__(self, evaluated: _Evaluated) -> None:
        ca.Callback.__init__(self)
        self._evaluated = evaluated
        self._form = self._sparsity()
        self.construct(self.called, {})

    def get_n_in(self) -> int:
        return 1

    def get_n_out(self) -> int:
        return 1

    def get_sparsity_in(self, i: int) -> Any:
        return ca.Sparsity.dense(self._evaluated.problem.course.size, 1)

    def get_sparsity_out(self, i: int) -> Any:
        return self._form

    def _sparsity(self) -> Any:
        raise NotImplementedError


class _Objective(_Piece):
    called = "objective"

    def _sparsity(self) -> Any:
        return ca.Sparsity.dense(1, 1)

    def eval(self, arg: Any) -> list[Any]:
        return [self._evaluated.at(arg[0]).value]


class _Slope(_Piece):
    called = "slope"

    def _sparsity(self) -> Any:
        return ca.Sparsity.dense(self._evaluated.problem.course.size, 1)

    def eval(self, arg: Any) -> list[Any]:
        return [ca.DM(self._evaluated.slope(arg[0]))]


class _Constraints(_Piece):
    called = "constraints"

    def _sparsity(self) -> Any:
        return ca.Sparsity.dense(len(self._evaluated.at(self._evaluated.start).constraints), 1)

    def eval(self, arg: Any) -> list[Any]:
        return [ca.DM(self._evaluated.at(arg[0]).constraints)]


class _Jacobian(_Piece):
    called = "jacobian"

    def _sparsity(self) -> Any:
        jacobian = self._evaluated.at(self._evaluated.start).jacobian
        # Column by column, as CasADi keeps its entries.
        self._order = np.lexsort((jacobian.row, jacobian.col))
        row, column = jacobian.row[self._order], jacobian.col[self._order]
        rows, columns = jacobian.shape
        return ca.Sparsity.triplet(rows, columns, row.tolist(), column.tolist())

    def eval(self, arg: Any) -> list[Any]:
        return [ca.DM(self._form, self._evaluated.at(arg[0]).jacobian.data[self._order])]
