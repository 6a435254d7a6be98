"""The section on what the model does not know."""

from dataclasses import replace

import pytest

from steelyard.report.documents.sections.disturbances import disturbances
from steelyard.report.evidence.values import DisturbanceTrack, Evidence

WRENCH = DisturbanceTrack(
    run="a",
    owner="robot",
    quantity="unmodelled force",
    cause="colored",
    stated=False,
    unit="N",
    deviation=(2.0, 2.0, 2.0),
    correlation_time=0.5,
    rms=(1.0, 2.0, 3.0),
    time=(0.0, 0.5, 1.0),
    values=((0.0, 1.0, 0.0), (0.0, -2.0, 0.0), (0.0, 0.0, -9.0)),
)


class Shown:
    """As much of a summary as the section looks at."""

    def __init__(self, *tracks):
        self.evidence = Evidence(disturbances=tracks)


def test_nothing_is_said_where_there_is_none():
    assert disturbances(Shown()) is None


def test_a_wrench_is_drawn_by_axis_and_said_where_to_look():
    section = disturbances(Shown(WRENCH))
    note, table, figure = section.blocks
    assert "neither the body" in str(note)
    assert table.rows[0][1:5] == ("platform", "unmodelled force", "wrench", "found")
    assert [each["name"] for each in figure.data] == ["x", "y", "z"]
    assert "largest 9 N at 1.0 s" in figure.alternative


@pytest.mark.parametrize(
    ("quantity", "count", "names"),
    [("tension", 4, ["cable 1", "cable 2", "cable 3", "cable 4"]), ("distance", 1, ["x"])],
)
def test_other_widths(quantity, count, names):
    own = replace(
        WRENCH,
        owner="cells",
        quantity=quantity,
        cause="drift",
        stated=True,
        deviation=(1.0,) * count,
        rms=(1.0,) * count,
        values=WRENCH.values[:1] * count,
    )
    table, figure = disturbances(Shown(own)).blocks
    assert table.rows[0][1:5] == ("cells", quantity, "drift", "stated")
    assert [each["name"] for each in figure.data] == names


def test_places_are_in_millimetres():
    own = replace(WRENCH, owner="tracker", quantity="position", unit="m", rms=(0.001,) * 3)
    table, _ = disturbances(Shown(own)).blocks
    assert table.rows[0][5:7] == ("mm", "1, 1, 1")
