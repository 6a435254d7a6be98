"""Forces that are late and forces that are filtered: both are behind by as much, and the one is not taken
for the other."""

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import bilinear, lfilter
from simulated import with_stream

from steelyard.experiment.read import read_experiment
from steelyard.inspection.identify import identify
from steelyard.simulation.mistakes import MISTAKES

RECORDING = Path(__file__).parents[3] / "data" / "rough-robots" / "four-cables-00"
LATE = 0.05  # [s]


@pytest.fixture(scope="module")
def sound():
    return read_experiment(RECORDING / "experiment.yaml")


def behind(experiment):
    """What an estimate says of how far the forces are behind [s], and the estimate."""
    estimate = identify(experiment, ["maximum-likelihood"]).estimate
    found = estimate.calibration["cables"]
    assert estimate.verdict.accepted
    return {key: found[key]["value"] for key in ("latency", "time_constant") if key in found}


@pytest.mark.integration
def test_late_forces_are_late(sound):
    """Where the readings hardly tell late from filtered, both may be there, and the body has the
    uncertainty of both; a filter alone is no explanation."""
    late = MISTAKES["forces late by 50 ms"](sound, np.random.default_rng(0))
    found = behind(late)
    assert found["latency"] > 0.6 * LATE
    assert sum(found.values()) == pytest.approx(LATE, abs=2e-3)


@pytest.mark.integration
@pytest.mark.parametrize("constant", [0.02, 0.05])
def test_filtered_forces_are_filtered(sound, constant):
    """Of 50 ms it was taken for late, and moments were 7 of their 1-sigma off, while the series in the
    time constant was put right in the readings."""
    rng, sigma = np.random.default_rng(0), sound.instruments["cables"].noise

    def through(values):
        read = values["tension"]
        numerator, denominator = bilinear([1.0], [constant, 1.0], 100.0)
        start = read[:1] * (1 - numerator[0])
        filtered = lfilter(numerator, denominator, read, axis=0, zi=start)[0]
        return {"tension": filtered + sigma * rng.standard_normal(read.shape)}

    found = behind(with_stream(sound, "cables", through))
    assert found == {"time_constant": pytest.approx(constant, abs=1e-3)}
