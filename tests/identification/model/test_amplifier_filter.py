"""Filters of force amplifiers: what correcting their readings costs, and whether it is worth it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import bilinear, lfilter
from simulated import PAPER, changed, moving, with_stream

from steelyard.identification.model.balance.amplifier_filter import ReadingChanges
from steelyard.identification.solve.joint_motion import fit_jointly


@pytest.mark.parametrize("rate", [25.0, 100.0, 1000.0])
@pytest.mark.parametrize("constant", [0.002, 0.01, 0.03, 0.1])
def test_corrected_readings_are_as_noisy_as_is_said(rate, constant):
    """Against the scatter of corrected noise, but for its ends."""
    noise = np.random.default_rng(0).standard_normal((int(20 * rate), 60))
    changes = ReadingChanges.of(np.arange(len(noise)) / rate, noise)
    inside = slice(int(rate), -int(rate))
    corrected = (noise - changes.added(constant))[inside]
    assert changes.louder(constant) == pytest.approx(
        corrected.std() / noise[inside].std(), rel=1e-2
    )


def test_readings_of_one_instant_are_as_noisy_as_they_were():
    assert ReadingChanges.of(np.zeros(1), np.zeros((1, 8))).louder(0.03) == 1.0


@pytest.mark.integration
@pytest.mark.parametrize("seed", range(3))
def test_a_filter_is_found_in_a_slow_motion(seed):
    """Corrections of readings whose noise is stated cost more there than they explain, were they not
    taken as noisier."""
    constant, rate, noise = 0.012, 100.0, 12.0
    cables = changed(PAPER["cables"], rate=rate, noise=1e-6)
    quiet = moving([1, 1, 1, 1, 1, 1], duration=20.0, harmonics=3)(
        seed, instruments={**PAPER, "cables": cables}
    )
    rng = np.random.default_rng(seed)
    # Five times as many samples, along straight lines, through the filter and back.
    numerator, denominator = bilinear([1.0], [constant, 1.0], 5 * rate)

    def read(values):
        true = values["tension"]
        dense = np.linspace(0, len(true) - 1, 5 * (len(true) - 1) + 1)
        through = []
        for own in true.T:
            along = np.interp(dense, np.arange(len(own)), own)
            start = [own[0] * (1 - numerator[0])]
            through.append(lfilter(numerator, denominator, along, zi=start)[0][::5])
        return {"tension": np.column_stack(through) + noise * rng.standard_normal(true.shape)}

    filtered = with_stream(quiet, "cables", read)
    stated = changed(cables, noise=noise, calibration={"time_constant": {"sigma": 0.03}})
    found = fit_jointly(replace(filtered, instruments={**quiet.instruments, "cables": stated}))
    place = found.calibration.calibration_parameters.place("cables", "time_constant", "run")
    sigma = found.deviations[place]
    assert sigma < 0.4 * constant
    assert abs(found.calibration.values[place] - constant) < 3 * sigma
