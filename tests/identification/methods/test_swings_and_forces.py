"""Swings with force sensors and without, of one body on one robot, in MuJoCo."""

from dataclasses import replace

import numpy as np
import pytest
from mujoco_swings import BODY, CELLS, swings

from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.methods.recursive import Recursive
from steelyard.identification.methods.two_step import TwoStep
from steelyard.identification.model.calibration_parameters.surroundings import surroundings

pytestmark = pytest.mark.integration

WEIGHED = 9e-3
"""1-sigma of the mass from a scale [kg]."""


@pytest.fixture(scope="module")
def whole():
    """Two swings with forces and six without, slowed by air."""
    return swings(3, 8, seed=61, duration=8.0, geometry=0.0003, weighed=2, air=0.02).experiment


@pytest.fixture(scope="module")
def kinds(whole):
    """What runs with forces, runs without, and all of them tell; the body has been weighed."""
    known = {"mass": (BODY.mass + 0.5 * WEIGHED, WEIGHED)}
    weighed, swung = (
        tuple(run for run in whole.runs if ("cables" in run.streams) == read)
        for read in (True, False)
    )

    def told(runs):
        used = {name for run in runs for name in run.streams}
        instruments = {name: each for name, each in whole.instruments.items() if name in used}
        return MaximumLikelihood()(replace(whole, runs=runs, instruments=instruments, known=known))

    return told(weighed), told(swung), told((*weighed, *swung))


def test_what_damps_swings_is_found_beside_runs_with_forces(whole):
    damped = [each for each in surroundings(whole) if each.key.startswith("damping")]
    assert damped
    assert all((each.deviation > 0).all() for each in damped)
    read = replace(whole, runs=whole.runs[:2])
    assert not any(
        each.deviation.any() for each in surroundings(read) if each.key.startswith("damping")
    )


def test_two_steps_take_runs_with_forces_alone(whole):
    found = TwoStep()(whole)
    assert list(found.runs) == ["swing 0", "swing 1"]
    assert any(
        "swing 2, swing 3, swing 4, swing 5, swing 6, swing 7" in note for note in found.notes
    )
    alone = TwoStep()(replace(whole, runs=whole.runs[:2]))
    np.testing.assert_array_equal(found.value, alone.value)


def test_recursive_says_that_it_needs_forces_in_all_runs(whole):
    assert "runs without forces" in Recursive().lack(whole)
    assert Recursive().lack(replace(whole, runs=whole.runs[:2])) == ""


@pytest.mark.slow
def test_each_kind_is_accepted_and_calibrated(kinds):
    for found in kinds:
        assert found.verdict.accepted, found.verdict.reasons
        off = found.value - BODY.body_parameters
        assert off @ np.linalg.solve(found.covariance, off) < 10 * 2.0


@pytest.mark.slow
def test_both_kinds_agree(kinds):
    forces, swung, _ = kinds
    apart = forces.value - swung.value
    together = forces.covariance + swung.covariance
    assert apart @ np.linalg.solve(together, apart) < 10 * 2.0


@pytest.mark.slow
def test_together_they_tell_more_than_either(kinds):
    forces, swung, both = (np.sqrt(np.diag(found.covariance)) for found in kinds)
    assert np.all(both < 1.02 * np.minimum(forces, swung))
    # What is known of mass and geometry beforehand limits each number; the volume of the ellipsoid
    # counts the directions in which it does not.
    volumes = [np.linalg.slogdet(found.covariance)[1] / 2 for found in kinds]
    assert volumes[2] < min(volumes[:2]) - 0.5, volumes


@pytest.mark.slow
def test_forces_that_resolve_more_of_the_motion_count_as_stated(kinds):
    """Motion capture alone asks for knots on which forces scatter by 6 per cent more than they do, and
    runs that scatter enlarge every 1-sigma to twice what it is.
    """
    forces = kinds[0]
    assert "runs" not in forces.details["covariance_enlarged_by"]
    found = forces.details["noise"]["cables"]["tension"]["found"]
    assert found == pytest.approx(CELLS["noise"], rel=0.04)
