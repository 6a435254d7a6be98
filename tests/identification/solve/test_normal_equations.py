"""Normal equations and the balance behind them, against stacked rows, Monte Carlo and samples
prepared again."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from simulated import BODY, CENTER, IDEAL, PAPER, ROBOT, at_rest, changed, moving, sound
from steelyard.identification.model.balance import (
    balance,
    by_geometry,
    by_lag,
    by_motion_errors,
    freedom,
    motion_errors,
    motion_noise,
    regressor_noise,
    shared_noise,
    whitener,
)

from steelyard.dynamics import platform_regressor, platform_wrench
from steelyard.identification.model.calibration_parameters import ROBOT as OWN
from steelyard.identification.model.calibration_parameters import Calibration, gather
from steelyard.identification.model.preparation import Samples, prepare
from steelyard.identification.solve import study
from steelyard.identification.solve.normal_equations import (
    TEN,
    Blocks,
    Prior,
    Rows,
    block_numbers,
    enlarged,
    robust_weights,
    solve,
    sums_of,
    together,
)

ROUNDING = 1e-8  # relative: normal equations lose half of the digits of stacked rows
ONES = np.ones(TEN)


def rows_of(A, b, *, Z=None, noise=None, shared=None, block=None):
    """Rows of n samples over k columns."""
    n, _, k = A.shape
    return Rows(
        A,
        A if Z is None else Z,
        b,
        np.zeros((TEN, TEN)) if noise is None else noise,
        np.zeros(k) if shared is None else shared,
        np.arange(n) * 20 // n if block is None else block,
    )


def summed(A, b, **keys):
    return sums_of(rows_of(A, b, **keys), np.ones(len(A)), float(len(A)), 0)


def nothing_known(k):
    return Prior(np.zeros(k), np.zeros((k, k)), np.zeros(k), np.zeros((k, k)))


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
    mean = np.concatenate([np.zeros(TEN), rng.normal(size=errors)])
    known = np.concatenate([rng.normal(size=TEN), mean[TEN:]])
    precision[np.ix_(estimated, ~estimated)] = precision[np.ix_(~estimated, estimated)] = 0.0
    sums, _ = summed(A, b)
    found = solve(
        sums,
        Prior(mean, precision, precision @ known, np.zeros((k, k))),
        estimated,
        ONES,
        correct=False,
    )

    flat, use = A.reshape(-1, k), np.flatnonzero(estimated)
    root = np.linalg.cholesky(precision[np.ix_(use, use)] + 1e-14 * np.eye(len(use))).T
    stacked = np.vstack([flat[:, use], root])
    target = np.concatenate([b.ravel() - flat[:, ~estimated] @ mean[~estimated], root @ known[use]])
    expected, *_ = np.linalg.lstsq(stacked, target, rcond=None)
    np.testing.assert_allclose(found.value[use], expected, rtol=1e-6, atol=1e-7)
    np.testing.assert_array_equal(found.value[~estimated], mean[~estimated])
    np.testing.assert_allclose(
        found.covariance[np.ix_(use, use)], np.linalg.inv(stacked.T @ stacked), rtol=1e-6, atol=1e-9
    )
    residual = b.ravel() - flat @ found.value
    hat = np.trace(flat[:, use] @ np.linalg.inv(stacked.T @ stacked) @ flat[:, use].T)
    assert found.spent == pytest.approx(hat, rel=ROUNDING)
    assert found.ratio == pytest.approx(residual @ residual / (6 * n - hat), rel=ROUNDING)
    np.testing.assert_allclose(found.residual_scores, flat.T @ residual, atol=1e-8 * 6 * n)
    assert found.untold.shape == (TEN, 0)


def test_sums_are_those_of_the_weighted_rows(rng):
    n, k = 50, 13
    A, Z, b = rng.normal(size=(n, 6, k)), rng.normal(size=(n, 6, TEN)), rng.normal(size=(n, 6))
    weight = rng.uniform(0.1, 1.0, n)
    noise, shared = random_positive(rng, TEN), rng.normal(size=k)
    rows = rows_of(A, b, Z=Z, noise=noise, shared=shared, block=np.sort(rng.integers(3, 9, n)))
    sums, blocks = sums_of(rows, weight, 12.0, 2)
    W = np.concatenate([Z, A[:, :, TEN:]], axis=2)
    for found, expected in (
        (sums.normal, np.einsum("n,nri,nrj->ij", weight, A, A)),
        (sums.crossed, np.einsum("n,nri,nrj->ij", weight, W, A)),
        (sums.squared, np.einsum("n,nri,nrj->ij", weight, W, W)),
        (sums.right, np.einsum("n,nri,nr->i", weight, W, b)),
        (sums.plain_right, np.einsum("n,nri,nr->i", weight, A, b)),
        (sums.square, np.einsum("n,nr,nr->", weight, b, b)),
        (sums.noise, noise * weight.mean()),
        (sums.shared, shared * weight.mean()),
    ):
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-10)
    for i, number in enumerate(np.unique(rows.block)):
        own = rows.block == number
        np.testing.assert_allclose(
            blocks.crossed[i], np.einsum("n,nri,nrj->ij", weight[own], W[own], A[own])
        )
        value = rng.normal(size=k)
        left = np.einsum("n,nri,nr->i", weight[own], W[own], b[own] - A[own] @ value)
        np.testing.assert_allclose(blocks.scores(value)[i], left, atol=1e-9)
    np.testing.assert_array_equal(blocks.run, 2)
    double = sums + sums
    np.testing.assert_allclose(double.normal, 2 * sums.normal)
    assert (double.freedom, (double - sums).square) == (24.0, pytest.approx(sums.square))
    assert len(together([blocks, blocks]).right) == 2 * len(blocks.right)


@pytest.mark.integration
def test_what_is_not_estimated_passes_its_uncertainty_on(rng):
    n, k, draws = 30, TEN + 6, 4000
    A = rng.normal(size=(n, 6, k))
    estimated = np.arange(k) < TEN + 3
    prior = np.zeros((k, k))
    prior[TEN:, TEN:] = random_positive(rng, 6, 0.3)
    prior[np.ix_(estimated, ~estimated)] = prior[np.ix_(~estimated, estimated)] = 0.0
    precision = np.zeros((k, k))
    precision[TEN:, TEN:] = np.linalg.inv(prior[TEN:, TEN:])
    mean = np.concatenate([np.zeros(TEN), rng.normal(size=6)])
    body = rng.normal(size=TEN)
    errors = []
    L = np.linalg.cholesky(prior[TEN:, TEN:])
    for _ in range(draws):
        truth = np.concatenate([body, mean[TEN:] + L @ rng.normal(size=6)])
        b = A @ truth + rng.normal(size=(n, 6))
        sums, _ = summed(A, b)
        found = solve(
            sums, Prior(mean, precision, precision @ mean, prior), estimated, ONES, correct=False
        )
        errors.append(found.value - truth)
    assert_covariance(np.array(errors), found.covariance)
    # It counts: noise and the priors of the estimated alone would be too sure.
    assert np.all(np.diag(found.covariance)[:TEN] > np.diag(found.noise_part)[:TEN])


def eiv_draws(rng, *, n=300, noise=0.2, draws=200):
    """Errors of plain, corrected and instrumental estimates where the ten columns are noisy
    themselves."""
    true = rng.normal(size=(n, 6, TEN))
    body = rng.uniform(0.5, 2.0, TEN)
    scatter = n * 6 * noise**2 * np.eye(TEN)
    found = {"plain": [], "corrected": [], "instruments": []}
    for _ in range(draws):
        own = true + noise * rng.normal(size=true.shape)
        other = true + noise * rng.normal(size=true.shape)
        b = true @ body + rng.normal(size=(n, 6))
        sums, _ = summed(own, b, noise=scatter)
        prior, use = nothing_known(TEN), np.ones(TEN, dtype=bool)
        plain = solve(sums, prior, use, ONES, correct=False)
        corrected = solve(sums, prior, use, ONES, correct=True)
        np.testing.assert_allclose(corrected.bias, plain.value - corrected.value, atol=1e-12)
        found["plain"].append(plain.value - body)
        found["corrected"].append(corrected.value - body)
        other_sums, _ = summed(own, b, Z=other, noise=scatter)
        found["instruments"].append(solve(other_sums, prior, use, ONES, correct=False).value - body)
    return {key: np.array(value) for key, value in found.items()}, body, noise


@pytest.mark.integration
def test_noise_in_the_regressor_biases_least_squares_and_not_the_others(rng):
    found, body, noise = eiv_draws(rng)
    means = {key: errors.mean(axis=0) for key, errors in found.items()}
    sampling = {key: errors.std(axis=0) / np.sqrt(len(errors)) for key, errors in found.items()}
    # Unit columns with independent noise are attenuated by the share of the noise in their square.
    expected = -body * noise**2 / (1 + noise**2)
    np.testing.assert_allclose(
        means["plain"], expected, atol=5 * sampling["plain"].max() + 0.05 * np.abs(expected).max()
    )
    assert np.all(np.abs(means["plain"]) > 5 * sampling["plain"])
    for key in ("corrected", "instruments"):
        assert np.all(np.abs(means[key]) < 5 * sampling[key])
        assert np.linalg.norm(means[key]) < 0.2 * np.linalg.norm(means["plain"])


@pytest.mark.integration
def test_the_covariance_of_instruments_is_that_of_their_scatter(rng):
    n, k = 40, TEN + 2
    A = rng.normal(size=(n, 6, k))
    Z = A[:, :, :TEN] + rng.normal(size=(n, 6, TEN))
    truth = rng.normal(size=k)
    errors = []
    for _ in range(3000):
        sums, _ = summed(A, A @ truth + rng.normal(size=(n, 6)), Z=Z)
        found = solve(sums, nothing_known(k), np.ones(k, dtype=bool), ONES, correct=False)
        errors.append(found.value - truth)
    assert_covariance(np.array(errors), found.covariance)


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
    sums, _ = summed(A, b)
    found = solve(sums, nothing_known(TEN), np.ones(TEN, dtype=bool), scale, correct=True)
    assert found.untold.shape == (TEN, 1)
    np.testing.assert_allclose(np.abs(found.untold[:, 0] / scale @ d), 1.0, rtol=1e-6)
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
    sums, _ = summed(A, rng.normal(size=(50, 6)))
    found = solve(sums, nothing_known(TEN), np.ones(TEN, dtype=bool), ONES, correct=False)
    assert (found.untold.shape[1] == 0) == told


@pytest.mark.parametrize("share", [0.1, 0.5])
def test_a_direction_that_noise_alone_shows_is_not_told(rng, share):
    A, d = deficient(rng, ONES, 5.0)
    A = A + np.sqrt(share) / np.sqrt(300) * 5.0 * rng.normal(size=A.shape)
    noise = share * 25.0 * np.eye(TEN)
    sums, _ = summed(A, rng.normal(size=(50, 6)), noise=noise)
    found = solve(sums, nothing_known(TEN), np.ones(TEN, dtype=bool), ONES, correct=True)
    # Told where the information is four times what noise would give: 25 (1 + share) against 100
    # share.
    assert found.untold.shape[1] == (1 if share == 0.5 else 0)
    if share == 0.5:
        assert abs(found.untold[:, 0] @ d) > 0.9


@pytest.mark.parametrize(("deviation", "told"), [(0.1, True), (100.0, False)])
def test_an_error_that_looks_like_the_body_hides_it_unless_it_is_known(rng, deviation, told):
    A = rng.normal(size=(40, 6, TEN + 1))
    A[:, :, TEN] = A[:, :, 0]
    precision = np.zeros((TEN + 1, TEN + 1))
    precision[TEN, TEN] = deviation**-2
    truth = np.arange(1.0, TEN + 2)
    truth[TEN] = 0.0
    sums, _ = summed(A, A @ truth + rng.normal(size=(40, 6)))
    prior = Prior(np.zeros(TEN + 1), precision, np.zeros(TEN + 1), np.zeros((TEN + 1, TEN + 1)))
    found = solve(sums, prior, np.ones(TEN + 1, dtype=bool), ONES, correct=False)
    assert (found.untold.shape[1] == 0) == told
    assert np.sqrt(found.covariance[0, 0]) == pytest.approx(0.1 if told else 1.0, rel=0.3)
    np.testing.assert_allclose(found.value[1:TEN], truth[1:TEN], atol=0.5)


# Enlarging


def enlarged_by(rng, residual_of, *, runs=1, n=200, blocks=20):
    """Inflation and normalised errors of one draw of residuals."""
    parts, freed, k = [], 0.0, TEN + 2
    truth = np.ones(k)
    total = None
    for run in range(runs):
        A = rng.normal(size=(n, 6, k))
        block = np.arange(n) * blocks // n
        each, own = sums_of(
            rows_of(A, A @ truth + residual_of(A, block, rng), block=block),
            np.ones(n),
            float(n),
            run,
        )
        total = each if total is None else total + each
        parts.append(own)
        freed += n
    plain = solve(total, nothing_known(k), np.ones(k, dtype=bool), ONES, correct=False)
    found = enlarged(plain, together(parts), np.ones(TEN, dtype=bool), freed)
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
    blocks = Blocks(np.zeros((0, TEN + 2, TEN + 2)), np.zeros((0, TEN + 2)), np.zeros(0, dtype=int))
    assert enlarged(plain, blocks, np.zeros(TEN, dtype=bool), 10.0) is plain


@pytest.mark.parametrize(("length", "spacing"), [(10.0, 0.1), (100.0, 0.02), (1.0, 0.3)])
def test_blocks_are_five_knots_long_or_a_hundredth_of_the_run(length, spacing):
    time = 3.0 + np.sort(np.random.default_rng(0).uniform(0, length, 2000))
    block = block_numbers(time, spacing)
    assert block[0] == 0
    assert np.all(np.diff(block) >= 0)
    spans = [np.ptp(time[block == b]) for b in np.unique(block)]
    assert max(spans) <= max(5 * spacing, length / 100) + 1e-9
    assert block[-1] <= 100


@pytest.mark.parametrize("n", [1, 7, 100, 1234])
def test_poses_at_rest_are_blocks_of_their_own(n):
    block = block_numbers(np.arange(n, dtype=float), 0.0)
    assert len(np.unique(block)) == min(n, 100)
    assert np.all(np.diff(block) >= 0)


def test_noise_keeps_its_weight_and_outliers_are_bounded(rng):
    residual = rng.normal(size=(100_000, 6))
    assert np.mean(robust_weights(residual) < 1) == pytest.approx(
        1e-4, abs=1e-4
    )  # ten expected, of Poisson
    far = robust_weights(np.array([[100.0, 0, 0, 0, 0, 0], [1e6, 0, 0, 0, 0, 0]]))
    np.testing.assert_allclose(far * [100.0, 1e6], far[0] * 100.0)


# The balance: samples prepared again with another description

ERRORS = {
    "gyro_bias": 0.01,
    "accelerometer_bias": 0.1,
    "position": 0.005,
    "misalignment": 0.01,
    "reference": 0.01,
}
FRAME = {"target": 0.005, "frame": {"position": 0.002, "rotation": 0.001}, "delay": 0.01}
GAINS = {"offset": 5.0, "gain": 0.02, "common_gain": 0.005}


@pytest.fixture(scope="module")
def ideal():
    """Noise-free readings of a motion of six axes, their samples, and errors that are not where
    they are expected."""
    instruments = {
        "cables": changed(IDEAL["cables"], rate=100.0, calibration=GAINS),
        "imu": changed(IDEAL["imu"], rate=100.0, calibration=ERRORS),
        "tracker": changed(IDEAL["tracker"], rate=100.0, calibration=FRAME),
        "command": changed(IDEAL["command"], rate=100.0),
    }
    experiment = moving([1] * 6)(0, instruments=instruments)
    calibration_parameters = gather(experiment)
    known = Calibration(calibration_parameters, calibration_parameters.mean)
    samples = prepare(experiment, experiment.runs[0], thin=True, calibration=known)
    return experiment, known, samples


def unbalanced(experiment, calibration, samples):
    again = prepare(
        experiment, experiment.runs[0], calibration=calibration, plan=samples.plan, thin=True
    )
    return again.wrench - platform_wrench(
        BODY.parameters, again.specific_force, again.omega, again.alpha
    )


def described(experiment, name, **keys):
    instruments = {**experiment.instruments, name: changed(experiment.instruments[name], **keys)}
    return replace(experiment, instruments=instruments)


def shifted(experiment, name, quantity, change):
    run = experiment.runs[0]
    stream = run.streams[name]
    moved = replace(stream, values={**stream.values, quantity: change(stream.values[quantity])})
    return replace(experiment, runs=(replace(run, streams={**run.streams, name: moved}),))


def late(experiment, name, delay):
    run = experiment.runs[0]
    stream = run.streams[name]
    return replace(
        experiment,
        runs=(
            replace(run, streams={**run.streams, name: replace(stream, time=stream.time - delay)}),
        ),
    )


def angles(vector):
    return tuple(Rotation.from_rotvec(vector).as_euler("ZYX", degrees=True)[::-1])


def turn(vector):
    return Rotation.from_rotvec(vector).as_matrix()


# What a description says that knows of an error d of three numbers.
ANOTHER = {
    ("imu", "gyro_bias"): lambda e, d: shifted(e, "imu", "angular_velocity", lambda v: v - d),
    ("imu", "accelerometer_bias"): lambda e, d: shifted(
        e, "imu", "specific_force", lambda v: v - d
    ),
    ("imu", "position"): lambda e, d: described(
        e, "imu", position=tuple(np.array(e.instruments["imu"].position) + d)
    ),
    ("imu", "misalignment"): lambda e, d: described(e, "imu", rpy_deg=angles(d)),
    ("imu", "reference"): lambda e, d: shifted(e, "imu", "orientation", lambda v: turn(d) @ v),
    ("tracker", "target"): lambda e, d: described(
        e, "tracker", target=tuple(np.array(e.instruments["tracker"].target) + d)
    ),
    ("tracker", "frame.position"): lambda e, d: described(
        e, "tracker", frame={"position": tuple(d)}
    ),
    ("tracker", "frame.rotation"): lambda e, d: described(
        e, "tracker", frame={"rpy_deg": angles(d)}
    ),
    ("tracker", "delay"): lambda e, d: late(e, "tracker", d[0]),
    (OWN, "gravity"): lambda e, d: replace(e, robot=replace(e.robot, gravity=e.robot.gravity + d)),
}


@pytest.mark.integration
@pytest.mark.parametrize("owner_key", ANOTHER, ids=lambda k: ".".join(k))
def test_the_balance_follows_an_error_of_a_motion_instrument_as_another_description_would(
    ideal, owner_key
):
    experiment, known, samples = ideal
    owner, key = owner_key
    run = experiment.runs[0].name if key == "delay" else None
    place = known.calibration_parameters.places[owner, key, run]
    places = np.arange(place.start, place.stop)
    assert np.isin(places, motion_errors(experiment, experiment.runs[0], known)).all()
    found = by_motion_errors(
        experiment, experiment.runs[0], samples, known, BODY.parameters, places
    )
    step = 2e-4
    for i in range(len(places)):
        d = step * np.eye(3)[i]
        ahead, behind = (ANOTHER[owner_key](experiment, sign * d) for sign in (1, -1))
        values = []
        for other in (ahead, behind):
            # Gravity is taken from the errors, which are those of the description.
            calibration_parameters = gather(other)
            values.append(
                unbalanced(
                    other, Calibration(calibration_parameters, calibration_parameters.mean), samples
                )
            )
        expected = (values[0] - values[1]) / (2 * step)
        size = max(np.abs(expected).max(), 1.0)
        # Few samples between two knots stand for all of them.
        np.testing.assert_allclose(found[:, :, i], expected, atol=0.01 * size)


@pytest.mark.integration
def test_the_wrench_follows_the_errors_of_the_force_sensors(ideal):
    experiment, known, samples = ideal
    run = experiment.runs[0]
    values = known.values.copy()
    rng = np.random.default_rng(0)
    for key, size in (("offset", 5.0), ("gain", 0.02), ("common_gain", 0.01)):
        place = known.calibration_parameters.places["cables", key, None]
        values[place] += size * rng.normal(size=place.stop - place.start)
    here = Calibration(known.calibration_parameters, values)
    samples = prepare(experiment, run, thin=True, calibration=here, plan=samples.plan)
    equations = balance(experiment, run, samples, here, np.full(8, 5.0))
    assert len(equations.places) == 8 + 8 + 1
    for column, place in enumerate(equations.places):
        step = 1e-3
        ends = []
        for sign in (1, -1):
            moved = values.copy()
            moved[place] += sign * step
            again = prepare(
                experiment,
                run,
                thin=True,
                calibration=replace(here, values=moved),
                plan=samples.plan,
            )
            ends.append(again.wrench)
        expected = (ends[0] - ends[1]) / (2 * step)
        np.testing.assert_allclose(
            equations.by_errors[:, :, column], expected, atol=1e-4 * np.abs(expected).max()
        )


def test_the_wrench_follows_the_readings(ideal):
    experiment, known, samples = ideal
    equations = balance(experiment, experiment.runs[0], samples, known, np.full(8, 5.0))
    for cable in (0, 5):
        moved = shifted(
            experiment, "cables", "tension", lambda v, cable=cable: v + np.eye(8)[cable]
        )
        again = prepare(moved, moved.runs[0], thin=True, calibration=known, plan=samples.plan)
        np.testing.assert_allclose(
            equations.by_reading[:, :, cable], again.wrench - samples.wrench, atol=1e-9 * 1e3
        )


@pytest.mark.integration
def test_the_wrench_follows_where_a_cable_is_fixed(ideal):
    experiment, known, samples = ideal
    found = by_geometry(experiment, samples)
    for key, part in (("anchors", found.anchor), ("attachments", found.attachment)):
        for number in (0, 10, 23):
            ends = []
            for sign in (1, -1):
                points = np.array(getattr(experiment.robot, key))
                points[number // 3, number % 3] += sign * 1e-4
                other = replace(experiment, robot=replace(experiment.robot, **{key: points}))
                ends.append(
                    prepare(
                        other, other.runs[0], thin=True, calibration=known, plan=samples.plan
                    ).wrench
                )
            expected = (ends[0] - ends[1]) / 2e-4
            np.testing.assert_allclose(
                part[:, :, number], expected, atol=1e-4 * np.abs(expected).max()
            )


def test_the_wrench_follows_how_far_the_forces_alone_are_late(ideal):
    # The forces are late, and not the pose that says where the cables pull.
    experiment, known, samples = ideal
    ends = [
        prepare(other, other.runs[0], thin=True, calibration=known, plan=samples.plan).wrench
        for other in (late(experiment, "cables", 1e-3), late(experiment, "cables", -1e-3))
    ]
    expected = (ends[0] - ends[1]) / 2e-3
    size = np.abs(expected).max(axis=0)
    # Differences of samples ten milliseconds apart; the first and the last have a neighbour on one
    # side only.
    assert np.all(np.abs(by_lag(samples) - expected)[1:-1] < 0.02 * size)


def test_poses_at_rest_are_not_late():
    run = at_rest(np.tile(CENTER, (5, 1)))
    experiment = replace(sound(0), runs=(run,))
    calibration_parameters = gather(experiment)
    samples = prepare(
        experiment,
        run,
        calibration=Calibration(calibration_parameters, calibration_parameters.mean),
    )
    assert not by_lag(samples).any()


# The noise of the balance

FIRM = ("cables", "imu", "tracker", "command")


def firm(name, **noise):
    """An instrument of the paper without systematic errors, with noise of its own."""
    zero = {term.key: 0.0 for term in PAPER[name].terms(8) if "." not in term.key}
    if name == "tracker":
        zero["frame"] = {"position": 0.0, "rotation": 0.0}
    return changed(PAPER[name], calibration={**zero, "delay": 0.0}, **noise)


@pytest.fixture(scope="module")
def firm_draws():
    """Left-over wrench of the true body over seeds, with noise of the forces alone and with noise
    of the motion alone."""
    recorder = moving([1] * 6)
    # What is left of noise is held against what noise does, so that both must be small against the
    # motion.
    quiet = {"angular_velocity": 1e-9, "specific_force": 1e-9, "orientation": 1e-9}
    suites = {
        "forces": {
            **{k: firm(k) for k in FIRM},
            "imu": firm("imu", noise=quiet),
            "tracker": firm("tracker", noise=1e-9),
        },
        "motion": {**{k: firm(k) for k in FIRM}, "cables": firm("cables", noise=1e-9)},
    }
    found = {}
    for kind, suite in suites.items():
        left, plan = [], None
        for seed in range(24):
            experiment = recorder(seed, instruments=suite, stated={k: firm(k) for k in FIRM})
            # The phase of the clocks is drawn with the seed; the plan of the first serves all.
            calibration_parameters = gather(experiment)
            known = Calibration(calibration_parameters, calibration_parameters.mean)
            samples = prepare(
                experiment, experiment.runs[0], thin=True, calibration=known, plan=plan
            )
            plan = plan or replace(samples.plan, spacing=0.16)
            if seed == 0:
                samples = prepare(
                    experiment, experiment.runs[0], thin=True, calibration=known, plan=plan
                )
            moves = platform_wrench(
                BODY.parameters, samples.specific_force, samples.omega, samples.alpha
            )
            left.append(samples.wrench - moves)
        left = np.array(left)
        # What the filter takes from the motion is the same in every draw.
        scatter = left - left.mean(axis=0)
        found[kind] = scatter * np.sqrt(len(left) / (len(left) - 1)), experiment, samples, known
    return found


@pytest.mark.integration
def test_whitened_force_noise_is_of_as_many_numbers_as_the_filter_has_let_through(firm_draws):
    scatter, experiment, samples, known = firm_draws["forces"]
    equations = balance(experiment, experiment.runs[0], samples, known, np.full(8, 5.0))
    L = whitener(equations, np.zeros((6, 6)))
    square = np.sum(np.einsum("nij,dnj->dni", L, scatter) ** 2, axis=(1, 2))
    # 24 draws of some 400 numbers tell their sum to 2 %; the ends of the run have knots of their
    # own.
    assert square.mean() == pytest.approx(6 * freedom(samples), rel=0.1)


def test_the_noise_of_the_motion_is_what_it_brings_into_the_balance(firm_draws):
    scatter, experiment, samples, _ = firm_draws["motion"]
    found = motion_noise(experiment, samples, BODY.parameters)
    covariance = np.einsum("dnk,dnl->kl", scatter, scatter) / scatter[:, :, 0].size
    covariance *= len(samples) * samples.share / freedom(samples)
    scale = np.sqrt(np.diag(covariance))
    ratio = np.sqrt(np.diag(found)) / scale
    # What the angular acceleration lets through is told by probes of white noise, and at the ends
    # of a run there is more of it.
    assert np.all((ratio > 0.85) & (ratio < 1.2)), ratio


def test_the_noise_of_the_regressor_is_that_of_its_motion(firm_draws, rng):
    _, _, samples, _ = firm_draws["motion"]
    found = regressor_noise(samples, rng)
    mean = np.einsum("dnki,dnkj->ij", found, found) / len(found)
    draws = []
    base = platform_regressor(samples.specific_force, samples.omega, samples.alpha)
    for _ in range(30):
        moved = {
            key: getattr(samples, key) + samples.noise[key] * rng.normal(size=(len(samples), 3))
            for key in ("specific_force", "omega", "alpha")
        }
        draws.append(platform_regressor(**moved) - base)
    expected = np.einsum("dnki,dnkj->ij", draws, draws) / len(draws)
    size = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(mean / size, expected / size, atol=0.15)


def test_whitened_rows_have_unit_variance(firm_draws, rng):
    _, experiment, samples, known = firm_draws["forces"]
    sigma = np.array([5.0, 1.0, 3.0, 5.0, 8.0, 5.0, 2.0, 5.0])
    extra = random_positive(rng, 6, 10.0)
    equations = balance(experiment, experiment.runs[0], samples, known, sigma)
    L = whitener(replace(equations, samples=replace(samples, share=4.0)), extra)
    readings = sigma * rng.normal(size=(200, len(samples), 8))
    noise = np.einsum("nkr,dnr->dnk", equations.by_reading, readings)
    noise = noise + rng.normal(size=noise.shape) @ np.linalg.cholesky(extra).T
    z = np.einsum("nij,dnj->dni", L, noise).reshape(-1, 6)
    # A sample that stands for four readings counts four times.
    np.testing.assert_allclose(z.T @ z / len(z), 4.0 * np.eye(6), atol=0.12)


# Gains multiply noise


def hanging(rng, n=400, noise=20.0):
    """Readings of eight cables of a known body, with noise, as samples, and the noise."""
    sample = prepare(sound(0), sound(0).runs[0], thin=True)
    pick = rng.integers(0, len(sample), n)
    W = sample.structure[pick]
    motion = {key: getattr(sample, key)[pick] for key in ("specific_force", "omega", "alpha")}
    tension = 600.0 + 200.0 * rng.normal(size=(n, 8))
    needed = platform_wrench(BODY.parameters, **motion) - np.einsum("nkm,nm->nk", W, tension)
    tension = tension + np.einsum("nmk,nk->nm", np.linalg.pinv(W), needed)
    return motion, W, tension, noise * rng.normal(size=(n, 8))


def as_samples(motion, W, tension):
    zero = np.zeros(len(tension))
    return Samples(
        run="run",
        time=np.arange(len(tension), dtype=float),
        **motion,
        wrench=np.einsum("nkm,nm->nk", W, tension),
        static=False,
        free_offset=False,
        alpha_noise=0.0,
        spacing=0.0,
        position_sigma=0.0,
        tension=tension,
        structure=W,
        position=np.zeros((len(zero), 3)),
        rotation=np.tile(np.eye(3), (len(zero), 1, 1)),
    )


@pytest.fixture(scope="module")
def with_gains():
    experiment = replace(
        sound(0),
        instruments={**PAPER, "cables": changed(PAPER["cables"], noise=20.0, calibration=GAINS)},
    )
    calibration_parameters = gather(experiment)
    return experiment, Calibration(calibration_parameters, calibration_parameters.mean)


def gain_rows(experiment, known, motion, W, tension, sigma):
    samples = as_samples(motion, W, tension)
    equations = balance(experiment, experiment.runs[0], samples, known, np.full(8, sigma))
    # The covariance of the noise knows nothing of the noise itself: straight from the structure
    # matrix.
    L = np.linalg.inv(np.linalg.cholesky(sigma**2 * W @ W.transpose(0, 2, 1)))
    columns = L @ np.concatenate(
        [platform_regressor(**motion), -equations.by_errors[:, :, 8:16]], axis=2
    )  # the body, and gains of the sensors
    return equations, L, columns, np.einsum("nij,nj->ni", L, samples.wrench)


@pytest.mark.integration
def test_noise_that_gains_share_with_the_target_is_as_stated(with_gains, rng):
    experiment, known = with_gains
    motion, W, tension, _ = hanging(rng)
    found = []
    for _ in range(400):
        noise = 20.0 * rng.normal(size=tension.shape)
        equations, L, _, target = gain_rows(experiment, known, motion, W, tension + noise, 20.0)
        clean, _, _, target_0 = gain_rows(experiment, known, motion, W, tension, 20.0)
        by_errors = L @ (equations.by_errors - clean.by_errors)
        found.append(np.einsum("nke,nk->e", by_errors, target - target_0))
    expected = np.mean(found, axis=0)
    stated = shared_noise(equations, known, L)
    sampling = np.std(found, axis=0) / np.sqrt(len(found))
    assert np.all(np.abs(stated - expected) < 5 * sampling + 1e-9)
    assert np.all(np.abs(stated[8:]) > 5 * sampling[8:])
    np.testing.assert_array_equal(stated[:8], 0.0)  # offsets are the same whatever is read


@pytest.mark.integration
def test_gains_are_not_biased_by_the_noise_that_they_multiply(with_gains, rng):
    experiment, known = with_gains
    motion, W, tension, _ = hanging(rng)
    k = TEN + 8
    # Gains in their own scale; the mean of them is that of the mass, which a prior holds.
    precision = np.diag(np.concatenate([np.zeros(TEN), np.full(8, 0.05**-2)]))
    prior = Prior(np.zeros(k), precision, np.zeros(k), np.zeros((k, k)))
    scale = study.plausible(BODY.parameters, ROBOT.size)
    errors = {True: [], False: []}
    for _ in range(300):
        noise = 20.0 * rng.normal(size=tension.shape)
        equations, L, columns, target = gain_rows(
            experiment, known, motion, W, tension + noise, 20.0
        )
        own = np.concatenate([np.zeros(TEN), -shared_noise(equations, known, L)[8:16]])
        for told in (True, False):
            sums, _ = summed(columns, target, shared=own if told else np.zeros(k))
            errors[told].append(
                solve(sums, prior, np.ones(k, dtype=bool), scale, correct=False).value[TEN:]
            )
    corrected, plain = np.array(errors[True]), np.array(errors[False])
    sampling = corrected.std(axis=0) / np.sqrt(len(corrected))
    assert np.linalg.norm(corrected.mean(axis=0)) < 0.3 * np.linalg.norm(plain.mean(axis=0))
    assert np.any(np.abs(plain.mean(axis=0)) > 10 * sampling)
