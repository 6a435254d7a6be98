"""The group of verbs: each is imported when it is asked for."""

import subprocess
import sys

import click
import pytest

from steelyard.cli import app

TOP = click.Context(app)


@pytest.mark.parametrize("verb", app.list_commands(TOP))
def test_every_verb_is_a_command_of_its_name(verb):
    command = app.get_command(TOP, verb)
    assert command.name == verb
    assert command.help


def test_verbs_stand_in_the_order_of_the_alphabet():
    verbs = app.list_commands(TOP)
    assert verbs == sorted(verbs)
    assert len(verbs) == 20


def test_an_unknown_verb_is_none():
    assert app.get_command(TOP, "weigh") is None


@pytest.mark.parametrize(
    "words",
    [
        ["campaign", "experiment.yaml"],
        ["simulate", "cogiro"],
        ["study", "cogiro"],
        ["convert", "experiment.yaml"],
        ["export", "estimate.json", "--format", "urdf"],
        ["import", "robot.xml"],
        ["init", "log.csv", "--robot", "cogiro"],
    ],
)
def test_a_required_option_is_missed(words):
    with pytest.raises(click.MissingParameter) as missed:
        app.main(words, standalone_mode=False)
    assert missed.value.param.opts == ["--out"]


ONE = """
import sys
from steelyard.cli import app
assert not [name for name in sys.modules if name.startswith("steelyard.cli.verbs.files.robots")]
app.main(["robots", "--help"], standalone_mode=False)
loaded = {name for name in sys.modules if name.startswith("steelyard.cli.")}
sys.exit(0 if "steelyard.cli.verbs.files.robots" in loaded and "steelyard.cli.verbs.design" not in loaded else 1)
"""


def test_a_verb_is_imported_when_it_is_asked_for():
    ended = subprocess.run(
        [sys.executable, "-c", ONE], capture_output=True, timeout=600, check=False
    )
    assert (ended.returncode, ended.stderr) == (0, b"")


def test_each_verb_has_a_line_in_the_help_that_fits(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    text = app.get_help(click.Context(app, info_name="steelyard", terminal_width=80))
    assert "..." not in text.partition("Options:")[2]
    assert max(map(len, text.splitlines())) <= 80


def test_a_wrong_verb_names_the_nearest():
    with pytest.raises(click.UsageError, match="did you mean 'identify'"):
        app.main(["identfy"], standalone_mode=False)
