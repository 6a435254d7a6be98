"""A step whose border is held back: the best of those that reach so far, and no other where the whole
one does not reach farther.
"""

import numpy as np
import pytest
from scipy.optimize import minimize

from steelyard.identification.solve.joint_fit import _reach_after
from steelyard.identification.solve.newton_step import _held_back
from steelyard.identification.solve.settings import FIT


def quadratic(rng, size=6):
    """A badly conditioned matrix, a right-hand side and the step to the minimum."""
    turned, _ = np.linalg.qr(rng.standard_normal((size, size)))
    matrix = turned * np.logspace(-2, 4, size) @ turned.T
    right = matrix @ rng.standard_normal(size) * 3
    return matrix, right, np.linalg.solve(matrix, right)


def promised(matrix, right, step):
    return 2 * right @ step - step @ matrix @ step


@pytest.mark.parametrize("reach", [1e-3, 0.1, 1.0])
def test_it_is_the_best_of_its_length(rng, reach):
    matrix, right, whole = quadratic(rng)
    held = _held_back(matrix, right, whole, reach)
    assert np.max(np.abs(held)) == pytest.approx(reach, rel=1e-3)
    # Independently: nothing of the same Euclidean length promises more.
    length = np.linalg.norm(held)

    def lacking(free):
        return -promised(matrix, right, free / max(np.linalg.norm(free) / length, 1.0))

    found = min(
        (minimize(lacking, held + 0.3 * length * rng.standard_normal(6)) for _ in range(20)),
        key=lambda each: each.fun,
    )
    assert promised(matrix, right, held) >= -found.fun * (1 - 1e-3)


def test_a_step_within_reach_is_whole(rng):
    matrix, right, whole = quadratic(rng)
    np.testing.assert_array_equal(_held_back(matrix, right, whole, np.inf), whole)
    np.testing.assert_array_equal(_held_back(matrix, right, whole, 1e6), whole)


def test_what_is_known_well_goes_on(rng):
    # One direction known a thousand times better than the other; both have far to go.
    matrix, far = np.diag([1e6, 1.0]), np.array([0.5, 40.0])
    held = _held_back(matrix, matrix @ far, far, 1.0)
    np.testing.assert_allclose(held, [0.5, 1.0], rtol=2e-3)


def test_a_direction_without_information_is_held(rng):
    matrix = np.diag([1.0, 0.0])
    held = _held_back(matrix, np.array([1.0, 1.0]), np.array([1.0, 1e16]), 0.5)
    assert np.all(np.isfinite(held))
    assert np.max(np.abs(held)) <= 0.5


@pytest.mark.parametrize(
    ("kept", "factor"), [(1.0, FIT.farther), (0.5, 1.0), (0.1, 1 / FIT.farther)]
)
def test_the_reach_follows_what_was_kept(kept, factor):
    from types import SimpleNamespace

    last = SimpleNamespace(cost=100.0, step=SimpleNamespace(promised=50.0))
    assert _reach_after(last, 100.0 - 50.0 * kept, 0.8, FIT) == pytest.approx(0.8 * factor)


@pytest.mark.parametrize(
    ("last", "ends"), [(90.0, "last"), (100.1, "origin"), (1e6, "origin"), (None, "origin")]
)
def test_a_fit_ends_where_the_cost_is_lower_and_cables_can_be(monkeypatch, last, ends):
    from types import SimpleNamespace

    from steelyard.errors import InfeasibleError
    from steelyard.identification.solve import joint_fit

    def about(task, state):
        cost = {"last": last, "origin": 100.0}[state]
        if cost is None:
            raise InfeasibleError("a cable hangs nowhere")
        return joint_fit._Evaluated(state, (), None, cost)

    monkeypatch.setattr(joint_fit, "_about", about)
    assert joint_fit._lower(SimpleNamespace(settings=FIT), "last", "origin").state == ends


@pytest.mark.integration
def test_a_step_to_where_no_cables_can_be_is_shortened(monkeypatch):
    """The fit ends where it does with the whole step."""
    from simulated import moving

    from steelyard.errors import InfeasibleError
    from steelyard.identification.solve import joint_fit
    from steelyard.identification.solve.joint_motion import fit_jointly

    experiment = moving([1, 1, 1, 1, 1, 1], duration=6.0)(3)
    whole = fit_jointly(experiment)
    linearise, calls = joint_fit.linearise, []

    def refusing(task, state, **kinds):
        calls.append(state)
        if state.parameters is not None and not refusing.done:
            refusing.seen += 1
            if refusing.seen in (2, 3):
                refusing.done = refusing.seen == 3
                raise InfeasibleError("a cable hangs nowhere")
        return linearise(task, state, **kinds)

    refusing.done, refusing.seen = False, 0
    monkeypatch.setattr(joint_fit, "linearise", refusing)
    found = fit_jointly(experiment)
    assert refusing.done
    off = found.solution.value - whole.solution.value
    sigma = np.sqrt(np.diag(whole.solution.covariance))
    assert np.abs(off[:10] / sigma[:10]).max() < 0.05
