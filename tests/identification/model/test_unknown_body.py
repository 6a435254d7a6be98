"""The fit of a body that nobody knows, against other ways to solve the same least squares."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from steelyard.dynamics import platform_regressor
from steelyard.identification.model.unknown_body import BODY, unknown_body

N, OFFSETS = 40, 3
TOLERANCE = 1e-8  # relative; of normal equations of 13 numbers of like sizes


@pytest.fixture
def rows():
    """Columns of a body and of constants, shape (n, 6, 13), and a wrench beside them."""
    rng = np.random.default_rng(1)
    Y = platform_regressor(*(rng.normal(0, 1, (N, 3)) for _ in range(3)))
    columns = np.concatenate([Y, rng.normal(0, 1, (N, 6, OFFSETS))], axis=2)
    return columns, columns @ rng.normal(0, 1, 10 + OFFSETS) + rng.normal(0, 0.1, (N, 6))


def by_stacking(columns, target, precision, expected, weight):
    """The same problem as rows of one matrix, with a solver of another kind."""
    root = np.sqrt(np.repeat(weight, 6))[:, None]
    A = np.vstack([columns.reshape(-1, columns.shape[2]) * root, np.diag(np.sqrt(precision))])
    b = np.concatenate([target.ravel() * root[:, 0], np.sqrt(precision) * expected])
    return lsq_linear(A, b, method="bvls", tol=1e-14).x, np.linalg.inv(A.T @ A)


def test_it_is_the_least_squares_solution_with_its_prior(rows):
    columns, target = rows
    rng = np.random.default_rng(2)
    precision, expected = rng.uniform(0.5, 3, 13), rng.normal(0, 1, 13)
    weight = rng.uniform(0.1, 2, N)
    found = unknown_body(columns, target, precision, expected=expected, weight=weight)
    value, covariance = by_stacking(columns, target, precision, expected, weight)
    np.testing.assert_allclose(found.value, value, rtol=TOLERANCE, atol=TOLERANCE)
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-7, atol=TOLERANCE)
    np.testing.assert_allclose(found.standard_deviation, np.sqrt(np.diag(covariance)), rtol=1e-7)
    np.testing.assert_allclose(found.residual, target - columns @ value, atol=1e-7)
    assert found.penalty == pytest.approx(float(precision @ value**2), rel=1e-6)


def test_what_the_motion_does_not_tell_stays_small(rows):
    columns, target = rows
    columns = columns.copy()
    columns[:, :, 5] = 0.0  # a moment about which nothing turned
    columns[:, :, 6] = columns[:, :, 7]
    found = unknown_body(columns, target, np.zeros(13), ridge=1e-9)
    assert found.value[5] == 0
    assert found.value[6] == pytest.approx(found.value[7], rel=1e-3)
    plain, *_ = np.linalg.lstsq(columns.reshape(-1, 13), target.ravel(), rcond=1e-12)
    np.testing.assert_allclose(found.residual, target - columns @ plain, atol=1e-5)


def test_units_do_not_matter(rows):
    columns, target = rows
    scale = 10.0 ** np.arange(-6, 7)
    precision = np.full(13, 0.3)
    one = unknown_body(columns, target, precision)
    other = unknown_body(columns * scale, target, precision * scale**2)
    np.testing.assert_allclose(other.value * scale, one.value, rtol=1e-9)
    np.testing.assert_allclose(other.residual, one.residual, atol=1e-10)


def test_the_body_comes_first():
    assert slice(0, 10) == BODY
