"""Noise of the balance: of readings and of a wrench that nothing explains."""

import numpy as np
import pytest

from steelyard.identification.model.balance.noise import BalanceNoise, UnmodelledWrench


def structures(rng, n, m):
    """Structure matrices of cables from random directions at random points."""
    along = rng.normal(size=(n, m, 3))
    along /= np.linalg.norm(along, axis=2, keepdims=True)
    at = rng.normal(size=(m, 3))
    return np.concatenate([along, np.cross(at, along)], axis=2).transpose(0, 2, 1)


def noise_of(m, level, gain=1.0, seed=0, n=5):
    rng = np.random.default_rng(seed)
    structure = structures(rng, n, m)
    by_reading = np.broadcast_to(np.eye(m) / gain, (n, m, m))
    unmodelled = UnmodelledWrench.of(structure, by_reading)
    wrench = unmodelled.wrench * level if level is not None else None
    return structure, BalanceNoise.of(structure @ by_reading, np.full((n, m), 2.0), wrench)


@pytest.mark.parametrize(("m", "level"), [(3, 0.5), (4, 0.01), (5, 3.0), (8, None), (8, 0.5)])
def test_the_whitener_makes_the_covariance_the_identity(m, level):
    _, noise = noise_of(m, level)
    covariance = noise.parts @ noise.parts.transpose(0, 2, 1)
    white = noise.whitener @ covariance @ noise.whitener.transpose(0, 2, 1)
    assert white == pytest.approx(np.broadcast_to(np.eye(6), white.shape), abs=1e-6)


@pytest.mark.parametrize(("m", "level"), [(3, 0.5), (4, 0.1), (6, None), (8, None), (12, 0.5)])
def test_six_equations_are_shared_out(m, level):
    _, noise = noise_of(m, level)
    assert noise.decided.sum(axis=1) == pytest.approx(6.0, rel=1e-6)


@pytest.mark.parametrize("m", [2, 3, 4, 5])
def test_what_few_cables_cannot_carry_is_left_to_the_unmodelled_wrench(m):
    _, noise = noise_of(m, 1e-3)
    assert noise.decided[:, :m].sum(axis=1) == pytest.approx(m, abs=1e-3)
    assert noise.decided[:, m:].sum(axis=1) == pytest.approx(6 - m, abs=1e-3)


@pytest.mark.parametrize(
    ("m", "unread"), [(2, []), (4, []), (5, []), (4, [1]), (5, [0, 3]), (3, [0, 1, 2])]
)
def test_a_white_wrench_that_no_cable_carries_takes_no_weight_from_the_readings(m, unread):
    rng = np.random.default_rng(m)
    structure, left_out = structures(rng, 5, m), np.isin(np.arange(m), unread)
    across = UnmodelledWrench.of(structure, np.broadcast_to(np.eye(m), (5, m, m))).across
    assert across @ structure == pytest.approx(0.0, abs=1e-9)
    assert np.trace(across, axis1=1, axis2=2) == pytest.approx(6 - m)
    sigmas, costs = np.full((5, m), 2.0), []
    carried = np.einsum("nir,nr->ni", structure, rng.normal(size=(5, m)))
    for level in (1e-3, 1.0, 1e3):
        noise = BalanceNoise.of(structure, sigmas, across * level, left_out if unread else None)
        decided = noise.decided
        assert decided[:, :m].sum(axis=1) == pytest.approx(m - len(unread), abs=1e-4)
        assert decided[:, m:].sum(axis=1) == pytest.approx(6 - m, abs=1e-4)
        costs.append(np.sum(np.einsum("nij,nj->ni", noise.whitener, carried) ** 2))
    assert costs == pytest.approx([costs[0]] * 3, rel=1e-4, abs=1e-4)


def test_a_correction_is_the_least_that_balances():
    structure, noise = noise_of(4, 0.5)
    left_over = np.random.default_rng(1).normal(size=(len(structure), 6))
    residual = np.einsum("nij,nj->ni", noise.whitener, left_over)
    correction = noise.correction(residual)
    assert np.einsum("nir,nr->ni", noise.parts, correction) == pytest.approx(left_over)
    least = np.stack([np.linalg.pinv(p) @ w for p, w in zip(noise.parts, left_over, strict=True)])
    assert correction == pytest.approx(least)


@pytest.mark.parametrize("m", [3, 4, 8])
@pytest.mark.parametrize("level", [0.1, 1.0, 10.0])
def test_gains_that_grow_gain_nothing(m, level):
    """Gains, tensions, body and residual together in other units are no better and no worse."""
    scaled = []
    for gain in (0.9, 1.0, 1.1):
        structure, noise = noise_of(m, level, gain)
        left_over = np.random.default_rng(2).normal(size=(len(structure), 6)) / gain
        scaled.append(np.sum(np.einsum("nij,nj->ni", noise.whitener, left_over) ** 2))
    assert scaled == pytest.approx([scaled[0]] * 3)


def test_cables_carry_what_they_can_of_an_unmodelled_wrench():
    structure, _ = noise_of(4, 1.0)
    unmodelled = UnmodelledWrench.of(structure, np.broadcast_to(np.eye(4), (5, 4, 4)))
    assert unmodelled.wrench == pytest.approx(np.broadcast_to(np.eye(6), (5, 6, 6)))
    wrench = np.random.default_rng(3).normal(size=6)
    carried = structure @ (unmodelled.reading @ wrench)[:, :, None]
    across = wrench - carried[:, :, 0]
    assert np.einsum("nij,ni->nj", structure, across) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("m", "unread"),
    [(8, [2]), (8, [0, 3, 5]), (4, [1]), (4, [0, 1, 2, 3]), (3, [0, 1, 2]), (2, [0, 1])],
)
def test_a_reading_that_nobody_reads_is_the_limit_of_one_of_infinite_noise(m, unread):
    """Least squares over the readings that nobody reads, as unknowns, is the same."""
    rng = np.random.default_rng(m)
    n, level = 5, 1e-3 if m - len(unread) < 6 else None
    structure = structures(rng, n, m)
    by_reading = np.broadcast_to(np.eye(m), (n, m, m))
    wrench = None if level is None else level * UnmodelledWrench.of(structure, by_reading).wrench
    left_out = np.isin(np.arange(m), unread)
    noise = BalanceNoise.of(structure @ by_reading, np.full((n, m), 2.0), wrench, left_out)
    left_over = rng.normal(size=(n, 6))
    residual = np.einsum("nij,nj->ni", noise.whitener, left_over)
    for i in range(n):
        white = np.linalg.inv(np.linalg.cholesky(noise.parts[i] @ noise.parts[i].T))
        across = white @ structure[i][:, unread]
        pulled, *_ = np.linalg.lstsq(across, white @ left_over[i], rcond=None)
        assert noise.pulled[i] @ left_over[i] == pytest.approx(pulled, rel=1e-4, abs=1e-6)
        rest = white @ left_over[i] - across @ pulled
        assert residual[i] @ residual[i] == pytest.approx(rest @ rest, rel=1e-4, abs=1e-9)
    assert noise.decided.sum(axis=1) == pytest.approx(6 - len(unread), rel=1e-4)
    assert noise.correction(residual)[:, unread] == pytest.approx(0.0)
