"""What is wrong in every log of an instrument is said once, under the instrument."""

import numpy as np
import pytest

from steelyard.errors import InputError
from steelyard.experiment.read import read_experiment
from steelyard.experiment.write import write_experiment
from steelyard.instruments.base import Instrument
from steelyard.instruments.tension import Tension

ROBOT = """\
name: two
cables:
- {anchor: [0, 0, 3], attachment: [0.1, 0, 0]}
- {anchor: [2, 0, 3], attachment: [-0.1, 0, 0]}
"""
TIMES = np.arange(12)
TENSION = np.column_stack([50.0 + TIMES**1.5, 80.0 - 2 * np.sqrt(TIMES)])
SPEED = 0.1 * np.sin(TIMES)


@pytest.fixture
def written(tmp_path):
    """Write an experiment with keys of both instruments and of the stream of the cables."""

    def write(cables="", imu="", stream=""):
        (tmp_path / "robot.yaml").write_text(ROBOT)
        rows = "\n".join(f"{i},{a},{b}" for i, (a, b) in enumerate(TENSION))
        (tmp_path / "f.csv").write_text(f"t,left,right\n{rows}\n")
        rows = "\n".join(f"{i},{w},0,{-w},0,0,9.81" for i, w in enumerate(SPEED))
        (tmp_path / "imu.csv").write_text(f"t,wx,wy,wz,ax,ay,az\n{rows}\n")
        file = tmp_path / "experiment.yaml"
        file.write_text(
            "format: steelyard/1\nrobot: robot.yaml\ninstruments:\n"
            f"  cables: {{kind: tension{cables}}}\n  imu: {{kind: imu{imu}}}\n"
            "runs:\n- name: a\n  imu: imu.csv\n"
            f"  cables: {{file: f.csv, columns: {{f1: left, f2: right}}{stream}}}\n"
        )
        return file

    return write


def tension(file):
    return read_experiment(file).runs[0].streams["cables"].values["tension"]


@pytest.mark.parametrize(
    ("cables", "stream", "wanted"),
    [
        (", scale: 1000", "", 1000 * TENSION),
        (", scale: {f1: -1}", "", TENSION * [-1, 1]),
        ("", ", scale: {f1: -1}", TENSION * [-1, 1]),
        (", scale: -1", ", scale: {f1: -1}", TENSION * [1, -1]),
        (", scale: 0.001", ", units: {left: kN, right: kN}", TENSION),
        (", columns: {f1: f2, f2: f1}", "", TENSION[:, ::-1]),
        (", columns: {f1: f2, f2: f1}, scale: {f1: -1}", "", TENSION[:, ::-1] * [-1, 1]),
        (", columns: {f1: right, f2: left}", "", TENSION[:, ::-1]),
    ],
)
def test_it_comes_on_top_of_what_streams_say(written, cables, stream, wanted):
    np.testing.assert_allclose(tension(written(cables, stream=stream)), wanted, rtol=1e-12)


def test_columns_of_one_quantity_among_others(written):
    stream = read_experiment(written(imu=", scale: {wz: -1}")).runs[0].streams["imu"]
    np.testing.assert_allclose(stream.values["angular_velocity"][:, 2], SPEED)  # the log has -wx
    np.testing.assert_allclose(stream.values["angular_velocity"][:, 0], SPEED)


def test_what_is_written_again_is_corrected_already(written, tmp_path):
    right = read_experiment(written(", scale: 1000"))
    (tmp_path / "again").mkdir()
    write_experiment(right, tmp_path / "again")
    assert "scale" not in (tmp_path / "again" / "experiment.yaml").read_text()
    np.testing.assert_allclose(tension(tmp_path / "again" / "experiment.yaml"), 1000 * TENSION)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"cables": ", scale: {f9: -1}"}, r"expected columns of the kind 'tension', found 'f9'"),
        ({"cables": ", columns: {x: f1}"}, r"expected columns of the kind 'tension', found 'x'"),
        ({"imu": ", scale: 2"}, r"expected a factor for each column, .* found 2 for all"),
        ({"cables": ", scale: many"}, r"instruments\.cables\.scale"),
        ({"cables": ", columns: [f1]"}, r"instruments\.cables\.columns"),
    ],
)
def test_what_makes_no_sense_is_said(written, keys, message):
    with pytest.raises(InputError, match=message):
        read_experiment(written(**keys))


def test_an_instrument_can_be_made_again_of_what_it_says():
    instrument = Tension(kind="tension", scale={"f1": -1.0}, columns={"f1": "f2"})
    again = Tension.model_validate(instrument.model_dump(exclude_unset=True))
    assert again == instrument
    assert hash(again) == hash(instrument)
    assert isinstance(again, Instrument)
    assert (again.factor("f1"), again.factor("f2")) == (-1, 1)
