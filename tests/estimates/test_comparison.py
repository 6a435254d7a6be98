"""Estimates side by side, what was added between two of them, and the files they are read from."""

import copy
import json
import os
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from scipy.special import gammaln, log_ndtr, logsumexp
from time_limits import finished

from steelyard.errors import InputError
from steelyard.estimates.chi_square import agreement
from steelyard.estimates.comparison import compare
from steelyard.estimates.comparison_settings import SETTINGS
from steelyard.estimates.estimate import FORMAT, Estimate, judge, unassessed
from steelyard.estimates.file.estimate_file import read_estimate_file
from steelyard.estimates.file.places import read_estimates
from steelyard.estimates.named_estimate import NamedEstimate
from steelyard.estimates.payload import payload
from steelyard.inertia import BODY_PARAMETERS, Inertia
from steelyard.report.documents.comparison import comparison_statements, payload_statements

ROUNDING = 1e-9  # of sums and quotients of numbers up to a few hundred
CHANCE = 1e-3  # p-value below which a fixed seed is not blamed any more

SIZES = np.array([0.4, 2e-3, 3e-3, 2e-3, 0.7, 0.6, 0.9, 0.4, 0.3, 0.5])
"""1-sigmas of a good estimate."""

_drawn = np.random.default_rng(11)
PLATFORM = _drawn.uniform(5.0, 20.0, 12), _drawn.normal([0.0, -0.1, -0.1], [0.7, 0.6, 0.4], (12, 3))
LOAD = _drawn.uniform(2.0, 6.0, 9), _drawn.normal([0.3, 0.2, 0.5], [0.3, 0.4, 0.3], (9, 3))
BEFORE = Inertia.from_points(*PLATFORM)
ADDED = Inertia.from_points(*LOAD)
AFTER = Inertia.from_points(*(np.concatenate(pair) for pair in zip(PLATFORM, LOAD, strict=True)))


def covariance_of(seed, sizes=SIZES, rank=14):
    """With all parameters correlated."""
    factor = np.random.default_rng(seed).normal(size=(10, rank))
    covariance = factor @ factor.T
    scale = sizes / np.sqrt(np.diag(covariance))
    return covariance * np.outer(scale, scale)


def named(value, covariance, name="one", *, method="two-step", source="", labels=None, **others):
    value = np.asarray(value, dtype=float)
    covariance = np.array(covariance, dtype=float)
    unknown = np.isnan(value)
    covariance[unknown, :] = covariance[:, unknown] = np.nan
    verdict = judge(value)
    verdict = replace(verdict, parameters={**verdict.parameters, **(labels or {})})
    return NamedEstimate(
        name, Estimate(method, value, covariance, verdict, notes=()), source=source, **others
    )


def without(value, *names):
    return np.where(np.isin(BODY_PARAMETERS, names), np.nan, value)


def draws(mean, covariance, count, rng):
    return rng.multivariate_normal(mean, covariance, size=count, method="eigh")


# Differences


def test_a_difference_is_second_minus_first_with_the_sum_of_the_covariances():
    C1, C2 = covariance_of(1), covariance_of(2)
    shift = np.arange(10) * SIZES
    body = BEFORE.body_parameters
    (pair,) = compare([named(body, C1, "a"), named(body + shift, C2, "b")]).pairs
    (back,) = compare([named(body + shift, C2, "b"), named(body, C1, "a")]).pairs
    np.testing.assert_allclose(pair.difference, shift, rtol=ROUNDING, atol=1e-13)
    np.testing.assert_allclose(pair.covariance, C1 + C2)
    np.testing.assert_allclose(pair.z, shift / np.sqrt(2) / SIZES, rtol=ROUNDING, atol=1e-10)
    np.testing.assert_array_equal(back.difference, -pair.difference)
    assert pair.basis == "independent"
    assert pair.agreement.chi_square == pytest.approx(shift @ np.linalg.solve(C1 + C2, shift))
    assert back.agreement.chi_square == pytest.approx(pair.agreement.chi_square)
    assert pair.agreement.p_value == pytest.approx(stats.chi2.sf(pair.agreement.chi_square, 10))


def test_what_one_does_not_know_is_left_out():
    C1, C2 = covariance_of(1), covariance_of(2)
    x1, x2 = (
        without(BEFORE.body_parameters, "Jxx", "cz"),
        without(BEFORE.body_parameters + SIZES, "Jxy"),
    )
    (pair,) = compare([named(x1, C1, "a"), named(x2, C2, "b")]).pairs
    known = ~np.isin(BODY_PARAMETERS, ("Jxx", "cz", "Jxy"))
    for values in (pair.difference, pair.standard_deviation, pair.z):
        np.testing.assert_array_equal(np.isfinite(values), known)
    d = SIZES[known]
    expected = d @ np.linalg.solve((C1 + C2)[np.ix_(known, known)], d)
    assert pair.agreement.chi_square == pytest.approx(expected)
    assert pair.agreement.freedom == 7
    assert pair.agreement.parameters == tuple(np.array(BODY_PARAMETERS)[known])


def test_nothing_in_common_is_no_agreement():
    C = covariance_of(1)
    only_mass = without(BEFORE.body_parameters, *BODY_PARAMETERS[1:])
    no_mass = without(BEFORE.body_parameters, "mass")
    comparison = compare([named(only_mass, C, "a"), named(no_mass, C, "b")])
    found = comparison.pairs[0].agreement
    assert (found.freedom, found.parameters) == (0, ())
    assert np.isnan(found.p_value)
    assert comparison.exceeding(1e6) == (
        "a and b: no parameter is known to both, so that nothing can be compared",
    )
    assert "no parameter is known to all of them" in " ".join(
        each.text for each in comparison_statements(comparison)
    )


def exact_mass(seed):
    C = covariance_of(seed)
    C[0, :] = C[:, 0] = 0.0
    return C


