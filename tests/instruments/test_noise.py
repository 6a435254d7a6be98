"""Noise as a file states it, and what it says of disturbances."""

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from steelyard.identification.model.processes import unresolved
from steelyard.instruments import AnyInstrument
from steelyard.instruments.noise import Disturbance
from steelyard.simulation.disturbances import markov


def instrument(**keys):
    return TypeAdapter(AnyInstrument).validate_python(keys)


def test_a_number_is_white_noise():
    (tension,) = instrument(kind="tension", noise=5.0).quantities(4)
    assert (tension.noise, tension.disturbed) == (5.0, ())


def test_a_coloured_part_stands_beside_it():
    stated = instrument(kind="pose", noise={"position": {"white": 0.001, "colored": 0.01}})
    position, orientation = stated.quantities(4)
    assert position.noise == 0.001
    assert position.disturbed == (Disturbance("colored", 0.01, None),)
    assert (orientation.noise, orientation.disturbed) == (None, ())


@pytest.mark.parametrize(
    ("keys", "quantity", "cause"),
    [
        ({"kind": "tension", "calibration": {"drift": 0.5}}, "tension", "drift"),
        ({"kind": "wrench", "calibration": {"drift": 0.5}}, "torque", "drift"),
        ({"kind": "imu", "calibration": {"gyro_drift": 0.1}}, "angular_velocity", "drift"),
        ({"kind": "imu", "calibration": {"accelerometer_drift": 0.1}}, "specific_force", "drift"),
        ({"kind": "imu", "calibration": {"filter": 2.0}}, "orientation", "filter"),
        ({"kind": "attitude", "calibration": {"heading": 0.02}}, "orientation", "drift"),
        ({"kind": "position", "calibration": {"reacquired": 0.01}}, "position", "reacquired"),
        ({"kind": "pose", "calibration": {"reacquired": 0.01}}, "position", "reacquired"),
    ],
)
def test_calibration_states_disturbances(keys, quantity, cause):
    assert [d.cause for d in instrument(**keys).quantity(quantity, 8).disturbed] == [cause]


@pytest.mark.parametrize(
    "noise", [-1.0, {"white": -1.0}, {"white": 1.0, "time": 0.0}, {"grey": 1.0}, "5 N", [5.0]]
)
def test_what_is_no_noise_is_refused(noise):
    with pytest.raises(ValidationError):
        instrument(kind="tension", noise=noise)


def test_it_is_written_as_it_was_stated():
    for noise in (5.0, {"white": 1.0, "colored": 5.0, "time": 0.3}, {"colored": 2.0}):
        written = instrument(kind="tension", noise=noise).model_dump(exclude_unset=True)
        assert written["noise"] == noise


SPACING = 0.2  # of the knots [s]
STEP = 0.002  # of the samples [s]


def density_at_the_end(values):
    """Two-sided spectral density times the sampling rate, just above half a period per spacing."""
    frequency = np.fft.rfftfreq(len(values), STEP)
    band = (frequency > 0.98 / (2 * SPACING)) & (frequency < 1.02 / (2 * SPACING))
    return np.mean(np.abs(np.fft.rfft(values)[band]) ** 2) / len(values)


@pytest.mark.parametrize("correlation", [0.02, 0.3, 3.0])
def test_what_knots_do_not_follow_has_the_density_of_where_they_end(correlation):
    rng = np.random.default_rng(3)
    values = markov(rng.normal(size=(2**21, 1)), STEP / correlation)[:, 0]
    stated = [Disturbance("colored", 1.0, correlation)]
    white = unresolved(stated, SPACING, STEP)
    assert white**2 == pytest.approx(density_at_the_end(values), rel=0.06)


def test_the_same_of_a_random_walk():
    rng = np.random.default_rng(4)
    # Slowly forgotten, it is the walk within seconds.
    correlation = 50.0
    values = markov(rng.normal(size=(2**21, 1)), STEP / correlation)[:, 0]
    values *= np.sqrt(correlation / 2)
    white = unresolved([Disturbance("drift", 1.0)], SPACING, STEP)
    assert white**2 == pytest.approx(density_at_the_end(values), rel=0.06)
