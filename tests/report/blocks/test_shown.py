"""Units and names as people read them."""

import pytest

from steelyard.report.blocks.shown import line_colour, shown_unit, slug, words
from steelyard.units import FACTORS


@pytest.mark.parametrize(
    ("unit", "quantity", "name", "log"),
    [
        ("rad", "", "°", "deg"),
        ("rad/s", "", "°/s", "deg/s"),
        ("m", "error", "mm", "mm"),
        ("s", "error", "ms", "ms"),
    ],
)
def test_factors_are_the_inverse_of_those_of_logs(unit, quantity, name, log):
    shown = shown_unit(unit, quantity)
    assert shown.name == name
    assert shown.factor * FACTORS[unit][log] == pytest.approx(1.0, rel=1e-15)


def test_other_units_are_only_written_better():
    assert shown_unit("kg m^2") == ("kg m²", 1.0)
    assert shown_unit("m") == ("m", 1.0)
    assert shown_unit("N") == ("N", 1.0)
    assert words("angular_velocity") == "angular velocity"


def test_names_for_links_are_safe_and_differ():
    found = [
        slug("a", "b"),
        slug("a-b"),
        slug("ä<b>"),
        slug("ä b "),
        slug("x" * 100),
        slug("\ud800"),
    ]
    assert len(set(found)) == len(found)
    assert all(c.isascii() and (c.isalnum() or c == "-") for each in found for c in each)
    assert slug("a", "b") == slug("a", "b")


def test_colours_of_lines_begin_again():
    assert len({line_colour(i) for i in range(20)}) == 8
    assert line_colour(0) == line_colour(8)
