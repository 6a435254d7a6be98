"""Several loads in one fit: what was added is known far better than either load."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from simulated import BODY, CENTER, PAPER, REACH, Recorder, Swinging, at_rest, changed

from steelyard.estimates.payload import payload
from steelyard.experiment.model import Load
from steelyard.identification.identify import identify
from steelyard.inertia import Inertia
from steelyard.motion.trajectory import multisine

pytestmark = pytest.mark.integration

ADDED = Inertia(16.0, np.array([0.2, -0.1, -0.4]), np.diag([0.45, 0.55, 0.33]))
# Gains are what two loads share.
INSTRUMENTS = {
    **PAPER,
    "cables": changed(PAPER["cables"], calibration={"gain": 0.01, "common_gain": 0.005}),
}
MOTION = multisine(list(CENTER), list(REACH), 8.0, 6)
LOADED = Inertia.from_parameters(BODY.parameters + ADDED.parameters)


@cache
def recorded(seed=0, order=("empty", "with-fork"), **of_loads):
    """Runs of the same motion with the platform alone and with what was added."""
    runs = {}
    for name, body in (("empty", BODY), ("with-fork", LOADED)):
        one = Recorder(MOTION, body, following=True)(seed, instruments=INSTRUMENTS, runs=("a", "b"))
        runs[name] = one
    empty, loaded = runs["empty"], runs["with-fork"]
    own = {
        "empty": replace(empty.runs[0], load="empty"),
        "with-fork": replace(loaded.runs[1], load="with-fork"),
    }
    loads = tuple(Load(name, known=dict(of_loads.get(name, ()))) for name in order)
    # The order of the runs is another matter than that of the loads.
    return replace(empty, runs=tuple(own.values()), loads=loads, known=loads[0].known)


@cache
def estimated(method="maximum-likelihood", **keys):
    return identify(recorded(**keys), method).estimate


def sigma(estimate):
    return np.sqrt(np.diag(estimate.covariance))


METHODS = [
    "maximum-likelihood",
    "recursive",
    "least-squares",
    "consistent",
    "instrumental-variables",
]


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_what_was_added_is_known_better_than_either(method):
    found = estimated(method).loads
    (difference,) = found.differences.values()
    assert list(found.differences) == ["with-fork - empty"]
    assert difference.verdict.accepted
    off = difference.value - ADDED.body_parameters
    assert off @ np.linalg.solve(difference.covariance, off) < 29.6  # one in a thousand
    for name, body in (("empty", BODY), ("with-fork", LOADED)):
        each = found.estimates[name]
        assert each.verdict.accepted, each.verdict.reasons
        off = each.value - body.body_parameters
        assert off @ np.linalg.solve(each.covariance, off) < 29.6
        assert sigma(difference)[0] < sigma(each)[0] / 5
    independent = payload(*found.estimates.values()).estimate
    assert sigma(difference)[0] < sigma(independent)[0] / 5


@pytest.mark.slow
def test_the_entry_itself_is_that_of_the_first_load():
    found = estimated()
    first = found.loads.estimates["empty"]
    np.testing.assert_array_equal(found.value, first.value)
    np.testing.assert_array_equal(found.covariance, first.covariance)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["maximum-likelihood", "instrumental-variables"])
def test_the_order_of_the_loads_does_not_matter(method):
    one, other = estimated(method).loads, estimated(method, order=("with-fork", "empty")).loads
    for name in ("empty", "with-fork"):
        a, b = one.estimates[name], other.estimates[name]
        np.testing.assert_allclose((a.value - b.value) / sigma(a), 0, atol=0.02)
        np.testing.assert_allclose(sigma(b) / sigma(a), 1, atol=0.02)
    (a,), (b,) = one.differences.values(), other.differences.values()
    assert "empty - with-fork" in other.differences
    assert a.value[0] == pytest.approx(-b.value[0], abs=0.02 * sigma(a)[0])
    assert sigma(a)[0] == pytest.approx(sigma(b)[0], rel=0.02)


def test_the_joint_covariance_has_those_of_the_loads_on_its_diagonal():
    found = estimated().loads
    assert found.joint.loads == ("empty", "with-fork")
    for i, each in enumerate(found.estimates.values()):
        own = found.joint.matrix[10 * i : 10 * (i + 1), 10 * i : 10 * (i + 1)]
        scale = np.outer(sigma(each), sigma(each))
        np.testing.assert_allclose(own / scale, each.covariance / scale, atol=1e-6)
    # Gains that both share: masses go together.
    assert found.joint.matrix[0, 10] > 0.9 * found.joint.matrix[0, 0]


def test_one_load_is_one_body():
    whole = recorded()
    alone = whole.alone(whole.loads[0])
    named = replace(alone, loads=(whole.loads[0],))
    plain, found = (identify(each, "maximum-likelihood").estimate for each in (alone, named))
    np.testing.assert_allclose(found.value, plain.value, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.covariance, plain.covariance, rtol=1e-9)
    assert not found.loads.differences


@pytest.mark.slow
def test_a_weighed_body_calibrates_the_force_sensors():
    mass = LOADED.body_parameters[0]
    keys = {"with-fork": (("mass", (mass, 0.01)),)}
    found = estimated(**keys).loads.estimates
    plain = estimated().loads.estimates
    assert sigma(found["with-fork"])[0] < 0.011
    assert sigma(found["empty"])[0] < sigma(plain["empty"])[0] / 5
    assert abs(found["empty"].value[0] - BODY.mass) < 4 * sigma(found["empty"])[0]
    assert found["with-fork"].verdict.parameters["mass"] == "prior"
    assert found["empty"].verdict.parameters["mass"] == "data"


@pytest.mark.slow
def test_what_is_known_is_taken_apart_from_the_readings():
    mass = LOADED.body_parameters[0]
    found = estimated(**{"with-fork": (("mass", (mass, 0.5)),)}).loads.estimates["with-fork"]
    alone = estimated().loads.estimates["with-fork"]
    known = found.details["known"]["mass"]
    assert (known["stated"], known["sigma"]) == (mass, 0.5)
    assert known["found"] == pytest.approx(alone.value[0], abs=0.02 * sigma(alone)[0])
    assert known["deviation"] == pytest.approx(sigma(alone)[0], rel=0.02)


@pytest.mark.slow
def test_a_body_that_was_weighed_wrongly_is_a_reason_against_all_loads():
    mass = LOADED.body_parameters[0] + 6.0
    found = estimated(**{"with-fork": (("mass", (mass, 0.01)),)}).loads.estimates
    for each in found.values():
        assert not each.verdict.accepted
        assert any("what is known beforehand does not go with" in r for r in each.verdict.reasons)


@pytest.mark.parametrize("method", ["maximum-likelihood", "least-squares"])
def test_the_uncertainty_budget_adds_up(method):
    for each in estimated(method).loads.estimates.values():
        shares = {
            k: np.array(list(v.values())) for k, v in each.details["uncertainty_budget"].items()
        }
        np.testing.assert_allclose(sum(shares.values()), 1)
        # Nothing was known of the bodies: readings and priors of the errors are all there is.
        assert shares.get("the body beforehand", np.zeros(10)).max() < 0.01
        assert shares["gains of cables"][0] > 0.5


def test_two_steps_look_at_each_load_alone():
    whole = recorded()
    found = identify(whole, "two-step").estimate.loads
    for load in whole.loads:
        alone = identify(whole.alone(load), "two-step").estimate
        np.testing.assert_allclose(found.estimates[load.name].value, alone.value)
    assert not found.joint.matrix[:10, 10:].any()


def test_instrumental_variables_compare_least_squares_of_each_load():
    found = estimated("instrumental-variables").loads.estimates
    for name, each in found.items():
        assert each.details["durbin_wu_hausman"]["p"] > 1e-3, name
        # The command is a good instrument; gains have none, and what is taken off there is counted.
        plain = estimated("least-squares").loads.estimates[name]
        ratio = sigma(each) / sigma(plain)
        assert np.all((ratio > 0.85) & (ratio < 2)), name
        assert np.all(np.abs(each.value - plain.value) < 1.5 * sigma(plain)), name


@pytest.mark.slow
def test_a_run_that_is_held_out_is_predicted_with_its_own_load():
    one = recorded()
    more = Recorder(MOTION, LOADED, following=True)(0, instruments=INSTRUMENTS, runs=("a", "b"))
    third = replace(more.runs[0], name="c", load="with-fork")
    found = identify(replace(one, runs=(*one.runs, third)), "least-squares", holdout=["c"])
    (prediction,) = found.predictions
    assert (prediction.error / prediction.noise).max() < 3


@pytest.mark.slow
@pytest.mark.long
def test_intervals_of_what_was_added_cover():
    z = []
    for seed in range(20):
        (found,) = estimated(seed=seed).loads.differences.values()
        z.append((found.value - ADDED.body_parameters) / sigma(found))
    assert 0.9 < np.mean(np.abs(z) < 1.96) < 0.99


# Something moves in a load

HANGING = np.array([0.2, -0.1, -0.4])
POSES = [
    [*(CENTER[:3] + shift), *turn]
    for shift, turn in (
        ([0, 0, 0], [0, 0, 0]),
        ([1, 0, 0], [0.3, 0, 0]),
        ([0, 1, 0], [0, 0.3, 0]),
        ([-1, 0, 0.5], [-0.3, 0, 0.2]),
        ([0, -1, 0.5], [0, -0.3, -0.2]),
        ([0.5, 0.5, 0], [0.2, 0.2, 0]),
    )
]


@cache
def loosely(rest=False, seed=0, rigid=False, duration=8.0):
    """A run of the platform alone and one with 16 kg that swing below a point of it."""
    motion = multisine(list(CENTER), list(REACH), duration, 6)
    recorder = Recorder(motion, BODY, following=True)
    swinging = Recorder(motion, BODY, following=True)
    swinging.response = Swinging(recorder.response, 16.0, HANGING, 1.6)
    empty = recorder(seed, instruments=INSTRUMENTS, runs=("a", "b"))
    loaded = swinging(seed, instruments=INSTRUMENTS, runs=("a", "b"))
    runs = [replace(empty.runs[0], load="empty"), replace(loaded.runs[1], load="swing")]
    if rest:
        # At rest a mass on a string pulls where it is tied.
        hangs = Inertia(16.0, HANGING, np.diag([1e-3] * 3))
        whole = Inertia.from_parameters(BODY.parameters + hangs.parameters)
        drawn = swinging.drawn["b"]
        still = at_rest(POSES, drawn, instruments=INSTRUMENTS, seed=seed, body=whole)
        runs.append(replace(still, load="swing"))
    return replace(empty, runs=tuple(runs), loads=(Load("empty"), Load("swing", rigid=rigid)))


@pytest.mark.slow
@pytest.mark.parametrize("method", ["maximum-likelihood", "recursive"])
def test_of_a_load_that_swings_in_motion_the_mass_is_told(method):
    found = identify(loosely(), method).estimate.loads.estimates
    assert found["empty"].verdict.accepted, found["empty"].verdict.reasons
    assert np.isfinite(found["empty"].value).all()
    swing = found["swing"]
    assert swing.verdict.accepted, swing.verdict.reasons
    assert np.isnan(swing.value[1:]).all()
    assert abs(swing.value[0] - BODY.mass - 16.0) < 3 * sigma(swing)[0]


@pytest.mark.slow
def test_what_the_swinging_load_weighs_more_is_told_beside_shared_gains():
    (more,) = identify(loosely(), "maximum-likelihood").estimate.loads.differences.values()
    assert more.value[0] == pytest.approx(16.0, abs=3 * sigma(more)[0])
    # Gains of a per cent leave more than a kilogram of either load.
    assert sigma(more)[0] < 1.1
    assert np.isnan(more.value[1:]).all()


@pytest.mark.slow
@pytest.mark.long
def test_a_load_that_swings_is_told_from_a_rigid_one():
    found = identify(loosely(rigid=True), "maximum-likelihood").estimate.loads.estimates
    assert not found["swing"].verdict.accepted


@pytest.mark.slow
@pytest.mark.long
def test_at_rest_its_centre_of_gravity_is_told_too():
    found = identify(loosely(rest=True), "maximum-likelihood").estimate.loads.estimates["swing"]
    assert found.verdict.accepted, found.verdict.reasons
    assert np.isfinite(found.value[:4]).all()
    assert np.isnan(found.value[4:]).all()
    whole = BODY.parameters[:4] + 16.0 * np.concatenate([[1.0], HANGING])
    off = found.value[:4] - np.concatenate([whole[:1], whole[1:] / whole[0]])
    assert off @ np.linalg.solve(found.covariance[:4, :4], off) < 18.5  # one in a thousand


@pytest.mark.slow
def test_two_steps_and_linear_methods_do_not_accept_what_moves():
    alone = identify(loosely(), "two-step").estimate.loads.estimates
    assert "rigid bodies alone" in alone["swing"].verdict.reasons[0]
    assert np.isfinite(alone["empty"].value).all()
    found = identify(loosely(), "least-squares").estimate.loads.estimates["swing"]
    assert not found.verdict.accepted


@pytest.mark.slow
@pytest.mark.long
def test_what_moves_is_said():
    found = identify(loosely(), "maximum-likelihood").estimate.loads.estimates
    assert any("something moves in it" in note for note in found["swing"].notes)
    assert not any("something moves in it" in note for note in found["empty"].notes)
