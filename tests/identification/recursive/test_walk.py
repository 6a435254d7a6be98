"""A mass that walks at random, against a filter written in another form."""

import numpy as np
import pytest

from steelyard.identification.model.segment import NormalEquations
from steelyard.identification.recursive.window.walk import (
    a_step_later,
    as_in_the_end,
    blind_to_mass,
    by_mass,
    settled_steps,
    steps_of,
    with_known_steps,
    with_steps,
)
from steelyard.identification.solve.border.normal_equations import BorderEquations
from steelyard.inertia import TEN, Inertia

BLOCK, K, VARIANCE = 2, TEN + 3, 0.3
ROUNDING = 1e-8  # of inverses of matrices of some tens of rows
BORDER = np.concatenate(
    [Inertia(12.0, [0.1, -0.2, 0.3], np.diag([2.0, 3.0, 4.0])).parameters, [0.4, -0.1, 0.7]]
)


def told(rng, rows=40):
    """Border and right-hand side of readings that look at the border alone, and what these are."""
    A = rng.normal(size=(rows, K))
    y = A @ BORDER + rng.normal(size=rows)
    return A, y


def equations(A, y, border):
    """Their normal equations about a border, of a motion that nobody looks at."""
    return NormalEquations(
        np.zeros((6 * BLOCK, BLOCK)),
        np.zeros((BLOCK, len(border))),
        A.T @ A,
        np.zeros(BLOCK),
        A.T @ (y - A @ border),
        block=BLOCK,
    )


def filtered(readings, direction, variance):
    """Mean and covariance after all readings by Kalman's filter: a prediction by one step before every
    further chunk, then an update by covariances, reading by reading."""
    mean, covariance = np.zeros(K), 1e6 * np.eye(K)
    for i, (A, y) in enumerate(readings):
        if i:
            covariance = covariance + variance * np.outer(direction, direction)
        for row, value in zip(A, y, strict=True):
            gain = covariance @ row / (row @ covariance @ row + 1.0)
            mean = mean + gain * (value - row @ mean)
            covariance = covariance - np.outer(gain, row @ covariance)
    return mean, covariance


@pytest.fixture
def readings():
    rng = np.random.default_rng(4)
    return [told(rng, rows) for rows in (40, 6, 9, 30)]


def test_the_mass_comes_and_goes_at_the_centre_of_gravity():
    before = Inertia.from_parameters(BORDER[:TEN])
    after = Inertia.from_parameters((BORDER + 5.0 * by_mass(BORDER))[:TEN])
    assert after.mass == pytest.approx(17.0)
    np.testing.assert_allclose(after.center_of_gravity, before.center_of_gravity, rtol=1e-12)
    np.testing.assert_allclose(after.inertia, before.inertia, atol=1e-12)
    assert not by_mass(BORDER)[TEN:].any()


