"""`compare --out`: intervals side by side, the same numbers as the estimates have."""

import json

import numpy as np
import pytest
from written_estimates import estimate_of, file_of

from steelyard.estimates.comparison import compare
from steelyard.estimates.named_estimate import NamedEstimate
from steelyard.report.blocks.document import Figure
from steelyard.report.documents.comparison import comparison_page

TEN = np.array([134.8, 0.27, -1.08, -15.9, 95.0, 89.0, 31.6, 4.1, -0.1, -0.4])


@pytest.fixture
def files(tmp_path):
    for name, ten in (("before", TEN), ("after", TEN * 1.01)):
        (tmp_path / name).mkdir()
        file_of(tmp_path / name, estimate_of(ten), experiment=name)
    return tmp_path


def test_intervals_are_those_of_the_estimates():
    estimates = [NamedEstimate(n, estimate_of(TEN * f)) for n, f in (("a", 1.0), ("b", 1.1))]
    figure = comparison_page(compare(estimates)).sections[0].blocks[0]
    assert isinstance(figure, Figure)
    marks = {each["name"]: each for each in figure.data if each.get("xaxis") == "x"}
    for each in estimates:
        assert marks[each.name]["x"] == [pytest.approx(each.estimate.mass)]
        sigma = each.estimate.standard_deviation[0]
        assert marks[each.name]["error_x"]["array"] == [pytest.approx(1.96 * sigma)]


def test_estimates_that_are_far_apart_are_both_seen():
    far = [NamedEstimate(n, estimate_of(TEN * f)) for n, f in (("a", 1.0), ("b", 40.0))]
    figure = comparison_page(compare(far)).sections[0].blocks[0]
    for layout in (figure.layout, figure.narrow.layout):
        for each in figure.data:
            low, high = layout["xaxis" + each["xaxis"][1:]]["range"]
            (value,), (reach,) = each["x"], each["error_x"]["array"]
            assert low <= value - reach
            assert value + reach <= high


def test_the_page_is_written_whole_and_nothing_is_replaced(run, files):
    out = files / "out"
    status, printed, err = run("compare", files / "before", files / "after", "--out", out, "--json")
    assert (status, err) == (0, "")
    assert json.loads((out / "comparison.json").read_text()) == json.loads(printed)
    assert 'id="figure-intervals"' in (out / "comparison.html").read_text()
    assert "## Side by side" in (out / "comparison.md").read_text()
    status, _, err = run("compare", files / "before", files / "after", "--out", out)
    assert status == 2
    assert "--force" in err
    assert run("compare", files / "before", files / "after", "--out", out, "--force")[0] == 0


def test_a_payload_is_written_too(run, files):
    out = files / "out"
    status, _, err = run("compare", files / "before", files / "after", "--payload", "--out", out)
    assert (status, err) == (0, "")
    assert "what was added" in (out / "payload.html").read_text()


def test_files_that_are_not_there_leave_nothing(run, files):
    status, _, _ = run("compare", files / "before", files / "none", "--out", files / "out")
    assert status == 2
    assert not (files / "out").exists()