def test_exact_values_are_compared_exactly():
    x = BEFORE.body_parameters
    same = compare([named(x, exact_mass(1), "a"), named(x, exact_mass(2), "b")]).pairs[0]
    assert (same.agreement.freedom, same.agreement.contradicted) == (9, ())
    assert same.z[0] == 0
    heavier = x + 1e-3 * np.eye(10)[0]
    other = compare([named(x, exact_mass(1), "a"), named(heavier, exact_mass(2), "b")])
    found = other.pairs[0]
    assert found.agreement.contradicted == ("mass",)
    assert found.agreement.p_value == 0
    assert found.z[0] == np.inf
    assert any("mass differs by inf" in text for text in other.exceeding(100))
    assert other.to_dict()["pairs"][0]["agreement"]["chi_square"] is None
    # Exact in one alone: the other's uncertainty is that of the difference.
    one = compare([named(x, exact_mass(1), "a"), named(heavier, covariance_of(2), "b")]).pairs[0]
    assert one.z[0] == pytest.approx(1e-3 / SIZES[0])
    assert one.agreement.freedom == 10


def test_estimates_of_exact_values_alone():
    x, nothing = BEFORE.body_parameters, np.zeros((10, 10))
    found = compare([named(x, nothing, "a"), named(x, nothing, "b")]).pairs[0].agreement
    assert (found.freedom, found.p_value, found.sigmas) == (0, 1.0, 0.0)


@pytest.mark.parametrize("rank", [14, 6])
def test_chi_square_of_two_is_calibrated(rng, rank):
    """Also where a covariance has less than full rank: such directions are left out and do not
    count."""
    C1, C2 = covariance_of(1, rank=rank), covariance_of(1, rank=rank) * 2.5
    x = BEFORE.body_parameters
    pairs = zip(draws(x, C1, 800, rng), draws(x, C2, 800, rng), strict=True)
    found = [agreement([a, b], [C1, C2]) for a, b in pairs]
    assert {each.freedom for each in found} == {min(rank, 10)}
    assert {each.dropped for each in found} == {10 - min(rank, 10)}
    chi_square = [each.chi_square for each in found]
    assert stats.kstest(chi_square, stats.chi2(min(rank, 10)).cdf).pvalue > CHANCE
    assert stats.kstest([each.p_value for each in found], stats.uniform.cdf).pvalue > CHANCE


@pytest.mark.integration
def test_heterogeneity_is_cochrans_q_and_calibrated(rng):
    covariances = [
        covariance_of(seed) * scale for seed, scale in ((1, 1.0), (2, 4.0), (3, 0.3), (4, 1.5))
    ]
    information = [np.linalg.inv(C) for C in covariances]
    statistics = []
    for i in range(600):
        values = [draws(BEFORE.body_parameters, C, 1, rng)[0] for C in covariances]
        found = agreement(values, covariances)
        statistics.append(found.chi_square)
        if i < 20:
            mean = np.linalg.solve(
                sum(information), sum(W @ x for W, x in zip(information, values, strict=True))
            )
            q = sum((x - mean) @ W @ (x - mean) for W, x in zip(information, values, strict=True))
            assert found.chi_square == pytest.approx(q, rel=1e-6)
            assert found.freedom == 30
    assert stats.kstest(statistics, stats.chi2(30).cdf).pvalue > CHANCE


def test_the_whole_takes_one_estimate_of_each_recording():
    x = BEFORE.body_parameters
    files = [
        named(x + i * SIZES, covariance_of(i), f"{source} {method}", method=method, source=source)
        for i, (source, method) in enumerate(
            [
                ("1", "two-step"),
                ("1", "maximum-likelihood"),
                ("2", "two-step"),
                ("3", "consistent"),
                ("3", "two-step"),
            ]
        )
    ]
    comparison = compare(files)
    assert comparison.whole_of == ("1 maximum-likelihood", "2 two-step", "3 consistent")
    used = [files[i].estimate for i in (1, 2, 3)]
    expected = agreement([e.value for e in used], [e.covariance for e in used])
    assert comparison.whole.chi_square == expected.chi_square
    assert comparison.whole.freedom == 20
    assert len(comparison.pairs) == 10
    assert compare(files[:3]).whole is None


@pytest.mark.parametrize(
    ("chi_square", "freedom"),
    [(9.0, 1), (50.0, 10), (700.0, 2), (1300.0, 2), (1400.0, 2), (4000.0, 2)],
)
def test_the_sigmas_of_a_chi_square(chi_square, freedom):
    C = np.diag(np.where(np.arange(10) < freedom, 1.0, 0.0))
    d = np.zeros(10)
    d[0] = np.sqrt(chi_square)
    found = agreement([np.zeros(10), d], [C, np.zeros((10, 10))])
    assert found.chi_square == pytest.approx(chi_square)
    if freedom == 1:
        assert found.sigmas == pytest.approx(3.0)
    # On two, the logarithm of the probability is - chi-square / 2.
    log_p = -chi_square / 2 if freedom == 2 else stats.chi2.logsf(chi_square, freedom)
    assert log_ndtr(-found.sigmas) + np.log(2) == pytest.approx(log_p)


@pytest.mark.parametrize("distance", [40.0, 60.0, 1e4, 1e7, 1e150])
@pytest.mark.parametrize("k", [3, 20])
def test_nothing_is_too_far_apart_to_disagree(distance, k):
    """Of an even number of degrees of freedom, the probability beyond is a finite sum."""
    values = [np.zeros(10)] * (k - 1) + [distance * np.eye(10)[0]]
    found = agreement(values, [np.eye(10)] * k)
    half = found.chi_square / 2
    assert half == pytest.approx(distance**2 * (1 - 1 / k) / 2)
    j = np.arange(5 * (k - 1))
    log_p = -half + logsumexp(j * np.log(half) - gammaln(j + 1))
    assert log_ndtr(-found.sigmas) + np.log(2) == pytest.approx(log_p, rel=1e-9)


# The same recordings


def regression(seed):
    """A linear problem with unequal noise: the best estimate, an ordinary one, and both over many
    draws of the noise."""
    rng = np.random.default_rng(seed)
    A, sigma = rng.normal(size=(60, 10)), rng.uniform(0.2, 3.0, 60)
    best = np.linalg.solve(A.T / sigma**2 @ A, A.T / sigma**2)
    plain = np.linalg.solve(A.T @ A, A.T)
    errors = rng.normal(size=(600, 60)) * sigma
    return (errors @ best.T, best * sigma @ (best * sigma).T), (
        errors @ plain.T,
        plain * sigma @ (plain * sigma).T,
    )


