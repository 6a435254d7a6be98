"""Pulls of what moves against the platform, against integrations of other formulations."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from steelyard.identification.verdict.responses import oscillator, pendulums

STEP = 0.01  # [s]
GRAVITY = np.array([0.0, 0.0, -9.81])
TIME = np.arange(0.0, 6.0, STEP)


def test_an_oscillator_is_the_integrated_one():
    driven = np.column_stack([np.sin(3 * TIME) * TIME, np.cos(5 * TIME) - 1, 0 * TIME])
    omega, damping = 2 * np.pi * 0.8, 0.03

    def rate(now, state):
        at = np.array([np.interp(now, TIME, each) for each in driven.T])
        return np.concatenate(
            [state[3:], -at - 2 * damping * omega * state[3:] - omega**2 * state[:3]]
        )

    solved = solve_ivp(rate, (0, TIME[-1]), np.zeros(6), t_eval=TIME, rtol=1e-8, atol=1e-10)
    assert oscillator(driven, omega, damping, STEP) == pytest.approx(
        omega**2 * solved.y[:3].T, abs=0.01 * np.abs(driven).max()
    )


def shaken(size):
    """A point that is moved along all axes, from rest [m/s^2], shape (t, 3)."""
    rising = np.minimum(TIME, 1.0)[:, None]
    return (
        size
        * rising
        * np.column_stack([np.sin(4 * TIME), np.cos(3.5 * TIME), 0.5 * np.sin(6 * TIME)])
    )


def test_small_swings_are_those_of_an_oscillator():
    acceleration, omega = shaken(0.05), 2 * np.pi * np.array([0.5, 0.7, 1.3])
    found = pendulums(acceleration, GRAVITY, omega, 0.02, STEP)
    for each, pull in zip(omega, found, strict=True):
        level = oscillator(acceleration, each, 0.02, STEP)[:, :2] + acceleration[:, :2]
        assert pull[:, :2] == pytest.approx(level, abs=0.02 * np.abs(level).max())
        assert np.abs(pull[:, 2]).max() < 0.1 * np.abs(level).max()


def test_a_plane_pendulum_obeys_the_equation_of_its_angle():
    """To more than a right angle; the pull from the angle and its rate."""
    acceleration = shaken(4.0) * [1.0, 0.0, 1.0]
    omega, damping = 2 * np.pi * 0.64, 0.01
    length = 9.81 / omega**2

    def rate(now, state):
        level, _, high = (np.interp(now, TIME, each) for each in acceleration.T)
        turned = -(level * np.cos(state[0]) + (9.81 + high) * np.sin(state[0])) / length
        return [state[1], turned - 2 * damping * omega * state[1]]

    solved = solve_ivp(rate, (0, TIME[-1]), [0, 0], t_eval=TIME, rtol=1e-9, atol=1e-11)
    angle, speed = solved.y
    assert np.abs(angle).max() > np.pi / 2
    along = np.column_stack([np.sin(angle), 0 * angle, -np.cos(angle)])
    felt = GRAVITY - acceleration
    pull = (length * speed**2 + np.sum(felt * along, axis=1))[:, None] * along - felt
    (found,) = pendulums(acceleration, GRAVITY, np.array([omega]), damping, STEP)
    assert found == pytest.approx(pull, abs=2e-3 * np.abs(pull).max())


def test_what_hangs_still_pulls_as_what_is_fixed():
    leaning = np.array([3.0, -4.0, -8.0])
    (found,) = pendulums(np.zeros((400, 3)), leaning, np.array([5.0]), 0.0, STEP)
    assert found == pytest.approx(np.zeros((400, 3)), abs=1e-9)
