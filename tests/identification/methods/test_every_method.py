"""What every method must do, on the same problems: a value within its own uncertainty, a covariance
that is one, null where nothing can be identified, a verdict against wrong descriptions, and a file
that gives all of it back.
"""

from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2
from simulated import TRUTH, moving, sound, with_stream
from written_estimates import file_of

from steelyard.estimates.file.estimate_file import read_estimate_file
from steelyard.experiment.read import read_experiment
from steelyard.identification.methods.consistent import Consistent
from steelyard.identification.methods.instrumental_variables import InstrumentalVariables
from steelyard.identification.methods.least_squares import LeastSquares
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.methods.recursive import Recursive
from steelyard.identification.methods.two_step import TwoStep
from steelyard.inertia import BODY_PARAMETERS

pytestmark = pytest.mark.integration

LIMIT = chi2.isf(1e-3, 10)
"""Of the chi-square of at most ten parameters: one sound recording of a thousand is above."""
METHODS = {
    method.name: method
    for method in (
        TwoStep(),
        LeastSquares(),
        InstrumentalVariables(),
        Consistent(),
        Recursive(),
        MaximumLikelihood(),
    )
}
WHOLE = [name for name in METHODS if name != "two-step"]
"""Methods whose covariance contains the systematic errors; that of the paper's two steps lists those
that it does not."""
NEAR = {"mass": 0.02, "cog": 0.03, "inertia": 0.08}
"""What two steps come to: relative, [m], relative to the largest moment."""


def swapped(experiment, i, j):
    order = np.arange(8)
    order[[i, j]] = j, i
    return with_stream(experiment, "cables", lambda v: {"tension": v["tension"][:, order]})


def in_g(experiment):
    return with_stream(
        experiment, "imu", lambda v: {"specific_force": v["specific_force"] / 9.80665}
    )


PROBLEMS = {
    "sound": lambda: sound(0),
    "translation": lambda: moving([1, 1, 1, 0, 0, 0])(0),
    "turning about z": lambda: moving([1, 1, 1, 0, 0, 1.2])(2),
    "cables exchanged": lambda: swapped(sound(0), 0, 1),
    "accelerometer in g": lambda: in_g(sound(1)),
}
LINEAR = frozenset({"mass", "cx", "cy", "cz"})
YAW = frozenset({"Jzz", "Jyz", "Jxz"})
IDENTIFIABLE = {
    "sound": dict.fromkeys(METHODS, frozenset(BODY_PARAMETERS)),
    # On its way along straight lines, gravity is all that two steps have for the centre of gravity.
    "translation": {
        **dict.fromkeys(METHODS, LINEAR),
        "two-step": {"mass"},
    },
    "turning about z": {
        **dict.fromkeys(METHODS, LINEAR | YAW),
        "two-step": {"mass", "cx", "cy", "Jzz"},
    },
}
WRONG = ("cables exchanged", "accelerometer in g")


@cache
def problem(name):
    return PROBLEMS[name]()


@cache
def estimate(method, name):
    return METHODS[method](problem(name))


def chi_square(found, truth):
    """Of what is identifiable, on its covariance."""
    use = np.isfinite(found.value)
    error = (found.value - truth)[use]
    return float(error @ np.linalg.solve(found.covariance[np.ix_(use, use)], error))


each_method = pytest.mark.parametrize("method", METHODS)
each_whole_method = pytest.mark.parametrize("method", WHOLE)
each_sound_problem = pytest.mark.parametrize("name", IDENTIFIABLE)


@pytest.mark.slow
@each_sound_problem
@each_whole_method
def test_the_truth_is_within_the_stated_uncertainty(method, name):
    found = estimate(method, name)
    assert chi_square(found, TRUTH) < LIMIT
    if IDENTIFIABLE[name][method]:
        assert found.verdict.accepted, found.verdict.reasons


