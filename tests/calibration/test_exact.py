"""A geometry that is stated as exact: nothing is found of it, and that is what is said."""

from dataclasses import replace

import pytest
from grids import grids

import steelyard
from steelyard.report.documents.calibration import calibration_document

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module")
def recorded():
    return steelyard.simulate("cogiro", duration=4.0, seed=1).experiment


def points(document):
    (grid,) = (each for each in grids(document) if each.caption == "Anchors and attachments")
    return [cell for row in grid.rows for cell in row[2:]]


def test_an_exact_geometry_is_not_called_a_result(recorded):
    assert set(recorded.uncertainty.values()) == {0.0}
    found = steelyard.calibrate(recorded)
    assert all(each.all() for each in found.exact.values())
    document = calibration_document(found)
    assert "stated as exact" in document.lead.text
    assert "accepted" not in document.lead.text
    assert document.lead.tone == "note"
    written = points(document)
    assert len(written) == 48
    assert all(text.endswith(" exact") and "±" not in text for text in written)


def test_what_is_exact_beside_what_is_not_told_is_said_of_it_alone(recorded):
    """A short motion tells no anchor better than half a centimetre."""
    found = steelyard.calibrate(
        replace(recorded, uncertainty={"anchor": 0.005, "attachment": 0.0, "gravity": 0.0})
    )
    assert not found.told["anchor"].any()
    document = calibration_document(found)
    assert "tell no coordinate better" in document.lead.text
    assert "accepted" not in document.lead.text
    written = points(document)
    assert set(written[:24]) == {"not told"}
    assert all(text.endswith(" exact") for text in written[24:])
