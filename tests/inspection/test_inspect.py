"""What `inspect` says of recordings: mistakes that were made in them on purpose are named, sound
ones raise no alarm."""

import json
from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest
from mistaken import MISTAKES, late, vector
from pydantic import TypeAdapter
from recordings import RUN, save, table, write_small
from simulated import PAPER, RECORDER, changed, sound, without

from steelyard.experiment.model import Experiment, Run, Stream
from steelyard.inspection.catalogue import OF_INSTRUMENTS, OF_READINGS
from steelyard.inspection.delays import of_excerpt
from steelyard.inspection.excerpt import excerpts
from steelyard.inspection.inspect import inspect
from steelyard.inspection.judgement import judged
from steelyard.inspection.mistakes import MistakeSettings, mistakes
from steelyard.instruments import AnyInstrument
from steelyard.report.documents.inspection_document import inspection_document
from steelyard.report.forms.markdown import markdown

pytestmark = pytest.mark.integration

# Others of the list are tried by `make bench` on more recordings; these take a second each.
TRIED = (
    "accelerometer in g", "gravity removed", "accelerometer upside down", "ax with the wrong sign", "ay and az exchanged", "gyro in deg/s",
    "gyro y with the wrong sign", "wx and wz exchanged", "orientation transposed", "quaternion x y z w",
    "angles of the orientation in degrees", "roll and yaw exchanged", "IMU turned by 90 degrees", "left-handed tracker", "tracker in mm",
    "target elsewhere", "cables 2 and 5 exchanged", "cables in reverse", "negative tensions", "tensions in daN", "tensions in kN",
    "one sensor in kgf", "one sensor with the wrong sign", "one sensor dead", "gravity with the wrong sign", "IMU late by half a second",
    "events of IMU and tracker exchanged", "command in degrees", "command in mm",
)  # fmt: skip


def found_in(experiment):
    (excerpt,) = excerpts(experiment, 1)
    return mistakes(excerpt)


@pytest.mark.slow
@pytest.mark.parametrize("name", TRIED)
def test_a_mistake_is_named_with_what_to_change(name):
    mistake = MISTAKES[name]
    found, after = found_in(mistake.make(sound(1)))
    assert found, "nothing was named"
    amendment = found[0].amendment
    text = f"{amendment.what}; {amendment.proposal}"
    assert any(word in text for word in mistake.words), text
    assert amendment.subject == mistake.subject or not mistake.subject
    assert not after.bad


@pytest.mark.parametrize("seed", range(1, 5))
def test_a_sound_recording_raises_no_alarm(seed):
    (excerpt,) = excerpts(sound(seed), 1)
    assert not judged(excerpt).bad


@pytest.mark.parametrize(
    ("instrument", "quantity"),
    [
        ("command", None),
        ("tracker", None),
        ("imu", "orientation"),
        ("imu", "angular_velocity"),
        ("imu", "specific_force"),
    ],
)
def test_fewer_instruments_raise_no_alarm_either(instrument, quantity):
    (excerpt,) = excerpts(without(sound(1), instrument, quantity), 1)
    assert not judged(excerpt).bad


def test_the_gyro_is_blamed_for_its_own_mistake_alone():
    found, _ = found_in(vector("imu", "angular_velocity", [1, 1, -1])(sound(2)))
    (mistake,) = found
    assert (mistake.amendment.subject, mistake.amendment.channel) == ("imu", "angular_velocity")
    assert "angular velocity of imu" in mistake.evidence


def test_two_mistakes_are_both_named():
    twice = MISTAKES["tensions in daN"].make(
        vector("imu", "angular_velocity", 180 / np.pi)(sound(1))
    )
    found, after = found_in(twice)
    assert {m.amendment.channel for m in found} == {"tension", "angular_velocity"}
    assert not after.bad


@pytest.mark.slow
def test_a_hand_on_the_platform_is_placed():
    finer = changed(PAPER["cables"], rate=100.0, noise=0.6)
    found = inspect(RECORDER(5, touched=True, instruments={**PAPER, "cables": finer}))
    assert found.mistakes == ()
    assert min(c.start for c in found.contacts) == pytest.approx(5.0, abs=0.4)
    assert max(c.end for c in found.contacts) == pytest.approx(7.0, abs=0.4)
    assert any("force y" in channel for c in found.contacts for channel in c.channels)


def shaken(rng, delay):
    """A body of 2 kg on a wrench sensor that shakes, with an accelerometer whose stamps are
    late."""
    from steelyard.instruments import Attitude, Imu, Wrench
    from steelyard.robot.model import Robot

    def force(t):
        return np.column_stack(
            [
                np.sin(2 * np.pi * f * t + f) + 0.1 * np.sin(2 * np.pi * 17 * f * t)
                for f in (0.9, 1.1, 1.3)
            ]
        )

    up = np.array([0.0, 0.0, 9.81])
    times = {
        "sensor": np.arange(0, 8, 1 / 700),
        "imu": np.arange(0.001, 8, 1 / 254),
        "arm": np.arange(0, 8, 0.01),
    }
    streams = {
        "sensor": Stream(times["sensor"], {"force": 2 * (force(times["sensor"]) + up) + rng.normal(0, 0.01, (5600, 3)), "torque": rng.normal(0, 1e-3, (5600, 3))}, "sensor"),
        "imu": Stream(times["imu"] + delay, {"specific_force": force(times["imu"]) + up + rng.normal(0, 0.02, (len(times["imu"]), 3))}, "imu"),
        "arm": Stream(times["arm"], {"orientation": np.tile(np.eye(3), (800, 1, 1))}, "arm"),
    }  # fmt: skip
    instruments = {
        "sensor": Wrench(kind="wrench"),
        "imu": Imu(kind="imu"),
        "arm": Attitude(kind="attitude"),
    }
    return Experiment(
        "shaken",
        Robot("sensor", np.zeros((0, 3)), np.zeros((0, 3))),
        instruments,
        (Run("run", streams),),
    )