def test_steps_in_the_window_are_what_a_kalman_filter_says(readings):
    direction, count = by_mass(BORDER), len(readings) - 1
    steps = np.array([0.3, -0.2, 0.6])  # as they happen to be
    parts = []
    for i, (A, y) in enumerate(readings):
        then = BORDER - direction * steps[i:].sum()
        parts.append(with_steps(equations(A, y, then), direction, np.arange(count) >= i))
    whole = parts[0]
    for part in parts[1:]:
        whole = whole + part
    known = with_known_steps(whole, steps, VARIANCE)
    normal, gradient = settled_steps(known.corner, known.border_gradient, count)
    mean, covariance = filtered(readings, direction, VARIANCE)
    # Of the filter something is known beforehand, if little.
    normal, gradient = normal + 1e-6 * np.eye(K), gradient - 1e-6 * BORDER
    step = np.linalg.solve(normal, gradient)
    np.testing.assert_allclose(np.linalg.inv(normal), covariance, rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(BORDER + step, mean, atol=1e-4)
    # At the minimum no step asks for more.
    moved = steps + steps_of(known.corner, known.border_gradient, step)
    there = np.concatenate([step, moved - steps])
    left = known.border_gradient - known.corner @ there
    np.testing.assert_allclose(left[K:], 0.0, atol=ROUNDING * np.abs(known.corner).max())


def test_what_has_passed_is_what_a_kalman_filter_predicts(readings):
    direction = by_mass(BORDER)
    point, past = BORDER, None
    for i, (A, y) in enumerate(readings):
        own = equations(A, y, point)
        if past is None:
            past = own
            continue
        # About where the last step, whatever it is now, leads to.
        step = 0.1 * i
        before = past.border_gradient + past.corner @ (direction * step)
        later = NormalEquations(
            past.band, past.side, past.corner, past.motion_gradient, before, block=BLOCK
        )
        past = a_step_later(later, direction, step, VARIANCE) + own
    mean, covariance = filtered(readings, direction, VARIANCE)
    normal = past.corner + 1e-6 * np.eye(K)
    np.testing.assert_allclose(np.linalg.inv(normal), covariance, rtol=1e-5, atol=1e-7)
    found = BORDER + np.linalg.solve(normal, past.border_gradient - 1e-6 * BORDER)
    np.testing.assert_allclose(found, mean, atol=1e-4)


def test_motion_that_goes_on_is_forgotten_as_the_inverse_of_the_whole_says():
    rng = np.random.default_rng(2)
    functions, size = 5, 5 * BLOCK
    A = rng.normal(size=(60, size + K))
    whole = A.T @ A
    band = np.zeros((6 * BLOCK, size))
    for row in range(size):
        band[row, : size - row] = np.diag(whole[:size, :size], -row)
    gradient = rng.normal(size=size + K)
    given = NormalEquations(
        band,
        whole[:size, size:],
        whole[size:, size:],
        gradient[:size],
        gradient[size:],
        block=BLOCK,
    )
    assert functions * BLOCK == size
    direction = np.concatenate([np.zeros(size), by_mass(BORDER)])
    found = a_step_later(given, direction[size:], 0.0, VARIANCE)
    expected = np.linalg.inv(np.linalg.inv(whole) + VARIANCE * np.outer(direction, direction))
    np.testing.assert_allclose(found.corner, expected[size:, size:], rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(found.side, expected[:size, size:], rtol=1e-8, atol=1e-8)
    for row in range(size):
        own = np.diag(expected[:size, :size], -row)
        np.testing.assert_allclose(found.band[row, : size - row], own, rtol=1e-8, atol=1e-8)
    # The place of the minimum stays where the step is as it was.
    value = np.linalg.solve(whole, gradient)
    there = np.concatenate([found.motion_gradient, found.border_gradient])
    np.testing.assert_allclose(np.linalg.solve(expected, there), value, rtol=1e-6, atol=1e-8)


def test_chunks_are_compared_without_their_masses():
    rng = np.random.default_rng(3)
    A, y = told(rng)
    direction = by_mass(BORDER)
    normal, right = blind_to_mass(A.T @ A, A.T @ y, direction)
    np.testing.assert_allclose(normal @ direction, 0.0, atol=1e-8)
    scores = [right - normal @ (BORDER + more * direction) for more in (0.0, 3.0)]
    np.testing.assert_allclose(scores[0], scores[1], atol=1e-7)
    # What is independent of the mass is told as before.
    across = rng.normal(size=K)
    across -= direction * (direction @ A.T @ A @ across) / (direction @ A.T @ A @ direction)
    assert across @ normal @ across == pytest.approx(across @ A.T @ A @ across)


def test_equations_of_chunks_and_what_is_added_say_what_is_known_in_the_end():
    rng = np.random.default_rng(5)
    chunks = [told(rng) for _ in range(3)]
    noise = 0.1 * np.eye(TEN)
    parts = [BorderEquations(A.T @ A, A.T @ y, noise, 40.0) for A, y in chunks]
    (A, y), direction = told(rng), by_mass(BORDER)
    end = BorderEquations(A.T @ A, A.T @ y, np.zeros((TEN, TEN)), 0.0)
    total = sum(parts[1:], parts[0]) + as_in_the_end(parts, end, direction)
    np.testing.assert_allclose(total.normal, end.normal, atol=1e-8)
    np.testing.assert_allclose(total.right, end.right, atol=1e-8)
    assert total.freedom == 120.0
    assert np.linalg.eigvalsh(total.noise).min() > 0
    own = direction[:TEN]
    kept = (direction @ end.normal @ direction) / sum(
        own @ each.normal[:TEN, :TEN] @ own for each in parts
    )
    assert own @ total.noise @ own == pytest.approx(min(kept, 1.0) * 3 * own @ noise @ own)
