"""Splines in time and their banded, bordered normal equations against SciPy's splines and dense
matrices."""

import numpy as np
import pytest
from scipy.interpolate import BSpline
from scipy.linalg import cholesky_banded

from steelyard.identification.banded import (
    banded_product,
    banded_square,
    banded_trace,
    solved,
)
from steelyard.identification.model.accumulation import accumulate
from steelyard.identification.model.segment import (
    POSE,
    WIDTH,
    Rows,
    at_rest,
    basis,
    motion_at,
    spread,
)
from steelyard.smoothing import DEGREE, knots

START, END, SPACING = 0.3, 2.9, 0.2  # [s]
ROUNDING = 1e-10  # relative to the largest number compared; sums of a few hundred products
STEP = 1e-6  # of central differences of functions that curve within 1e-2
DIFFERENCES = 1e-7  # relative, of central differences

EVEN = knots(START, END, SPACING)
UNEVEN = np.concatenate(
    [[START] * 6, START + np.cumsum([0.05, 0.4, 0.11, 0.3, 0.02, 0.7]), [END] * 6]
)


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
    coefficients = np.array([coefficient(UNEVEN[j + 1 : j + DEGREE + 1]) for j in range(count)])[
        :, None
    ] * np.ones(POSE)
    t = np.linspace(START, END, 21)
    pose, rate, acceleration, jerk = motion_at(basis(UNEVEN, t), coefficients)
    for found, expected in (
        (pose, t**4 / 24),
        (rate, t**3 / 6),
        (acceleration, t**2 / 2),
        (jerk, t),
    ):
        np.testing.assert_allclose(found, np.tile(expected[:, None], POSE), atol=1e-9)


FUNCTIONS, BORDER = 9, 4


@pytest.fixture
def parts(rng):
    """Readings of three instruments, of different numbers and noise; one of them has no sample
    left."""

    def rows(n, k):
        first = np.sort(rng.integers(0, FUNCTIONS - DEGREE, n))
        return Rows(
            first,
            rng.normal(size=(n, k)),
            rng.normal(size=(n, k, WIDTH)),
            rng.normal(size=(n, k, BORDER)),
        )

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
    np.testing.assert_allclose(
        equations.motion_step(border), expected[:-BORDER], rtol=1e-8, atol=1e-8
    )


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
    mixed = Rows(
        *(getattr(parts[0], key)[order] for key in ("first", "residual", "by_motion", "by_errors"))
    )
    one, other = (accumulate(FUNCTIONS, BORDER, iter([p, *parts[1:]])) for p in (parts[0], mixed))
    for key in ("band", "side", "corner", "motion_gradient", "border_gradient"):
        a, b = getattr(one, key), getattr(other, key)
        np.testing.assert_allclose(a, b, atol=ROUNDING * 100)


def test_a_motion_that_nothing_determines_is_refused(parts):
    some = parts[0]
    blind = Rows(
        some.first, some.residual, some.by_motion * (np.arange(WIDTH) % POSE != 2), some.by_errors
    )
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
        np.testing.assert_allclose(
            found[row], own.reshape(4, WIDTH), atol=DIFFERENCES * np.abs(expected).max()
        )
        expected[row, :, first : first + DEGREE + 1] = 0
    assert not expected.any()


def test_a_reading_of_the_pose_alone_needs_no_other_derivative(rng):
    times = rng.uniform(START, END, 5)
    local, by_pose = basis(EVEN, times), rng.normal(size=(5, 2, POSE))
    nothing = np.zeros_like(by_pose)
    np.testing.assert_array_equal(spread(local, by_pose), spread(local, by_pose, nothing, nothing))


# What the motion's matrix says by itself


FACTORED = 1e-8  # relative to the largest: rounding in a matrix of a condition of some thousands
LENGTHS = [6, 9, 10, 24]  # one instant, a part of a block of the recursion, whole blocks, several
GYRO, TRACKER = ("imu", "angular_velocity"), ("tracker", "position")


def motion_rows_of(rng, functions, width, n, k, label=None, border=BORDER):
    """Readings at random instants, every one of which has some."""
    instants = functions - width // POSE + 1
    first = np.sort(np.concatenate([np.arange(instants), rng.integers(0, instants, n)]))
    n = len(first)
    return Rows(
        first,
        rng.normal(size=(n, k)),
        rng.normal(size=(n, k, width)),
        rng.normal(size=(n, k, border)),
        label=label,
    )


def dense_motion(part, functions):
    """Jacobian by all coefficients, row by row."""
    n, k, width = part.by_motion.shape
    full = np.zeros((n, k, functions * POSE))
    for sample, first in enumerate(part.first):
        full[sample, :, first * POSE : first * POSE + width] = part.by_motion[sample]
    return full.reshape(n * k, -1)


