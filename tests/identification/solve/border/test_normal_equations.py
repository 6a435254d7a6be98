"""Normal equations of the border, against stacked rows and Monte Carlo."""

from dataclasses import replace

import numpy as np
import pytest

from steelyard.identification.solve.border.directions import curvature
from steelyard.identification.solve.border.normal_equations import (
    Blocks,
    BorderEquations,
    BorderPrior,
    solve,
    summed,
    together,
)
from steelyard.identification.solve.border.scatter import enlarged
from steelyard.inertia import TEN

ROUNDING = 1e-8  # relative: normal equations lose half of the digits of stacked rows
ONES = np.ones(TEN)


def equations_of(A, b, noise=None):
    """Normal equations of n samples of six rows over k columns."""
    flat = A.reshape(-1, A.shape[2])
    noise = np.zeros((TEN, TEN)) if noise is None else noise
    return BorderEquations(flat.T @ flat, flat.T @ b.ravel(), noise, float(len(A)))


def blocks_of(A, b, block, run=0):
    """The same, block by block."""
    own = [equations_of(A[block == i], b[block == i]) for i in np.unique(block)]
    return Blocks(
        np.array([each.normal for each in own]),
        np.array([each.right for each in own]),
        np.full(len(own), run),
        np.arange(len(own), dtype=np.float64),
    )


def nothing_known(k):
    return BorderPrior(np.zeros((k, k)), np.zeros(k))


def random_positive(rng, k, size=1.0):
    M = rng.normal(size=(k, k)) * size
    return M @ M.T + 0.1 * size**2 * np.eye(k)


def assert_covariance(errors, covariance, sigmas=5.0):
    """Draws scatter as a covariance says: whitened, their second moments are those of the unit
    normal.

    The mean square of n draws has a standard deviation of sqrt(2 / n), a mean product 1 / sqrt(n).
    """
    values, vectors = np.linalg.eigh(covariance)
    kept = values > 1e-12 * values[-1]
    white = errors @ vectors[:, kept] / np.sqrt(values[kept])
    found = white.T @ white / len(white)
    limit = sigmas * np.where(np.eye(int(kept.sum())), np.sqrt(2), 1) / np.sqrt(len(white))
    assert np.all(np.abs(found - np.eye(int(kept.sum()))) < limit)


# Solving


@pytest.mark.parametrize("seed", range(4))
def test_solving_is_least_squares_over_rows_and_prior_stacked(seed):
    rng = np.random.default_rng(seed)
    n, errors = 60, 7
    k = TEN + errors
    A, b = rng.normal(size=(n, 6, k)), rng.normal(size=(n, 6))
    estimated = np.ones(k, dtype=bool)
    estimated[rng.choice(np.arange(TEN, k), 2, replace=False)] = False
    # Something is known about errors, and about the body as well.
    precision = np.zeros((k, k))
    precision[TEN:, TEN:] = random_positive(rng, errors, 3.0)
    precision[:TEN, :TEN] += 9.0 * np.outer(e := rng.normal(size=TEN), e)
    precision[~estimated, :] = precision[:, ~estimated] = 0.0
    known = rng.normal(size=k)
    found = solve(equations_of(A, b), BorderPrior(precision, precision @ known), estimated, ONES)

    flat, use = A.reshape(-1, k), np.flatnonzero(estimated)
    root = np.linalg.cholesky(precision[np.ix_(use, use)] + 1e-14 * np.eye(len(use))).T
    stacked = np.vstack([flat[:, use], root])
    target = np.concatenate([b.ravel(), root @ known[use]])
    expected, *_ = np.linalg.lstsq(stacked, target, rcond=None)
    np.testing.assert_allclose(found.value[use], expected, rtol=1e-6, atol=1e-7)
    np.testing.assert_array_equal(found.value[~estimated], 0.0)
    np.testing.assert_allclose(
        found.covariance[np.ix_(use, use)], np.linalg.inv(stacked.T @ stacked), rtol=1e-6, atol=1e-9
    )
    residual = b.ravel() - flat @ found.value
    hat = np.trace(flat[:, use] @ np.linalg.inv(stacked.T @ stacked) @ flat[:, use].T)
    assert found.spent == pytest.approx(hat, rel=ROUNDING)
    np.testing.assert_allclose(found.scores, flat.T @ residual, atol=1e-8 * 6 * n)
    assert found.wide.shape[1] == 0