def test_two_steps_are_near_the_truth():
    found = estimate("two-step", "sound")
    assert found.value[0] == pytest.approx(TRUTH[0], rel=NEAR["mass"])
    np.testing.assert_allclose(found.value[1:4], TRUTH[1:4], atol=NEAR["cog"])
    np.testing.assert_allclose(found.value[4:], TRUTH[4:], atol=NEAR["inertia"] * TRUTH[4:7].max())
    assert found.verdict.accepted is None


@each_method
def test_sound_recordings_identify_a_body_by_their_data(method):
    found = estimate(method, "sound")
    assert found.physical
    assert set(found.verdict.parameters.values()) == {"data"}


@pytest.mark.slow
@pytest.mark.parametrize("name", PROBLEMS)
@each_method
def test_the_covariance_is_one(method, name):
    found = estimate(method, name)
    use = np.isfinite(found.value)
    covariance = found.covariance[np.ix_(use, use)]
    assert np.isfinite(covariance).all()
    np.testing.assert_allclose(covariance, covariance.T, rtol=1e-9, atol=1e-300)
    sigma = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(found.standard_deviation[use], sigma)
    assert np.all(sigma > 0)
    correlation = covariance / np.outer(sigma, sigma)
    if use.any():
        # Two steps may tie parameters to each other exactly.
        assert np.linalg.eigvalsh(correlation).min() > (-1e-9 if method == "two-step" else 1e-9)


@each_sound_problem
@each_method
def test_what_cannot_be_identified_is_null_and_labelled(method, name):
    found = estimate(method, name)
    finite = {
        parameter
        for parameter, value in zip(BODY_PARAMETERS, found.value, strict=True)
        if np.isfinite(value)
    }
    labels = found.verdict.parameters
    assert finite == {each for each in labels if labels[each] != "unidentifiable"}
    assert finite == IDENTIFIABLE[name][method]
    if len(finite) < 10:
        assert found.physical is None


@pytest.mark.parametrize("name", WRONG)
@each_whole_method
def test_wrong_descriptions_are_not_accepted_and_say_why(method, name):
    verdict = estimate(method, name).verdict
    assert not verdict.accepted
    assert all(reason.strip() for reason in verdict.reasons)
    assert verdict.reasons


def test_two_steps_reject_an_accelerometer_in_g():
    """They test no description, but know what is no body."""
    verdict = estimate("two-step", "accelerometer in g").verdict
    assert not verdict.accepted
    assert "a moment of inertia is not positive" in verdict.reasons[0]


@each_sound_problem
@each_method
def test_a_file_gives_the_estimate_back(method, name, tmp_path):
    found = estimate(method, name)
    back = read_estimate_file(file_of(tmp_path, found)).estimates[method].estimate
    assert back.method == method
    np.testing.assert_array_equal(back.value, found.value)
    # The reader makes it symmetric, to the last bit.
    np.testing.assert_allclose(back.covariance, found.covariance, rtol=1e-12, atol=0)
    assert back.verdict.accepted == found.verdict.accepted
    assert back.verdict.reasons == found.verdict.reasons
    assert dict(back.verdict.parameters) == dict(found.verdict.parameters)


# Recordings of another simulator; least squares has more to say about these in its own file.

RECORDED = [
    *((name, "points-02") for name in ("instrumental-variables", "consistent")),
    *(
        ("maximum-likelihood", recording)
        for recording in ("points-00", "points-01", "points-02", "points-03")
    ),
    pytest.param("maximum-likelihood", "ideal-points", marks=pytest.mark.slow),
]


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(("method", "recording"), RECORDED)
def test_recordings_of_another_simulator(recordings, recorded_truth, method, recording):
    found = METHODS[method](read_experiment(recordings / recording / "experiment.yaml"))
    assert chi_square(found, recorded_truth[recording].body_parameters) < LIMIT
    assert found.verdict.accepted, found.verdict.reasons
    assert found.physical