def in_band(matrix, width):
    """Lower banded form of a symmetric matrix."""
    band = np.zeros((width, len(matrix)))
    for d in range(min(width, len(matrix))):
        band[d, : len(matrix) - d] = np.diag(matrix, -d)
    return band


def some_bands(rng, size, width, count=2):
    """Symmetric positive definite matrices that reach no further than their band, densely."""
    found = []
    for _ in range(count):
        full = rng.normal(size=(size, size))
        found.append(
            np.tril(np.triu(full + full.T, 1 - width), width - 1) + 4 * width * np.eye(size)
        )
    return found


def some_costs(rng, functions, width, count=2):
    """Such matrices between coefficients that some instant depends on."""
    return [
        blocks_that_meet(functions, width) * each
        for each in some_bands(rng, functions * POSE, width, count)
    ]


@pytest.mark.parametrize("touched", [(4,), (0, 2, 9), (0, 1, 2, 3, 4, 5, 6, 7, 8), range(10)])
@pytest.mark.parametrize("functions", [9, 40])
def test_rows_that_depend_on_few_coefficients_give_what_all_of_them_would(rng, functions, touched):
    # A pose and three processes beside it.
    block, instants, k = 10, functions - DEGREE, 3
    first = np.sort(rng.integers(0, instants, 5 * functions))
    n = len(first)
    by_motion = np.zeros((n, k, DEGREE + 1, block))
    by_motion[..., list(touched)] = rng.normal(size=(n, k, DEGREE + 1, len(touched)))
    part = Rows(
        first,
        rng.normal(size=(n, k)),
        by_motion.reshape(n, k, -1),
        rng.normal(size=(n, k, 2)),
        columns=np.array([0, 3]),
    )
    full = np.zeros((n, k, functions * block + BORDER))
    for sample, start in enumerate(first * block):
        full[sample, :, start : start + block * (DEGREE + 1)] = part.by_motion[sample]
    full[:, :, [functions * block, functions * block + 3]] = part.by_errors
    J = full.reshape(n * k, -1)
    found = accumulate(functions, BORDER, [part], width=block * (DEGREE + 1), block=block)
    matrix, gradient, size = J.T @ J, -J.T @ part.residual.ravel(), functions * block
    expected = in_band(matrix[:size, :size], block * (DEGREE + 1))
    np.testing.assert_allclose(found.band, expected, atol=ROUNDING * np.abs(matrix).max())
    for own, dense in (
        (found.side, matrix[:size, size:]),
        (found.corner, matrix[size:, size:]),
        (found.motion_gradient, gradient[:size]),
        (found.border_gradient, gradient[size:]),
    ):
        np.testing.assert_allclose(own, dense, atol=ROUNDING * np.abs(matrix).max())


@pytest.fixture(
    params=[(WIDTH, f) for f in LENGTHS] + [(POSE, 1), (POSE, 8)],
    ids=lambda p: f"width {p[0]} of {p[1]}",
)
def problem(request, rng):
    """Three kinds of rows of a spline, or of poses at rest; two of them of one instrument."""
    width, functions = request.param
    rows = [
        motion_rows_of(rng, functions, width, 40 * functions, 3, GYRO),
        motion_rows_of(rng, functions, width, 10 * functions, 2, TRACKER),
        motion_rows_of(rng, functions, width, 5 * functions, 3, GYRO),
        motion_rows_of(rng, functions, width, 0, 7),
    ]
    A = np.vstack([dense_motion(part, functions) for part in rows])
    return rows, accumulate(functions, BORDER, iter(rows), width=width), A, width, functions


def blocks_that_meet(functions, width):
    """Which pairs of coefficients some instant depends on, densely."""
    function = np.arange(functions * POSE) // POSE
    return np.abs(function[:, None] - function) < width // POSE


def test_the_inverse_is_the_dense_one_where_an_instant_depends_on_both(problem):
    _, equations, A, width, functions = problem
    dense = np.linalg.inv(A.T @ A)
    expected = in_band(np.where(blocks_that_meet(functions, width), dense, 0.0), width)
    told = in_band(blocks_that_meet(functions, width).astype(float), width)
    assert equations.inverse.shape == (width, functions * POSE)
    # Nothing stands beyond the end of the matrix.
    assert not equations.inverse[in_band(np.ones_like(dense), width) == 0].any()
    np.testing.assert_allclose(
        equations.inverse * told, expected, atol=FACTORED * np.abs(dense).max()
    )


def test_the_inverse_is_as_good_where_the_motion_is_stiff(problem, rng):
    # A prior that is many orders stiffer than the readings, as that of a smooth motion is.
    _, equations, A, width, functions = problem
    extra = 1e4 * some_costs(rng, functions, width, 1)[0]
    stiff = equations.stiffened([in_band(extra, width)], np.zeros((functions, POSE)))
    dense = np.linalg.inv(A.T @ A + extra)
    told = blocks_that_meet(functions, width)
    found = stiff.inverse * in_band(told.astype(float), width)
    np.testing.assert_allclose(
        found, in_band(dense * told, width), atol=FACTORED * np.abs(dense).max()
    )


