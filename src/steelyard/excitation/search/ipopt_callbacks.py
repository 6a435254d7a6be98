"""A nonlinear programme with exact first derivatives as CasADi functions, for IPOPT
[Waechter2006]_.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import casadi as ca
import numpy as np
from scipy.sparse import coo_array

from steelyard.arrays import Array

SearchProgress = Callable[[int, float], None]
"""Is given the number of the iteration and the objective there."""


class Programme(Protocol):
    """An objective and constraints that must be at most 1."""

    def objective(self, x: Array) -> tuple[float, Callable[[], Array]]:
        """Its value, and its gradient when asked for."""

    def constraints(self, x: Array) -> tuple[Array, coo_array]:
        """Their values, shape (g,), and their Jacobian, sparse, shape (g, x)."""


@dataclass
class _Iterate:
    value: float
    gradient: Callable[[], Array]
    constraints: Array
    jacobian: coo_array


class EvaluatedProgramme:
    """A programme at the last point, which the solver asks about piece by piece."""

    def __init__(
        self, programme: Programme, start: Array, accepted: float, progress: SearchProgress
    ) -> None:
        self.programme = programme
        self.start = start
        self._accepted = accepted
        self._progress = progress
        self._key = b""
        self._iterate: _Iterate | None = None
        self._gradient: Array | None = None
        self.gradients = 0
        self.best: Array | None = None
        """Of all points whose constraints are at most what is accepted."""
        self._least = np.inf

    def at(self, x: Any) -> _Iterate:
        """Values at a point."""
        x = np.asarray(x, dtype=np.float64).ravel()
        if self._iterate is None or x.tobytes() != self._key:
            self._iterate = _Iterate(*self.programme.objective(x), *self.programme.constraints(x))
            self._key = x.tobytes()
            self._gradient = None
        return self._iterate

    def gradient(self, x: Any) -> Array:
        """Of the objective at a point, which is then an iterate of the search."""
        iterate = self.at(x)
        if self._gradient is None:
            self._gradient = iterate.gradient()
            self.gradients += 1
            self._progress(self.gradients, iterate.value)
            if iterate.value < self._least and iterate.constraints.max() <= self._accepted:
                self.best = np.array(x, dtype=np.float64).ravel()
                self._least = iterate.value
        return self._gradient


class SolverFunctions:
    """The programme as CasADi's ``nlpsol`` takes it.

    CasADi does not own callbacks: this value has to live as long as the solver.
    """

    def __init__(self, evaluated: EvaluatedProgramme) -> None:
        n, first = len(evaluated.start), evaluated.at(evaluated.start)
        jacobian = first.jacobian
        # Column by column, as CasADi keeps its entries.
        order = np.lexsort((jacobian.row, jacobian.col))
        row, column = jacobian.row[order].tolist(), jacobian.col[order].tolist()
        count, _ = jacobian.shape
        entries = ca.Sparsity.triplet(count, n, row, column)
        dense = ca.Sparsity.dense
        x = ca.MX.sym("x", n)
        self._owned = (
            _ProgrammePart("objective", n, dense(1, 1), lambda x: evaluated.at(x).value),
            _ProgrammePart("gradient", n, dense(n, 1), evaluated.gradient),
            _ProgrammePart(
                "constraints", n, dense(count, 1), lambda x: evaluated.at(x).constraints
            ),
            _ProgrammePart("jacobian", n, entries, lambda x: evaluated.at(x).jacobian.data[order]),
        )
        f, grad_f, g, jac_g = (part(x) for part in self._owned)
        self.programme: dict[str, Any] = {"x": x, "f": f, "g": g}
        self.derivatives: dict[str, Any] = {
            "grad_f": _with_parameters("nlp_grad_f", x, [f, grad_f]),
            "jac_g": _with_parameters("nlp_jac_g", x, [g, jac_g]),
            "no_nlp_grad": True,
        }
        """Options of ``nlpsol``."""


def _with_parameters(name: str, x: Any, outputs: Sequence[Any]) -> Any:
    """A function of the form that the solver asks derivatives in."""
    return ca.Function(name, [x, ca.MX.sym("p", 0)], list(outputs))


class _ProgrammePart(ca.Callback):
    """One part of the programme as a function of the n unknowns."""

    def __init__(self, name: str, n: int, form: Any, value: Callable[[Any], Any]) -> None:
        ca.Callback.__init__(self)
        self._n, self._form, self._value = n, form, value
        self.construct(name, {})

    def get_sparsity_in(self, i: int) -> Any:
        return ca.Sparsity.dense(self._n, 1)

    def get_sparsity_out(self, i: int) -> Any:
        return self._form

    def eval(self, arg: Any) -> list[Any]:
        return [ca.DM(self._form, self._value(arg[0]))]