def test_equations_and_blocks_of_several_runs_add_up(rng):
    n, k = 50, 13
    A, b = rng.normal(size=(n, 6, k)), rng.normal(size=(n, 6))
    one, other = (
        equations_of(A[:20], b[:20], np.eye(TEN)),
        equations_of(A[20:], b[20:], np.eye(TEN)),
    )
    both, whole = summed([one, other]), equations_of(A, b)
    np.testing.assert_allclose(both.normal, whole.normal)
    np.testing.assert_allclose(both.right, whole.right)
    np.testing.assert_allclose(both.noise, 2 * np.eye(TEN))
    assert both.freedom == n
    blocks = together([blocks_of(A, b, np.arange(n) // 10), blocks_of(A, b, np.arange(n) // 25, 1)])
    np.testing.assert_array_equal(blocks.run, [0] * 5 + [1] * 2)
    value = rng.normal(size=k)
    left = np.einsum("nri,nr->i", A, b - A @ value)
    np.testing.assert_allclose(blocks.scores(value)[:5].sum(axis=0), left, atol=1e-9)
    np.testing.assert_allclose(blocks.scores(value)[5:].sum(axis=0), left, atol=1e-9)


@pytest.mark.integration
def test_a_bias_by_noise_in_the_regressor_is_taken_off(rng):
    n, noise, draws = 300, 0.2, 200
    true, body = rng.normal(size=(n, 6, TEN)), rng.uniform(0.5, 2.0, TEN)
    # What independent noise in the columns does to the right-hand side in the mean.
    bias = n * 6 * noise**2 * body
    found = {"plain": [], "corrected": []}
    for _ in range(draws):
        own = true + noise * rng.normal(size=true.shape)
        given = equations_of(own, true @ body + rng.normal(size=(n, 6))), nothing_known(TEN)
        plain = solve(*given, np.ones(TEN, dtype=bool), ONES)
        corrected = solve(*given, np.ones(TEN, dtype=bool), ONES, bias)
        np.testing.assert_allclose(corrected.bias, corrected.value - plain.value, atol=1e-12)
        found["plain"].append(plain.value - body)
        found["corrected"].append(corrected.value - body)
    means = {key: np.mean(errors, axis=0) for key, errors in found.items()}
    sampling = {key: np.std(errors, axis=0) / np.sqrt(draws) for key, errors in found.items()}
    # Unit columns with independent noise are attenuated by the share of the noise in their square.
    expected = -body * noise**2 / (1 + noise**2)
    np.testing.assert_allclose(
        means["plain"], expected, atol=5 * sampling["plain"].max() + 0.05 * np.abs(expected).max()
    )
    assert np.all(np.abs(means["plain"]) > 5 * sampling["plain"])
    assert np.all(np.abs(means["corrected"]) < 5 * sampling["corrected"])


def deficient(rng, scale, strength=0.0):
    """Columns of the ten in units of their scale that say (nearly) nothing along one direction."""
    d = rng.normal(size=TEN)
    d /= np.linalg.norm(d)
    X = rng.normal(size=(50, 6, TEN))
    X = X - np.einsum("nri,i,j->nrj", X, d, d)
    if strength:
        X = X + strength / np.sqrt(300) * rng.choice([-1.0, 1.0], size=(50, 6, 1)) * d
    return X / scale, d


def test_a_direction_that_is_not_told_is_held_and_as_uncertain_as_plausible(rng):
    scale = 10 ** rng.uniform(-2, 3, TEN)
    A, d = deficient(rng, scale)
    b = rng.normal(size=(50, 6))
    sums = equations_of(A, b)
    found = solve(sums, nothing_known(TEN), np.ones(TEN, dtype=bool), scale)
    assert found.wide.shape[1] == 1
    np.testing.assert_allclose(np.abs(found.wide[:TEN, 0] / scale @ d), 1.0, rtol=1e-6)
    # What is told is what the shortest solution has in units of the plausible sizes.
    expected, *_ = np.linalg.lstsq((A * scale).reshape(-1, TEN), b.ravel(), rcond=1e-10)
    np.testing.assert_allclose(found.value / scale, expected, atol=1e-6)
    scaled = found.covariance / np.outer(scale, scale)
    assert d @ scaled @ d == pytest.approx(1.0, rel=1e-2)
    np.testing.assert_allclose(
        scaled - np.outer(d, d), np.linalg.pinv((A * scale).reshape(-1, TEN).T @ (A * scale).reshape(-1, TEN), rcond=1e-10),
        atol=1e-4,
    )  # fmt: skip


@pytest.mark.parametrize(("strength", "told"), [(0.3, False), (0.8, True)])
def test_a_direction_known_no_better_than_to_twice_its_plausible_size_is_not_told(
    rng, strength, told
):
    # Information strength^2 is a 1-sigma of 1 / strength plausible sizes; the bound is two of them.
    A, _ = deficient(rng, ONES, strength)
    sums = equations_of(A, rng.normal(size=(50, 6)))
    found = solve(sums, nothing_known(TEN), np.ones(TEN, dtype=bool), ONES)
    assert (found.wide.shape[1] == 0) == told


@pytest.mark.parametrize("share", [0.1, 0.5])
def test_a_direction_that_noise_alone_shows_is_not_told(rng, share):
    A, d = deficient(rng, ONES, 5.0)
    A = A + np.sqrt(share) / np.sqrt(300) * 5.0 * rng.normal(size=A.shape)
    noise = 4 * share * 25.0 * np.eye(TEN)
    sums = equations_of(A, rng.normal(size=(50, 6)), noise=noise)
    found = solve(sums, nothing_known(TEN), np.ones(TEN, dtype=bool), ONES)
    # Identifiable where the information exceeds what must be exceeded: 25 (1 + share) against 100
    # share.
    assert found.wide.shape[1] == (1 if share == 0.5 else 0)
    if share == 0.5:
        assert abs(found.wide[:TEN, 0] @ d) > 0.9


@pytest.mark.parametrize(("deviation", "told"), [(0.1, True), (100.0, False)])
def test_an_error_that_looks_like_the_body_hides_it_unless_it_is_known(rng, deviation, told):
    A = rng.normal(size=(40, 6, TEN + 1))
    A[:, :, TEN] = A[:, :, 0]
    precision = np.zeros((TEN + 1, TEN + 1))
    precision[TEN, TEN] = deviation**-2
    truth = np.arange(1.0, TEN + 2)
    truth[TEN] = 0.0
    sums = equations_of(A, A @ truth + rng.normal(size=(40, 6)))
    prior = BorderPrior(precision, np.zeros(TEN + 1))
    found = solve(sums, prior, np.ones(TEN + 1, dtype=bool), ONES)
    assert (found.wide.shape[1] == 0) == told
    assert np.sqrt(found.covariance[0, 0]) == pytest.approx(0.1 if told else 1.0, rel=0.3)
    np.testing.assert_allclose(found.value[1:TEN], truth[1:TEN], atol=0.5)


# Enlarging


def enlarged_by(rng, residual_of, *, runs=1, n=200, blocks=20):
    """Inflation and normalised errors of one draw of residuals."""
    parts, each, k, square = [], [], TEN + 2, 0.0
    truth = np.ones(k)
    for run in range(runs):
        A = rng.normal(size=(n, 6, k))
        block = np.arange(n) * blocks // n
        b = A @ truth + residual_of(A, block, rng)
        each.append(equations_of(A, b))
        parts.append(blocks_of(A, b, block, run))
        square += np.sum(b**2)
    total = summed(each)
    plain = solve(total, nothing_known(k), np.ones(k, dtype=bool), ONES)
    left = square - 2 * plain.value @ total.right + plain.value @ total.normal @ plain.value
    plain = replace(plain, ratio=left / (6 * total.freedom - plain.spent))
    found = enlarged(plain, together(parts), np.ones(TEN, dtype=bool), total.freedom)
    return found, (found.value - truth)[:TEN] / np.sqrt(np.diag(found.covariance)[:TEN]), plain


def white(A, block, rng):
    return rng.normal(size=A.shape[:2])


def coloured(A, block, rng):
    """Noise along the columns that stays the same within a block."""
    return white(A, block, rng) + np.einsum(
        "nrk,nk->nr", A, 0.3 * rng.normal(size=(block.max() + 1, A.shape[2]))[block]
    )


def different(A, block, rng):
    """Every run has a body of its own."""
    return white(A, block, rng) + A @ (0.3 * rng.normal(size=A.shape[2]))


@pytest.mark.integration
@pytest.mark.parametrize("runs", [1, 4])
def test_white_noise_is_rarely_taken_for_more(rng, runs):
    count = 300
    seen = [enlarged_by(rng, white, runs=runs, n=60, blocks=12)[0].inflation for _ in range(count)]
    # Each of two or three questions is asked at a level of five per cent; the largest answer is
    # kept.
    rate = np.mean([bool(s) for s in seen])
    assert 0.02 < rate < 0.05 * (2 if runs == 1 else 3) + 4 * np.sqrt(0.1 / count)
    assert all(1 < factor < 2.5 for s in seen for factor in s.values())


@pytest.mark.integration
@pytest.mark.parametrize(
    ("residual", "runs", "name"), [(coloured, 1, "blocks"), (different, 6, "runs")]
)
def test_errors_stay_within_what_was_enlarged(rng, residual, runs, name):
    draws = [enlarged_by(rng, residual, runs=runs) for _ in range(60)]
    assert all(list(found.inflation) == [name] for found, _, _ in draws)
    z = np.array([z for _, z, _ in draws])
    plain = np.array(
        [(found.value - 1)[:TEN] / np.sqrt(np.diag(p.covariance)[:TEN]) for found, _, p in draws]
    )
    assert np.sqrt(np.mean(plain**2)) > 2.5
    # Few blocks or runs tell the factor to a fifth; 600 numbers in draws of ten that share it tell
    # the mean to a few per cent.
    assert 0.85 < np.sqrt(np.mean(z**2)) < 1.15


def test_larger_noise_enlarges_by_its_variance(rng):
    found, _, plain = enlarged_by(rng, lambda A, block, rng: 2.0 * white(A, block, rng), n=1000)
    (factor,) = found.inflation.values()
    assert factor == pytest.approx(4.0, rel=0.35)
    np.testing.assert_allclose(
        found.covariance, plain.covariance + (factor - 1) * plain.noise_part, rtol=1e-12, atol=1e-15
    )


def test_smaller_noise_enlarges_nothing(rng):
    found, _, plain = enlarged_by(rng, lambda A, block, rng: 0.3 * white(A, block, rng))
    assert found.inflation == {}
    np.testing.assert_array_equal(found.covariance, plain.covariance)


def test_what_is_not_told_enlarges_nothing(rng):
    _, _, plain = enlarged_by(rng, different, runs=3)
    blocks = Blocks(
        np.zeros((0, TEN + 2, TEN + 2)), np.zeros((0, TEN + 2)), np.zeros(0, dtype=int), np.zeros(0)
    )
    assert enlarged(plain, blocks, np.zeros(TEN, dtype=bool), 10.0) is plain


def errors_in_variables(seed, count=300, weak=0.3, noise=0.3):
    """Ten regressors of unit size but for the last three, with noise of known size, and what they make
    of a body; estimate by singular values, and the normal equations with all regressors eliminated."""
    rng = np.random.default_rng(seed)
    body = np.array([1.0, 0.5, -0.4, 0.3, 0.6, 0.4, 0.5, 0.8, -0.9, 0.7])
    size = np.where(np.arange(TEN) < 7, 1.0, weak)
    true = size * rng.standard_normal((count, TEN))
    seen = true + noise * rng.standard_normal((count, TEN))
    read = true @ body + noise * rng.standard_normal(count)
    vectors = np.linalg.svd(np.column_stack([seen, read]))[2]
    found = -vectors[-1, :TEN] / vectors[-1, TEN]
    # Of the whole: one equation for each reading, and one for each regressor.
    variance = noise**2 * (1 + found @ found)
    left = read - seen @ found
    settled = seen + np.outer(left, found) * noise**2 / variance
    normal = settled.T @ settled / variance
    spread = noise**2 * (np.eye(TEN) - np.outer(found, found) * noise**2 / variance)
    by_noise = count * spread / variance
    return body, found, BorderEquations(normal, normal @ found, 0 * normal, count / 6, by_noise)


def test_covariance_of_an_estimate_whose_derivatives_are_noisy_is_true():
    """Against the scatter of total least squares by singular values."""
    nothing = nothing_known(TEN)
    every, whole, plain, bound = np.ones(TEN, dtype=bool), [], [], []
    for seed in range(200):
        body, found, equations = errors_in_variables(seed)
        solution = solve(equations, nothing, every, np.full(TEN, 100.0))
        np.testing.assert_allclose(solution.value, found, rtol=1e-6)
        error = found - body
        whole.append(error @ np.linalg.solve(solution.covariance, error))
        plain.append(error @ equations.normal @ error)
        bound.append(error @ np.linalg.solve(solution.attainable, error))
    # Chi-squares of ten, whose mean over 200 scatters by .32.
    assert 9.0 < np.mean(whole) < 11.0
    assert np.mean(plain) > 16.0
    np.testing.assert_allclose(plain, bound, rtol=1e-6)


def test_noise_takes_nothing_of_the_curvature_of_what_readings_tell_by_far():
    _, _, equations = errors_in_variables(0, count=3000, weak=1.0, noise=0.01)
    curved = curvature(equations.normal, equations.by_noise, ONES)
    np.testing.assert_allclose(
        curved, equations.normal, rtol=1e-3, atol=1e-3 * equations.normal[0, 0]
    )
    assert curvature(equations.normal, None, np.ones(TEN)) is equations.normal


def test_what_noise_tells_alone_is_told_by_nothing():
    """The curvature stays positive, and what nothing but noise tells is not identifiable."""
    _, _, equations = errors_in_variables(0, weak=0.0)
    curved = curvature(equations.normal, equations.by_noise, ONES)
    assert np.linalg.eigvalsh(curved).min() > 0
    nothing = nothing_known(TEN)
    solution = solve(equations, nothing, np.ones(TEN, dtype=bool), ONES)
    told = np.sqrt(np.diag(solution.covariance)) < 0.5
    assert told[:7].all()
    assert not told[7:].any()