@pytest.mark.integration
def test_methods_on_the_same_data_are_compared_by_the_difference_of_covariances():
    (best, C_best), (plain, C_plain) = regression(5)
    x = BEFORE.body_parameters
    found = []
    for one, other in zip(best, plain, strict=True):
        a = named(x + one, C_best, "best", method="maximum-likelihood", source="same")
        b = named(x + other, C_plain, "plain", method="least-squares", source="same")
        found.append(compare([a, b]).pairs[0])
    assert {pair.basis for pair in found} == {"nested"}
    np.testing.assert_allclose(found[0].covariance, C_plain - C_best, rtol=1e-9, atol=1e-12)
    assert (
        stats.kstest([pair.agreement.chi_square for pair in found], stats.chi2(10).cdf).pvalue
        > CHANCE
    )
    z = np.array([pair.z for pair in found])
    assert stats.kstest(z[:, 0], stats.norm.cdf).pvalue > CHANCE
    # What independence would say is never more than that.
    independent = [
        agreement([x + a, x + b], [C_best, C_plain]).chi_square
        for a, b in zip(best, plain, strict=True)
    ]
    assert all(i < pair.agreement.chi_square for i, pair in zip(independent, found, strict=True))


@pytest.mark.parametrize(
    ("methods", "factor"),
    [
        (("maximum-likelihood", "two-step"), 0.5),  # the better method is the less certain one
        (("two-step", "two-step"), 4.0),  # neither is better
        (("two-step", "magic"), 4.0),
        (("maximum-likelihood", "two-step"), 1.0),
    ],
)
def test_otherwise_the_uncertainty_on_the_same_data_is_an_upper_bound(methods, factor):
    C = covariance_of(1)
    x = BEFORE.body_parameters
    pair = [
        named(x, C, "a", method=methods[0], source="same"),
        named(x + SIZES, factor * C, "b", method=methods[1], source="same"),
    ]
    comparison = compare(pair)
    assert comparison.pairs[0].basis == "bound"
    np.testing.assert_allclose(comparison.pairs[0].covariance, (1 + factor) * C)
    assert any(
        "upper bound" in note and note.startswith("a and b: the same recordings")
        for note in comparison.notes
    )


def test_an_estimate_agrees_with_itself():
    a = named(BEFORE.body_parameters, covariance_of(1), "a", source="same")
    found = compare([a, replace(a, name="b")]).pairs[0]
    assert found.agreement.chi_square == 0
    assert found.agreement.sigmas == 0
    np.testing.assert_array_equal(found.z, 0)


def test_notes_say_what_makes_a_comparison_doubtful():
    C, x = covariance_of(1), BEFORE.body_parameters
    prior = {"mass": "prior"}
    a = named(x, C, "a", source="1", experiment="lab", labels=prior)
    b = named(x, C, "b", source="2", experiment="lab", labels=prior, correlated=False)
    notes = " | ".join(compare([a, b]).notes)
    assert "different recordings are taken as independent" in notes
    assert "a and b: experiments of one name ('lab')" in notes
    assert "a and b: prior knowledge determines mass" in notes
    assert "b: the file has no covariance" in notes
    assert "one name" not in " ".join(compare([a, replace(b, experiment="other")]).notes)
    singular = covariance_of(1, rank=5)
    assert "few pieces of data" in " ".join(
        compare([named(x, singular, "a"), named(x, singular, "b")]).notes
    )


@pytest.mark.parametrize("count", [0, 1])
def test_one_estimate_is_no_comparison(count):
    with pytest.raises(InputError, match=f"at least two estimates, found {count}"):
        compare([named(BEFORE.body_parameters, covariance_of(1))] * count)


# Payload


def test_the_payload_is_what_was_added():
    C = covariance_of(1) * 1e-4
    found = payload(named(BEFORE.body_parameters, C, "a"), named(AFTER.body_parameters, C, "b"))
    np.testing.assert_allclose(
        found.estimate.value, ADDED.body_parameters, rtol=ROUNDING, atol=ROUNDING
    )
    assert found.estimate.verdict.accepted
    assert found.estimate.physical
    assert found.possible
    assert "accepted, of a body that can exist" in next(payload_statements(found)).text


@pytest.mark.slow
@pytest.mark.integration
def test_covariance_of_the_payload_is_that_of_many_draws(rng):
    """The clouds' composite with scattered parameters, taken apart by the linear parameters of
    Inertia."""
    C1, C2 = covariance_of(1) * 1e-4, covariance_of(2) * 4e-4
    predicted = payload(
        named(BEFORE.body_parameters, C1, "a"), named(AFTER.body_parameters, C2, "b")
    ).estimate

    def linear(values):
        return Inertia.from_body_parameters(values).parameters

    pairs = zip(
        draws(BEFORE.body_parameters, C1, 8000, rng),
        draws(AFTER.body_parameters, C2, 8000, rng),
        strict=True,
    )
    seen = np.cov(
        [Inertia.from_parameters(linear(b) - linear(a)).body_parameters for a, b in pairs],
        rowvar=False,
    )
    sigma = predicted.standard_deviation
    # 1-sigma of a sample covariance of n draws is at most sqrt(2 / n) in units of the sigmas.
    np.testing.assert_allclose(
        seen / np.outer(sigma, sigma), predicted.covariance / np.outer(sigma, sigma), atol=0.07
    )


def test_a_payload_between_baselines_is_no_more_than_they_are():
    C = covariance_of(1) * 1e-4
    pair = [named(BEFORE.body_parameters, C, "a"), named(AFTER.body_parameters, C, "b")]
    baseline = unassessed(judge(pair[0].estimate.value))
    pair[0] = replace(pair[0], estimate=replace(pair[0].estimate, verdict=baseline))
    found = payload(*pair)
    assert found.estimate.verdict.accepted is None
    said = list(payload_statements(found))
    assert not any(": accepted" in each.text or each.tone == "good" for each in said)
    assert any(each.text == "a: baseline, not assessed" and each.tone == "note" for each in said)


