"""Splines in time and their banded, bordered normal equations against SciPy's splines and dense matrices."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from steelyard.identification.arc import POSE, WIDTH, Rows, accumulate, basis, motion_at, spread
from steelyard.identification.smoothing import DEGREE, knots

START, END, SPACING = 0.3, 2.9, 0.2  # [s]
ROUNDING = 1e-10  # relative to the largest number compared; sums of a few hundred products
STEP = 1e-6  # of central differences of functions that curve within 1e-2
DIFFERENCES = 1e-7  # relative, of central differences

EVEN = knots(START, END, SPACING)
UNEVEN = np.concatenate([[START] * 6, START + np.cumsum([0.05, 0.4, 0.11, 0.3, 0.02, 0.7]), [END] * 6])


def all_functions(grid, times, order):
    """Every spline function at every time, densely, shape (n, f)."""
    count = len(grid) - DEGREE - 1
    return BSpline(grid, np.eye(count), DEGREE)(times, nu=order)


def dense(local, grid, order):
    """What a basis holds, scattered to all functions."""
    full = np.zeros((len(local.first), len(grid) - DEGREE - 1))
    for row, first in enumerate(local.first):
        full[row, first : first + DEGREE + 1] = local.values[order, row]
    return full


TIMES = {
    "anywhere": np.sort(np.random.default_rng(1).uniform(START, END, 50)),
    "at the inner knots": None,
    "at the ends": np.array([START, END]),
    "repeated": np.array([START, START, 0.77, 0.77, 0.77, 1.9, END, END]),
    "just inside the ends": np.array([np.nextafter(START, END), np.nextafter(END, START)]),
    "a single one": np.array([1.0]),
}


@pytest.mark.parametrize("order", range(4))
@pytest.mark.parametrize("where", TIMES)
@pytest.mark.parametrize("grid", [EVEN, UNEVEN], ids=["even", "uneven"])
def test_spline_functions_and_their_derivatives_are_those_of_scipy(grid, where, order):
    times = grid[DEGREE + 1 : -DEGREE - 1] if TIMES[where] is None else TIMES[where]
    expected = all_functions(grid, times, order)
    found = dense(basis(grid, times), grid, order)
    size = np.abs(all_functions(grid, np.linspace(START, END, 200), order)).max()
    np.testing.assert_allclose(found, expected, atol=ROUNDING * size)


def test_a_motion_is_the_spline_with_its_coefficients(rng):
    coefficients = rng.normal(size=(len(UNEVEN) - DEGREE - 1, POSE))
    times = np.sort(np.concatenate([rng.uniform(START, END, 30), UNEVEN]))
    spline = BSpline(UNEVEN, coefficients, DEGREE)
    for order, found in enumerate(motion_at(basis(UNEVEN, times), coefficients)):
        expected = spline(times, nu=order)
        np.testing.assert_allclose(found, expected, atol=ROUNDING * np.abs(expected).max())


def test_a_motion_of_constant_snap_has_the_derivatives_of_its_polynomial():
    # Blossoms: the coefficients of t^4 / 24 are elementary symmetric means of the knots.
    def coefficient(inner):
        pairs = [np.prod([inner[i] for i in chosen]) for chosen in FOURS]
        return np.mean(pairs) / 24

    FOURS = [(0, 1, 2, 3), (0, 1, 2, 4), (0, 1, 3, 4), (0, 2, 3, 4), (1, 2, 3, 4)]
    count = len(UNEVEN) - DEGREE - 1
    coefficients = np.array([coefficient(UNEVEN[j + 1 : j + DEGREE + 1]) for j in range(count)])[:, None] * np.ones(
        POSE
    )
    t = np.linspace(START, END, 21)
    pose, rate, acceleration, jerk = motion_at(basis(UNEVEN, t), coefficients)
    for found, expected in ((pose, t**4 / 24), (rate, t**3 / 6), (acceleration, t**2 / 2), (jerk, t)):
        np.testing.assert_allclose(found, np.tile(expected[:, None], POSE), atol=1e-9)


FUNCTIONS, BORDER = 9, 4


@pytest.fixture
def parts(rng):
    """Readings of three instruments, of different numbers and noise; one of them has no sample left."""

    def rows(n, k):
        first = np.sort(rng.integers(0, FUNCTIONS - DEGREE, n))
        return Rows(first, rng.normal(size=(n, k)), rng.normal(size=(n, k, WIDTH)), rng.normal(size=(n, k, BORDER)))

    return [rows(60, 3), rows(0, 3), rows(25, 7), rows(1, 1)]


def dense_rows(parts):
    """Jacobian over all coefficients and border parameters, and the residual, row by row."""
    jacobian, residual = [], []
    for part in parts:
        for sample, first in enumerate(part.first):
            for row in range(part.residual.shape[1]):
                line = np.zeros(FUNCTIONS * POSE + BORDER)
                for function in range(DEGREE + 1):
                    for number in range(POSE):
                        place = (first + function) * POSE + number
                        line[place] = part.by_motion[sample, row, function * POSE + number]
                line[FUNCTIONS * POSE :] = part.by_errors[sample, row]
                jacobian.append(line)
                residual.append(part.residual[sample, row])
    return np.array(jacobian), np.array(residual)


def test_the_step_is_that_of_dense_least_squares(parts):
    J, r = dense_rows(parts)
    # The residual is linearised as r + J x: least squares asks for J x = -r.
    expected = np.linalg.lstsq(J, -r, rcond=None)[0]
    equations = accumulate(FUNCTIONS, BORDER, iter(parts))
    matrix, gradient = equations.reduced()
    border = np.linalg.solve(matrix, gradient)
    np.testing.assert_allclose(border, expected[-BORDER:], rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(equations.motion_step(border), expected[:-BORDER], rtol=1e-8, atol=1e-8)


def test_the_reduced_matrix_is_the_inverse_of_the_border_s_covariance(parts):
    J, _ = dense_rows(parts)
    covariance = np.linalg.inv(J.T @ J)[-BORDER:, -BORDER:]
    matrix, _ = accumulate(FUNCTIONS, BORDER, iter(parts)).reduced()
    np.testing.assert_allclose(np.linalg.inv(matrix), covariance, rtol=1e-8, atol=1e-12)


def test_the_step_of_the_motion_goes_with_any_step_of_the_border(parts, rng):
    J, r = dense_rows(parts)
    A, E, border = J[:, :-BORDER], J[:, -BORDER:], rng.normal(size=BORDER)
    expected = np.linalg.lstsq(A, -r - E @ border, rcond=None)[0]
    equations = accumulate(FUNCTIONS, BORDER, iter(parts))
    np.testing.assert_allclose(equations.motion_step(border), expected, rtol=1e-8, atol=1e-8)


def test_the_order_of_the_samples_does_not_matter(parts, rng):
    order = rng.permutation(60)
    mixed = Rows(*(getattr(parts[0], key)[order] for key in ("first", "residual", "by_motion", "by_errors")))
    one, other = (accumulate(FUNCTIONS, BORDER, iter([p, *parts[1:]])) for p in (parts[0], mixed))
    for key in ("band", "side", "corner", "motion_gradient", "border_gradient"):
        a, b = getattr(one, key), getattr(other, key)
        np.testing.assert_allclose(a, b, atol=ROUNDING * 100)


def test_a_motion_that_nothing_determines_is_refused(parts):
    some = parts[0]
    blind = Rows(some.first, some.residual, some.by_motion * (np.arange(WIDTH) % POSE != 2), some.by_errors)
    with pytest.raises(np.linalg.LinAlgError):
        accumulate(FUNCTIONS, BORDER, iter([blind])).reduced()


WEIGHTS = np.random.default_rng(9).normal(size=(3, 4, POSE))


def reading(pose, rate, acceleration):
    """Four numbers that depend on pose, rate and acceleration, nonlinearly."""
    a, b, c = (x @ w.T for x, w in zip((pose, rate, acceleration), WEIGHTS, strict=True))
    return np.sin(a) * b + np.cos(c) + a * c


def reading_derivatives(pose, rate, acceleration):
    a, b, c = (x @ w.T for x, w in zip((pose, rate, acceleration), WEIGHTS, strict=True))
    by = (np.cos(a) * b + c, np.sin(a), a - np.sin(c))
    return [each[:, :, None] * w for each, w in zip(by, WEIGHTS, strict=True)]


def test_derivatives_by_the_coefficients_are_those_of_differences(rng):
    times = np.sort(rng.uniform(START, END, 12))
    local = basis(EVEN, times)
    coefficients = 0.1 * rng.normal(size=(len(EVEN) - DEGREE - 1, POSE))
    found = spread(local, *reading_derivatives(*motion_at(local, coefficients)[:3]))
    expected = np.zeros((len(times), 4, *coefficients.shape))
    for function, number in np.ndindex(coefficients.shape):
        step = np.zeros_like(coefficients)
        step[function, number] = STEP
        ahead, behind = (reading(*motion_at(local, coefficients + s)[:3]) for s in (step, -step))
        expected[:, :, function, number] = (ahead - behind) / (2 * STEP)
    for row, first in enumerate(local.first):
        own = expected[row, :, first : first + DEGREE + 1]
        np.testing.assert_allclose(found[row], own.reshape(4, WIDTH), atol=DIFFERENCES * np.abs(expected).max())
        expected[row, :, first : first + DEGREE + 1] = 0
    assert not expected.any()


def test_a_reading_of_the_pose_alone_needs_no_other_derivative(rng):
    times = rng.uniform(START, END, 5)
    local, by_pose = basis(EVEN, times), rng.normal(size=(5, 2, POSE))
    nothing = np.zeros_like(by_pose)
    np.testing.assert_array_equal(spread(local, by_pose), spread(local, by_pose, nothing, nothing))
