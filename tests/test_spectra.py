"""Spectra and convolutions against SciPy's."""

import subprocess
import sys

import numpy as np
import pytest
from scipy.signal import fftconvolve, welch

from steelyard.spectra import convolved, density

ROUNDING = 1e-12  # relative to the largest; sums of a thousand products


@pytest.mark.parametrize("trend", [False, True])
@pytest.mark.parametrize(("n", "length"), [(300, 64), (301, 65), (65, 65), (64, 64), (1000, 3)])
def test_a_density_is_welch_s(n, length, trend, rng):
    values = rng.normal(size=(n, 2)) + np.linspace(0, 5, n)[:, None]
    step = 0.04
    frequency, found = density(values, step, length, trend=trend)
    expected_frequency, expected = welch(
        values, 1 / step, nperseg=length, axis=0, detrend="linear" if trend else False
    )
    np.testing.assert_allclose(frequency, expected_frequency, rtol=ROUNDING)
    np.testing.assert_allclose(found, expected, atol=ROUNDING * expected.max())


def test_white_noise_has_twice_its_variance_over_the_rate(rng):
    step, sigma = 0.01, 3.0
    _, found = density(sigma * rng.normal(size=(200_000, 1)), step, 256)
    assert found[1:-1].mean() == pytest.approx(2 * step * sigma**2, rel=0.01)


def test_inputs_stay_as_they_are(rng):
    values = rng.normal(size=(100, 2))
    before = values.copy()
    density(values, 0.1, 20, trend=True)
    np.testing.assert_array_equal(values, before)


@pytest.mark.parametrize(("n", "m"), [(1, 1), (5, 3), (64, 65), (100, 900)])
def test_a_convolution_is_the_sum_of_shifted_products(n, m, rng):
    one, other = rng.normal(size=(n, 2)), rng.normal(size=(m, 2))
    expected = np.column_stack([np.convolve(a, b) for a, b in zip(one.T, other.T, strict=True)])
    np.testing.assert_allclose(convolved(one, other), expected, atol=1e-10)
    np.testing.assert_allclose(convolved(one, other), fftconvolve(one, other, axes=0), atol=1e-10)


@pytest.mark.integration
def test_to_identify_and_report_needs_no_module_of_signals():
    # Which takes longer to import than all that is computed.
    code = (
        "import sys, steelyard.inspection.identify, steelyard.report.write, steelyard.spectra;"
        "sys.exit('scipy.signal' in sys.modules or 'scipy.stats' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
