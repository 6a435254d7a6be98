"""Hands on a platform that swings without force sensors: found, named and left out."""

import numpy as np
import pytest
from laboratory_swings import Laboratory, record

from steelyard.estimates.per_mass import PerMass
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.model.balance import Forces
from steelyard.identification.solve.misfits.hands import touching, without
from steelyard.identification.solve.settings import FIT

TIME = np.arange(0.0, 8.0, 0.01)


class Left:
    """A balance of which only this is looked at."""

    def __init__(self, residual):
        self.time, self.residual = TIME, residual


def forces(unread=True, left_out=None):
    many = np.zeros((len(TIME), 3), dtype=bool)
    return Forces(
        name="cables",
        time=TIME,
        readings={"tension": np.ones((len(TIME), 3))},
        sigma=np.ones(3),
        left_out=many if left_out is None else left_out,
        unread=np.full(3, unread),
    )


def noise_and(push, rng):
    """Noise of a differentiated motion, swings that decay, and a push."""
    noise = np.diff(rng.standard_normal((len(TIME) + 1, 6)), axis=0)
    swings = np.exp(-TIME / 5)[:, None] * np.sin(5 * TIME[:, None] + np.arange(6))
    return Left(noise + 0.3 * swings + push[:, None] * [1, 0, 0, 0, 0.5, 0])


def test_a_push_is_found_where_it_was(rng):
    push = np.where((TIME > 1) & (TIME < 1.6), 5 * np.sin(np.pi * (TIME - 1) / 0.6) ** 2, 0)
    at = noise_and(push, rng)
    ((start, end),) = touching(at, forces())
    assert 0.7 < start < 1.2
    assert 1.4 < end < 1.9
    cut = without(forces(), at, ((start, end),))
    np.testing.assert_array_equal(cut.touched, (start <= TIME) & (end >= TIME))
    # What is left out already is not found again.
    assert touching(at, cut) == ()


def test_swings_and_noise_are_no_hand(rng):
    assert touching(noise_and(0 * TIME, rng), forces()) == ()


def test_single_readings_are_no_hand(rng):
    push = np.where(np.isclose(TIME, 3.0), 10.0, 0.0)
    assert touching(noise_and(push, rng), forces()) == ()


def test_where_forces_are_read_they_tell_it(rng):
    push = np.where((TIME > 1) & (TIME < 1.6), 20.0, 0.0)
    assert touching(noise_and(push, rng), forces(unread=False)) == ()


def test_a_short_run_has_no_usual_size(rng):
    few = Left(rng.standard_normal((3, 6)))
    few.time = TIME[:3]
    short = without(forces(), noise_and(0 * TIME, rng), ())
    assert touching(few, short.part(slice(0, 3)), FIT) == ()


@pytest.mark.mujoco
@pytest.mark.slow
def test_a_body_is_found_though_a_hand_still_touches():
    recorded = record(Laboratory(cables=3, runs=3, duration=6.0, hand=1.0), [77, 3, 0])
    found = MaximumLikelihood()(recorded.experiment)
    truth = PerMass.of(recorded.body.body_parameters, np.zeros((10, 10))).value
    assert found.verdict.accepted
    assert np.all(np.abs(found.per_mass.value - truth) < 4 * found.per_mass.standard_deviation)
    for run in ("swing 0", "swing 1", "swing 2"):
        assert any(run in note and "pulled or pushed" in note for note in found.notes)
    assert not any("damaged files" in note for note in found.notes)
