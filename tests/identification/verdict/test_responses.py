"""Pulls of what moves against the platform, against integrations of other formulations."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from steelyard.dynamics import FLEXIBILITY
from steelyard.identification.verdict.force_stretch import ForceStretch
from steelyard.identification.verdict.responses import (
    KINDS,
    AskedStretch,
    Bent,
    oscillator,
    pendulums,
)

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


@pytest.mark.integration
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


def stretch_of(over):
    """A stretch in which nothing is estimated, of forces as noisy as unity; what is left over is told."""
    time, instants = np.arange(0.0, 20.0, 0.02), np.arange(0.0, 20.02, STEP)
    waves = np.sin(2 * np.pi * np.array([0.3, 0.7, 1.1, 1.6, 2.0, 2.4]) * instants[:, None])
    felt = waves @ np.random.default_rng(0).normal(size=(6, 6)) + [0, 0, 9.81, 0, 0, 0]
    n = len(time)
    return ForceStretch(
        time=time,
        duration=20.0,
        instants=instants,
        acceleration=np.zeros((len(instants), 3)),
        gravity=np.array([0, 0, -9.81]),
        felt=felt,
        omega=np.zeros((n, 3)),
        rotation=np.tile(np.eye(3), (n, 1, 1)),
        whitener=np.tile(np.eye(6), (n, 1, 1)),
        use=np.ones(n, dtype=bool),
        kept=0.0,
        base=np.zeros((6 * n - 6, 0)),
        by_body=np.zeros((6 * n - 6, 10)),
        over=over,
        scatter=1.0,
        is_disturbed=False,
    )


BENDS = next(each for each in KINDS if each.is_stiff)
MATRIX = np.array([float(i == j) for i, j in FLEXIBILITY])


def bent_by(frequency, rng):
    """What bends at a frequency, of which the estimate knows how it does so at once."""
    silent = stretch_of(np.zeros(6 * 1000 - 6))
    asked = AskedStretch.of(silent, BENDS, 10.0)
    more = asked.whitened(((asked.bent(frequency) - asked.bent(np.inf)) @ MATRIX)[:, :, None])
    over = more[:, 0] / more.std() + rng.normal(size=len(more))
    seen = AskedStretch.of(stretch_of(over), BENDS, 10.0)
    return Bent.of([seen], MATRIX), float(more.std())


@pytest.mark.parametrize("frequency", [5.0, 7.0, 11.0])
def test_what_bends_answers_at_its_own_frequency(frequency):
    bent, size = bent_by(frequency, np.random.default_rng(1))
    tests = {each: bent.tested(each) for each in (3.0, 5.0, 7.0, 11.0)}
    assert max(tests, key=lambda each: tests[each].fall) == frequency
    # What looks like more of the same at once has moved the matrix.
    expected = 1 / size
    assert tests[frequency].pull[0] == pytest.approx(expected, rel=0.5)


def test_noise_bends_by_chance():
    chances, falls = [], []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        asked = AskedStretch.of(stretch_of(rng.normal(size=6 * 1000 - 6)), BENDS, 10.0)
        bent = Bent.of([asked], MATRIX)
        chances.append(bent.chance)
        falls.append(bent.tested(7.0).fall)
    assert 0.3 < np.mean(chances) < 0.7
    # A negative share, every other one, counts for nothing.
    assert np.mean(falls) == pytest.approx(0.5, abs=0.35)


def test_springs_that_are_stiff_follow_at_once():
    asked = AskedStretch.of(stretch_of(np.zeros(6 * 1000 - 6)), BENDS, 10.0)
    at_once = asked.bent(np.inf)
    # Once what they have begun with has died away.
    late = asked.stretch.time > 8.0
    apart = [
        np.sqrt(np.mean((asked.bent(each) - at_once)[late] ** 2) / np.mean(at_once[late] ** 2))
        for each in (7.0, 14.0, 20.0)
    ]
    # They answer more by the square of the frequency of the motion over their own.
    assert apart[0] > 3 * apart[1] > 4 * apart[2]
    assert apart[1] < 0.06
