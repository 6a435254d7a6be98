"""What `inspect` says of whole experiments, and its command."""

import json
from dataclasses import replace

import pytest
from mistaken import late
from recordings import RUN, save, table, write_small
from simulated import PAPER, RECORDER, changed, sound

from steelyard.identification.solve.settings import FitSettings
from steelyard.inspection.inspect import inspect
from steelyard.inspection.settings import (
    IdentifiabilitySettings,
    InspectionSettings,
    StreamSettings,
)
from steelyard.report.documents.inspection_document import inspection_document
from steelyard.report.forms.markdown import markdown

pytestmark = pytest.mark.integration


@pytest.mark.slow
@pytest.mark.long
def test_a_hand_on_the_platform_is_placed():
    finer = changed(PAPER["cables"], rate=100.0, noise=0.6)
    found = inspect(RECORDER(5, touched=True, instruments={**PAPER, "cables": finer}))
    assert found.mistakes == ()
    assert min(c.start for c in found.contacts) == pytest.approx(5.0, abs=0.4)
    assert max(c.end for c in found.contacts) == pytest.approx(7.0, abs=0.4)
    assert any("force y" in channel for c in found.contacts for channel in c.channels)


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


@pytest.mark.slow
def test_levels_can_be_set(whole):
    levels = InspectionSettings(
        fitted=1,
        fit=FitSettings(iterations=1, iterations_beginning=1),
        streams=StreamSettings(fewest=10**9),
        identifiability=IdentifiabilitySettings(data=1e-9),
    )
    found = inspect(sound(1), settings=levels)
    assert any("did not converge" in remark for remark in found.remarks)
    assert not any("did not converge" in remark for remark in whole.remarks)
    noises = [
        quantity.noise_in_motion for report in found.streams for quantity in report.quantities
    ]
    assert noises == [None] * len(noises)
    assert "data" not in {each.told for each in found.excitation.body}


@pytest.mark.slow
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
        for name in ("tracker", "imu"):
            text = text.replace(f"    {name}: moving/{name}.csv\n", "")
        path.write_text(text)
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
