"""Whole screens as a terminal shows them, against recorded ones; STEELYARD_RECORD_SCREENS=yes
records them anew, to be looked at before they are committed.
"""

import os
import re
from pathlib import Path

import pytest
from rich.console import Console
from written_summary import summary

from steelyard.report.documents.identification import brief_of
from steelyard.report.forms import terminal

SCREENS = Path(__file__).parent / "screens"


def shown(monkeypatch, capsys, width, environment, count, *, encoding="utf-8", details=False):
    for name in ("NO_COLOR", "FORCE_COLOR", "COLORTERM", "TERM"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(Console, "encoding", property(lambda _: encoding))
    # Without a height the library takes a dumb terminal to have eighty columns.
    sized = {"width": width, "height": 25, "force_terminal": True}
    monkeypatch.setattr(terminal, "Console", lambda **given: Console(**sized, **given))
    terminal.show(brief_of(summary(count), details=details))
    return capsys.readouterr().out


COLOUR = {"TERM": "xterm-256color"}
PLAIN = {**COLOUR, "NO_COLOR": "1"}
CASES = {
    "two-methods-80": (80, {"TERM": "dumb"}, 2, {}),
    "two-methods-100": (100, {"TERM": "dumb"}, 2, {}),
    "six-methods-80": (80, {"TERM": "dumb"}, 6, {}),
    "six-methods-160": (160, {"TERM": "dumb"}, 6, {}),
    "details-80": (80, {"TERM": "dumb"}, 2, {"details": True}),
    "ascii-80": (80, {"TERM": "dumb"}, 2, {"encoding": "ascii"}),
    "colour-80": (80, COLOUR, 2, {}),
    "no-colour-80": (80, PLAIN, 2, {}),
}


@pytest.mark.parametrize("name", CASES)
def test_the_screen_is_the_recorded_one(monkeypatch, capsys, name):
    width, environment, count, further = CASES[name]
    out = shown(monkeypatch, capsys, width, environment, count, **further)
    path = SCREENS / f"{name}.txt"
    if os.environ.get("STEELYARD_RECORD_SCREENS"):
        path.write_text(out, encoding="utf-8")
    assert out == path.read_text(encoding="utf-8")


@pytest.mark.parametrize("name", CASES)
def test_no_screen_has_cut_numbers(name):
    text = (SCREENS / f"{name}.txt").read_text(encoding="utf-8")
    assert "…" not in text
    for cell in text.split():
        assert cell not in {"-0", "+0", "-0.0", "-0.00", "5e+03"}
    if name != "colour-80":
        assert "\x1b[3" not in text
        assert max(map(len, stripped(text).splitlines())) <= CASES[name][0]


def test_colours_say_nothing_that_words_do_not():
    coloured, plain = (
        (SCREENS / f"{name}-80.txt").read_text(encoding="utf-8") for name in ("colour", "no-colour")
    )
    assert "\x1b[32m" in coloured
    assert stripped(coloured) == stripped(plain)


def stripped(text):
    return re.sub(r"\x1b\[[0-9;]*m", "", text)


def test_runs_are_shown_on_request_and_it_is_said_how():
    brief, detailed = (
        (SCREENS / f"{name}-80.txt").read_text(encoding="utf-8")
        for name in ("two-methods", "details")
    )
    assert "--details shows it" in brief
    assert "run-7" not in brief
    assert "run-7" in detailed
