"""The joint problem by scipy.optimize.least_squares, beside the package's own solver.

`python benchmarks/general_solver.py`.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
from recordings import recordings
from scipy.optimize import least_squares

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.experiment.read import read_experiment
from steelyard.identification.model.force_residuals import BALANCE, force_residuals
from steelyard.identification.model.motion_residuals import motion_residuals
from steelyard.identification.model.motion_segment import PARTS, Segment
from steelyard.identification.model.segment import POSE, Rows, basis
from steelyard.identification.solve import fit_readings
from steelyard.identification.solve.between_fits import cuts, lengths_by_tensions
from steelyard.identification.solve.fit_state import Fit, FitState, Task
from steelyard.identification.solve.joint_fit import fit
from steelyard.identification.solve.joint_motion import fit_jointly
from steelyard.identification.tally import Tally, limit
from steelyard.inertia import LINEAR_PARAMETERS, TEN
from steelyard.smoothing import DEGREE

PATIENCE = 300.0
"""[s]"""
MOST = 200
"""Evaluations."""
ARRIVED = 0.5
"""Excess of a chi-square over its least at which a solver has arrived: where the package's
stops."""


class LateError(Exception):
    """It takes too long."""


@dataclass
class Residuals:
    """The joint problem as residuals of all coefficients of the motion, the ten and the systematic
    errors.

    Noise and smoothness are held at what the state has. Huber's cost is that of a residual of
    length sqrt(2 c r - c^2).
    """

    task: Task
    state: FitState
    began: float = field(default_factory=time.perf_counter)
    trace: list[tuple[float, float, Array]] = field(default_factory=list)
    """Time [s], chi-square and point of every evaluation."""
    _last: tuple[Array, Array, sp.csr_matrix] | None = None

    def __post_init__(self) -> None:
        counts = [segment.coefficients.size for segment in self.state.segments]
        self.origins = np.concatenate([[0], np.cumsum(counts)])
        self.motion = int(self.origins[-1])
        self.columns = np.where(self.task.active, TEN + np.cumsum(self.task.active) - 1, -1)
        self.size = self.motion + TEN + int(self.task.active.sum())

    def point(self, state: FitState) -> Array:
        """Where a state stands, shape (N,)."""
        motion = [segment.coefficients.ravel() for segment in state.segments]
        return np.concatenate(
            [*motion, state.parameters, state.calibration.values[self.task.active]]
        )

    def at(self, point: Array) -> FitState:
        """The state at a point."""
        values = self.state.calibration.values.copy()
        values[self.task.active] = point[self.motion + TEN :]
        segments = tuple(
            replace(segment, coefficients=point[first:last].reshape(-1, POSE))
            for segment, first, last in zip(
                self.state.segments, self.origins[:-1], self.origins[1:], strict=True
            )
        )
        return replace(
            self.state,
            segments=segments,
            calibration=replace(self.state.calibration, values=values),
            parameters=point[self.motion : self.motion + TEN],
        )

    def residual(self, point: Array) -> Array:
        """Whitened, shape (M,)."""
        if time.perf_counter() - self.began > PATIENCE:
            raise LateError
        found = self._evaluated(point)[1]
        self.trace.append((time.perf_counter() - self.began, float(found @ found), point.copy()))
        return found

    def jacobian(self, point: Array) -> sp.csr_matrix:
        """Of the residuals, shape (M, N)."""
        return self._evaluated(point)[2]

    def _evaluated(self, point: Array) -> tuple[Array, Array, sp.csr_matrix]:
        if self._last is None or not np.array_equal(self._last[0], point):
            parts = list(self._parts(self.at(point)))
            residual = np.concatenate([part for part, _ in parts])
            self._last = (
                point.copy(),
                residual,
                sp.vstack([matrix for _, matrix in parts], format="csr"),
            )
        return self._last

    def _parts(self, state: FitState) -> Iterator[tuple[Array, sp.csr_matrix]]:
        task = self.task
        for segment, force_samples, origin in zip(
            state.segments, task.force_samples, self.origins[:-1], strict=True
        ):
            grouped = {
                segment.label(*each.source): 3 for each in segment.readings if each.values.ndim == 3
            }
            rows = motion_residuals(
                task.experiment, segment, state.calibration, self.columns, state.factors, Tally()
            )
            for part in rows:
                yield self._huber(part, int(origin), grouped.get(part.label, 1))
            given = (
                task.experiment,
                segment,
                force_samples,
                state.calibration,
                self.columns,
                state.parameters,
                state.factors,
                Tally(),
            )
            for part in force_residuals(*given):
                assert part.label == segment.label(force_samples.name, BALANCE)
                yield self._huber(part, int(origin), part.residual.shape[1])
            stiff = self._smooth(segment, int(origin))
            yield stiff @ self.point(state), stiff
        deviation = task.calibration_parameters.deviation[task.active]
        off = (state.calibration.values - task.calibration_parameters.mean)[task.active] / deviation
        columns = self.motion + TEN + np.arange(len(off))
        yield (
            off,
            sp.csr_matrix(
                (1 / deviation, (np.arange(len(off)), columns)), shape=(len(off), self.size)
            ),
        )

    def _huber(self, rows: Rows, origin: int, together: int) -> tuple[Array, sp.csr_matrix]:
        """Residuals whose squares add up to Huber's cost; rows hold sqrt(w) r and sqrt(w) J, w = c
        / r where r > c."""
        residual = rows.residual
        size = (
            np.abs(residual)
            if together == 1
            else np.sqrt(np.sum(residual**2, axis=1, keepdims=True))
        )
        far = limit(together) / np.maximum(size, 1e-300)
        weight = np.ones_like(size) if rows.label is None else np.where(far < 1, far**2, 1.0)
        root = np.broadcast_to(np.sqrt(2 - weight), residual.shape)
        n, k, width = rows.by_motion.shape
        border = TEN + int(self.task.active.sum())
        named = np.arange(border) if rows.columns is None else rows.columns
        first = np.broadcast_to(
            (origin + POSE * rows.first)[:, None, None] + np.arange(width), (n, k, width)
        )
        last = np.broadcast_to(self.motion + named, (n, k, len(named)))
        values = np.concatenate([rows.by_motion, rows.by_errors], axis=2) / root[:, :, None]
        columns = np.concatenate([first, last], axis=2)
        starts = np.arange(n * k + 1) * columns.shape[2]
        matrix = sp.csr_matrix((values.ravel(), columns.ravel(), starts), shape=(n * k, self.size))
        return (residual * root).ravel(), matrix

    def _smooth(self, segment: Segment, origin: int) -> sp.csr_matrix:
        """Third derivatives at the nodes of Gauss between knots, in 1-sigma of the white noise that
        they are."""
        inner = segment.knots[DEGREE : len(segment.knots) - DEGREE]
        nodes, weights = np.polynomial.legendre.leggauss(
            3
        )  # exact for squares of what is quadratic between knots
        half = np.diff(inner) / 2
        local = basis(
            segment.knots, (((inner[1:] + inner[:-1]) / 2)[:, None] + half[:, None] * nodes).ravel()
        )
        root = np.sqrt((half[:, None] * weights).ravel())
        intensity = np.ones(POSE)
        for part, place in PARTS.items():
            intensity[place] = segment.smoothness[part]
        values = (
            local.values[3][:, None, :] * root[:, None, None] / np.sqrt(intensity)[:, None]
        )  # (n, 7, 6)
        functions = local.first[:, None, None] + np.arange(DEGREE + 1)
        columns = np.broadcast_to(
            origin + POSE * functions + np.arange(POSE)[:, None], values.shape
        )
        starts = np.arange(values.shape[0] * POSE + 1) * (DEGREE + 1)
        shape = (values.shape[0] * POSE, self.size)
        return sp.csr_matrix((values.ravel(), columns.ravel(), starts), shape=shape)


def noticed(experiment: Experiment) -> list[tuple[Task, FitState, Fit]]:
    """Every joint fit that is made: what, from where, and where it ended."""
    fits: list[tuple[Task, FitState, Fit]] = []

    def noticing(task: Task, state: FitState, *given: Any, **named: Any) -> Fit:
        found = fit(task, state, *given, **named)
        fits.append((task, state, found))
        return found

    fitting = (fit_readings, cuts, lengths_by_tensions)
    for module in fitting:
        module.fit = noticing
    try:
        fit_jointly(experiment)
    finally:
        for module in fitting:
            module.fit = fit
    return fits


def general() -> None:
    """The joint problem by scipy.optimize.least_squares, beside the package's own solver."""
    path = next(path for name, path, _ in recordings() if name == "points-00")
    fits = noticed(read_experiment(path))
    task, start, found = next(each for each in fits if each[1].parameters is not None)
    assert found is fits[-1][2], "points-00 has nothing to leave out"
    problem = Residuals(task, found.state)
    best, least = problem.point(found.state), found.tally.cost
    matrix = problem.jacobian(best)
    own = problem.residual(best)
    prior = (found.state.calibration.values - task.calibration_parameters.mean)[
        task.active
    ] / task.calibration_parameters.deviation[task.active]
    assert np.isclose(own @ own, least + prior @ prior, rtol=1e-9)
    print(
        f"points-00: {matrix.shape[0]} residuals, {matrix.shape[1]} unknowns ({problem.motion} of"
        f" the motion, {TEN} of the body, {int(task.active.sum())} errors), {matrix.nnz}"
        f" derivatives; chi-square {own @ own:.3f}"
    )
    # On the knots of the joint fit, which are in the time of the clock of the forces.
    begun = replace(
        start,
        segments=tuple(
            replace(segment, coefficients=first.coefficients)
            for segment, first in zip(start.segments, fits[0][1].segments, strict=True)
        ),
        calibration=fits[0][1].calibration,
    )
    given = {"from the motion's fit": start, "from the beginning": begun}
    sigma = np.sqrt(np.diag(found.covariance))
    print(
        f"{'solver':66}{'time':>10}{'ratio':>9}{'evaluations':>13}{'steps':>7}{'arrived':>11}{'chi2 over':>12}{'off: ten':>10}{'errors':>8}"
        "   (off: from the package's answer, in its 1-sigma)"
    )
    for words, beginning in given.items():
        seconds, ours = _median(lambda from_=beginning: fit(task, from_))
        _line(
            f"package, all of it, {words}",
            seconds,
            1.0,
            (ours.turns, ours.turns),
            None,
            problem,
            ours.state,
            best,
            sigma,
        )
        held = replace(
            beginning,
            factors=found.state.factors,
            segments=tuple(
                replace(a, smoothness=b.smoothness)
                for a, b in zip(beginning.segments, found.state.segments, strict=True)
            ),
        )
        given_noise, again = _median(lambda from_=held: fit(task, from_))
        _line(
            f"package, noise and smoothness as found, {words}", given_noise, given_noise / seconds, (again.turns, again.turns),
            None, problem, again.state, best, sigma,
        )  # fmt: skip
        _general(
            "scipy trf, lsmr, jac", problem, held, words, seconds, best, sigma, jac=problem.jacobian
        )
    pattern = matrix.copy()
    pattern.data[:] = 1.0
    words, beginning = next(iter(given.items()))
    _general(
        "scipy trf, lsmr, finite differences", problem, beginning, words, _median(lambda: fit(task, start))[0], best, sigma,
        jac="2-point", jac_sparsity=pattern,
    )  # fmt: skip
    print(
        "(scipy is given noise and smoothness, which the package finds; 'arrived': within a"
        f" chi-square of {ARRIVED} of the package's; each of its evaluations makes the derivatives"
        " too)"
    )


