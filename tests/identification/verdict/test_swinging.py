"""Loads that swing, against an integrated pendulum."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from steelyard.identification.verdict.swinging import likeliest_swing

pytestmark = pytest.mark.integration

GRAVITY = np.array([0.0, 0.0, -9.81])
TIMES = np.arange(0.0, 20.0, 0.02)
TURNED = Rotation.from_rotvec(0.2 * np.sin(np.outer(TIMES, [0.9, 1.1, 0.7])))
WAVES = [(0.35, 0.9), (0.6, 0.7), (1.1, 0.4)]  # [Hz], [m/s^2]


def acceleration(time):
    """Of the platform, level."""
    time = np.asarray(time)
    own = [sum(a * np.sin(2 * np.pi * f * time + k) for f, a in WAVES) for k in (0.3, 1.7)]
    return np.stack([*own, np.zeros_like(time)], axis=-1)


def pull_of(mass, length):
    """Of a load on a string, which swings in earnest: no small angles [N], platform frame."""

    def rate(time, state):
        away, speed = state[:2], state[2:]
        down = np.sqrt(length**2 - away @ away)
        return np.concatenate([speed, -acceleration(time)[:2] - 9.81 * away / down - 0.05 * speed])

    solved = solve_ivp(rate, (0, TIMES[-1]), np.zeros(4), t_eval=TIMES, rtol=1e-8, atol=1e-10)
    away = solved.y[:2].T
    down = np.sqrt(length**2 - np.sum(away**2, axis=1))
    level = mass * 9.81 * away / down[:, None]
    return TURNED.inv().apply(np.column_stack([level, np.zeros(len(TIMES))]))


def likeliest(pull, independent=80.0):
    return likeliest_swing(pull, TURNED.as_matrix(), acceleration(TIMES), GRAVITY, independent)


@pytest.mark.parametrize(("mass", "length"), [(4.0, 0.6), (1.5, 0.4)])
def test_a_load_on_a_string_is_named(mass, length):
    found = likeliest(pull_of(mass, length))
    assert found.mass == pytest.approx(mass, rel=0.3)
    assert found.frequency == pytest.approx(np.sqrt(9.81 / length) / (2 * np.pi), rel=0.1)
    assert found.explained > 0.7
    assert "swing" in str(found)


def test_what_walks_by_itself_is_none():
    rng = np.random.default_rng(4)
    kept = np.exp(-0.02 / 0.4)
    for _ in range(10):
        noise = rng.normal(size=(len(TIMES), 3))
        walk = np.zeros_like(noise)
        for i in range(1, len(walk)):
            walk[i] = kept * walk[i - 1] + noise[i]
        assert likeliest(walk, independent=walk.size * 0.02 / 0.8) is None