def test_a_payload_below_its_uncertainty_has_no_place():
    C = covariance_of(1, 100 * SIZES)
    found = payload(named(BEFORE.body_parameters, C, "a"), named(AFTER.body_parameters, C, "b"))
    mass = found.estimate.value[0]
    assert mass == pytest.approx(ADDED.mass)
    assert mass < SETTINGS.significant * found.estimate.standard_deviation[0]
    assert found.estimate.standard_deviation[0] == pytest.approx(np.sqrt(2) * 40)
    assert np.isnan(found.estimate.value[1:]).all()
    assert np.isnan(found.estimate.covariance[1:, 1:]).all()
    assert not found.estimate.verdict.accepted
    assert "less than 3 sigmas" in found.estimate.verdict.reasons[0]
    assert found.possible is None


def test_nothing_added_without_any_uncertainty():
    same = named(BEFORE.body_parameters, np.zeros((10, 10)), "a")
    found = payload(same, replace(same, name="b"))
    assert found.estimate.value[0] == 0
    assert np.isnan(found.estimate.value[1:]).all()


def test_what_was_taken_off_is_named():
    C = covariance_of(1) * 1e-4
    found = payload(named(AFTER.body_parameters, C, "a"), named(BEFORE.body_parameters, C, "b"))
    assert found.estimate.value[0] == pytest.approx(-ADDED.mass)
    np.testing.assert_allclose(found.estimate.value[1:4], ADDED.center_of_gravity, atol=1e-9)
    assert "taken off" in found.estimate.verdict.reasons[0]
    assert found.estimate.physical is False


@pytest.mark.parametrize(
    ("missing", "told"),
    [
        (BODY_PARAMETERS[4:], ("mass", "cx", "cy", "cz")),
        (BODY_PARAMETERS[1:], ("mass",)),
        (("Jxy",), BODY_PARAMETERS[:9]),
        # xx needs y and z, zz needs x and y: without z, what is about the z axis alone is left.
        (("cz",), ("mass", "cx", "cy", "Jzz", "Jxy")),
        (("mass",), ()),
    ],
)
@pytest.mark.parametrize("which", [0, 1])
def test_what_one_estimate_lacks_the_payload_lacks_where_it_needs_it(missing, told, which):
    C = covariance_of(1) * 1e-4
    values = [BEFORE.body_parameters, AFTER.body_parameters]
    whole = payload(named(values[0], C, "a"), named(values[1], C, "b")).estimate
    values[which] = without(values[which], *missing)
    found = payload(named(values[0], C, "a"), named(values[1], C, "b"))
    known = np.isin(BODY_PARAMETERS, told)
    np.testing.assert_allclose(
        found.estimate.value, np.where(known, ADDED.body_parameters, np.nan), atol=1e-9
    )
    np.testing.assert_allclose(
        found.estimate.covariance,
        np.where(np.outer(known, known), whole.covariance, np.nan),
        rtol=1e-9,
    )
    assert found.possible is None
    assert found.estimate.verdict.accepted is ("mass" in told)


def test_a_body_that_cannot_exist_is_said_and_whether_it_may_be_chance():
    # A thin rod along x whose estimated moment about x is a little below zero.
    rod = Inertia(20.0, [0.1, 0.0, 0.3], np.diag([-0.01, 1.5, 1.5]))
    after = Inertia.from_parameters(BEFORE.parameters + rod.parameters).body_parameters
    coarse, fine = covariance_of(1) * 1e-2, covariance_of(1) * 1e-10
    chance = payload(named(BEFORE.body_parameters, coarse, "a"), named(after, coarse, "b"))
    assert chance.estimate.physical is False
    assert chance.possible is True
    assert chance.estimate.verdict.accepted
    assert any(
        "not positive" in note and "body that can exist" in note for note in chance.estimate.notes
    )
    certain = payload(named(BEFORE.body_parameters, fine, "a"), named(after, fine, "b"))
    assert certain.possible is False
    assert not certain.estimate.verdict.accepted
    assert "not positive" in certain.estimate.verdict.reasons[0]


@pytest.mark.integration
def test_the_margin_of_a_thin_body_is_calibrated(rng):
    """Of a flat plate, on the edge of what can exist, about one in 740 lies three sigmas
    outside."""
    plate = Inertia(20.0, [0.1, 0.0, 0.3], np.diag([1.0, 2.0, 3.0]))
    after = Inertia.from_parameters(BEFORE.parameters + plate.parameters).body_parameters
    C = covariance_of(1) * 1e-4
    found = [
        payload(named(a, C, "a"), named(b, C, "b"))
        for a, b in zip(
            draws(BEFORE.body_parameters, C, 400, rng), draws(after, C, 400, rng), strict=True
        )
    ]
    assert np.mean([bool(each.estimate.physical) for each in found]) == pytest.approx(0.5, abs=0.1)
    assert np.mean([each.possible is True for each in found]) > 0.98


def test_a_mass_without_uncertainty_is_not_distinguished_from_nothing():
    C = covariance_of(1)
    C[0, :] = C[:, 0] = np.nan
    found = payload(named(BEFORE.body_parameters, C, "a"), named(AFTER.body_parameters, C, "b"))
    assert found.estimate.value[0] == pytest.approx(ADDED.mass)
    assert "uncertainty is not known" in found.estimate.verdict.reasons[0]


def test_inputs_stay_as_they_are():
    a, b = (
        named(BEFORE.body_parameters, covariance_of(1), "a"),
        named(AFTER.body_parameters, covariance_of(2), "b"),
    )
    before = [copy.deepcopy((e.estimate.value, e.estimate.covariance)) for e in (a, b)]
    compare([a, b])
    payload(a, b)
    for each, (value, covariance) in zip((a, b), before, strict=True):
        np.testing.assert_array_equal(each.estimate.value, value)
        np.testing.assert_array_equal(each.estimate.covariance, covariance)


# Files


