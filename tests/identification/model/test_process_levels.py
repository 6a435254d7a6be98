"""Levels of disturbances by marginal likelihood, against matrices that are full."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import multivariate_normal

from steelyard.arrays import Array
from steelyard.identification.model.accumulation import accumulate
from steelyard.identification.model.process_levels import ProcessLevel, _evidence, likeliest
from steelyard.identification.model.processes import Process, embedded, integrals_of, places
from steelyard.identification.model.segment import POSE, Rows, basis, spread
from steelyard.identification.solve.settings import FIT
from steelyard.smoothing import DEGREE, knots

GRID = knots(0.0, 12.0, 0.1)
FUNCTIONS = len(GRID) - DEGREE - 1
STEP = 0.04
TIMES = np.arange(STEP, 12.0, STEP)
FIRST, SECOND = ("imu", "orientation"), ("robot", "unmodelled force")
NOISE = 0.3


@dataclass(frozen=True, eq=False)
class Disturbed:
    """What is asked of a segment: a pose that is held at zero, and processes."""

    processes: tuple[Process, ...]

    @property
    def block(self) -> int:
        return POSE + sum(each.components for each in self.processes)

    @cached_property
    def coefficients(self) -> Array:
        return np.zeros((FUNCTIONS, self.block))

    @property
    def process_places(self):
        return places(self.processes)

    @property
    def prior_cost(self) -> float:
        return 0.0

    def smooth(self, equations):
        bands = [
            embedded(each.precision, i, self.block)
            for each in self.processes
            for i in range(*self.process_places[each.source].indices(self.block))
        ]
        still = np.zeros_like(bands[0])
        for place in range(POSE):
            still[0, place :: self.block] = 1e12
        return equations.stiffened([*bands, still], self.coefficients)


def walk(rng, level, time, count):
    """Samples of a stationary Gauss-Markov process, shape (t, count)."""
    kept = np.exp(-STEP / time)
    values = [level * rng.normal(size=count)]
    for _ in TIMES[1:]:
        values.append(kept * values[-1] + level * np.sqrt(1 - kept**2) * rng.normal(size=count))
    return np.array(values)


def read(own, readings):
    """Normal equations of readings of the sum of all processes."""
    local = basis(GRID, TIMES)
    derivative = np.zeros((len(TIMES), 3, own.block))
    for each in own.processes:
        derivative[:, :, own.process_places[each.source]] = np.eye(3) / NOISE
    rows = Rows(
        local.first,
        -readings / NOISE,
        spread(local, derivative, block=own.block),
        np.zeros((len(TIMES), 3, 0)),
    )
    return accumulate(FUNCTIONS, 0, [rows], width=6 * own.block, block=own.block)


def disturbed(*sources):
    integrals = integrals_of(GRID)
    return Disturbed(tuple(Process(each, np.ones(3), 1.0, 0.5, integrals) for each in sources))


def likelihood(readings, *processes):
    """Logarithm, by the full covariance of sums of processes of level and time, and noise."""
    apart = np.abs(np.subtract.outer(TIMES, TIMES))
    covariance = NOISE**2 * np.eye(len(TIMES))
    for level, time in processes:
        covariance += level**2 * np.exp(-apart / time)
    return float(multivariate_normal.logpdf(readings.T, cov=covariance).sum())


def recorded(seed, *processes):
    rng = np.random.default_rng(seed)
    return sum(walk(rng, *each, 3) for each in processes) + NOISE * rng.normal(size=(len(TIMES), 3))


@pytest.mark.integration
def test_level_and_time_are_those_of_the_full_likelihood():
    readings = recorded(3, (0.5, 0.8))
    own = disturbed(FIRST)
    found = likeliest([own], [read(own, readings)]).of[FIRST]
    expected = minimize(
        lambda logs: -likelihood(readings, np.exp(logs)), np.log([0.5, 0.8]), method="Nelder-Mead"
    )
    assert np.log([found.level, found.time]) == pytest.approx(expected.x, abs=0.15)
    assert found.gain == pytest.approx(-expected.fun - likelihood(readings), rel=0.03)


def test_a_level_stays_below_what_it_has_at_most():
    own = disturbed(FIRST)
    readings = read(own, recorded(3, (0.5, 0.8)))
    assert likeliest([own], [readings], largest={FIRST: 0.2}).of[FIRST].level == pytest.approx(0.2)
    free, bounded = (likeliest([own], [readings], largest=each).of for each in (None, {FIRST: 5.0}))
    assert bounded[FIRST].level == pytest.approx(free[FIRST].level, rel=1e-6)


def test_two_processes_share_what_each_explains():
    true = (0.6, 0.4), (1.5, 6.0)
    readings = recorded(5, *true)
    own = disturbed(FIRST, SECOND)
    own = Disturbed((own.processes[0], own.processes[1].at(1.0, 3.0)))
    found = likeliest([own], [read(own, readings)]).of
    levels = [(each.level, each.time) for each in found.values()]
    assert likelihood(readings, *levels) > likelihood(readings, *true) - 0.5
    assert min(each.gain for each in found.values()) > 10.0


def test_what_is_not_there_has_no_gain():
    readings = recorded(6, (1e-9, 1.0))
    own = disturbed(FIRST)
    assert likeliest([own], [read(own, readings)]).of[FIRST].gain < FIT.asked_for


# With body and calibration beside them

SHAPE = np.cos(2.0 * TIMES) + 0.3 * TIMES  # by which a parameter each acts on the first two axes
PRIOR = 5.0  # 1-sigma of them


def read_beside(own, readings):
    """Normal equations of readings of the sum of all processes and of two parameters."""
    local = basis(GRID, TIMES)
    derivative = np.zeros((len(TIMES), 3, own.block))
    for each in own.processes:
        derivative[:, :, own.process_places[each.source]] = np.eye(3) / NOISE
    by_parameters = np.zeros((len(TIMES), 3, 2))
    by_parameters[:, 0, 0] = by_parameters[:, 1, 1] = SHAPE / NOISE
    rows = Rows(
        local.first, -readings / NOISE, spread(local, derivative, block=own.block), by_parameters
    )
    return accumulate(FUNCTIONS, 2, [rows], width=6 * own.block, block=own.block)


def likelihood_beside(readings, *processes):
    """Logarithm, by the full covariance with that of the parameters."""
    apart = np.abs(np.subtract.outer(TIMES, TIMES))
    covariance = NOISE**2 * np.eye(len(TIMES))
    for level, time in processes:
        covariance += level**2 * np.exp(-apart / time)
    wide = covariance + PRIOR**2 * np.outer(SHAPE, SHAPE)
    return sum(
        float(multivariate_normal.logpdf(column, cov=own))
        for column, own in zip(readings.T, (wide, wide, covariance), strict=True)
    )


def prior():
    return np.eye(2) / PRIOR**2, np.zeros(2)


@pytest.mark.slow
@pytest.mark.integration
def test_parameters_beside_them_are_integrated_out():
    # What the parameters do is no process, however wrong they are.
    readings = recorded(7, (0.4, 0.8)) + np.outer(SHAPE, [6.0, -4.0, 0.0])
    own = disturbed(FIRST)
    found = likeliest([own], [read_beside(own, readings)], prior=prior()).of[FIRST]
    expected = minimize(
        lambda logs: -likelihood_beside(readings, np.exp(logs)),
        np.log([0.4, 0.8]),
        method="Nelder-Mead",
    )
    assert np.log([found.level, found.time]) == pytest.approx(expected.x, abs=0.15)
    gain = -expected.fun - likelihood_beside(readings)
    assert found.gain == pytest.approx(gain, rel=0.05)
    held = likeliest([own], [read_beside(own, readings)]).of[FIRST]
    assert held.level > 3 * found.level


def test_the_gradient_is_that_of_differences():
    readings = recorded(8, (0.4, 0.8)) + np.outer(SHAPE, [1.0, 2.0, 0.0])
    own = disturbed(FIRST, SECOND)
    pairs = [(own, read_beside(own, readings))]

    def at(logs):
        levels = dict(
            zip(
                (FIRST, SECOND),
                [ProcessLevel(*pair, 0.0) for pair in np.exp(logs).reshape(2, 2)],
                strict=True,
            )
        )
        return _evidence(pairs, levels, prior())

    logs = np.log([0.5, 0.4, 0.8, 3.0])
    _, gradient = at(logs)
    differences = [
        (at(logs + step)[0] - at(logs - step)[0]) / 2e-4 for step in 1e-4 * np.eye(len(logs))
    ]
    assert gradient == pytest.approx(differences, rel=1e-3, abs=1e-3)