def test_the_determinant_is_the_dense_one(problem):
    _, equations, A, *_ = problem
    assert equations.log_determinant == pytest.approx(np.linalg.slogdet(A.T @ A)[1], rel=ROUNDING)


def freedom(rows, A, functions, extra=0.0):
    """Label -> trace of its part of the hat matrix."""
    hat = np.diag(A @ np.linalg.inv(A.T @ A + extra) @ A.T)
    found, start = {}, 0
    for part in rows:
        end = start + part.residual.size
        found[part.label] = found.get(part.label, 0.0) + hat[start:end].sum()
        start = end
    return found


def test_freedom_that_the_motion_takes_is_the_trace_of_the_hat_matrix(problem):
    rows, equations, A, _, functions = problem
    spent, expected = equations.spent(), freedom(rows, A, functions)
    assert set(spent) == {GYRO, TRACKER, None}
    assert spent == pytest.approx(expected, rel=FACTORED)
    # Where nothing else holds the motion, it takes one of each coefficient.
    assert sum(spent.values()) == pytest.approx(functions * POSE, rel=FACTORED)


def test_a_stiff_motion_takes_less_freedom(problem, rng):
    rows, equations, A, width, functions = problem
    (extra,) = some_costs(rng, functions, width, 1)
    stiff = equations.stiffened([in_band(extra, width)], np.zeros((functions, POSE)))
    assert stiff.spent() == pytest.approx(freedom(rows, A, functions, extra), rel=FACTORED)
    assert sum(stiff.spent().values()) < functions * POSE