def contents(body=BEFORE, scale=1.0, experiment="lab", methods=("two-step",), seed=1, missing=()):
    """As identify writes it."""
    value = without(body.body_parameters, *missing)
    estimates = {}
    for i, method in enumerate(methods):
        each = named(
            value + 0.1 * i * SIZES, covariance_of(seed + i) * scale, method=method
        ).estimate
        estimates[method] = json.loads(json.dumps(replace(each, notes=("a remark",)).to_dict()))
    nominal = BEFORE.to_dict()
    return {
        "format": FORMAT,
        "experiment": experiment,
        "nominal": nominal,
        "result": methods[0],
        "estimates": estimates,
    }


def save(path, values):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(values if isinstance(values, str) else json.dumps(values))
    return path


@pytest.mark.parametrize("missing", [(), ("Jxx", "cz"), BODY_PARAMETERS])
def test_a_file_is_read_back_as_it_was_written(tmp_path, missing):
    save(tmp_path / "estimate.json", contents(methods=("consistent", "two-step"), missing=missing))
    file = read_estimate_file(tmp_path)
    assert (file.experiment, file.result) == ("lab", "consistent")
    np.testing.assert_allclose(file.nominal.body_parameters, BEFORE.body_parameters)
    for i, method in enumerate(("consistent", "two-step")):
        expected = named(
            without(BEFORE.body_parameters, *missing) + 0.1 * i * SIZES,
            covariance_of(1 + i),
            method=method,
        ).estimate
        found = file.estimates[method].estimate
        np.testing.assert_array_equal(found.value, expected.value)
        np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-14)
        assert found.method == method
        assert found.verdict == expected.verdict
        assert found.notes == ("a remark",)
        assert not found.value.flags.writeable


def test_a_file_without_covariance_has_its_sigmas(tmp_path):
    values = contents(missing=("Jxy",))
    del values["estimates"]["two-step"]["covariance"]
    each = read_estimate_file(save(tmp_path / "e.json", values)).estimates["two-step"]
    assert not each.correlated
    np.testing.assert_allclose(each.estimate.standard_deviation, without(SIZES, "Jxy"))
    off = each.estimate.covariance[:9, :9] - np.diag(np.diag(each.estimate.covariance)[:9])
    np.testing.assert_array_equal(off, 0)


def test_tiny_sigmas_without_covariance(tmp_path):
    values = contents()
    del entry_of(values)["covariance"]
    entry_of(values)["standard_deviation"]["mass"] = 1e-150
    with pytest.raises(
        InputError, match=r"'estimates\.two-step': expected variances of 0 or of a possible size"
    ):
        read_estimate_file(save(tmp_path / "e.json", values))


def test_optional_and_further_keys(tmp_path):
    values = contents()
    values["nominal"] = None
    values["more"] = [[[1]]]
    entry = values["estimates"]["two-step"]
    entry["calibration"] = {"cables": {"offset": {"value": [float(i) for i in range(300_000)]}}}
    entry["verdict"] = {"accepted": False}
    del entry["notes"], entry["physical"]
    found = read_estimate_file(save(tmp_path / "e.json", values))
    assert found.nominal is None
    assert not found.estimates["two-step"].estimate.verdict.accepted


def test_methods_are_chosen_by_suffix_or_option(tmp_path):
    both = ("consistent", "two-step")
    one = str(save(tmp_path / "one" / "estimate.json", contents(methods=both)))
    two = str(
        save(tmp_path / "two:x" / "estimate.json", contents(methods=both, experiment="yard")).parent
    )

    def chosen(*places, method=None):
        return [(e.experiment, e.estimate.method) for e in read_estimates(places, method)]

    assert chosen(one, two) == [("lab", "consistent"), ("yard", "consistent")]
    assert chosen(one, two, method="two-step") == [("lab", "two-step"), ("yard", "two-step")]
    assert chosen(f"{one}:two-step", two) == [("lab", "two-step"), ("yard", "consistent")]
    assert chosen(f"{two}:all") == [("yard", "consistent"), ("yard", "two-step")]
    assert chosen(one, f"{two}:consistent", method="two-step") == [
        ("lab", "two-step"),
        ("yard", "consistent"),
    ]


def test_names_are_short_and_differ(tmp_path):
    both = ("consistent", "two-step")
    a = str(save(tmp_path / "monday" / "estimate.json", contents(methods=both)))
    b = str(save(tmp_path / "tuesday" / "estimate.json", contents(methods=both)))
    c = str(save(tmp_path / "other.json", contents(methods=both, experiment="yard")))

    def names(*places):
        return [each.name for each in read_estimates(places)]

    assert names(f"{a}:all") == ["consistent", "two-step"]
    assert names(a, c) == ["lab", "yard"]
    assert names(a, f"{a}:two-step", c) == ["lab, consistent", "lab, two-step", "yard, consistent"]
    assert names(a, b, c) == ["monday", "tuesday", "other"]
    assert names(f"{a}:all", b)[2] == "tuesday, consistent"
    assert names(a, a, b) == [
        "monday, consistent #1",
        "monday, consistent #2",
        "tuesday, consistent",
    ]


# The verb


@pytest.fixture
def files(tmp_path, monkeypatch):
    """Estimates of the platform, of nearly the same, and of the loaded one."""
    monkeypatch.chdir(tmp_path)
    near = Inertia.from_body_parameters(BEFORE.body_parameters + 0.5 * SIZES)
    save(
        tmp_path / "empty" / "estimate.json",
        contents(methods=("consistent", "two-step"), experiment="empty"),
    )
    save(tmp_path / "again" / "estimate.json", contents(near, experiment="empty again", seed=5))
    save(tmp_path / "loaded" / "estimate.json", contents(AFTER, experiment="loaded", seed=7))
    return tmp_path


def test_compare_prints_values_differences_and_whether_they_agree(run, files):
    status, out, err = run("compare", "empty", "again")
    assert (status, err) == (0, "")
    assert "empty again, two-step, compared with empty, consistent" in out
    for word in (
        "mass",
        "kg",
        "mm",
        "kg m²",
        "difference",
        "in sigmas",
        "agree within their uncertainty: chi-square",
    ):
        assert word in " ".join(out.split())
    row = next(line for line in out.splitlines() if "mass" in line)
    assert "+0.20 ± 0.57" in row
    assert row.endswith("+0.4")
    assert "a remark" in out


