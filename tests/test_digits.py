"""How numbers are rounded: by their uncertainty, else to significant digits, read back as numbers."""

import numpy as np
import pytest
from grids import is_a_deviation

from steelyard import digits


@pytest.mark.parametrize(
    ("value", "count", "text"),
    [
        (5000.0, 3, "5000"), (1014.3, 3, "1014"), (123456.0, 3, "123456"), (0.4996, 3, "0.5"),
        (-0.0, 3, "0"), (-93.27, 3, "-93.3"), (0.00175, 3, "0.00175"), (5.8e-10, 2, "5.8e-10"),
        (9.996, 3, "10"), (28000.0, 2, "28000"), (3.2e9, 2, "3.2e+09"), (np.nan, 3, "-"),
        (None, 3, "-"), (np.inf, 3, "-"),
    ],
)  # fmt: skip
def test_significant_digits_without_powers_of_ten(value, count, text):
    assert digits.figures(value, count) == text


def test_significant_digits_are_near_the_value(rng):
    for value in rng.normal(size=300) * 10.0 ** rng.integers(-6, 9, size=300):
        text = digits.figures(value, 3)
        assert float(text) == pytest.approx(value, rel=5.1e-3)
        if 1e-4 <= abs(value) < 1e7:
            assert "e" not in text


@pytest.mark.parametrize(
    ("value", "sigma", "text"),
    [(-0.04, 14.0, "0 ± 14"), (161.1812, 0.3819, "161.18 ± 0.38"), (-0.001, 0.4, "0.00 ± 0.40")],
)
def test_what_rounds_to_nothing_has_no_sign(value, sigma, text):
    assert digits.number(value, sigma) == text
    assert digits.number(value, sigma, sign=True).lstrip("+") == text


@pytest.mark.parametrize(
    ("low", "high", "text"),
    [(-0.042, 0.645, "-0.042 to 0.645"), (290.0, 5000.0, "290 to 5000"), (-1e-9, 34.4, "0.0 to 34.4"), (0, 0, "0 to 0")],
)  # fmt: skip
def test_both_ends_have_the_same_digits(low, high, text):
    assert digits.between(low, high) == text


@pytest.mark.parametrize(
    ("seconds", "text"), [(1.5e-15, "< 0.001"), (0.0, "< 0.001"), (2.9e-4, "0.29"), (0.0123, "12")]
)
def test_times_no_clock_reads_are_none(seconds, text):
    assert digits.milliseconds(seconds) == text


def test_a_deviation_alone_is_that_beside_its_number():
    for sigma in (0.382, 0.6, 12.3, 0.0999):
        assert digits.number(1.0, sigma).endswith(f"± {digits.deviation(sigma)}")
    assert digits.deviation(None) == "-"
    assert digits.per_cent(0.198) == "20%"


@pytest.mark.parametrize(
    ("values", "texts"),
    [
        ([0.21, 0.212, 0.2204], ["0.210", "0.212", "0.220"]),
        ([10.0, 7.591, 5.63], ["10.0", "7.6", "5.6"]),
        ([161.0, None, np.nan], ["161", "-", "-"]),
        ([3e-6, 2e-6], ["3e-06", "2e-06"]),
        ([0.0], ["0"]),
    ],
)
def test_numbers_of_one_kind_have_the_same_digits(values, texts):
    assert digits.alike(values) == texts


def test_a_deviation_below_all_digits_is_no_zero():
    assert digits.deviation(3.14e-8) == "3.1e-08"


def test_a_deviation_has_two_digits_also_just_below_a_power_of_ten(rng):
    sizes = [*(10.0 ** rng.uniform(-4.9, 4, size=300)), 0.000999, 0.0998, 9.97, 99.7]
    texts = [digits.deviation(value) for value in sizes]
    assert [text for text in texts if not is_a_deviation(text)] == []
    assert digits.number(5.1234, 0.0998) == "5.12 ± 0.10"
    assert digits.number(5.1234, 0.0994) == "5.123 ± 0.099"
