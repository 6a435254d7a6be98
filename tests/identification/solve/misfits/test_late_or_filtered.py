"""Forces that are late and forces that are filtered: both are behind by as much, and the one is not taken
for the other."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import bilinear, lfilter
from scipy.stats import chi2
from simulated import with_stream

from steelyard.campaigns.study.draw import drawn
from steelyard.campaigns.study.setup import setup_of_robot
from steelyard.experiment.read import read_experiment
from steelyard.identification.model.calibration_parameters import CalibrationValues, gather
from steelyard.identification.solve.misfits.late_or_filtered import shared
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


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.integration
def test_late_forces_are_late(sound):
    """Where the readings hardly tell late from filtered, both may be there, and the body has the
    uncertainty of both; a filter alone is no explanation."""
    late = MISTAKES["forces late by 50 ms"](sound, np.random.default_rng(0))
    found = behind(late)
    assert found["latency"] > 0.6 * LATE
    assert sum(found.values()) == pytest.approx(LATE, abs=2e-3)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.integration
@pytest.mark.parametrize("constant", [0.02, 0.05])
def test_filtered_forces_are_filtered(sound, constant):
    """Of 50 ms it was taken for late, and accepted with 5.4, while the series in the
    time constant was put right in the readings."""
    rng, sigma = np.random.default_rng(0), sound.instruments["cables"].noise

    def through(values):
        read = values["tension"]
        numerator, denominator = bilinear([1.0], [constant, 1.0], 100.0)
        start = read[:1] * (1 - numerator[0])
        filtered = lfilter(numerator, denominator, read, axis=0, zi=start)[0]
        return {"tension": filtered + sigma * rng.standard_normal(read.shape)}

    found = behind(with_stream(sound, "cables", through))
    # 20 ms are hardly told from a delay there.
    assert found["time_constant"] > 0.3 * constant
    assert sum(found.values()) == pytest.approx(constant, abs=1e-3)
    assert constant == 0.02 or "latency" not in found


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.integration
def test_over_a_held_motion_late_forces_are_no_filter_whose_estimate_misleads():
    """Where their delay is stated, a filter alone was taken: chi-squares of 2.4 per parameter in the mean of
    50 draws, 4.9 at most, half of them accepted."""
    setup, squares = setup_of_robot("cogiro", "paper", "multisine", 20.0), []
    truth = setup.robot_of().platform.body_parameters
    for seed in range(4):
        late = MISTAKES["forces late by 50 ms"](drawn(setup, seed), np.random.default_rng(seed))
        estimate = identify(late, ["consistent"]).estimate
        assert "latency" in estimate.calibration["cables"]
        off = estimate.value - truth
        squares.append(off @ np.linalg.solve(estimate.covariance, off))
    assert sum(squares) < chi2.isf(1e-3, 10 * len(squares))


@dataclass(frozen=True)
class Held:
    """What a task or a state hold of calibration parameters."""

    calibration_parameters: object = None
    calibration: object = None


def test_what_is_behind_is_shared_between_latency_and_filter(sound):
    parameters = gather(sound)
    keys = [("cables", "latency", None), ("cables", "time_constant", None)]
    values = parameters.mean.copy()
    alone = values.copy()
    alone[parameters.places["cables", "time_constant", None]] = 0.04
    task, state = shared(
        Held(parameters),
        Held(calibration=CalibrationValues(parameters, values)),
        frozenset(keys),
        Held(calibration=CalibrationValues(parameters, alone)),
    )
    places = task.calibration_parameters.places
    of_filter, late = (state.calibration.values[places[key]] for key in reversed(keys))
    assert of_filter + late == pytest.approx(0.04)
    # Half of what the whole would smooth.
    assert of_filter**2 == pytest.approx(0.04**2 / 2, rel=0.05)
    entry = next(e for e in task.calibration_parameters.entries if e.key == "time_constant")
    assert entry.mean == pytest.approx(of_filter)
