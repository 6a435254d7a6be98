"""What is seen while a verb works: one bar for the whole, at once, and silence where it is asked for."""

import io
import os
import pty
import subprocess
import sys

import pytest

from steelyard.cli.printing import parts, progress, say
from steelyard.display import time_left
from steelyard.identification.chosen_methods import chosen_methods
from steelyard.identification.identify import _shares

SCRIPT = """
from steelyard.cli.printing import progress
with progress(quiet=QUIET) as tell:
    import sys
    sys.stderr.write("") if tell is None else None
    if tell:
        tell("fitting the motion", 0.6)
        tell("motion and forces", 0.2)
print("done")
"""


def on_terminal(quiet, term="xterm"):
    """What a terminal gets on stderr."""
    leader, follower = pty.openpty()
    environment = {**os.environ, "TERM": term, "COLUMNS": "80"}
    script = SCRIPT.replace("QUIET", str(quiet))
    done = subprocess.run(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=follower, env=environment,
        check=False, timeout=300,
    )  # fmt: skip
    os.close(follower)
    shown = b""
    while True:
        try:
            more = os.read(leader, 65536)
        except OSError:
            break
        if not more:
            break
        shown += more
    os.close(leader)
    assert done.stdout == b"done\n"
    return shown.decode()


def test_one_bar_that_is_there_at_once_and_never_goes_back():
    shown = on_terminal(quiet=False)
    assert shown.index("loading") < shown.index("60 %")
    assert "motion and forces" in shown
    assert "20 %" not in shown


def test_quiet_is_quiet():
    assert on_terminal(quiet=True) == ""


def test_a_terminal_that_cannot_draw_gets_lines():
    shown = on_terminal(quiet=False, term="dumb")
    assert shown.split("\r\n") == ["loading", "fitting the motion", "motion and forces", ""]


def test_where_nobody_looks_there_is_nothing(monkeypatch):
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with progress(quiet=False) as tell:
        assert tell is None
    assert sys.stderr.getvalue() == ""


@pytest.mark.parametrize(
    ("done", "elapsed", "text"),
    [
        (0.5, 10.0, "about 10 s left"), (0.01, 10.0, ""), (0.5, 0.5, ""), (1.0, 10.0, ""),
        (0.1, 60.0, "about 9 min left"),
    ],
)  # fmt: skip
def test_the_time_that_is_left(done, elapsed, text):
    assert time_left(done, elapsed) == text


def test_parts_follow_each_other():
    told = []
    first, second = parts(lambda what, fraction: told.append((what, fraction)), 1.0, 3.0)
    first("a", 0.5)
    first("a", 1.0)
    second("b", 0.5)
    second("b", 2.0)
    assert told == [("a", 0.125), ("a", 0.25), ("b", 0.625), ("b", 1.0)]
    assert parts(None, 1.0, 1.0) == [None, None]


def test_methods_share_the_whole_of_identify():
    told = []
    methods = chosen_methods(["all"], {})
    for share in _shares(lambda _, fraction: told.append(fraction), methods, holdout=True):
        share("begins", 0.0)
        share("ends", 1.0)
    assert told[0] == 0
    assert told[-1] == pytest.approx(1.0)
    assert told[1:-1:2] == pytest.approx(told[2::2])
    assert told == sorted(told)


def test_sentences_keep_to_the_width_of_a_terminal_and_commands_stay_whole():
    """What stands behind the tables: no word is cut, no line is too long."""
    script = """
from steelyard.cli.printing import say
say("word " * 50)
say("a note " * 30, "  ")
print("steelyard " + "x" * 90)
"""
    leader, follower = pty.openpty()
    environment = {**os.environ, "COLUMNS": "80"}
    subprocess.run(
        [sys.executable, "-c", script], stdout=follower, env=environment, check=True, timeout=300
    )
    os.close(follower)
    lines = os.read(leader, 65536).decode().split("\r\n")[:-1]
    os.close(leader)
    *sentences, command = lines
    assert len(sentences) == 4 + 3
    assert max(map(len, sentences)) <= 80
    assert all(line.startswith(("  a note", "  note")) for line in sentences[4:])
    assert command == "steelyard " + "x" * 90


def test_sentences_are_one_line_where_no_terminal_is(capsys):
    say("word " * 50, "  ")
    assert capsys.readouterr().out == "  " + "word " * 50 + "\n"
