"""Consistent estimates: always a body, least squares where that is one, and the nearest one where
it is not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2
from simulated import BODY, PAPER, RECORDER, TRUTH, changed, moving, sound, studied

from steelyard.bodies.mass_region import Box, Ellipsoid
from steelyard.errors import InputError
from steelyard.identification.methods.consistent import Consistent
from steelyard.identification.methods.least_squares import LeastSquares
from steelyard.identification.solve.held_motion import fit_with_held_motion
from steelyard.inertia import Inertia, body_jacobian

pytestmark = pytest.mark.integration

AGREEMENT = 1e-6  # of the two solvers, in sigmas per (1 + distance)
SEEDS = (0, 1, 2)


def second_moments(body):
    """Integral of r r^T dm about the centre of gravity, from the inertia matrix."""
    return np.trace(body.inertia) / 2 * np.eye(3) - body.inertia


@pytest.mark.parametrize("seed", SEEDS)
def test_where_least_squares_is_a_body_nothing_changes(seed):
    own, other = Consistent().of(studied(seed)), LeastSquares().of(studied(seed))
    assert other.physical
    np.testing.assert_allclose(own.value, other.value, rtol=1e-9)
    np.testing.assert_allclose(own.covariance, other.covariance, rtol=1e-9)
    assert own.verdict.accepted
    assert own.details["constraints"]["status"] == "unchanged"
    assert own.details["constraints"]["misfit"] == 0.0


# A body that is all but flat, moved little: noise makes no body of it.
FLAT = Inertia(BODY.mass, BODY.center_of_gravity, np.diag([30.0, 40.0, 69.9]))


@pytest.fixture(scope="module")
def flat():
    """Studies of a nearly flat body, of which many an estimate is no body."""
    recorder = moving([1] * 6, scale=0.3)
    recorder.body = FLAT
    return [fit_with_held_motion(recorder(seed)) for seed in (0, 1, 3)]


def test_an_estimate_that_is_no_body_gives_the_nearest_one_and_says_so(flat):
    none = 0
    for found in flat:
        plain, own = LeastSquares().of(found), Consistent().of(found)
        assert own.physical
        assert own.details["constraints"]["disagreement_of_two_solvers"] < AGREEMENT
        if plain.physical:
            continue
        none += 1
        assert not plain.verdict.accepted
        assert own.details["constraints"]["status"] == "boundary"
        assert own.details["constraints"]["binding"]
        assert any(
            "no body, and the nearest one is on the edge" in text
            for text in (*own.notes, *own.verdict.reasons)
        )
        # Near, in what the data tell: no body is nearer than the true one.
        error = Inertia.from_body_parameters(own.value).parameters - found.parameters
        truth = FLAT.parameters - found.parameters
        information = np.linalg.inv(found.solution.covariance[:10, :10])
        assert error @ information @ error <= truth @ information @ truth * (1 + 1e-6)
        assert own.details["constraints"]["misfit"] == pytest.approx(
            error @ information @ error, rel=1e-6
        )
        # The flat body lies level, at the height of its centre of gravity.
        assert "all mass lies in the plane" in own.details["constraints"]["binding"][0]
    assert none >= 2  # else the fixture does not test what it is for


def test_constraints_bring_the_estimate_nearer_to_the_truth(flat):
    """On average: the truth keeps the constraints, and a projection onto a convex set moves nowhere
    away from it."""
    for found in flat:
        information = np.linalg.inv(found.solution.covariance[:10, :10])

        def distance(parameters, information=information):
            error = parameters - FLAT.parameters
            return error @ information @ error

        own = Inertia.from_body_parameters(Consistent().of(found).value)
        assert distance(own.parameters) <= distance(found.parameters) * (1 + 1e-6)


def test_what_the_constraints_cost_too_much_is_a_reason_against_it():
    # The sign of a product of inertia that no body has: forces of another motion.
    found = studied(0)
    value = found.solution.value.copy()
    value[6] += 400.0
    impossible = replace(found, solution=replace(found.solution, value=value))
    estimate = Consistent().of(impossible)
    assert estimate.physical
    assert not estimate.verdict.accepted
    assert any("costs a chi-square of" in reason for reason in estimate.verdict.reasons)


def test_a_region_that_holds_the_body_changes_nothing():
    # The cloud of equal masses at the ends of the principal axes has the body's second moments; it
    # lies well within.
    corners = np.abs(BODY.center_of_gravity) + 2 * np.sqrt(
        np.linalg.eigvalsh(second_moments(BODY)).max() / BODY.mass
    )
    found = Consistent(
        regions=[Box(-3 * corners, 3 * corners), Ellipsoid(np.zeros(3), 4 * corners)]
    ).of(studied(0))
    np.testing.assert_allclose(found.value, LeastSquares().of(studied(0)).value, rtol=1e-9)


def test_a_box_is_kept_to():
    S = second_moments(BODY)
    radius = np.sqrt(np.diag(S) / BODY.mass)
    # Smaller than the body: mass no further than one radius of gyration from the centre of gravity
    # on each side.
    low, high = BODY.center_of_gravity - 0.95 * radius, BODY.center_of_gravity + 0.95 * radius
    estimate = Consistent(regions=[Box(low, high)]).of(studied(0))
    body = estimate.body
    assert body.is_physical
    moments = second_moments(body)
    for i in range(3):
        c = body.center_of_gravity[i]
        assert low[i] <= c <= high[i]
        # Integral of (x - low)(high - x) dm is not negative.
        assert moments[i, i] <= body.mass * (high[i] - c) * (c - low[i]) * (1 + 1e-6)
    assert any("box" in each for each in estimate.details["constraints"]["binding"])


def test_an_ellipsoid_is_kept_to():
    axes = np.full(3, 1.02 * np.sqrt(np.trace(second_moments(BODY)) / BODY.mass)) * 0.9
    region = Ellipsoid(BODY.center_of_gravity, axes)
    body = Consistent(regions=[region]).of(studied(0)).body
    d = body.center_of_gravity - BODY.center_of_gravity
    second = second_moments(body) + body.mass * np.outer(d, d)
    assert np.trace(second / axes[:, None] ** 2) <= body.mass * (1 + 1e-6)


# Pulled towards the nominal body


@pytest.mark.slow
def test_a_pull_to_the_right_body_helps_what_the_data_tell_badly():
    weak = moving([1] * 6, scale=0.15)
    free, pulled = [], []
    for seed in (0, 2):
        found = fit_with_held_motion(weak(seed))
        estimate = Consistent(towards_nominal=True).of(found)
        assert estimate.physical
        details = estimate.details["pull_towards_nominal"]
        free.append((Consistent().of(found).value - TRUTH)[4:])
        pulled.append((estimate.value - TRUTH)[4:])
        if details["weight"]:
            assert np.all(
                estimate.standard_deviation < 1.001 * LeastSquares().of(found).standard_deviation
            )
            assert any("pulled towards the nominal body" in note for note in estimate.notes)
    assert np.linalg.norm(pulled) < 1.1 * np.linalg.norm(free)


@pytest.mark.slow
def test_a_pull_to_a_wrong_body_is_not_let_to_spoil_good_data():
    experiment = sound(1)
    wrong = Inertia(BODY.mass * 1.5, BODY.center_of_gravity + 0.3, BODY.inertia * 2)
    found = fit_with_held_motion(
        replace(experiment, robot=replace(experiment.robot, platform=wrong))
    )
    estimate = Consistent(towards_nominal=True).of(found)
    error = estimate.value - TRUTH
    information = np.linalg.inv(LeastSquares().of(found).covariance)
    assert error @ information @ error < chi2.isf(1e-4, 10)
    assert estimate.verdict.accepted


def test_there_must_be_a_nominal_body_to_pull_towards():
    experiment = sound(0)
    found = replace(
        studied(0), experiment=replace(experiment, robot=replace(experiment.robot, platform=None))
    )
    with pytest.raises(
        InputError, match="expected a nominal body to pull towards, found none; add 'platform'"
    ):
        Consistent(towards_nominal=True).of(found)


# Noise and regions


def test_strong_noise_still_gives_a_body():
    loud = changed(PAPER["cables"], noise=150.0)
    estimate = Consistent()(RECORDER(0, instruments={**PAPER, "cables": loud}))
    use = np.isfinite(estimate.value)
    assert estimate.body is None or estimate.body.is_physical
    assert np.abs((estimate.value - TRUTH)[use] / estimate.standard_deviation[use]).max() < 4.5


def test_the_covariance_is_that_of_the_estimate_it_stands_at():
    found = studied(0)
    J = body_jacobian(Inertia.from_body_parameters(Consistent().of(found).value).parameters)
    expected = J @ found.solution.covariance[:10, :10] @ J.T
    np.testing.assert_allclose(Consistent().of(found).covariance, expected, rtol=1e-9)


def test_a_region_far_from_the_body_is_refused_in_one_sentence():
    with pytest.raises(InputError, match="regions: expected"):
        Consistent(regions=[Box(np.full(3, 10.0), np.full(3, 11.0))]).of(studied(0))
