"""Pictures of an inspection: seconds across, one unit a scale, angles instead of matrices."""

from dataclasses import replace

import numpy as np
import pytest
from recordings import write_small
from scipy.spatial.transform import Rotation

from steelyard.experiment.read import read_experiment
from steelyard.inspection.inspect import inspect
from steelyard.report.blocks.document import Figure, OneOf, flat
from steelyard.report.blocks.plot import Panel, line, stacked
from steelyard.report.documents.inspection_document import inspection_document


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    folder = tmp_path_factory.mktemp("inspected")
    return inspect(read_experiment(write_small(folder / "small")))


@pytest.fixture(scope="module")
def pictures(found):
    document = inspection_document(found)
    return [
        block
        for section in document.sections
        if section.name in {"balance", "agreements", "streams"}
        for block in flat(section.blocks)
        if isinstance(block, Figure)
    ]


@pytest.mark.integration
def test_seconds_are_across(pictures):
    assert pictures
    for figure in pictures:
        assert figure.layout["xaxis"]["title"]["text"] == "time [s]"
        for each in figure.data:
            assert len(each["x"]) == len(each["y"])


def test_every_scale_has_one_unit_of_the_report(pictures):
    for figure in pictures:
        for key, axis in figure.layout.items():
            if key.startswith("yaxis"):
                title = axis["title"]["text"]
                assert title.count("[") == 1
                assert not any(unit in title for unit in ("rad", "^", ";", ","))


def test_orientations_are_the_angles_of_their_matrices(found, pictures):
    (figure,) = (each for each in pictures if each.title == "Run moving: imu")
    angles = [each for each in figure.data if each["name"] in {"roll", "pitch", "yaw"}]
    assert len(angles) == 3
    run = next(each for each in found.experiment.runs if each.name == "moving")
    matrices = run.streams["imu"].values["orientation"]
    step = -(-len(matrices) // len(angles[0]["x"]))
    turned = Rotation.from_euler(
        "xyz", np.stack([each["y"] for each in angles], axis=1), degrees=True
    )
    np.testing.assert_allclose(turned.as_matrix(), matrices[::step], atol=1e-9)


def test_channels_have_names_of_axes(pictures):
    names = {each["name"] for figure in pictures for each in figure.data}
    assert {"x", "y", "z"} <= names
    assert not any(name[-1].isdigit() and not name.startswith("cable") for name in names)


def test_panels_share_what_is_across_and_one_legend():
    panels = [Panel(f"[{unit}]", [line(n, [0, 1], [0, 1], {}) for n in "xyz"]) for unit in "ab"]
    lines, layout = stacked("time [s]", panels)
    assert [each["showlegend"] for each in lines] == [True] * 3 + [False] * 3
    assert [each["yaxis"] for each in lines] == ["y"] * 3 + ["y2"] * 3
    assert layout["xaxis"]["anchor"] == "y2"
    assert layout["yaxis"]["domain"][0] >= layout["yaxis2"]["domain"][1]


def test_several_runs_are_a_choice(found):
    twice = [("a", found.agreements[0][1]), ("b", found.agreements[0][1])]
    runs = tuple(replace(found.experiment.runs[0], name=name) for name in "ab")
    both = replace(found, agreements=tuple(twice), experiment=replace(found.experiment, runs=runs))
    (section,) = (s for s in inspection_document(both).sections if s.name == "agreements")
    (choice,) = section.blocks
    assert isinstance(choice, OneOf)
    assert [name for name, _ in choice.options] == ["a", "b"]
