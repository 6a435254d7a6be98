"""Which instruments may have which mistakes."""

import pytest
from pydantic import TypeAdapter

from steelyard.inspection.mistakes.catalogue import OF_INSTRUMENTS, of_readings
from steelyard.inspection.mistakes.settings import PLACES
from steelyard.instruments import AnyInstrument


@pytest.mark.parametrize(
    ("kind", "names"),
    {
        "tension": {"order, signs and units of cables"},
        "length": {"order, signs and units of cables"},
        "attitude": {"how an orientation is written", "mounting"},
        "position": {
            "axes, signs and units of a vector",
            "tracker frame",
            "place on the platform",
        },
        "imu": {
            "axes, signs and units of a vector",
            "how an orientation is written",
            "place on the platform",
            "keys of two values",
            "gravity upside down",
            "rates in world axes",
            "mounting",
        },
        "wrench": {"axes, signs and units of a wrench"},
    }.items(),
)
def test_the_table_says_which_instruments_may_have_a_mistake(kind, names):
    instrument = validated(kind)
    quantities = instrument.quantities(8)
    found = {
        each.name
        for each in of_readings(PLACES)
        for q in quantities
        if each.may_have(instrument, q)
    }
    found |= {each.name for each in OF_INSTRUMENTS if each.may_have(instrument, quantities)}
    assert found == names


def validated(kind):
    return TypeAdapter(AnyInstrument).validate_python({"kind": kind})