def test_estimates_that_differ_are_no_failure_unless_it_is_asked_for(run, files):
    assert run("compare", "empty", "loaded")[0] == 0
    status, out, err = run("compare", "empty", "loaded", "--fail-above", 3)
    assert (status, err) == (1, "")
    assert "above 3 sigmas" in out
    assert "mass differs by" in out
    assert "differ as a whole by" in out
    status, out, err = run("compare", "empty", "again", "--fail-above", "3")
    assert (status, err) == (0, "")
    assert "nothing differs by more than 3 sigmas" in out
    assert run("compare", "empty", "loaded", "--fail-above", 1e6)[0] == 0
    assert run("compare", "empty", "again", "loaded", "--fail-above", 3)[0] == 1
    assert run("compare", "empty", "--method", "all", "--fail-above", 3)[0] == 0


def test_each_parameter_alone_can_exceed(run, files):
    values = contents(experiment="shifted", seed=9)
    values["estimates"]["two-step"]["mass"] += 3.5 * np.sqrt(2) * SIZES[0]
    for entry in (values, second := contents(experiment="second", seed=9)):
        del entry["estimates"]["two-step"]["covariance"]
    save(files / "shifted.json", values)
    save(files / "second.json", second)
    out = run("compare", "shifted.json", "second.json", "--fail-above", 3)[1]
    # 3.5 sigmas of one parameter are not rare among ten.
    assert "mass differs by 3.5 sigmas" in out
    assert "differ as a whole" not in out
    assert "no covariance" in out


def test_comparison_as_json(run, files):
    status, out, err = run(
        "compare", "empty", "again", "loaded", "--json", "--fail-above", "4", "--quiet"
    )
    assert (status, err) == (1, "")
    answer = json.loads(out)
    comparison = compare(read_estimates(["empty", "again", "loaded"]))
    exceeding = list(comparison.exceeding(4))
    assert answer == json.loads(
        json.dumps({**comparison.to_dict(), "fail_above": 4.0, "exceeding": exceeding})
    )
    empty, again, loaded = "empty, consistent", "empty again, two-step", "loaded, two-step"
    assert [e["name"] for e in answer["estimates"]] == [empty, again, loaded]
    assert [(p["first"], p["second"]) for p in answer["pairs"]] == [
        (empty, again),
        (empty, loaded),
        (again, loaded),
    ]
    assert answer["pairs"][0]["difference"]["mass"] == pytest.approx(0.2)
    assert answer["pairs"][0]["sigmas"]["mass"] == pytest.approx(0.5 / np.sqrt(2))
    assert answer["whole"]["freedom"] == 20
    assert "exceeding" not in json.loads(run("compare", "empty", "again", "--json")[1])


def test_payload_of_two_estimates(run, files):
    status, out, err = run("compare", "empty", "loaded", "--payload")
    assert (status, err) == (0, "")
    assert "payload: what was added" in out
    assert "payload: accepted" in out
    status, out, err = run("compare", "empty", "loaded", "--payload", "--json")
    assert (status, err) == (0, "")
    found = json.loads(out)["payload"]
    # The second method of 'empty' is not asked for.
    np.testing.assert_allclose(found["center_of_gravity"], ADDED.center_of_gravity, atol=1e-9)
    np.testing.assert_allclose(found["inertia"], ADDED.inertia, atol=1e-9)
    assert found["mass"] == pytest.approx(ADDED.mass)
    assert found["standard_deviation"]["mass"] == pytest.approx(np.sqrt(2) * SIZES[0])
    assert found["physical"] is True
    assert run("compare", "loaded", "empty", "--payload")[0] == 0
    assert "taken off" in run("compare", "loaded", "empty", "--payload")[1]


def test_an_estimate_that_was_not_accepted_is_named(run, files):
    values = contents(experiment="odd")
    values["estimates"]["two-step"]["verdict"] = {
        "accepted": False,
        "reasons": ["the mass is\x1b[31m not positive"],
    }
    save(files / "odd.json", values)
    out = run("compare", "odd.json", "empty")[1]
    assert "was not accepted when it was made: the mass is" in out
    assert "\x1b" not in out


@pytest.mark.slow
@pytest.mark.integration
def test_what_identify_wrote_can_be_compared(tmp_path):
    """A process of its own, of files that other code wrote."""
    ideal = contents()
    save(tmp_path / "a.json", ideal)
    save(tmp_path / "b.json", ideal)
    command = [
        sys.executable,
        "-m",
        "steelyard",
        "compare",
        "a.json",
        "b.json",
        "--fail-above",
        "1",
    ]
    ended = finished(command, capture_output=True, text=True, cwd=tmp_path)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert "p = 1" in ended.stdout
    assert "experiments of one name" in ended.stdout


# Bad input


def entry_of(values):
    return values["estimates"]["two-step"]


def set_at(*keys, to):
    def corrupt(values):
        inner = values
        for key in keys[:-1]:
            inner = inner[key]
        if to is LEFT_OUT:
            del inner[keys[-1]]
        else:
            inner[keys[-1]] = to

    return corrupt


LEFT_OUT = object()
ENTRY = ("estimates", "two-step")
MATRIX = (*ENTRY, "covariance", "matrix")


def indefinite(values):
    matrix = entry_of(values)["covariance"]["matrix"]
    for i, j, sign in ((1, 2, 1), (1, 3, 1), (2, 3, -1)):
        matrix[i][j] = matrix[j][i] = sign * 0.9 * np.sqrt(matrix[i][i] * matrix[j][j])


def skew(values):
    entry_of(values)["covariance"]["matrix"][4][5] += 0.1


