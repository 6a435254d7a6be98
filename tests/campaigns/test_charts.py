"""Control charts: false alarms as seldom as they say, and changes seen soon."""

import numpy as np
import pytest
from drawn_estimates import series
from scipy.stats import norm

from steelyard.campaigns.charts.control import intervals, parameter_chart
from steelyard.campaigns.charts.run_length import decision_interval, run_length
from steelyard.campaigns.charts.settings import CHARTS


def charts(values, sigmas):
    return [parameter_chart(values[:, p], sigmas[:, p], p) for p in range(10)]


def markov_run_length(k, h, states=800):
    """The approximation of Brook and Evans: a Markov chain whose states are stretches of the sum."""
    width = 2 * h / (2 * states - 1)
    to = np.arange(states) * width
    upper = norm.cdf(to[None, :] + width / 2 - to[:, None] + k)
    P = np.diff(np.column_stack([np.zeros(states), upper]), axis=1)
    return np.linalg.solve(np.eye(states) - P, np.ones(states))[0]


@pytest.mark.parametrize(("k", "h"), [(0.5, 4.0), (1.0, 3.0), (2.0, 1.5), (0.25, 8.0)])
def test_run_lengths_are_those_of_a_markov_chain(k, h):
    assert run_length(k, h) == pytest.approx(markov_run_length(k, h), rel=1e-3)


@pytest.mark.parametrize(("h", "two_sided"), [(4.0, 168.0), (5.0, 465.0)])
def test_run_lengths_are_those_of_textbooks(h, two_sided):
    # Two sides halve it; Montgomery, Introduction to Statistical Quality Control, table 9.3.
    assert run_length(0.5, h) / 2 == pytest.approx(two_sided, rel=0.003)


def test_run_lengths_are_those_of_drawn_numbers():
    rng = np.random.default_rng(4)
    lengths = []
    for _ in range(400):
        s, n = 0.0, 0
        while s <= 2.0:
            s, n = max(0.0, s + rng.normal() - 0.5), n + 1
        lengths.append(n)
    expected = run_length(0.5, 2.0)
    assert abs(np.mean(lengths) - expected) < 4 * np.std(lengths) / 20


@pytest.mark.integration
def test_intervals_have_the_run_length_that_is_asked_for():
    for k, h in zip(CHARTS.allowances, intervals(), strict=True):
        assert run_length(k, h) == pytest.approx(40 * 1e6, rel=1e-6)
        assert run_length(k, h) == pytest.approx(markov_run_length(k, h, 1600), rel=0.02)
    assert decision_interval(0.5, 930.0) == pytest.approx(5.0, abs=0.01)


def test_differences_are_the_scatter_about_the_mean():
    # The sum of squared recursive residuals is the weighted sum of squares about the mean.
    values, sigmas = series(40, 1)
    for p in range(10):
        chart = parameter_chart(values[:, p], sigmas[:, p])
        w = sigmas[:, p] ** -2
        mean = (w * values[:, p]).sum() / w.sum()
        assert chart.chi_square == pytest.approx((w * (values[:, p] - mean) ** 2).sum(), rel=1e-9)
        assert chart.count == 39


def test_over_a_thousand_sound_recordings_at_most_one_false_alarm():
    found = charts(*series(1000, 2))
    assert sum(len(chart.alarms) for chart in found) <= 1
    for chart in found:
        assert chart.ratio == pytest.approx(1.0, abs=4 / np.sqrt(2 * 999))
        assert min(chart.p_values) > 1e-4


@pytest.mark.parametrize("seed", range(12))
def test_five_kilograms_more_are_flagged_within_two_recordings(seed):
    found = charts(*series(100, seed, added=60))
    (alarm,) = found[0].alarms
    assert alarm.at in (60, 61)
    assert alarm.since == pytest.approx(60, abs=1)
    assert abs(alarm.change - 5.0) < 4 * alarm.sigma
    assert not [each for chart in found[1:] for each in chart.alarms]


def test_two_changes_are_two_alarms():
    values, sigmas = series(90, 7, added=30)
    values[60:, 0] -= 10.0
    alarms = parameter_chart(values[:, 0], sigmas[:, 0]).alarms
    assert [each.change > 0 for each in alarms] == [True, False]


def test_recordings_without_a_number_are_passed_over():
    values, sigmas = series(30, 3)
    gaps = values.copy()
    gaps[[0, 11, 12], 0] = np.nan
    chart = parameter_chart(gaps[:, 0], sigmas[:, 0])
    kept = np.isfinite(gaps[:, 0])
    alone = parameter_chart(values[kept, 0], sigmas[kept, 0])
    np.testing.assert_array_equal(chart.z[kept], alone.z)
    np.testing.assert_array_equal(chart.sums[:, kept], alone.sums)
    assert np.isnan(chart.z[~kept]).all()


def test_nothing_is_said_of_no_recordings():
    chart = parameter_chart(np.full(3, np.nan), np.full(3, np.nan))
    assert (chart.count, chart.alarms) == (0, ())
    assert np.isnan([chart.ratio, *chart.p_values]).all()
