"""Instruments, logs, exports and sinks of another package, which is not imported before they are
named."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hall_sensors import ENTRY_POINTS
from places import ROOT
from recordings import RUN, simulated, table, write_small
from written_estimates import estimate_of, file_of

import steelyard
from steelyard.errors import InputError
from steelyard.experiment.read import read_experiment
from steelyard.live.sinks.table import check_sink, open_sink
from steelyard.plugins.provided import names, provided
from steelyard.simulation.sensors import read_sensors

BODY = np.array([12.0, 0.1, -0.2, 0.3, 3.0, 2.5, 4.0, 0.1, 0.2, -0.1])


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """The package as if it were installed."""
    home = tmp_path / "site"
    about = home / "hall_sensors-1.0.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: hall-sensors\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(ENTRY_POINTS)
    monkeypatch.syspath_prepend(str(home))
    return home


def test_without_the_package_there_is_nothing():
    assert provided("instruments", "altimeter") is None
    assert "altimeter" not in names("instruments")


def test_an_instrument_of_another_package(installed, tmp_path):
    path = write_small(tmp_path / "small")
    rows = table(path.parent / RUN / "tracker.csv")
    lines = ["t h", *(f"{row[0]} {row[3]}" for row in rows[1:])]
    (path.parent / RUN / "height.hall").write_text("\n".join(lines) + "\n")
    text = path.read_text().replace("runs:\n", "  height: {kind: altimeter, noise: 0.001}\nruns:\n")
    text = text.replace(
        "    tracker: moving/tracker.csv\n",
        "    tracker: moving/tracker.csv\n    height: moving/height.hall\n",
    )
    sync = simulated().runs[0].sync["tracker"]
    path.write_text(text.replace(f"tracker: {sync!r}}}", f"tracker: {sync!r}, height: {sync!r}}}"))
    read = read_experiment(path)
    assert type(read.instruments["height"]).__name__ == "Altimeter"
    np.testing.assert_allclose(
        read.runs[0].streams["height"].values["height"][:, 0], [float(row[3]) for row in rows[1:]]
    )
    # It is written, and its measurement equation simulates it.
    steelyard.write_experiment(read, tmp_path)
    assert read_experiment(tmp_path / "experiment.yaml").instruments["height"].kind == "altimeter"
    suite = read_sensors("ideal", read.robot)
    suite = replace(
        suite,
        instruments={
            **suite.instruments,
            "height": read.instruments["height"].model_copy(update={"rate": 50.0}),
        },
    )
    virtual = steelyard.simulate(read.robot, "multisine", suite, duration=4.0)
    stream = virtual.experiment.runs[0].streams["height"].values["height"]
    assert 0.5 < stream.min() < stream.max() < 4


def test_an_export_of_another_package(installed, tmp_path, run):
    path = file_of(tmp_path, estimate_of(BODY))
    status, out, err = run("export", path, "--format", "hall", "--out", "-")
    assert (status, out, err) == (0, "12.0\n", "")
    status, _, err = run("export", path, "--format", "step", "--out", "-")
    assert status == 2
    assert "'step' is not one of" in err


def test_a_sink_of_another_package(installed):
    from hall_sensors import HallSink

    sink = open_sink("hall://east")
    sink.send("{}")
    assert HallSink.sent[-1] == ("hall://east", "{}")
    with pytest.raises(InputError, match="publish: expected"):
        check_sink("tcp://east")


def test_a_package_that_cannot_be_imported_is_one_sentence(installed):
    about = installed / "hall_sensors-1.0.dist-info" / "entry_points.txt"
    about.write_text("[steelyard.instruments]\nbarometer = no_such_module:Barometer\n")
    with pytest.raises(
        InputError,
        match=r"instruments 'barometer': expected that package 'hall-sensors' can be imported",
    ):
        provided("instruments", "barometer")


def test_two_packages_of_one_name_are_named(installed):
    other = installed / "other-1.0.dist-info"
    other.mkdir()
    (other / "METADATA").write_text("Metadata-Version: 2.1\nName: other\nVersion: 1.0\n")
    (other / "entry_points.txt").write_text("[steelyard.instruments]\naltimeter = other:A\n")
    with pytest.raises(InputError, match="found hall-sensors and other; remove one"):
        provided("instruments", "altimeter")


@pytest.mark.integration
def test_it_is_not_imported_before_it_is_named(installed, tmp_path):
    path = write_small(tmp_path / "small")
    code = (
        "import sys; from steelyard.experiment.read import read_experiment;"
        f" read_experiment({str(path)!r}); from steelyard.plugins.provided import names;"
        " print(names('instruments'), 'hall_sensors' in sys.modules)"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code],
        env={"PYTHONPATH": f"{installed}:{ROOT / 'tests'}:{ROOT / 'src'}"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (ended.stdout, ended.stderr) == ("['altimeter'] False\n", "")
