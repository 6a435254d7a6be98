"""Units are what their definitions say, however a log spells them; what has two meanings has
none."""

import math

import pytest

from steelyard.units import FACTORS, MASS, canonical_unit, is_unit

DEGREE = math.pi / 180

SPELLINGS = {
    "s": ["s", "sec", "Sec.", "secs", "second", "Seconds", "SECONDS", "Sekunden", " s "],
    "ms": ["ms", "msec", "milliseconds"],
    "us": ["us", "µs", "μs", "usec", "microseconds"],
    "ns": ["ns", "nsec"],
    "min": ["min", "min.", "minutes"],
    "N": ["N", "newton", "Newtons"],
    "kN": ["kN", "kilonewton"],
    "kgf": ["kgf", "kg", "KG"],
    "lbf": ["lbf", "lb", "lbs"],
    "N m": ["N m", "N·m", "N*m", "N.m", "N-m", "N⋅m", "Newton-meters"],
    "N mm": ["N mm", "N·mm", "N.mm"],
    "mN m": ["mN m", "mN·m"],
    "lbf ft": ["lbf ft", "ft-lbf", "lb-ft", "ft lb"],
    "m": ["m", "meter", "Metres"],
    "mm": ["mm", "millimeters", "Millimeters"],
    "um": ["um", "µm"],
    "in": ["in", "in.", "inch", "inches"],
    "ft": ["ft", "feet"],
    "rad": ["rad", "RAD", "radians"],
    "deg": ["deg", "Deg", "°", "º", "degree", "degrees"],
    "rad/s": [
        "rad/s",
        "rad / s",
        "rad/sec",
        "rad s^-1",
        "rad·s⁻¹",
        "rad s-1",
        "radians per second",
    ],
    "deg/s": ["deg/s", "°/s", "° / s", "deg/sec", "degrees/s", "degrees per second", "Deg/s"],
    "dps": ["dps"],
    "rpm": ["rpm", "RPM", "rev/min", "U/min"],
    "m/s^2": [
        "m/s^2",
        "m/s²",
        "m/s**2",
        "m / s²",
        "m/s/s",
        "m/sec^2",
        "m/sec2",
        "m s^-2",
        "m·s⁻²",
        "m.s-2",
    ],
    "mm/s^2": ["mm/s^2", "mm/s2", "mm/s²"],
    "ft/s^2": ["ft/s^2", "ft/s2"],
    "g": ["g", "gn", "g0", "g_n"],
    "mg": ["mg"],
    "1": ["1", "-"],
}


@pytest.mark.parametrize(
    ("unit", "text"), [(unit, text) for unit, texts in SPELLINGS.items() for text in texts]
)
def test_spellings_of_units(unit, text):
    assert canonical_unit(text) == unit
    assert is_unit(text)


@pytest.mark.parametrize(
    "text",
    [
        "grad",  # gon in English, degrees in German
        "Grad",
        "mil",  # a thousandth of an inch, or of a radian
        "M",  # mega, a minute, or a metre in capitals
        "MM",
        "S",  # siemens
        "G",  # gauss
        "GN",  # giganewton, not the g of gravity
        "MN",  # not millinewton
        "MS",
        "nm",  # nanometre, not newton metre
        "NM",
        "Nmm2",
        "ms^-2",  # per square millisecond, or metres per square second
        "ms-2",
        "'",  # feet, or minutes of arc
        '"',
        "t",
        "p",
        "kip",
        "1/s",
        "1/min",
        "kHz",
        "%",
        "V",
        "counts",
        "kg m",
        "m/s",
        "",
        " ",
        ".",
        "N N",
        "raw",
        "SI",
    ],
)
def test_what_has_no_or_two_meanings_is_no_unit(text):
    assert canonical_unit(text) is None


@pytest.mark.parametrize(
    "text", ["V", "mV/V", "°C", "%", "kHz", "bar", "counts", "grad", "m/s", "MN"]
)
def test_units_of_other_quantities_are_known_as_such(text):
    assert is_unit(text)
    assert canonical_unit(text) is None


@pytest.mark.parametrize("text", ["", "raw", "left", "x", "NaN", "Comment"])
def test_words_are_no_units(text):
    assert not is_unit(text)


@pytest.mark.parametrize(
    ("quantity", "text", "factor"),
    [
        ("s", "100ns", 1e-7),
        ("s", "h", 3600),
        ("N", "kg", 9.80665),
        ("N", "lbf", 4.4482216152605),  # exact, BIPM
        ("N m", "ft-lbf", 1.3558179483314004),
        ("m", "inch", 0.0254),
        ("rad", "°", DEGREE),
        ("rad", "gon", DEGREE * 0.9),
        ("rad", "arcmin", DEGREE / 60),
        ("rad/s", "°/s", DEGREE),
        ("rad/s", "rpm", 2 * math.pi / 60),
        ("m/s^2", "g", 9.80665),
        ("m/s^2", "mg", 9.80665e-3),
    ],
)
def test_factors_are_those_of_the_definitions(quantity, text, factor):
    assert FACTORS[quantity][canonical_unit(text)] == pytest.approx(factor, rel=1e-15)


def test_a_unit_is_of_one_quantity():
    units = [unit for key, factors in FACTORS.items() if key != MASS for unit in factors]
    assert len(units) == len({*units})
    assert all(canonical_unit(unit) == unit for unit in units)
