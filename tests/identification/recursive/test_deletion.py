"""What stands alone among linear readings, against fits that are made anew without each of them."""

from types import SimpleNamespace

import numpy as np
import pytest

from steelyard.identification.model.segment import Rows
from steelyard.identification.recursive.arriving.deletion import Alone, Deletion, Foreknown

LEVEL = 5.0
SIZE = 6


def known(rng):
    root = rng.normal(size=(SIZE, SIZE))
    return Foreknown(root @ root.T + 0.1 * np.eye(SIZE), rng.normal(size=SIZE), SIZE)


def rows_of(J, r):
    """Rows of one number a sample, which depends on all coefficients."""
    return Rows(np.zeros(len(r), dtype=np.intp), r[:, None], J[:, None], np.zeros((len(r), 1, 0)))


def read(rng, count):
    """Derivatives and residuals of readings of one motion, with noise of unit variance."""
    J = rng.normal(size=(count, SIZE))
    return J, rng.normal(size=count) - J @ np.array([3.0, -2, 1, 0, 4, -1])


def balance_of(J, r, shares):
    """Six whitened equations of force readings that make them as noisy as they are."""
    first = np.zeros(len(r), dtype=np.intp)
    rows = (SimpleNamespace(first=first, by_motion=J),)
    noise = SimpleNamespace(readings=shares.shape[2], shares=shares)
    return SimpleNamespace(
        at=SimpleNamespace(noise=noise, residual=r), rows=rows, root=np.ones(len(r))
    )


def forces(rng, count, cells=8):
    """The same of forces on the same motion."""
    shares = np.linalg.qr(rng.normal(size=(count, cells, 6)))[0].transpose(0, 2, 1)
    J = rng.normal(size=(count, 6, SIZE))
    noise = np.einsum("nir,nr->ni", shares, rng.normal(size=(count, cells)))
    return J, noise - J @ np.array([3.0, -2, 1, 0, 4, -1]), shares


def loose():
    """Nothing is known but what is read."""
    return Foreknown(1e-9 * np.eye(SIZE), np.zeros(SIZE), SIZE)


def nothing_left_out(asked):
    return Alone(np.zeros(len(asked.residual), bool), np.zeros(asked.shares.shape[::2], bool))


def test_a_reading_is_as_far_off_as_from_a_fit_that_is_made_without_it():
    rng = np.random.default_rng(1)
    J, r = read(rng, 9)
    prior = known(rng)
    asked = Deletion.of(prior, [rows_of(J, r)], ())
    far, _ = asked.far(nothing_left_out(asked))
    for i in range(len(r)):
        others = np.arange(len(r)) != i
        A = prior.precision + J[others].T @ J[others]
        step = np.linalg.solve(A, prior.pull - J[others].T @ r[others])
        deviation = np.sqrt(1 + J[i] @ np.linalg.solve(A, J[i]))
        expected = abs(r[i] + J[i] @ step) / deviation
        assert far[i] == pytest.approx(expected, rel=1e-8)
        # The same, once it is left out.
        one = Alone(~others, np.zeros((0, 0), bool))
        assert asked.off(one)[0][i] == pytest.approx(expected, rel=1e-8)


def test_a_force_is_as_far_off_as_the_error_of_its_own_that_a_fit_would_find():
    rng = np.random.default_rng(2)
    J, r = read(rng, 4)
    by_motion, balance, shares = forces(rng, 5)
    prior = known(rng)
    asked = Deletion.of(prior, [rows_of(J, r)], [balance_of(by_motion, balance, shares)])
    _, far = asked.far(nothing_left_out(asked))
    A = np.vstack([J, by_motion.reshape(-1, SIZE)])
    e = np.concatenate([r, balance.ravel()])
    for i, k in np.ndindex(far.shape):
        error = np.zeros(len(e))
        error[4 + 6 * i : 10 + 6 * i] = shares[i, :, k]
        B = np.column_stack([A, error])
        normal = B.T @ B
        normal[:SIZE, :SIZE] += prior.precision
        right = np.append(prior.pull, 0.0) - B.T @ e
        covariance = np.linalg.inv(normal)
        expected = abs((covariance @ right)[-1]) / np.sqrt(covariance[-1, -1])
        assert far[i, k] == pytest.approx(expected, rel=1e-7)
        one = nothing_left_out(asked)
        one.single[i, k] = True
        assert asked.off(one)[1][i, k] == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("seed", range(8))
