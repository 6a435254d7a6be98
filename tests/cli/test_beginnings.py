"""What somebody meets who begins: a folder to fill in, a robot of one's own, recordings without an
experiment file, the list of verbs, the shell's completion."""

import json
import shutil
import subprocess
import sys

import click
import pytest
from recordings import RUN, write_small

from steelyard.cli import app
from steelyard.drafts.blank import FILES
from steelyard.experiment.read import read_experiment
from steelyard.robot.file import read_robot
from steelyard.simulation.sensors import read_sensors


def filled(text):
    """The places that are empty with what belongs there; points that differ."""
    numbers = iter(range(1, 1000))
    while "[]" in text:
        i = next(numbers)
        text = text.replace("[]", f"[{i % 3}.5, {i % 5}.25, {i}.0]", 1)
    return text


@pytest.mark.parametrize("cables", [1, 4, 8])
def test_a_folder_to_fill_in_is_read_once_it_is_filled(run, tmp_path, cables):
    status, out, err = run("new", tmp_path / "my robot", "--cables", cables)
    assert (status, err) == (0, "")
    assert all(name in out for name in FILES)
    folder = tmp_path / "my robot"
    for name in FILES:
        path = folder / name
        assert max(map(len, path.read_text().splitlines())) < 200
        path.write_text(filled(path.read_text()))
    robot = read_robot(str(folder / "robot.yaml"))
    assert (robot.name, robot.m) == ("my robot", cables)
    assert read_sensors(str(folder / "sensors.yaml"), robot).instruments.keys() == {
        "cables",
        "imu",
        "tracker",
        "command",
    }
    # All that is still missing are the logs, and that is said.
    status, _, err = run("inspect", folder / "experiment.yaml")
    assert status == 2
    assert "recordings/cables.csv: expected" in err
    small = write_small(tmp_path / "small")
    shutil.copytree(small.parent / RUN, folder / "recordings")
    shutil.copy(small.parent / "robot.yaml", folder / "robot.yaml")
    assert read_experiment(folder / "experiment.yaml").runs[0].unsynchronised


def test_comments_are_as_true_as_what_stands_there(run, tmp_path):
    """Without their marks the commented keys are read too."""
    run("new", tmp_path / "r")
    path = tmp_path / "r" / "robot.yaml"
    keys = ("cable:", "tension:", "limits:", "platform:", "  mass:", "  center_", "  inertia:")
    lines = [
        line[2:] if line.startswith(tuple(f"# {key}" for key in keys)) else line
        for line in filled(path.read_text()).splitlines()
    ]
    path.write_text("\n".join(lines))
    robot = read_robot(str(path))
    assert robot.platform.mass == 160
    assert robot.limits.speed == 1
    assert robot.cable.axial_stiffness == 5e5


def test_what_is_missing_is_said_in_plain_words(run, tmp_path):
    run("new", tmp_path / "r")
    status, out, err = run("inspect", tmp_path / "r" / "experiment.yaml")
    assert (status, out) == (2, "")
    assert "'instruments.imu.position': expected at least 3 values, found 0; add what is" in err
    status, _, err = run("robots", tmp_path / "r" / "robot.yaml")
    assert status == 2
    assert "robot.yaml:9: 'cables[0].anchor': expected at least 3 values, found 0" in err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--cables", 0], "--cables: expected 1 to 64, found 0"),
        (["--cables", 65], "--cables: expected 1 to 64, found 65"),
    ],
)
def test_no_folder_is_written_of_what_is_no_robot(run, tmp_path, words, said):
    status, _, err = run("new", tmp_path / "r", *words)
    assert status == 2
    assert said in err
    assert not (tmp_path / "r").exists()
    assert run("new", tmp_path / "r")[0] == 0
    assert "expected a new or empty folder" in run("new", tmp_path / "r")[2]
    assert run("new", tmp_path / "r", "--force")[0] == 0


def test_a_robot_of_ones_own_is_checked_and_drawn(run, tmp_path):
    path = write_small(tmp_path).parent / "robot.yaml"
    status, out, err = run("robots", path, "--out", tmp_path / "robot.html")
    assert (status, err) == (0, "")
    assert "8 cables, a platform of 161.058 kg" in out
    assert "its cables hold the platform with 543 to 714 N" in " ".join(out.split())
    page = (tmp_path / "robot.html").read_text()
    assert "Robot straight" in page
    assert "scatter3d" in page
    assert json.loads(run("robots", path, "--json")[1])["name"] == "straight"
    path.write_text(path.read_text().replace("max: 5000", "max: 60"))
    assert "can hold 161.1 kg with 50 to 60 N, found none" in " ".join(
        run("robots", path)[1].split()
    )


