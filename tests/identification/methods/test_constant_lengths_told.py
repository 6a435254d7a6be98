"""Swings on locked winches whose lengths are said to be constant, simulated in MuJoCo."""

from dataclasses import replace

import numpy as np
import pytest
from laboratory_swings import Laboratory, record

from steelyard.estimates.per_mass import PerMass
from steelyard.experiment.unread import LOCKED, with_constant_lengths
from steelyard.identification.methods.least_squares import LeastSquares
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.methods.recursive import Recursive
from steelyard.identification.solve.beginning.begin import begin
from steelyard.identification.solve.beginning.readings import read
from steelyard.identification.solve.misfits.undisturbed_swings import undisturbed_swings

pytestmark = pytest.mark.mujoco
NOISE = 3e-4


def with_lengths(recorded):
    return with_constant_lengths(replace(recorded.experiment, length_noise=NOISE))


def off(recorded, found):
    """Errors of the nine in 1-sigma."""
    truth = PerMass.of(recorded.body.body_parameters, np.zeros((10, 10))).value
    return (found.per_mass.value - truth) / found.per_mass.standard_deviation


@pytest.mark.slow
def test_lengths_that_do_not_change_tell_the_inertia_better():
    """Cables that stretch by half a millimetre more and less, which nobody has stated: taken as rigid
    they would make the inertia wrong by many 1-sigma."""
    lab = Laboratory(cables=3, runs=3, duration=5.0, stiffness=5e4, stretch_stated=False)
    recorded = record(lab, [8_120, 3])
    plain = MaximumLikelihood()(recorded.experiment)
    found = MaximumLikelihood()(with_lengths(recorded))
    assert found.verdict.accepted
    assert np.abs(off(recorded, found)).max() < 3.0
    moments = slice(3, 6)
    told = found.per_mass.standard_deviation[moments]
    assert (told < 0.8 * plain.per_mass.standard_deviation[moments]).all()
    # 1 / EA, for the mass that is assumed in place of the true one.
    softness = found.calibration[LOCKED]["compliance"]
    scale = recorded.body.mass / recorded.experiment.known["mass"][0]
    value, sigma = (float(np.squeeze(softness[key])) for key in ("value", "standard_deviation"))
    assert value == pytest.approx(scale / 5e4, abs=4 * sigma)
    assert sigma < 0.2 * value


def test_a_slack_cable_is_shorter_than_it_is_long():
    lab = Laboratory(cables=4, runs=2, duration=5.0, push=1.5, slack=True)
    recorded = record(lab, [8_121, 4])
    assert recorded.slack.max() > 0
    readings = read(with_lengths(recorded), None, lambda what, fraction: None)
    begun = begin(readings, lambda what, fraction: None, thorough=False)
    readings, begun = undisturbed_swings(readings, begun)
    for segment, forces in zip(begun.state.segments, readings.force_samples, strict=True):
        (lengths,) = (each for each in segment.readings if each.source[0] == LOCKED)
        after = np.clip(np.searchsorted(forces.time, lengths.time), 1, len(forces.time) - 1)
        assert not (forces.touched[after - 1] & forces.touched[after]).any()
        assert len(lengths.time) < 0.9 * 20 * np.ptp(forces.time)
        # By tensions that carry the platform, no guess.
        assert np.ptp(lengths.tension, axis=0).min() > 0


@pytest.mark.slow
@pytest.mark.parametrize("method", [LeastSquares, Recursive])
def test_a_motion_that_is_not_there_as_a_whole_says_nothing_of_lengths(method):
    """Held, it would have cables stretch by tensions that do not change; followed, it was lost."""
    recorded = record(Laboratory(cables=3, runs=2, duration=4.0), [8_122, 3])
    plain, found = (method()(e) for e in (recorded.experiment, with_lengths(recorded)))
    np.testing.assert_array_equal(plain.per_mass.value, found.per_mass.value)
    assert LOCKED not in found.calibration
