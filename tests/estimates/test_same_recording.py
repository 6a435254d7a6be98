"""Two results of one recording in two files are known as such."""

import json

import pytest
from recordings import RUN, simulated
from simulated import RECORDER
from written_estimates import estimate_of, file_of

from steelyard.estimates.comparison import compare
from steelyard.estimates.comparison_notes import BOUND_NOTE, INDEPENDENT_NOTE
from steelyard.estimates.file.places import read_estimates
from steelyard.identification.identification import Identification

TEN = RECORDER.body.body_parameters


def written(folder, experiment):
    folder.mkdir()
    path = file_of(folder, estimate_of(TEN))
    found = Identification("x", None, {"maximum-likelihood": estimate_of(TEN)}, recorded=experiment)
    values = json.loads(path.read_text())
    path.write_text(json.dumps(values | {"recordings": found.to_dict()["recordings"]}))
    return str(path)


@pytest.mark.parametrize("without", [(), ("imu",)])
def test_two_results_of_one_recording(tmp_path, without):
    one = written(tmp_path / "a", simulated())
    other = written(tmp_path / "b", simulated().without(*without))
    pairs = compare(read_estimates([one, other]))
    assert pairs.pairs[0].basis == "bound"
    assert any(BOUND_NOTE in note for note in pairs.notes)
    assert INDEPENDENT_NOTE not in pairs.notes


@pytest.mark.integration
def test_two_recordings_of_one_command_are_two(tmp_path):
    one, other = (written(tmp_path / name, RECORDER(seed)) for name, seed in (("a", 1), ("b", 2)))
    pairs = compare(read_estimates([one, other]))
    assert pairs.pairs[0].basis == "independent"


def test_files_that_do_not_say_are_taken_as_before(tmp_path):
    places = []
    for name in "ab":
        (tmp_path / name).mkdir()
        places.append(str(file_of(tmp_path / name, estimate_of(TEN))))
    assert compare(read_estimates(places)).pairs[0].basis == "independent"


def test_clocks_make_no_other_recording():
    from dataclasses import replace

    run = simulated().runs[0]
    later = {name: replace(each, time=each.time + 5) for name, each in run.streams.items()}
    moved = replace(simulated(), runs=(replace(run, streams=later),))
    assert moved.digests() == simulated().digests()
    assert list(moved.digests()) == [RUN]
