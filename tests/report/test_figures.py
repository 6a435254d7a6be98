"""The pictures of the report as figures for a notebook, and the results written from Python."""

from dataclasses import replace

import numpy as np
import plotly.graph_objects as go
import pytest
from recordings import write_small

import steelyard

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    experiment = steelyard.read_experiment(write_small(tmp_path_factory.mktemp("small")))
    return steelyard.identify(experiment)


@pytest.fixture(scope="module")
def drawn(found):
    return steelyard.figures(found, found.nominal)


def test_all_pictures_are_figures(drawn):
    assert list(drawn)[:3] == ["intervals", "robot", "body"]
    assert {"learned", "correlation"} <= set(drawn)
    assert sum(name.startswith("trace-") for name in drawn) == 7
    assert sum(name.startswith("spectra-") for name in drawn) == 1
    for each in drawn.values():
        assert isinstance(each, go.Figure)
        assert each.layout.title.text
        assert "var(" not in each.to_json()


def test_intervals_are_those_of_the_estimates(found, drawn):
    marks = {
        trace.name: trace
        for trace in drawn["intervals"].data
        if trace.xaxis == "x" and trace.mode == "markers"
    }
    for name, estimate in found.estimates.items():
        assert marks[name].x[0] == pytest.approx(estimate.mass)
        assert marks[name].error_x.array[0] == pytest.approx(1.96 * estimate.standard_deviation[0])
    assert marks["smallest possible"].error_x.array[0] == pytest.approx(
        1.96 * found.bound.standard_deviation[0], rel=5e-3
    )


def test_the_platform_stands_where_the_motion_begins(found, drawn):
    robot = found.recorded.robot
    cables = next(trace for trace in drawn["robot"].data if trace.name == "cables")
    points = np.stack([cables.x, cables.y, cables.z], axis=1)
    np.testing.assert_array_equal(points[::3], robot.anchors)
    pose = found.posterior.samples[0]
    # The fit has the origin of the platform frame elsewhere.
    attachments = found.posterior.experiment.robot.attachments
    expected = attachments @ pose.rotation[0].T + pose.position[0]
    np.testing.assert_allclose(points[1::3], expected, atol=1e-4)


def test_one_by_name(found, drawn):
    assert steelyard.figure(found, "correlation").to_json() == drawn["correlation"].to_json()
    assert "force" in steelyard.figure(found, "trace-moving-platform-force").layout.title.text
    with pytest.raises(
        steelyard.InputError, match=r"expected one of intervals, robot, .*found 'pie'"
    ):
        steelyard.figure(found, "pie")


def test_names_are_text(found):
    hostile = "<b>bold</b>"
    runs = tuple(replace(run, name=hostile) for run in found.recorded.runs)
    named = replace(found, recorded=replace(found.recorded, runs=runs), posterior=None)
    text = "".join(each.to_json() for each in steelyard.figures(named).values())
    assert "<b>" not in text.replace("\\u003c", "<")


def test_results_are_written_as_the_verb_does(found, tmp_path):
    page = steelyard.write_results(found, tmp_path / "out", found.nominal)
    assert page == tmp_path / "out" / "report.html"
    names = {"estimate.json", "motion.parquet", "report.html", "report.json", "report.md"}
    assert {path.name for path in page.parent.iterdir()} == names
    (estimate,) = steelyard.read_estimates([str(page.parent)])
    np.testing.assert_array_equal(estimate.estimate.value, found.estimate.value)
    with pytest.raises(steelyard.InputError, match="force=True"):
        steelyard.write_results(found, tmp_path / "out")
    steelyard.write_results(found, tmp_path / "out", force=True)
