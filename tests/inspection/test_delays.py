"""How late a clock is, by vibrations that two instruments share."""

import numpy as np
import pytest

from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run, Stream
from steelyard.inspection.delays import of_excerpt

pytestmark = pytest.mark.integration


def shaken(rng, delay):
    """A body of 2 kg on a wrench sensor that shakes, with an accelerometer whose stamps are
    late."""
    from steelyard.instruments import Attitude, Imu, Wrench
    from steelyard.robot.model import Robot

    def force(t):
        return np.column_stack(
            [
                np.sin(2 * np.pi * f * t + f) + 0.1 * np.sin(2 * np.pi * 17 * f * t)
                for f in (0.9, 1.1, 1.3)
            ]
        )

    up = np.array([0.0, 0.0, 9.81])
    times = {
        "sensor": np.arange(0, 8, 1 / 700),
        "imu": np.arange(0.001, 8, 1 / 254),
        "arm": np.arange(0, 8, 0.01),
    }
    streams = {
        "sensor": Stream(times["sensor"], {"force": 2 * (force(times["sensor"]) + up) + rng.normal(0, 0.01, (5600, 3)), "torque": rng.normal(0, 1e-3, (5600, 3))}, "sensor"),
        "imu": Stream(times["imu"] + delay, {"specific_force": force(times["imu"]) + up + rng.normal(0, 0.02, (len(times["imu"]), 3))}, "imu"),
        "arm": Stream(times["arm"], {"orientation": np.tile(np.eye(3), (800, 1, 1))}, "arm"),
    }  # fmt: skip
    instruments = {
        "sensor": Wrench(kind="wrench"),
        "imu": Imu(kind="imu"),
        "arm": Attitude(kind="attitude"),
    }
    return Experiment(
        "shaken",
        Robot("sensor", np.zeros((0, 3)), np.zeros((0, 3))),
        instruments,
        (Run("run", streams),),
    )


@pytest.mark.parametrize("delay", [-0.004, 0.0, 0.0072])
def test_vibrations_tell_how_late_an_accelerometer_is(rng, delay):
    experiment = shaken(rng, delay)
    found = {each.instruments: each for each in of_excerpt(experiment, experiment.runs[0])}
    accelerometer = found["imu",]
    assert accelerometer.told
    assert accelerometer.value == pytest.approx(delay, abs=5e-4)
