import numpy as np
import pytest

from steelyard.smoothing import Samples1D, choose_spacing, fit, segments


def signal(t, order=0):
    w = 2 * np.pi * 0.4
    return (
        np.column_stack([np.sin(w * t + order * np.pi / 2), 2 * np.cos(w * t + order * np.pi / 2)])
        * w**order
    )


def test_follows_a_smooth_signal_and_its_derivatives():
    t = np.arange(0, 10, 0.01)
    smooth = fit(Samples1D(t, signal(t)), 0, 10, 0.1)
    inner = np.linspace(1, 9, 300)
    for order, tolerance in ((0, 1e-7), (1, 1e-5), (2, 1e-3)):
        np.testing.assert_allclose(smooth.at(inner, order), signal(inner, order), atol=tolerance)


def test_copes_with_uneven_repeated_and_missing_samples(rng):
    t = np.sort(rng.uniform(0, 10, 800))
    t = np.sort(np.concatenate([t, t[::7]]))
    smooth = fit(Samples1D(t, signal(t)), 0, 10, 0.1)
    inner = np.linspace(1, 9, 300)
    np.testing.assert_allclose(smooth.at(inner, 1), signal(inner, 1), atol=1e-4)


def test_states_the_noise_that_it_finds_and_lets_through():
    t = np.arange(0, 20, 0.02)
    sigma, found, passed = 0.05, [], []
    inner = np.linspace(2, 18, 400)
    for seed in range(20):
        noisy = signal(t) + np.random.default_rng(seed + 100).normal(size=(len(t), 2)) * sigma
        smooth = fit(Samples1D(t, noisy), 0, 20, 0.25)
        found.append(smooth.sigma)
        passed.append(
            (
                np.sqrt(np.mean((smooth.at(inner, 1) - signal(inner, 1)) ** 2)),
                smooth.noise(inner, 1),
            )
        )
    assert np.mean(found) == pytest.approx(sigma, rel=0.02)
    actual, stated = np.mean(np.square(passed), axis=0) ** 0.5
    assert stated == pytest.approx(actual, rel=0.15)


def test_filters_all_streams_alike():
    # The same signal at two rates comes out the same, far above what the knots pass.
    fast, slow = np.arange(0, 10, 0.004), np.arange(0, 10, 0.02)
    high = [np.sin(2 * np.pi * 4 * t)[:, None] for t in (fast, slow)]
    inner = np.linspace(1, 9, 200)
    a, b = (
        fit(Samples1D(t, x), 0, 10, 0.25).at(inner) for t, x in zip((fast, slow), high, strict=True)
    )
    assert np.abs(a - b).max() < 0.02
    assert np.abs(a).max() < 0.2


def test_chooses_wide_knots_for_noise_and_narrow_ones_for_detail(rng):
    t = np.arange(0, 20, 0.02)
    candidates = [0.05, 0.1, 0.2, 0.4, 0.8]
    noisy = Samples1D(t, signal(t) + rng.normal(size=(len(t), 2)) * 0.3)
    detailed = Samples1D(t, signal(t) + 0.3 * np.sin(2 * np.pi * 3 * t)[:, None])
    assert choose_spacing([noisy], candidates, 0, 20) >= 0.4
    assert choose_spacing([detailed], candidates, 0, 20) <= 0.1


def test_leaves_gaps_out():
    t = np.arange(0, 10, 0.04)
    gappy = t[(t < 3) | (t > 4.5)]
    parts = segments([t, gappy], 0.0, 9.9, 0.1)
    assert len(parts) == 2
    assert parts[0][1] < 3.05
    assert parts[1][0] > 4.45


def test_says_nothing_where_samples_do_not_suffice():
    t = np.linspace(0, 1, 6)
    assert fit(Samples1D(t, np.zeros((6, 1))), 0, 1, 0.1) is None
    clustered = np.concatenate([np.linspace(0, 0.1, 50), np.linspace(0.9, 1, 50)])
    assert fit(Samples1D(clustered, np.zeros((100, 1))), 0, 1, 0.05) is None
