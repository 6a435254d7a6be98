"""What two clocks share is linear, whatever the mounting, units, biases and levers; and no
combination of coefficients is odd in time, which a shift would need.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from steelyard.clocks.clock_signals import (
    POSITION,
    RATE,
    ROTATION,
    SPECIFIC_FORCE,
    Signal,
)
from steelyard.clocks.relations import relations

STEP = 1e-4  # [s], of differences of fourth order
TIME = np.linspace(-5.0, 5.0, 401)
GRAVITY = np.array([0, 0, -9.81])
LEVER = np.array([0.3, -0.2, 0.5])
MOUNTING = Rotation.from_euler("ZYX", [0.5, -0.3, 2.0])
RATES = np.array([1.1, 1.7, 0.9])


def derivative(function, t):
    """Of a function of time, by differences."""
    near = function(t + STEP) - function(t - STEP)
    far = function(t + 2 * STEP) - function(t - 2 * STEP)
    return (8 * near - far) / (12 * STEP)


class Moving:
    """A motion as the functions that a clock would have of it; even in time, or not."""

    def __init__(self, phase):
        self.phase = phase

    def place(self, t):
        return np.cos(np.outer(t, RATES) + self.phase) * [0.6, 0.5, 0.4] + [0, 0, 2]

    def attitude(self, t):
        return Rotation.from_rotvec(0.7 * np.cos(np.outer(t, RATES[::-1]) + 2 * self.phase))

    def omega(self, t):
        """In the platform [rad/s]."""
        ahead, behind = self.attitude(t + STEP), self.attitude(t - STEP)
        return (behind.inv() * ahead).as_rotvec() / (2 * STEP)

    def acceleration(self, t):
        return -(RATES**2) * (self.place(t) - [0, 0, 2])

    def specific_force(self, t, lever=(0.0, 0.0, 0.0)):
        """Of a point of the platform, in it [m/s^2]."""
        omega, alpha = self.omega(t), derivative(self.omega, t)
        inside = self.attitude(t).inv().apply(self.acceleration(t) - GRAVITY)
        turned = np.cross(omega, np.cross(omega, lever))
        return inside + np.cross(alpha, lever) + turned


class Known:
    """What one clock tells: exact functions, and samples."""

    def __init__(self, motion, **samples):
        self.motion = motion
        self.known = {name.replace("_", " "): values for name, values in samples.items()}

    def has(self, *kinds):
        return all(kind in self.known for kind in kinds)

    def samples(self, kind):
        return Signal(TIME, self.known[kind](TIME))

    def at(self, kind, time, order=0):
        if order == 2 and kind == POSITION:
            return self.motion.acceleration(time)
        return self.known[kind](time) if order == 0 else derivative(self.known[kind], time)

    def turning(self, time):
        motion = self.motion
        return motion.attitude(time).as_matrix(), motion.omega(time), derivative(motion.omega, time)


def quaternions(attitude):
    return lambda t: attitude(t).as_quat(scalar_first=True)


def clocks(motion):
    """Kind -> a clock that tells it, with errors of its own, and what explains it exactly."""
    gyro = lambda t: 57.3 * MOUNTING.inv().apply(motion.omega(t)) + [1, 2, 3]  # noqa: E731
    accelerometer = lambda t: (  # noqa: E731
        MOUNTING.inv().apply(motion.specific_force(t, LEVER)) / 9.81 + 0.1
    )
    target = lambda t: 1e3 * (motion.place(t) + motion.attitude(t).apply(LEVER))  # noqa: E731
    turned = quaternions(lambda t: motion.attitude(t) * MOUNTING)
    own = {"position": motion.place, "rotation": quaternions(motion.attitude)}
    return {
        ROTATION: (Known(motion, rotation=turned), Known(motion, rotation=own["rotation"])),
        RATE: (Known(motion, rate=gyro), Known(motion, rotation=own["rotation"])),
        "two gyros": (Known(motion, rate=gyro), Known(motion, rate=motion.omega)),
        POSITION: (Known(motion, position=target), Known(motion, **own)),
        SPECIFIC_FORCE: (Known(motion, specific_force=accelerometer), Known(motion, **own)),
    }


KINDS = (ROTATION, RATE, "two gyros", POSITION, SPECIFIC_FORCE)


@pytest.mark.parametrize("kind", KINDS)
def test_readings_are_a_linear_function_of_what_the_other_clock_tells(kind):
    of, by = clocks(Moving(np.array([0.3, 1.1, 2.0])))[kind]
    (relation,) = relations(of, by)
    assert relation.linear
    columns = [relation.other(TIME), relation.own(TIME), np.ones((len(TIME), 1))]
    design = np.hstack(columns)
    read = relation.response.values
    coefficients = np.linalg.lstsq(design, read, rcond=1e-12)[0]
    left = read - design @ coefficients
    assert np.abs(left).max() < 1e-5 * np.abs(read).max()


@pytest.mark.parametrize("kind", KINDS)
def test_what_explains_has_the_parity_of_what_is_explained(kind):
    """On a motion that is even in time, rates are odd and all else is even."""
    of, by = clocks(Moving(np.zeros(3)))[kind]
    (relation,) = relations(of, by)
    sign = -1 if kind in {RATE, "two gyros"} else 1
    explained = relation.other(TIME)
    scale = np.abs(explained).max()
    np.testing.assert_allclose(explained[::-1], sign * explained, atol=1e-5 * scale)