@pytest.mark.parametrize("ending", ["yaml", "json"])
def test_a_robot_file_to_copy_from(run, tmp_path, ending):
    path = write_small(tmp_path).parent / "robot.yaml"
    for name in ("cogiro", path):
        copy = tmp_path / f"copy.{ending}"
        status, out, err = run("robots", name, "--out", copy, "--force")
        assert (status, err) == (0, "")
        assert f"{copy}: its robot file" in " ".join(out.split())
        assert run("robots", copy, "--json") == run("robots", name, "--json")


def test_a_robot_is_written_as_what_its_name_ends_in(run, tmp_path):
    status, out, err = run("robots", "cogiro", "--out", tmp_path / "robot.svg")
    assert (status, out) == (2, "")
    assert "expected FILE.html (a page with a picture) or FILE.yaml" in err
    assert "found '.svg'" in err
    assert not list(tmp_path.iterdir())


def test_a_picture_of_every_bundled_robot(run, tmp_path):
    status, out, _ = run("robots", "--out", tmp_path / "pictures")
    assert status == 0
    assert "cogiro-cuboid" in out
    assert {path.name for path in (tmp_path / "pictures").iterdir()} == {
        "cogiro.html",
        "cogiro-cuboid.html",
    }


@pytest.mark.parametrize("verb", ["identify", "inspect", "convert"])
def test_recordings_without_an_experiment_lead_to_init(run, tmp_path, verb):
    path = write_small(tmp_path)
    more = ["--out", tmp_path / "out"] if verb == "convert" else []
    status, _, err = run(verb, path.parent / RUN, *more)
    assert status == 2
    assert f"'steelyard init {path.parent / RUN} --robot ROBOT --out" in err
    status, _, err = run(verb, path.parent / RUN / "cables.csv", *more)
    assert status == 2
    assert (
        f"found a log; draft one from all logs of the recording with 'steelyard init {path}"[:60]
        in err
    )
    assert f"name {path}" in run(verb, path.parent, *more)[2]


def test_init_says_which_robots_there_are(run, tmp_path):
    path = write_small(tmp_path)
    status, _, err = run("init", path.parent / RUN, "--out", tmp_path / "first.yaml")
    assert status == 2
    assert "--robot: expected one of cogiro, cogiro-cuboid, or a robot file, found none" in err


def test_help_lists_every_verb_once_in_the_order_of_work():
    ctx = click.Context(app, info_name="steelyard")
    text = app.get_help(ctx)
    rows = [
        line.split()[0]
        for line in text.splitlines()
        if line.startswith("  ") and line[2:3].isalpha()
    ]
    verbs = app.list_commands(ctx)
    assert sorted(row for row in rows if row in verbs) == sorted(verbs)
    headings = [
        line for line in text.splitlines() if line.endswith(":") and not line.startswith(" ")
    ]
    assert headings == ["Options:", "Begin:", "Plan and look:", "Find:", "Use:", "More:"]
    assert max(map(len, text.splitlines())) <= 80


# Completion

ENTRY = "import sys; sys.argv[0] = 'steelyard'; from steelyard.cli import main; main()"


def completed(words, shell, **environment):
    import os

    ended = subprocess.run(
        [sys.executable, "-c", ENTRY],
        env={**os.environ, "_STEELYARD_COMPLETE": f"{shell}_complete", **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.stderr == ""
    return ended.stdout


@pytest.mark.integration
def test_the_shells_complete_verbs_and_options():
    found = completed("steelyard i", "bash", COMP_WORDS="steelyard i", COMP_CWORD="1")
    assert {line.split(",")[1] for line in found.split()} >= {"identify", "import", "init"}
    words = "steelyard identify --hol"
    assert "--holdout" in completed(words, "bash", COMP_WORDS=words, COMP_CWORD="2")
    assert "identify" in completed(words, "zsh", COMP_WORDS="steelyard id", COMP_CWORD="1")
    assert "identify" in completed(words, "fish", COMP_WORDS="steelyard id", COMP_CWORD="id")


@pytest.mark.integration
@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_what_the_start_up_file_takes(shell, tmp_path):
    import os

    ended = subprocess.run(
        [sys.executable, "-c", ENTRY],
        env={**os.environ, "_STEELYARD_COMPLETE": f"{shell}_source"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0
    assert f"_STEELYARD_COMPLETE={shell}_complete" in ended.stdout
    if shutil.which(shell):
        (tmp_path / "completion").write_text(ended.stdout)
        subprocess.run([shell, "-n", tmp_path / "completion"], check=True)