@pytest.mark.parametrize("delay", [-0.004, 0.0, 0.0072])
def test_vibrations_tell_how_late_an_accelerometer_is(rng, delay):
    experiment = shaken(rng, delay)
    found = {each.instruments: each for each in of_excerpt(experiment, experiment.runs[0])}
    accelerometer = found["imu",]
    assert accelerometer.told
    assert accelerometer.value == pytest.approx(delay, abs=5e-4)


@pytest.fixture(scope="module")
def whole():
    return inspect(sound(1))


def test_everything_is_looked_at(whole):
    assert [each.instrument for each in whole.streams] == ["cables", "imu", "tracker", "command"]
    assert [each.told for each in whole.excitation.body] == ["data"] * 10
    assert whole.mistakes == ()
    assert whole.contacts == ()
    tracker = next(each for each in whole.delays if "tracker" in each.instruments)
    assert tracker.told
    assert tracker.sigma < 1e-3


def test_noise_is_found_as_it_was_made(whole):
    for report in whole.streams:
        for quantity in report.quantities:
            if quantity.stated:
                assert quantity.noise_in_motion == pytest.approx(quantity.stated, rel=0.15)


def test_the_value_is_plain(whole):
    values = json.loads(json.dumps(whole.to_dict(), allow_nan=False))
    assert values["format"] == "steelyard-inspection/1"
    assert values["excitation"]["body"]["mass"]["told"] == "data"
    assert "all instruments agree" in markdown(inspection_document(whole))


def test_a_clock_that_is_late_beyond_its_prior_is_remarked():
    experiment = late("tracker", 0.1)(sound(1))
    tracker = experiment.instruments["tracker"]
    prior = tracker.calibration.model_copy(
        update={"delay": type(tracker.calibration.delay).model_validate({"sigma": 0.01})}
    )
    experiment = replace(
        experiment,
        instruments={
            **experiment.instruments,
            "tracker": tracker.model_copy(update={"calibration": prior}),
        },
    )
    found = inspect(experiment)
    assert any("clock of tracker is late by" in text for text in found.remarks) or any(
        m.amendment.kind == "clock" for m in found.mistakes
    )


class TestCommandLine:
    def test_a_sound_recording(self, run, tmp_path):
        path = write_small(tmp_path / "e")
        status, out, err = run("inspect", path)
        assert (status, err) == (0, "")
        assert "Streams" in out
        assert "no mistake" in out

    def test_json_and_files(self, run, tmp_path):
        path = write_small(tmp_path / "e")
        status, out, err = run("inspect", path, "--json", "--out", tmp_path / "out")
        assert (status, err) == (0, "")
        values = json.loads(out)
        assert values == json.loads((tmp_path / "out" / "inspection.json").read_text())
        page = (tmp_path / "out" / "inspection.html").read_text()
        assert page.count("<script src=") == 0
        assert "Plotly.newPlot" in page
        assert 'id="figure-stream-1-data"' in page
        assert all(
            f'id="section-{name}"' in page
            for name in ("found", "numbers", "agreements", "streams", "spectra")
        )
        assert (tmp_path / "out" / "inspection.md").read_text().startswith("# ")
        status, _, err = run("inspect", path, "--out", tmp_path / "out")
        assert status == 2
        assert "--force" in err

    def test_a_mistake_ends_with_status_0(self, run, tmp_path):
        path = write_small(tmp_path)
        log = tmp_path / RUN / "imu.csv"
        rows = table(log)
        for name in ("ax", "ay", "az"):
            column = rows[0].index(name)
            for row in rows[1:]:
                row[column] = repr(float(row[column]) / 9.80665)
        save(log, rows)
        status, out, _ = run("inspect", path)
        assert status == 0
        assert "units: {ax: g, ay: g, az: g}" in " ".join(out.split())

    def test_what_identify_fails_on(self, run, tmp_path):
        path = write_small(tmp_path)
        text = path.read_text()
        path.write_text(text.replace("    tracker: moving/tracker.csv\n", ""))
        expected = run("identify", path)
        status, out, err = run("inspect", path)
        assert (status, out, err) == expected
        assert status == 2

    def test_a_clock_in_milliseconds_is_pointed_at(self, run, tmp_path):
        path = write_small(tmp_path)
        log = tmp_path / RUN / "tracker.csv"
        rows = table(log)
        column = rows[0].index("t")
        for row in rows[1:]:
            row[column] = repr(float(row[column]) * 1000)
        save(log, rows)
        status, out, err = run("inspect", path)
        assert status in {0, 2}
        assert "units: {t: ms}" in out + err or "overlap" in err

    def test_an_unknown_run(self, run, tmp_path):
        status, _, err = run("inspect", write_small(tmp_path), "--run", "nowhere")
        assert status == 2
        assert "--run" in err


def test_what_is_named_can_be_set():
    twice = MISTAKES["gyro in deg/s"].make(sound(1))
    (excerpt,) = excerpts(twice, 1)
    assert mistakes(excerpt)[0]
    assert not mistakes(excerpt, settings=MistakeSettings(most=0))[0]
    assert not mistakes(excerpt, settings=MistakeSettings(least_gain=1e3))[0]
    with pytest.raises(FrozenInstanceError):
        MistakeSettings().most = 3


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
    found = {each.name for each in OF_READINGS for q in quantities if each.may_have(instrument, q)}
    found |= {each.name for each in OF_INSTRUMENTS if each.may_have(instrument, quantities)}
    assert found == names


def validated(kind):
    return TypeAdapter(AnyInstrument).validate_python({"kind": kind})