BAD_VALUES = [
    (
        "wrong format",
        set_at("format", to="steelyard-estimate/2"),
        r"'format': expected 'steelyard-estimate/1', found \"ste",
    ),
    (
        "no format",
        set_at("format", to=LEFT_OUT),
        r"'format': .*found no such key; name a file that identify wrote",
    ),
    ("format of another kind", set_at("format", to=[1] * 1000), r"'format': expected"),
    (
        "no estimates",
        set_at("estimates", to=LEFT_OUT),
        r"'estimates': expected this key, found it missing",
    ),
    (
        "empty estimates",
        set_at("estimates", to={}),
        r"'result': expected the name of one of the estimates \(there is none",
    ),
    ("estimates a list", set_at("estimates", to=[1]), r"'estimates': expected a mapping"),
    ("estimate a number", set_at(*ENTRY, to=3), r"'estimates\.two-step': expected a mapping"),
    (
        "result of another name",
        set_at("result", to="best"),
        r"'result': expected .*\(two-step\), found 'best'",
    ),
    (
        "no mass",
        set_at(*ENTRY, "mass", to=LEFT_OUT),
        r"'estimates\.two-step\.mass': expected this key",
    ),
    (
        "mass as text",
        set_at(*ENTRY, "mass", to="12 kg"),
        r"two-step\.mass': expected a number, found '12 kg'",
    ),
    (
        "mass beyond reason",
        set_at(*ENTRY, "mass", to=1e300),
        r"two-step\.mass': expected a number of a possible size",
    ),
    (
        "mass of 400 digits",
        set_at(*ENTRY, "mass", to=10**400),
        r"two-step\.mass': expected a number",
    ),
    (
        "two coordinates",
        set_at(*ENTRY, "center_of_gravity", to=[0, 0]),
        r"center_of_gravity.*found 2",
    ),
    (
        "null for a vector",
        set_at(*ENTRY, "center_of_gravity", to=None),
        r"center_of_gravity': expected a list",
    ),
    (
        "inertia of four rows",
        set_at(*ENTRY, "inertia", to=[[1, 0, 0]] * 4),
        r"inertia': expected at most 3 values",
    ),
    (
        "inertia not symmetric",
        set_at(*ENTRY, "inertia", to=[[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]),
        r"inertia': expected a symmetric matrix, found \[\[1\.0, 0\.1",
    ),
    (
        "inertia with one null of two",
        set_at(*ENTRY, "inertia", to=[[1, None, 0], [0, 1, 0], [0, 0, 1]]),
        r"inertia': expected a symmetric matrix, found \[\[1\.0, None",
    ),
    (
        "no sigmas",
        set_at(*ENTRY, "standard_deviation", to=LEFT_OUT),
        r"standard_deviation': expected this key",
    ),
    (
        "negative sigma",
        set_at(*ENTRY, "standard_deviation", "mass", to=-1),
        r"expected no 1-sigma below 0, found -1",
    ),
    ("no verdict", set_at(*ENTRY, "verdict", to=LEFT_OUT), r"verdict': expected this key"),
    (
        "verdict as text",
        set_at(*ENTRY, "verdict", "accepted", to="yes"),
        r"accepted': expected true or false, found 'yes'",
    ),
    (
        "unknown label",
        set_at(*ENTRY, "verdict", "parameters", "cx", to="guess"),
        r"verdict\.parameters\.cx': expected one of",
    ),
    (
        "covariance of nine rows",
        set_at(*MATRIX, to=np.eye(10)[:9].tolist()),
        r"matrix': expected 10 rows of 10, found 9 of 10",
    ),
    (
        "covariance 9 x 9",
        set_at(*MATRIX, to=np.eye(9).tolist()),
        r"matrix': expected 10 rows of 10, found 9 of 9",
    ),
    ("empty covariance", set_at(*MATRIX, to=[]), r"matrix': expected 10 rows of 10, found 0 of 0"),
    (
        "ragged covariance",
        set_at(*MATRIX, 3, to=[1.0]),
        r"matrix': expected 10 rows of 10, found 10 of 1",
    ),
    (
        "covariance not symmetric",
        skew,
        r"matrix': expected a symmetric matrix, found two different numbers for Jxx and Jyy",
    ),
    (
        "covariance indefinite",
        indefinite,
        r"matrix': expected a matrix without negative eigenvalues, found -",
    ),
    (
        "correlation of two",
        set_at(*MATRIX, 0, 1, to=1.0),
        r"expected correlations from -1 to 1, found one beyond between mass and cx",
    ),
    (
        "correlation with an exact value",
        set_at(*MATRIX, 0, 0, to=0.0),
        r"found one beyond between mass and cx",
    ),
    (
        "covariance next to zero",
        set_at(*MATRIX, 0, 0, to=1e-320),
        r"expected variances of 0 or of a possible size, found 1e-320 of mass",
    ),
    (
        "negative variance",
        set_at(*MATRIX, 2, 2, to=-1.0),
        r"expected no variance below 0, found -1 of cy",
    ),
    (
        "covariance with a hole",
        set_at(*MATRIX, 0, 1, to=None),
        r"expected a number for mass and cx, .*found null",
    ),
    (
        "covariance of other parameters",
        set_at(*ENTRY, "covariance", "parameters", to=["m"] * 10),
        r"covariance\.parameters': expected mass, cx.*found m, m",
    ),
    (
        "deep where a number belongs",
        lambda v: v["estimates"]["two-step"].update(mass=nested(100)),
        r"at most 16 lists in each other",
    ),
    (
        "nominal not symmetric",
        set_at("nominal", "inertia", 0, to=[1, 2, 3]),
        r"'nominal': .*symmetric",
    ),
    ("nominal of nothing", set_at("nominal", to={}), r"'nominal\.mass': expected this key"),
    ("many notes", set_at(*ENTRY, "notes", to=["x"] * 200_000), r"expected at most 100000 values"),
    ("name of control characters", set_at("result", to="\x1b[31mred\n"), r"'result': expected"),
    ("half a character", set_at("result", to="\ud800"), r"'result': expected"),
]


def nested(depth):
    value = 1.0
    for _ in range(depth):
        value = [value]
    return value


BAD_TEXTS = [
    ("empty", "", r"bad\.json:1: expected JSON, found a mistake"),
    ("no JSON", "mass: 12\n", r"bad\.json:1: expected JSON"),
    ("cut off", json.dumps(contents(), indent=1)[:3000], r"bad\.json:\d+: expected JSON"),
    ("a list", "[]", r"expected an estimate that identify wrote, found a list"),
    ("null", "null", r"expected an estimate that identify wrote, found nothing"),
    ("a number", "3", r"found a single value"),
    (
        "NaN",
        json.dumps(contents()).replace('"mass": 1', '"mass": NaN, "x": 1', 1),
        r"found NaN, which JSON does not have; write null",
    ),
    ("Infinity", '{"format": -Infinity}', r"found -Infinity, which JSON does not have"),
    ("nested a million times", "[" * 1_000_000, r"100000 lists of JSON, found more"),
    ("nested in an estimate", '{"a":' * 100_000, r"found lists too deep"),
    ("truth of a simulation", json.dumps(BEFORE.to_dict()), r"'format': .*found no such key"),
    (
        "design",
        '{"format": "steelyard-design/1"}',
        r"found \"steelyard-design/1\"; name a file that identify wrote",
    ),
    ("a robot file", "name: cogiro\ncables: []\n", r"expected JSON"),
]


def assert_one_sentence(status, out, err):
    assert (status, out) == (2, "")
    assert err.startswith("steelyard: ")
    assert err.count("\n") == 1
    assert "Traceback" not in err
    assert err.removesuffix("\n").isprintable()
    assert len(err) < 1000
    assert "; " in err


@pytest.mark.parametrize(
    ("corrupt", "pattern"), [pytest.param(*case[1:], id=case[0]) for case in BAD_VALUES]
)
def test_bad_values_end_with_one_sentence(run, files, corrupt, pattern):
    values = contents()
    corrupt(values)
    save(files / "bad.json", values)
    status, out, err = run("compare", "empty", "bad.json", "--json")
    assert_one_sentence(status, out, err)
    with pytest.raises(InputError, match=pattern):
        read_estimates(["empty", "bad.json"])
    assert "bad.json: " in err


@pytest.mark.parametrize(
    ("text", "pattern"), [pytest.param(*case[1:], id=case[0]) for case in BAD_TEXTS]
)
def test_bad_text_ends_with_one_sentence(run, files, text, pattern):
    save(files / "bad.json", text)
    assert_one_sentence(*run("compare", "bad.json", "empty"))
    with pytest.raises(InputError, match=pattern):
        read_estimate_file(Path("bad.json"))


@pytest.mark.parametrize(
    ("arguments", "pattern"),
    [
        ("compare", r"Missing argument"),
        ("compare empty", r"at least two estimates, found 1; .*':all'"),
        (
            "compare empty nowhere",
            r"nowhere: expected a file that identify wrote, or its folder, found nothing there",
        ),
        (
            "compare empty .",
            (
                r"estimate\.json: expected a file that identify wrote, or its folder, found nothing"
                r" there"
            ),
        ),
        (
            "compare empty loaded:magic",
            r"loaded/estimate\.json: expected an estimate of method 'magic', found two-step",
        ),
        ("compare empty loaded --method magic", r"'magic', found consistent, two-step; choose"),
        (
            "compare empty loaded --method consistent",
            r"loaded/estimate\.json: .*'consistent', found two-step",
        ),
        (
            "compare empty loaded --fail-above 0",
            r"--fail-above: expected a number of sigmas above 0, found 0",
        ),
        ("compare empty loaded --fail-above nan", r"--fail-above: .*found nan"),
        ("compare empty loaded --fail-above -3", r"--fail-above: .*found -3"),
        ("compare empty loaded --fail-above inf", r"--fail-above: .*found inf"),
        ("compare empty loaded --fail-above much", r"--fail-above.*'much'"),
        (
            "compare empty --payload",
            r"--payload: expected two estimates, before and after, found 1",
        ),
        ("compare empty again loaded --payload", r"--payload: expected two .*found 3"),
        ("compare empty:all loaded --payload", r"--payload: expected two .*found 3"),
        (
            "compare empty loaded --payload --fail-above 3",
            r"--fail-above: expected none with --payload",
        ),
        ("compare " + "empty " * 21, r"expected at most 20 estimates, found 21"),
        (f"compare empty {'x' * 5000}", r"too long"),
    ],
)
def test_a_bad_command_line_ends_with_one_sentence(run, files, arguments, pattern):
    status, out, err = run(*arguments.split())
    assert_one_sentence(status, out, err)
    assert re.search(pattern, err), err


def test_bytes_that_are_no_text(run, files):
    (files / "bad.json").write_bytes(b'{"format": "\xff"}')
    status, out, err = run("compare", "empty", "bad.json")
    assert_one_sentence(status, out, err)
    assert "a byte that is not at 12" in err


def test_a_pipe_is_not_opened(run, files):
    os.mkfifo(files / "pipe")
    status, out, err = run("compare", "empty", "pipe")
    assert_one_sentence(status, out, err)
    assert "no regular file" in err


def test_a_file_of_gigabytes_is_not_read(run, files):
    with (files / "large.json").open("wb") as file:
        file.truncate(1 << 32)
    status, out, err = run("compare", "empty", "large.json")
    assert_one_sentence(status, out, err)
    assert "at most 32 MiB" in err


def read_or_refuse(path):
    try:
        return read_estimates(["empty", path])
    except InputError as error:
        return (
            None
            if str(error).startswith(f"{path}: ")
            else pytest.fail(f"does not say where: {error}")
        )


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(30))
def test_any_part_may_be_missing_or_of_another_type(files, seed):
    """Whatever is at any place: the file is read, or refused with a sentence."""
    rng = np.random.default_rng(seed)
    values = contents()
    places = []

    def visit(value, key):
        places.append(key)
        for part, inner in (
            value.items()
            if isinstance(value, dict)
            else enumerate(value)
            if isinstance(value, list)
            else ()
        ):
            visit(inner, (*key, part))

    visit(values, ())
    for i in rng.choice(len(places) - 1, 12, replace=False) + 1:
        for wrong in (None, "", "x", -1, 0, True, [], {}, [None], 1e16, LEFT_OUT):
            changed = copy.deepcopy(values)
            set_at(*places[i], to=wrong)(changed)
            save(files / "bad.json", changed)
            found = read_or_refuse("bad.json")
            if found is not None:
                json.dumps(compare(found).to_dict(), allow_nan=False)
                json.dumps(payload(*found).to_dict(), allow_nan=False)
