"""Forces that scatter more from sample to sample than their noise: a fit begins with that scatter."""

import numpy as np
import pytest

from steelyard.identification.model.balance import Forces
from steelyard.identification.samples.force_samples import louder_forces

TIME = np.arange(0.0, 20.0, 0.01)
SIGMA = 0.5


def forces(read, left_out=None):
    none = np.zeros(read.shape, dtype=bool)
    sigma = np.full(read.shape[1], SIGMA)
    return Forces("cables", TIME, {"tension": read}, sigma, none if left_out is None else left_out)


def pulled(rng):
    """Four cables of a platform that swings at 2 Hz."""
    swing = 40 * np.sin(2 * np.pi * 2.0 * TIME[:, None] + np.arange(4))
    return 100 + swing + SIGMA * rng.standard_normal((len(TIME), 4))


def test_swings_and_noise_as_stated_are_no_scatter(rng):
    assert louder_forces(forces(pulled(rng))) == {}


def test_a_hum_is_scatter(rng):
    hum = 2.0 * np.sin(2 * np.pi * 49.3 * TIME[:, None] + rng.uniform(0, 6, 4))
    rms = np.sqrt(1 + (2.0**2 / 2) / SIGMA**2)
    # Differences see a line near half the sampling rate 1.8 times as large as white noise, and half
    # of its size is more than half of that of normal noise.
    assert rms < louder_forces(forces(pulled(rng) + hum))["tension"] < 3 * rms


def test_single_readings_that_are_far_off_or_left_out_do_not_count(rng):
    read = pulled(rng)
    spiked = rng.random(read.shape) < 0.01
    read[spiked] += 80.0
    assert louder_forces(forces(read)) == {}
    gone = np.zeros(read.shape, dtype=bool)
    gone[500:900] = True
    read[500:900] *= rng.standard_normal((400, 4))
    assert louder_forces(forces(read, gone)) == {}


def test_a_noise_stated_in_another_unit_is_none_to_begin_with(rng):
    read = 1000 * pulled(rng)
    assert louder_forces(forces(read)) == {}
    assert louder_forces(forces(0.1 * read))["tension"] == pytest.approx(100, rel=0.1)
