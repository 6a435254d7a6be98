"""Poses at rest with forces: how a platform hangs tells where its cables are fixed, and its body."""

from dataclasses import replace

import numpy as np
import pytest
from halls import CENTRE, MASS, G, errors, hung, recorded

from steelyard.calibration.calibrate import calibrate
from steelyard.experiment.observations import DeadWeights
from steelyard.instruments import Tension, Weight
from steelyard.instruments.base import Prior

pytestmark = pytest.mark.integration


@pytest.mark.slow
def test_lengths_and_forces_alone_tell_the_shape():
    experiment, _ = hung(0)
    found = calibrate(experiment)
    assert not found.reasons
    assert found.gauges["anchor"].untied == ("x", "y", "z", "rotation about z")
    # Up is told by the weight.
    assert "rotation about x" not in found.gauges["anchor"].untied


@pytest.mark.slow
@pytest.mark.long
def test_intervals_cover_up_to_the_gauge():
    chi = []
    for seed in range(10):
        experiment, true = hung(seed)
        off = errors(found := calibrate(experiment), true)
        assert not found.reasons
        chi.append(off @ np.linalg.solve(found.covariance, off) / len(off))
    assert 0.8 < np.mean(chi) < 1.25


@pytest.mark.parametrize("seed", range(3))
def test_forces_beside_a_tracker_tell_the_body(seed):
    experiment, true = hung(seed, tracker=True, off=0.3)
    found = calibrate(experiment)
    assert not found.reasons
    body, sigma = found.body
    assert abs(body[0] - MASS) < 4 * sigma[0] < 0.02 * MASS
    assert (np.abs(body[1:4] - CENTRE) < 4 * sigma[1:4]).all()
    # At rest nothing tells how a body turns.
    assert np.isnan(body[4:]).all()
    assert found.to_dict()["body"]["inertia"][0][0] is None
    assert np.abs(found.points["anchor"] - true.anchors).max() < 0.05


def test_a_sign_that_is_wrong_is_rejected():
    experiment, _ = hung(1, tracker=True)
    (run,) = experiment.runs
    cables = run.streams["cables"]
    values = cables.values["tension"] * np.array([1, 1, -1, 1, 1, 1, 1, 1])
    streams = {**run.streams, "cables": replace(cables, values={"tension": values})}
    assert calibrate(replace(experiment, runs=(replace(run, streams=streams),))).reasons


def weights(gain, offset, noise=0.5):
    """Three on each of the eight cells."""
    cable, mass = np.repeat(np.arange(8), 3), np.tile([10.0, 30.0, 60.0], 8)
    rng = np.random.default_rng(99)
    reading = gain[cable] * mass * G + offset[cable] + noise * rng.standard_normal(24)
    form = Weight.model_validate({"kind": "weight", "of": "cables", "noise": noise})
    return DeadWeights("bench", "weights", form, cable + 1, mass, reading)


def test_dead_weights_tell_the_mass():
    gain, offset = 1.01 + np.linspace(-0.006, 0.006, 8), np.linspace(-3, 3, 8)
    experiment, _ = hung(0, tracker=True, cells=(gain, offset))
    cells = experiment.instruments["cables"]
    calibration = cells.calibration.model_copy(update={"common_gain": Prior(sigma=0.01)})
    wide = cells.model_copy(update={"calibration": calibration})
    experiment = replace(experiment, instruments={**experiment.instruments, "cables": wide})
    without = calibrate(experiment)
    weighed = calibrate(replace(experiment, weights=(weights(gain, offset),)))
    assert not weighed.reasons
    (mass, *_), (sigma, *_) = weighed.body
    print(
        f"1-sigma of the mass {without.body[1][0]:.3f} kg without weights, {sigma:.3f} kg with them"
    )
    assert abs(mass - MASS) < 4 * sigma
    assert sigma < without.body[1][0] / 5


def test_cells_of_which_there_are_only_weights_are_told_too():
    experiment, _ = recorded()
    cells = Tension.model_validate({"kind": "tension", "noise": 1.0})
    gain, offset = np.linspace(0.99, 1.01, 8), np.linspace(-2, 2, 8)
    found = calibrate(
        replace(
            experiment,
            instruments={**experiment.instruments, "cables": cells},
            weights=(weights(gain, offset),),
        )
    )
    told = found.to_dict()["calibration"]["cables"]
    both = np.array(told["gain"]["value"]) * told["common_gain"]["value"]
    np.testing.assert_allclose(both, gain, atol=6e-3)
    sigma = np.array(told["offset"]["standard_deviation"])
    off = np.array(told["offset"]["value"]) - offset
    assert (np.abs(off) < 4 * sigma).all()
    assert not found.unobservable


def test_a_weight_that_was_typed_wrong_is_named_beside_wrong_poses():
    experiment, _ = recorded()
    cells = Tension.model_validate({"kind": "tension", "noise": 1.0})
    table = weights(np.ones(8), np.zeros(8))
    mass = table.mass.copy()
    mass[4] = 3.0
    found = calibrate(
        replace(
            experiment,
            instruments={**experiment.instruments, "cables": cells},
            weights=(replace(table, mass=mass),),
        )
    )
    (row,) = found.to_dict()["wrong_rows"]
    assert row.startswith("run 'bench': row 5 of 'weights': 3 kg on cable 2")
