"""Runs without force sensors on locked winches."""

import numpy as np
import pytest
from mujoco_swings import ANCHORS, ATTACHMENTS

from steelyard.errors import InputError
from steelyard.experiment.read import read_experiment
from steelyard.experiment.unread import LOCKED, UNREAD, is_unread, with_constant_lengths
from steelyard.experiment.write import write_experiment
from steelyard.files.yaml_file import to_yaml
from steelyard.instruments.unread_cables import CHANGE

POSE = {"kind": "pose", "noise": {"position": 3e-4, "rotation": 5e-4}}


def written(folder, m=4, instruments=None, run=None, **further):
    """An experiment of one run of a platform that swings a little."""
    anchors, attachments = (
        ANCHORS[m]
        if m in ANCHORS
        else [[x + 0.01 * i, y, z] for i, (x, y, z) in enumerate(own * 2)][:m]
        for own in (ANCHORS[4], ATTACHMENTS[4])
    )
    if m in ATTACHMENTS:
        attachments = ATTACHMENTS[m]
    cables = [{"anchor": a, "attachment": b} for a, b in zip(anchors, attachments, strict=True)]
    (folder / "robot.yaml").write_text(to_yaml({"name": "swing", "cables": cables}))
    t = np.arange(0, 2, 0.005)
    table = np.column_stack(
        [t, 0.01 * np.sin(6 * t), 0 * t, 1 + 0 * t, 1 + 0 * t, 0 * t, 0 * t, 0 * t]
    )
    header = "t,x,y,z,qw,qx,qy,qz"
    np.savetxt(folder / "pose.csv", table, delimiter=",", header=header, comments="")
    values = {
        "format": "steelyard/1",
        "robot": "robot.yaml",
        "instruments": instruments or {"pose": POSE},
        "runs": [{"name": "swing", "pose": "pose.csv", **(run or {})}],
        **further,
    }
    (folder / "experiment.yaml").write_text(to_yaml(values))
    return folder / "experiment.yaml"


def test_cables_carry_the_platform_without_being_read(tmp_path):
    experiment = read_experiment(written(tmp_path, run={"winches": "locked"}))
    assert is_unread(experiment)
    assert experiment.mass_assumed
    (run,) = experiment.runs
    assert run.locked
    assert experiment.force_instrument(run) == UNREAD
    # By the clock of the motion capture, at most a hundred times a second.
    assert experiment.delay(run, "pose").sigma == 0
    assert np.median(np.diff(run.streams[UNREAD].time)) == pytest.approx(0.01)


def test_a_mass_that_is_known_is_no_assumption(tmp_path):
    path = written(
        tmp_path, run={"winches": "locked"}, known={"mass": {"value": 9.0, "sigma": 0.01}}
    )
    experiment = read_experiment(path)
    assert is_unread(experiment)
    assert not experiment.mass_assumed
    assert experiment.known["mass"] == (9.0, 0.01)


def test_what_stands_in_is_not_written(tmp_path):
    run = {"winches": "locked", "sync": {"pose": 0.5}}
    experiment = read_experiment(written(tmp_path, run=run))
    assert experiment.runs[0].sync[UNREAD] == 0.5
    again = tmp_path / "again"
    again.mkdir()
    write_experiment(experiment, again)
    text = (again / "experiment.yaml").read_text()
    assert UNREAD not in text
    assert "known" not in text
    back = read_experiment(again / "experiment.yaml")
    assert back.runs[0].locked
    assert back.mass_assumed
    assert back.runs[0].streams.keys() == experiment.runs[0].streams.keys()


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({}, "add the forces, or write 'winches: locked'"),
        ({"m": 6}, "found none; add the forces$"),
        ({"m": 6, "run": {"winches": "locked"}}, "found 6 cables and no forces: it hangs still"),
        ({"m": 7, "run": {"winches": "locked"}}, "found 7 cables and no forces: it hangs still"),
        ({"run": {"winches": "locked", "static": True}}, "found poses at rest; remove the key"),
        ({"run": {"winches": "open"}}, "expected 'locked', or a run without this key"),
    ],
)
def test_a_run_without_forces_needs_locked_winches_and_few_cables(tmp_path, given, expected):
    with pytest.raises(InputError, match=expected):
        read_experiment(written(tmp_path, **given))


STATED = {"run": {"winches": "locked"}, "uncertainty": {"length_noise": 4e-4}}


def test_lengths_of_locked_winches_do_not_change_to_a_stated_noise(tmp_path):
    experiment = read_experiment(written(tmp_path, **STATED))
    (run,) = experiment.runs
    own, stream = experiment.instruments[LOCKED], run.streams[LOCKED]
    assert own.quantity(CHANGE, 4).noise == 4e-4
    # Twenty times a second, by the clock of the motion capture.
    assert np.diff(stream.time) == pytest.approx(0.05, rel=0.01)
    assert (stream.time[0], stream.time[-1]) == tuple(run.streams["pose"].time[[0, -1]])
    assert own.clock == experiment.instruments[UNREAD].clock
    np.testing.assert_array_equal(stream.values[CHANGE], np.zeros((len(stream), 4)))
    assert with_constant_lengths(experiment).runs[0].streams.keys() == run.streams.keys()


def test_nothing_is_said_of_lengths_unless_it_is_stated(tmp_path):
    for further in ({}, {"uncertainty": {"length_noise": None}}):
        experiment = read_experiment(written(tmp_path, run={"winches": "locked"}, **further))
        assert experiment.instruments.keys() == {"pose", UNREAD}


def test_encoders_say_by_themselves_that_lengths_are_constant(tmp_path):
    path = written(
        tmp_path,
        instruments={"pose": POSE, "encoders": {"kind": "length", "noise": 1e-4}},
        run={"winches": "locked", "encoders": "lengths.csv"},
        uncertainty={"length_noise": 4e-4},
    )
    t = np.arange(0, 2, 0.01)
    table = np.column_stack([t, *np.ones((4, len(t)))])
    header = "t,l1,l2,l3,l4"
    np.savetxt(tmp_path / "lengths.csv", table, delimiter=",", header=header, comments="")
    assert LOCKED not in read_experiment(path).instruments


def test_the_noise_of_lengths_is_written_and_their_stream_is_not(tmp_path):
    experiment = read_experiment(written(tmp_path, **STATED))
    again = tmp_path / "again"
    again.mkdir()
    write_experiment(experiment, again)
    text = (again / "experiment.yaml").read_text()
    assert LOCKED not in text
    back = read_experiment(again / "experiment.yaml")
    assert back.length_noise == 4e-4
    assert back.runs[0].streams.keys() == experiment.runs[0].streams.keys()


@pytest.mark.parametrize("noise", [-1e-3, 0])
def test_a_noise_of_lengths_is_larger_than_zero(tmp_path, noise):
    given = {**STATED, "uncertainty": {"length_noise": noise}}
    with pytest.raises(InputError, match=r"length_noise.*expected a number above 0"):
        read_experiment(written(tmp_path, **given))


def test_a_noise_of_lengths_needs_a_run_with_locked_winches(tmp_path):
    with pytest.raises(InputError, match="expected a run with 'winches: locked', in which") as why:
        read_experiment(written(tmp_path, uncertainty={"length_noise": 4e-4}))
    assert "found none; add it to these runs, or remove the key" in str(why.value)
