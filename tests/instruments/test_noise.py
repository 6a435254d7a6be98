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


def test_what_knots_do_not_follow_is_the_part_above_their_frequency():
    step, correlation, spacing = 0.002, 0.3, 0.2
    rng = np.random.default_rng(3)
    values = markov(rng.normal(size=(2**18, 1)), step / correlation)[:, 0]
    spectrum = np.fft.rfft(values)
    spectrum[np.fft.rfftfreq(len(values), step) < 1 / (2 * spacing)] = 0.0
    left = np.std(np.fft.irfft(spectrum))
    stated = [Disturbance("colored", 1.0, correlation)]
    assert unresolved(stated, spacing) == pytest.approx(left, rel=0.03)


def test_the_same_of_a_random_walk():
    step, spacing = 0.002, 0.2
    rng = np.random.default_rng(4)
    # Slowly forgotten, it is the walk within seconds.
    correlation = 50.0
    values = markov(rng.normal(size=(2**20, 1)), step / correlation)[:, 0] * np.sqrt(
        correlation / 2
    )
    spectrum = np.fft.rfft(values)
    spectrum[np.fft.rfftfreq(len(values), step) < 1 / (2 * spacing)] = 0.0
    left = np.std(np.fft.irfft(spectrum)[1000:-1000])
    assert unresolved([Disturbance("drift", 1.0)], spacing) == pytest.approx(left, rel=0.05)
