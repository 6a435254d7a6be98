"""Accelerometers that a drive shakes and forces that hum: what is faster than the motion is no error
of the description, and what follows the motion is none of a drive or of the mains.
"""

import numpy as np
import pytest
from simulated import sound, with_stream

from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.samples.motion_noise import rapid_scatter


def shaken(experiment, frequency, size, quantity="specific_force"):
    """The experiment with a line in the readings of its IMU, on each axis with a phase of its own."""
    (run,) = experiment.runs
    phase = 2 * np.pi * frequency * run.streams["imu"].time[:, None] + [0.3, 1.9, 4.0]
    return with_stream(
        experiment, "imu", lambda values: {quantity: values[quantity] + size * np.sin(phase)}
    )


def assert_same_body(found, plain, wider):
    """Within noise, and not so many times less certain."""
    assert found.verdict.accepted, found.verdict.reasons
    assert np.all(np.abs(found.value - plain.value) < 3 * found.standard_deviation)
    assert np.all(found.standard_deviation < wider * plain.standard_deviation)


@pytest.mark.integration
def test_a_vibration_above_the_motion_is_noise():
    plain, found = (MaximumLikelihood()(each) for each in (sound(1), shaken(sound(1), 10.3, 0.8)))
    assert_same_body(found, plain, 3)
    (note,) = [each for each in found.notes if "is shaken" in each]
    assert "specific force of imu is shaken, most at 10.3 Hz" in note
    assert "0.57 m/s^2" in note


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize(
    "wrong",
    [
        lambda e: shaken(e, 0.4, 0.8),
        lambda e: with_stream(e, "imu", lambda v: {"specific_force": 1.2 * v["specific_force"]}),
        lambda e: with_stream(
            e, "imu", lambda v: {"specific_force": v["specific_force"][:, [1, 0, 2]]}
        ),
    ],
    ids=["at the frequencies of the motion", "scale", "axes"],
)
def test_what_follows_the_motion_is_none(wrong):
    found = MaximumLikelihood()(wrong(sound(1)))
    assert not found.verdict.accepted
    assert not [each for each in found.notes if "is shaken" in each]


def humming(experiment, frequency, size):
    """The experiment with a line in the readings of its cables, on each with a phase of its own [N]."""
    (run,) = experiment.runs
    phase = 2 * np.pi * frequency * run.streams["cables"].time[:, None] + 2.4 * np.arange(8) ** 2
    return with_stream(
        experiment, "cables", lambda values: {"tension": values["tension"] + size * np.sin(phase)}
    )


@pytest.mark.slow
@pytest.mark.integration
def test_forces_that_hum_are_noisy_and_no_sensor_reads_another():
    """A common hum is akin in all cables: what one reads of another would explain it."""
    plain, found = (MaximumLikelihood()(each) for each in (sound(1), humming(sound(1), 31.3, 25.0)))
    assert_same_body(found, plain, 5)
    assert not found.details["found_errors"]
    (note,) = [each for each in found.notes if "hums" in each]
    # Cables are read with 25 Hz.
    assert "tension of cables hums, most at 6.3" in note
    assert "sampled as that" in note


@pytest.mark.slow
@pytest.mark.integration
def test_forces_that_depart_at_the_frequencies_of_the_motion_do_not_hum():
    found = MaximumLikelihood()(humming(sound(1), 0.4, 25.0))
    assert not [each for each in found.notes if "hums" in each]


def test_rapid_scatter_is_that_of_the_noise_and_not_of_the_motion():
    rng = np.random.default_rng(0)
    time = np.arange(0, 20, 0.01)
    motion = np.column_stack([np.sin(2 * np.pi * f * time) for f in (0.2, 0.7, 1.1)])
    assert rapid_scatter(motion) < 1e-3
    noisy = motion + rng.normal(0, [0.01, 0.03, 0.02], motion.shape)
    assert rapid_scatter(noisy) == pytest.approx(0.03, rel=0.1)
    noisy[::50] += 5.0
    assert rapid_scatter(noisy) == pytest.approx(0.03, rel=0.2)
