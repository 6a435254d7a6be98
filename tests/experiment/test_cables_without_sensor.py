"""Cables without a force sensor: read, estimated with, drawn."""

import json
import re
import shutil

import numpy as np
import pytest
from places import DATA
from recordings import RUN, save, table, write_small

from steelyard.errors import InputError
from steelyard.experiment.read import read_experiment
from steelyard.identification.identify import identify
from steelyard.identification.samples.preparation import prepare


def without(path, cables):
    text = path.read_text()
    path.write_text(text.replace("kind: tension", f"kind: tension\n    without: {cables}", 1))


def drop(path, names):
    rows = table(path)
    keep = [i for i, name in enumerate(rows[0]) if name not in names]
    save(path, [[row[i] for i in keep] for row in rows])


@pytest.mark.parametrize("absent", [False, True])
def test_their_columns_are_ignored_or_absent(tmp_path, absent):
    path = write_small(tmp_path)
    without(path, [3, 8])
    if absent:
        drop(tmp_path / RUN / "cables.csv", {"f3", "f8"})
    tension = read_experiment(path).runs[0].streams["cables"].values["tension"]
    assert tension.shape[1] == 8
    np.testing.assert_array_equal(np.isnan(tension).all(axis=0), np.isin(np.arange(8), [2, 7]))
    assert np.isfinite(tension[:, [0, 1, 3, 4, 5, 6]]).all()


@pytest.mark.parametrize(
    ("cables", "sentence"),
    [
        ("[9]", r"expected numbers of the 8 cables of the robot, from 1, found 9; correct it"),
        ("[1, 2, 3, 4, 5, 6, 7, 8]", r"expected a cable that has a sensor, found none"),
        ("[0]", r"without.*greater than or equal to 1|without.*at least 1"),
    ],
)
def test_numbers_that_make_no_sense_are_refused(tmp_path, cables, sentence):
    path = write_small(tmp_path)
    without(path, cables)
    with pytest.raises(InputError, match=sentence):
        read_experiment(path)


def test_the_two_steps_say_that_they_need_every_cable(tmp_path):
    path = write_small(tmp_path)
    without(path, [3])
    experiment = read_experiment(path)
    with pytest.raises(InputError, match="force of every cable, found none of cable 3"):
        prepare(experiment, experiment.runs[0])


@pytest.mark.integration
@pytest.mark.parametrize("method", ["maximum-likelihood", "least-squares"])
def test_six_sensors_of_eight_tell_the_body(tmp_path, method):
    path = write_small(tmp_path)
    whole = identify(read_experiment(path), [method]).estimate
    without(path, [3, 8])
    found = identify(read_experiment(path), [method]).estimate
    assert found.verdict.accepted, found.verdict.reasons
    told = np.isfinite(found.value)
    assert told[:4].all()
    # They tell less, and agree.
    assert np.all(found.standard_deviation[told] > 0.99 * whole.standard_deviation[told])
    assert np.all(np.abs(found.value - whole.value)[told] < 5 * found.standard_deviation[told])


@pytest.mark.slow
@pytest.mark.integration
def test_a_report_of_four_cables_one_of_them_without_a_sensor(run, tmp_path):
    shutil.copytree(DATA / "rough-robots" / "four-cables-00", tmp_path / "e")
    without(tmp_path / "e" / "experiment.yaml", [2])
    status, _, err = run("identify", tmp_path / "e" / "experiment.yaml", "--out", tmp_path / "out")
    assert (status, err) == (0, "")
    result = json.loads((tmp_path / "out" / "estimate.json").read_text())
    assert result["result"] == "maximum-likelihood"
    assert result["estimates"]["two-step"]["mass"] is None
    page = (tmp_path / "out" / "report.md").read_text()
    assert re.search(r"\| robot \| unmodelled wrench \| N \|", page)
