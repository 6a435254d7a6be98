"""The search for the best motion: a nonlinear programme over the free coefficients of a spline.

Everything is evaluated at fixed instants. The objective needs the whole motion, the constraints
only the commands of one instant each, so that their derivatives are sparse.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array

from steelyard.arrays import Array
from steelyard.excitation.command.commanded_state import COMMAND
from steelyard.excitation.command.motion_spline import MotionSpline, SplineSamples
from steelyard.excitation.information.optimality_criterion import OptimalityCriterion
from steelyard.excitation.information.predicted_information import (
    InformationTerms,
    PredictedInformation,
)
from steelyard.excitation.limits.cable_vibration import CableVibration
from steelyard.excitation.limits.motion_constraints import MotionConstraints
from steelyard.excitation.search.ipopt_callbacks import (
    EvaluatedProgramme,
    SearchProgress,
    SolverFunctions,
)
from steelyard.excitation.settings import DEFAULT, DesignSettings

_LEAST_SECONDS = 0.1
"""That IPOPT is given at least [s]: it takes no smaller number."""


@dataclass(frozen=True, eq=False)
class SearchResult:
    """Where a search ended."""

    x: Array
    """Free coefficients of the motion."""
    value: float
    """Logarithm of the norm of the criterion there."""
    excess: float
    """By how much the worst constraint exceeds 1 there."""
    best_feasible: Array | None
    """The best iterate whose constraints hold, about; where the search was broken off it may be
    better."""
    steps: int
    in_time: bool
    """Whether it ended by itself."""


@dataclass(frozen=True, eq=False)
class DesignProblem:
    """What is optimised over motion splines, and its constraints."""

    spline: MotionSpline
    predicted: PredictedInformation
    criterion: OptimalityCriterion
    motion_constraints: MotionConstraints
    vibration: CableVibration | None
    settings: DesignSettings = DEFAULT

    @cached_property
    def _information_samples(self) -> SplineSamples:
        return self.spline.at(self.predicted.times)

    @cached_property
    def _constraint_samples(self) -> SplineSamples:
        return self.spline.at(self.spline.midpoints(self.settings.constraint_instants))

    @cached_property
    def _vibration_samples(self) -> SplineSamples:
        assert self.vibration is not None
        return self.spline.at(self.vibration.times)

    def information(self, x: Array) -> tuple[Array, InformationTerms]:
        """Of a motion, shape (b, b)."""
        return self.predicted.information(self._information_samples.commands(x))

    def objective(self, x: Array) -> tuple[float, Callable[[], Array]]:
        """Logarithm of the norm of the criterion, and its gradient when asked for, shape (6 f,)."""
        information, terms = self.information(x)
        value, weight = self.criterion.value(information)

        def gradient() -> Array:
            return self._information_samples.gradient(self.predicted.gradient(terms, weight))

        return value, gradient

    def constraints(self, x: Array) -> tuple[Array, coo_array]:
        """Numbers that must be at most 1, shape (g,), and their Jacobian, sparse, shape (g, 6
        f).
        """
        samples = self._constraint_samples
        values, by_command = self.motion_constraints.linearised(samples.commands(x)[:, :COMMAND])
        found = values.ravel()
        i, j, v = _entries(samples, by_command)
        if self.vibration is not None:
            samples = self._vibration_samples
            value, slope = self.vibration.value(samples.commands(x)[:, :COMMAND])
            every = np.arange(self.spline.size)
            i = np.concatenate([i, np.full(self.spline.size, len(found))])
            j = np.concatenate([j, every])
            v = np.concatenate([v, samples.gradient(slope)])
            found = np.concatenate([found, [value]])
        return found, coo_array((v, (i, j)), shape=(len(found), self.spline.size))

    def search(
        self,
        start: Array,
        *,
        steps: int,
        seconds: float,
        progress: SearchProgress | None = None,
    ) -> SearchResult:
        """Improve a motion.

        Args:
            start: Free coefficients; they need not be feasible.
            steps: At most.
            seconds: At most; then what has been reached is the answer.
            progress: Is given every iterate.
        """
        chosen = self.settings
        evaluated = EvaluatedProgramme(
            self, start, 1 + chosen.accepted_excess, progress or (lambda step, value: None)
        )
        count = evaluated.at(start).constraints.shape[0]
        functions = SolverFunctions(evaluated)
        options = {
            "print_time": False,
            "error_on_fail": False,
            **functions.derivatives,
            "ipopt": _ipopt_options(chosen, steps, seconds),
        }
        solver = ca.nlpsol("design", "ipopt", functions.programme, options)
        found = solver(x0=start, lbg=-np.inf, ubg=np.full(count, chosen.constraint_limit))
        status = solver.stats()
        end = np.asarray(found["x"]).ravel()
        end = end if np.isfinite(end).all() else start
        iterate = evaluated.at(end)
        return SearchResult(
            end,
            iterate.value,
            float(iterate.constraints.max() - 1),
            evaluated.best,
            int(status["iter_count"]),
            "time" not in str(status["return_status"]).lower(),
        )


def _entries(
    samples: SplineSamples, by_command: Array
) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """Rows, columns and values of the Jacobian of constraints of single instants.

    Args:
        samples: Of the motion at n instants.
        by_command: Derivatives of the g constraints by the commands, shape (n, g, 18).
    """
    n, g, _ = by_command.shape
    columns, inside = samples.sparsity
    values = samples.jacobian(by_command)
    inside = np.broadcast_to(inside[:, None, :], values.shape)
    rows = np.broadcast_to(np.arange(n * g).reshape(n, g, 1), values.shape)
    columns = np.broadcast_to(columns[:, None, :], values.shape)
    return rows[inside], columns[inside], values[inside]


def _ipopt_options(settings: DesignSettings, steps: int, seconds: float) -> dict[str, Any]:
    """Options of IPOPT; see its documentation."""
    return {
        "print_level": 0,
        "sb": "yes",
        "hessian_approximation": "limited-memory",
        "limited_memory_max_history": settings.memory,
        "mu_strategy": "adaptive",
        "tol": settings.tolerance,
        "acceptable_tol": 1e3 * settings.tolerance,
        "acceptable_constr_viol_tol": settings.tolerance,
        "acceptable_obj_change_tol": settings.settled_change,
        "acceptable_iter": settings.settled_steps,
        "max_iter": steps,
        "max_wall_time": max(seconds, _LEAST_SECONDS),
    }
