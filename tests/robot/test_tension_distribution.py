from itertools import combinations, product

import numpy as np
import pytest
from scipy.optimize import linprog, minimize
from scipy.spatial.transform import Rotation

from steelyard.errors import InfeasibleError, SteelyardError
from steelyard.robot.file import read_robot
from steelyard.robot.kinematics import cables_at
from steelyard.robot.tension import distribute

TOLERANCE = 1e-6  # of the wrench: interior-point programmes end at 1e-8, and W is far from singular

LIMITS = (50.0, 2000.0)
COGIRO = read_robot("cogiro").with_straight_cables()


def structures(n, seed=0):
    rng = np.random.default_rng(seed)
    position = rng.uniform([-3, -2, 0.5], [3, 2, 3], (n, 3))
    turn = Rotation.from_euler("ZYX", rng.uniform(-0.3, 0.3, (n, 3))).as_matrix()
    return cables_at(COGIRO, position, turn, np.ones(8)).structure


def reachable_wrenches(structure, seed=1):
    """Wrenches of random tensions within the limits, a third of them at a limit."""
    tension = np.random.default_rng(seed).uniform(-900, 2950, (len(structure), 8)).clip(*LIMITS)
    return np.einsum("nkm,nm->nk", structure, tension)


def nearest_by_enumeration(W, w, low, high, level):
    """The same optimum by trying every set of up to two cables at a limit: eight cables leave a
    plane of tensions."""
    best, distance = None, np.inf
    plain = level + np.linalg.pinv(W) @ (w - level * W.sum(axis=1))
    null = np.linalg.svd(W)[2][6:].T  # (8, 2)
    for count in range(3):
        for cables in map(list, combinations(range(8), count)):
            for limits in product((low, high), repeat=count):
                move = (
                    np.linalg.pinv(null[cables]) @ (limits - plain[cables])
                    if count
                    else np.zeros(2)
                )
                t = plain + null @ move
                slack = 1e-9 * high
                fits = (t > low - slack).all() and (t < high + slack).all()
                if fits and np.linalg.norm(t - level) < distance:
                    best, distance = t, np.linalg.norm(t - level)
    return best


@pytest.mark.parametrize("reference", [None, 300.0, 1500.0])
def test_is_the_optimum_that_enumeration_finds(reference):
    W = structures(40)
    w = reachable_wrenches(W)
    tension = distribute(W, w, LIMITS, reference)
    at_a_limit = 0
    for k in range(40):
        expected = nearest_by_enumeration(W[k], w[k], *LIMITS, reference or 0.0)
        np.testing.assert_allclose(tension[k], expected, atol=TOLERANCE * np.abs(w[k]).max())
        at_a_limit += bool(
            np.isclose(expected, LIMITS[0]).any() or np.isclose(expected, LIMITS[1]).any()
        )
    assert 5 < at_a_limit < 35  # both ways of the solution were used


def test_is_the_optimum_that_slsqp_finds():
    W = structures(10, seed=5)
    w = reachable_wrenches(W, seed=6)
    tension = distribute(W, w, LIMITS, 400.0)
    for k in range(10):
        found = minimize(
            lambda t: np.sum((t - 4.0) ** 2),
            np.full(8, 8.0),
            jac=lambda t: 2 * (t - 4.0),
            bounds=[(0.5, 20.0)] * 8,
            constraints={
                "type": "eq",
                "fun": lambda t, k=k: W[k] @ t - w[k] / 100,
                "jac": lambda t, k=k: W[k],
            },
            method="SLSQP",
            options={"ftol": 1e-11, "maxiter": 500},
        )
        assert found.success
        np.testing.assert_allclose(tension[k], 100 * found.x, atol=TOLERANCE * np.abs(w[k]).max())


@pytest.mark.parametrize("limits", [(50.0, 2000.0), (0.0, np.inf), (50.0, np.inf)])
def test_gives_the_wrench_within_the_limits(limits):
    W = structures(200)
    w = reachable_wrenches(W)
    tension = distribute(W, w, limits)
    assert (tension >= limits[0]).all()
    assert (tension <= limits[1]).all()
    error = np.abs(np.einsum("nkm,nm->nk", W, tension) - w).max(axis=1)
    assert (error <= TOLERANCE * np.abs(w).max(axis=1)).all()


def test_is_infeasible_exactly_where_linear_programming_says_so():
    W = structures(120, seed=2)
    rng = np.random.default_rng(3)
    w = np.einsum("nkm,nm->nk", W, np.full((120, 8), 400.0)) + rng.normal(
        0, [400] * 3 + [200] * 3, (120, 6)
    )
    feasible = 0
    for k in range(120):
        answer = linprog(np.zeros(8), A_eq=W[k], b_eq=w[k], bounds=LIMITS)
        if answer.status == 0:
            distribute(W[k : k + 1], w[k : k + 1], LIMITS)
            feasible += 1
        else:
            assert answer.status == 2
            with pytest.raises(InfeasibleError):
                distribute(W[k : k + 1], w[k : k + 1], LIMITS)
    assert 20 < feasible < 100


def test_says_at_which_sample_there_are_no_tensions():
    W = structures(30)
    w = reachable_wrenches(W)
    w[17, 2] = -1e5  # cables cannot push down
    with pytest.raises(
        InfeasibleError, match="expected tensions within 50 to 2000 N that carry the platform"
    ) as caught:
        distribute(W, w, LIMITS)
    assert caught.value.sample == 17
    assert isinstance(caught.value, SteelyardError)


def test_a_wrench_that_the_cables_cannot_span_is_infeasible():
    W = structures(1)[:, :, :4]
    with pytest.raises(InfeasibleError):
        distribute(W, np.array([[10.0, 0, 500, 0, 30, 0]]), (0.0, np.inf))


def test_six_cables_leave_no_choice():
    W = structures(5)[:, :, [0, 1, 2, 4, 5, 7]]
    tension = np.random.default_rng(8).uniform(100, 900, (5, 6))
    w = np.einsum("nkm,nm->nk", W, tension)
    np.testing.assert_allclose(distribute(W, w, LIMITS), tension, rtol=TOLERANCE)


def test_inputs_stay_as_they_are():
    W = structures(5)
    w = reachable_wrenches(W)
    before = W.copy(), w.copy()
    distribute(W, w, LIMITS)
    np.testing.assert_array_equal(W, before[0])
    np.testing.assert_array_equal(w, before[1])