def test_what_is_spiked_stands_alone_and_nothing_else(seed):
    rng = np.random.default_rng(seed)
    J, r = read(rng, 60)
    by_motion, balance, shares = forces(rng, 30)
    spiked = rng.choice(60, 3, replace=False)
    r[spiked] += 40 * rng.choice([-1, 1], 3)
    at, cells = rng.choice(30, 4, replace=False), rng.integers(0, 8, 4)
    balance[at] += 60 * shares[at, :, cells]
    rows, balances = [rows_of(J, r)], [balance_of(by_motion, balance, shares)]
    found = Deletion.of(loose(), rows, balances).alone(LEVEL)
    assert sorted(np.flatnonzero(found.motion)) == sorted(spiked)
    assert sorted(map(tuple, np.argwhere(found.single))) == sorted(
        zip(at.tolist(), cells.tolist(), strict=True)
    )


def test_forces_of_another_load_do_not_stand_alone():
    rng = np.random.default_rng(3)
    J, r = read(rng, 60)
    by_motion, balance, shares = forces(rng, 30)
    balance[5:] += 80 * rng.normal(size=6)
    rows, balances = [rows_of(J, r)], [balance_of(by_motion, balance, shares)]
    found = Deletion.of(loose(), rows, balances).alone(LEVEL)
    assert not found.single.any()


def test_motion_is_asked_where_no_force_was_read():
    rng = np.random.default_rng(4)
    J, r = read(rng, 40)
    r[7] += 30.0
    found = Deletion.of(loose(), [rows_of(J, r)], ()).alone(LEVEL)
    assert np.flatnonzero(found.motion).tolist() == [7]
    assert not found.single.size


def test_forces_are_asked_where_nothing_else_was_read():
    by_motion, balance, shares = forces(np.random.default_rng(5), 20)
    balance[4] += 50 * shares[4, :, 2]
    found = Deletion.of(loose(), [], [balance_of(by_motion, balance, shares)]).alone(LEVEL)
    assert np.argwhere(found.single).tolist() == [[4, 2]]
    assert not found.motion.size


def test_readings_beside_those_of_a_balance_are_asked_as_they_are():
    by_motion, balance, shares = forces(np.random.default_rng(6), 20)
    beside = np.zeros((20, 8))
    beside[9, 5] = 300.0
    balances = [balance_of(by_motion, balance, shares)]
    found = Deletion.of(loose(), [], balances, beside=beside).alone(LEVEL)
    assert np.argwhere(found.single).tolist() == [[9, 5]]


def test_a_quantity_that_has_jumped_is_off_the_motion_that_all_others_show():
    rng = np.random.default_rng(12)
    quantities = [read(rng, 40) for _ in range(3)]
    asked = Deletion.of(loose(), [rows_of(J, r) for J, r in quantities], ())
    assert not asked.jumped(LEVEL).any()
    # Most of it, so that it bends the motion and others stand far from it.
    J, r = quantities[1]
    quantities[1] = J, r + np.where(np.arange(40) < 30, 300.0, 0.0)
    asked = Deletion.of(loose(), [rows_of(J, r) for J, r in quantities], ())
    assert np.flatnonzero(asked.jumped(LEVEL)).tolist() == list(range(40, 70))
    # Of two that have jumped, or a motion that no other shows, nobody can tell.
    J, r = quantities[2]
    quantities[2] = J, r + 200.0 * rng.normal(size=40)
    asked = Deletion.of(loose(), [rows_of(J, r) for J, r in quantities], ())
    assert not asked.jumped(LEVEL).any()
    asked = Deletion.of(loose(), [rows_of(*quantities[1])], ())
    assert not asked.jumped(LEVEL).any()
