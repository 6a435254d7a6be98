"""Gauss-Markov processes on the knots of a motion."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.interpolate import BSpline

from steelyard.identification.model.processes import Process, embedded, integrals_of, places
from steelyard.identification.model.segment import POSE, basis, values_at
from steelyard.smoothing import DEGREE, knots

GRID = knots(0.0, 6.0, 0.1)
SOURCE = ("imu", "orientation")


def dense(band):
    """The symmetric matrix of a lower banded form."""
    size = band.shape[1]
    found = np.zeros((size, size))
    for d, row in enumerate(band):
        found += np.diag(row[: size - d], -d)
        if d:
            found += np.diag(row[: size - d], d)
    return found


@pytest.mark.parametrize("time", [0.3, 1.0, 5.0])
def test_the_covariance_is_that_of_a_gauss_markov_process(time):
    """Far from the ends and of times well above the spacing of the knots."""
    own = Process(SOURCE, np.ones(1), 2.0, time, integrals_of(GRID))
    local = basis(GRID, np.array([2.0, 2.5, 3.0, 4.0]))
    functions = len(GRID) - DEGREE - 1
    rows = np.zeros((4, functions))
    for i, first in enumerate(local.first):
        rows[i, first : first + DEGREE + 1] = local.values[0][i]
    covariance = rows @ np.linalg.inv(dense(own.precision)) @ rows.T
    apart = np.abs(np.subtract.outer([2.0, 2.5, 3.0, 4.0], [2.0, 2.5, 3.0, 4.0]))
    assert covariance == pytest.approx(4.0 * np.exp(-apart / time), abs=0.25)


def test_the_cost_is_the_integral_that_defines_the_process():
    level, time = 0.7, 0.4
    own = Process(SOURCE, np.ones(2), level, time, integrals_of(GRID))
    coefficients = np.random.default_rng(1).normal(size=(len(GRID) - DEGREE - 1, 2))
    expected = 0.0
    start, end = 0.0, 6.0
    for column in coefficients.T:
        spline = BSpline(GRID, column, DEGREE)
        rate = spline.derivative()
        inner = np.unique(np.clip(GRID, start, end))
        moving = sum(
            quad(lambda t, x=spline, v=rate: (time * v(t) + x(t)) ** 2, a, b)[0]
            for a, b in pairwise(inner)
        )
        expected += (spline(start) ** 2 + moving / (2 * time)) / level**2
    assert own.roughness(coefficients) == pytest.approx(expected, rel=1e-6)


def test_the_determinant_is_that_of_all_components():
    own = Process(SOURCE, np.ones(3), 0.7, 0.4, integrals_of(GRID))
    assert own.log_determinant == pytest.approx(3 * np.linalg.slogdet(dense(own.precision))[1])


def test_a_component_stands_among_the_others():
    own = Process(SOURCE, np.ones(1), 1.0, 1.0, integrals_of(GRID))
    one = np.zeros((3, 3))
    one[1, 1] = 1.0
    found = dense(embedded(own.precision, 1, 3))
    assert found == pytest.approx(np.kron(dense(own.precision), one))


def test_processes_stand_behind_the_pose():
    first = Process(SOURCE, np.ones(3), 1.0, 1.0, integrals_of(GRID))
    second = Process(("cables", "tension"), np.ones(8), 1.0, 1.0, integrals_of(GRID))
    assert places([first, second]) == {
        SOURCE: slice(POSE, POSE + 3),
        ("cables", "tension"): slice(POSE + 3, POSE + 11),
    }


@pytest.mark.parametrize("order", [0, 1, 2])
def test_values_are_those_of_the_spline(order):
    rng = np.random.default_rng(2)
    coefficients = rng.normal(size=(len(GRID) - DEGREE - 1, 2))
    times = rng.uniform(0.0, 6.0, 20)
    found = values_at(basis(GRID, times), coefficients, order)
    expected = BSpline(GRID, coefficients, DEGREE).derivative(order)(times)
    assert found == pytest.approx(expected)


def test_changes_with_level_and_time_are_those_of_differences():
    own = Process(SOURCE, np.ones(3), 0.7, 0.4, integrals_of(GRID))
    step = 1e-5
    for i, moved in enumerate(
        (
            lambda factor: own.at(own.level * factor, own.time),
            lambda factor: own.at(own.level, own.time * factor),
        )
    ):
        more, less = moved(np.exp(step)), moved(np.exp(-step))
        expected = (more.precision - less.precision) / (2 * step)
        assert own.changes[i] == pytest.approx(
            expected, rel=1e-6, abs=1e-6 * np.abs(expected).max()
        )
        determinant = (more.log_determinant - less.log_determinant) / (2 * step)
        found = own.components * own.log_determinant_changes[i]
        assert found == pytest.approx(determinant, rel=1e-6, abs=1e-4)