def _median(call: Callable[[], Fit]) -> tuple[float, Fit]:
    """Median time of three calls [s], and what the last gave."""
    times = []
    for _ in range(3):
        start = time.perf_counter()
        found = call()
        times.append(time.perf_counter() - start)
    return statistics.median(times), found


def _general(
    what: str,
    problem: Residuals,
    beginning: FitState,
    words: str,
    reference: float,
    best: Array,
    sigma: Array,
    **how: object,
) -> None:
    """Solve by SciPy and print how that went."""
    # A fresh one: nothing that is known from before.
    problem = Residuals(problem.task, problem.state)
    how = {**how, **({"jac": problem.jacobian} if callable(how["jac"]) else {})}
    try:
        solved = least_squares(
            problem.residual,
            problem.point(beginning),
            method="trf",
            tr_solver="lsmr",
            x_scale="jac",
            max_nfev=MOST,
            **how,
        )
        seconds, counts = time.perf_counter() - problem.began, (solved.nfev, solved.njev)
        end = problem.at(solved.x)
        note = (
            f"; ended: {solved.message}"
            if solved.status > 0
            else f"; did not arrive within {MOST} evaluations"
        )
    except LateError:
        seconds, counts = time.perf_counter() - problem.began, (len(problem.trace), None)
        end = problem.at(min(problem.trace, key=lambda each: each[1])[2])
        note = f"; did not arrive within {PATIENCE:.0f} s"
    _line(
        f"{what}, {words}",
        seconds,
        seconds / reference,
        counts,
        problem.trace,
        problem,
        end,
        best,
        sigma,
        note,
    )


def _line(
    what: str,
    seconds: float,
    ratio: float,
    counts: tuple[int, int | None],
    trace: list[tuple[float, float, Array]] | None,
    problem: Residuals,
    end: FitState,
    best: Array,
    sigma: Array,
    note: str = "",
) -> None:
    fresh = Residuals(problem.task, problem.state)
    point = fresh.point(end)
    least, reached = (float(np.sum(fresh.residual(each) ** 2)) for each in (best, point))
    arrived = next((at for at, cost, _ in trace or () if cost < least + ARRIVED), None)
    off = np.abs(point - best)[problem.motion :] / np.where(sigma > 0, sigma, np.inf)
    print(
        f"{what:66}{seconds:8.2f} s{ratio:8.1f}x{counts[0]:13}{counts[1] or '-':>7}"
        + (f"{arrived:9.2f} s" if arrived is not None else f"{'':11}")
        + f"{reached - least:12.4f}{off[:TEN].max():10.4f}{off[TEN:].max():8.4f}   "
        + f"worst {LINEAR_PARAMETERS[int(np.argmax(off[:TEN]))]}{note}",
        flush=True,
    )


if __name__ == "__main__":
    general()