def test_a_cost_of_the_coefficients_counts_as_readings_of_them(problem, rng):
    rows, equations, A, width, functions = problem
    extra = some_costs(rng, functions, width)
    coefficients = rng.normal(size=(functions, POSE))
    stiff = equations.stiffened((in_band(each, width) for each in extra), coefficients)
    root = np.linalg.cholesky(sum(extra)).T
    E = np.vstack([part.by_errors.reshape(-1, BORDER) for part in rows])
    r = np.concatenate([part.residual.ravel() for part in rows])
    J = np.block([[A, E], [root, np.zeros((len(root), BORDER))]])
    expected = np.linalg.lstsq(J, -np.concatenate([r, root @ coefficients.ravel()]), rcond=None)[0]
    matrix, gradient = stiff.reduced()
    border = np.linalg.solve(matrix, gradient)
    np.testing.assert_allclose(border, expected[-BORDER:], rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(stiff.motion_step(border), expected[:-BORDER], rtol=1e-8, atol=1e-8)
    # What it is made of stays.
    np.testing.assert_array_equal(
        equations.band, accumulate(functions, BORDER, iter(rows), width=width).band
    )


@pytest.mark.parametrize(("size", "width"), [(1, 1), (5, 1), (7, 7), (20, 7), (90, WIDTH)])
def test_a_banded_product_is_the_dense_one(rng, size, width):
    (dense,) = some_bands(rng, size, width, 1)
    vector = rng.normal(size=size)
    band, before = in_band(dense, width), vector.copy()
    np.testing.assert_allclose(banded_product(band, vector), dense @ vector, rtol=ROUNDING)
    np.testing.assert_array_equal(vector, before)


@pytest.mark.parametrize(("size", "width"), [(1, 1), (3, 7), (20, 7)])
def test_a_banded_square_is_the_dense_one_within_its_band(rng, size, width):
    columns = rng.normal(size=(size, 4))
    dense = columns @ columns.T
    found = banded_square(columns, width)
    for d in range(width):
        np.testing.assert_allclose(found[d, : max(size - d, 0)], np.diag(dense, -d), rtol=ROUNDING)
        assert not found[d, max(size - d, 0) :].any()


@pytest.mark.parametrize(("size", "width"), [(1, 1), (5, 1), (7, 7), (20, 7), (90, WIDTH)])
def test_a_banded_trace_is_that_of_the_dense_product(rng, size, width):
    one, other = some_bands(rng, size, width)
    full = rng.normal(size=(size, size))
    full += full.T
    found = banded_trace(in_band(one, width), in_band(other, width))
    assert found == pytest.approx(np.trace(one @ other), rel=ROUNDING)
    # The second may reach further than it is told.
    found = banded_trace(in_band(one, width), in_band(full, width))
    assert found == pytest.approx(
        np.trace(one @ full), rel=ROUNDING, abs=ROUNDING * np.abs(one).max()
    )


@pytest.mark.parametrize("columns", [1, 15, 16, 64, 150])
@pytest.mark.parametrize("functions", [1, 5, 6, 23])
@pytest.mark.parametrize("block", [1, 7, 9])
def test_a_solution_with_a_banded_matrix_is_the_dense_one(rng, block, functions, columns):
    # Functions of a spline overlap with the five before and after.
    size, width = functions * block, block * (DEGREE + 1)
    function = np.arange(size) // block
    near = np.abs(function[:, None] - function) <= DEGREE
    root = np.where(near, rng.normal(size=(size, size)), 0.0)
    dense = np.where(near, root @ root.T, 0.0) + 40 * width * np.eye(size)
    factor = cholesky_banded(in_band(dense, width), lower=True)
    right = rng.normal(size=(size, columns))
    before = right.copy()
    found = solved(factor, right, block)
    np.testing.assert_allclose(found, np.linalg.solve(dense, right), rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(solved(factor, right[:, 0], block), found[:, 0], rtol=1e-10)
    np.testing.assert_array_equal(right, before)


def test_a_pose_at_rest_is_its_own_coefficients(rng):
    poses = np.array([2, 0, 1, 2, 2])
    coefficients = rng.normal(size=(3, POSE))
    pose, *others = motion_at(at_rest(poses), coefficients)
    np.testing.assert_array_equal(pose, coefficients[poses])
    for nothing in others:
        np.testing.assert_array_equal(nothing, 0.0)
    by_pose, by_rate = rng.normal(size=(2, 5, 3, POSE))
    np.testing.assert_array_equal(spread(at_rest(poses), by_pose, by_rate, by_rate), by_pose)


def test_rows_of_some_border_parameters_say_nothing_about_the_others(parts, rng):
    columns = [np.array([3, 0]), np.array([2]), np.arange(BORDER), np.zeros(0, dtype=int)]
    some = [
        Rows(p.first, p.residual, p.by_motion, p.by_errors[:, :, : len(c)], c)
        for p, c in zip(parts, columns, strict=True)
    ]
    filled = []
    for part, own in zip(some, columns, strict=True):
        by_errors = np.zeros((*part.residual.shape, BORDER))
        by_errors[:, :, own] = part.by_errors
        filled.append(Rows(part.first, part.residual, part.by_motion, by_errors))
    J, r = dense_rows(filled)
    expected = np.linalg.lstsq(J, -r, rcond=None)[0]
    equations = accumulate(FUNCTIONS, BORDER, iter(some))
    border = np.linalg.solve(*equations.reduced())
    np.testing.assert_allclose(border, expected[-BORDER:], rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(
        equations.motion_step(border), expected[:-BORDER], rtol=1e-8, atol=1e-8
    )


def test_samples_of_a_part_of_the_border_may_come_in_any_order(parts, rng):
    order, columns = rng.permutation(60), np.array([3, 1])
    part = parts[0]
    sorted_, mixed = (
        Rows(
            part.first[o],
            part.residual[o],
            part.by_motion[o],
            part.by_errors[o][:, :, columns],
            columns,
            GYRO,
        )
        for o in (np.arange(60), order)
    )
    one, other = (accumulate(FUNCTIONS, BORDER, iter([p])) for p in (sorted_, mixed))
    for key in ("band", "side", "corner", "motion_gradient", "border_gradient"):
        np.testing.assert_allclose(getattr(one, key), getattr(other, key), atol=ROUNDING * 100)
    assert set(other.parts) == {GYRO}


def test_a_long_motion_is_summed_up_as_a_short_one(rng):
    # Products are held of some instants at once; samples on both sides of the cut must all count.
    functions = 2100
    rows = motion_rows_of(rng, functions, POSE, 0, 2, border=1)
    equations = accumulate(functions, 1, [rows], width=POSE)
    J = rows.by_motion
    np.testing.assert_allclose(
        equations.band[0].reshape(-1, POSE),
        np.einsum("nki,nki->ni", J, J),
        rtol=ROUNDING,
        atol=ROUNDING,
    )
    np.testing.assert_allclose(
        equations.side[:, 0].reshape(-1, POSE),
        np.einsum("nki,nk->ni", J, rows.by_errors[:, :, 0]),
        atol=ROUNDING,
    )
    assert equations.corner[0, 0] == pytest.approx(np.sum(rows.by_errors**2), rel=ROUNDING)


def test_the_labels_together_make_the_band(problem):
    rows, equations, A, width, functions = problem
    for label in {part.label for part in rows}:
        own = np.vstack([dense_motion(part, functions) for part in rows if part.label == label])
        np.testing.assert_allclose(
            equations.parts[label], in_band(own.T @ own, width), atol=ROUNDING * len(A)
        )
    np.testing.assert_allclose(equations.band, in_band(A.T @ A, width), atol=ROUNDING * len(A))
