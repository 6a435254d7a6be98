"""How far a call has come, in notebooks and elsewhere."""

import re
import sys
from types import SimpleNamespace

import pytest

import steelyard
from steelyard.report import progress_bar as module


@pytest.fixture
def clock(monkeypatch):
    """Seconds that pass when they are told to."""
    now = SimpleNamespace(seconds=100.0)
    monkeypatch.setattr(module, "monotonic", lambda: now.seconds)
    return now


@pytest.fixture
def marimo(monkeypatch):
    """What the output of a cell of marimo is made to show, one text after the other."""
    shown = []
    output = SimpleNamespace(replace=shown.append, clear=lambda: shown.append(""))
    fake = SimpleNamespace(running_in_notebook=lambda: True, output=output, Html=str)
    monkeypatch.setitem(sys.modules, "marimo", fake)
    return shown


def test_one_bar_with_the_time_that_is_left_which_goes_when_the_work_is_done(clock, marimo):
    with steelyard.progress_bar() as progress:
        assert "0 %" in marimo[-1]
        clock.seconds += 10
        progress("fitting the motion", 0.5)
        assert 'value="0.500"' in marimo[-1]
        assert "50 % fitting the motion · about 10 s left" in marimo[-1]
        clock.seconds += 10
        progress("fitting <again>\x1b", 0.2)
        assert 'value="0.500"' in marimo[-1], "it went back"
        assert "fitting &lt;again&gt;" in marimo[-1]
        assert "\x1b" not in marimo[-1]
    assert marimo[-1] == ""


def test_a_browser_gets_no_more_pictures_than_it_can_show(clock, marimo):
    with steelyard.progress_bar() as progress:
        for i in range(1000):
            clock.seconds += 0.001
            progress("fitting", i / 1000)
    assert len(marimo) < 15


def test_the_bar_goes_when_the_work_fails(clock, marimo):
    with pytest.raises(ValueError, match="no"), steelyard.progress_bar():
        raise ValueError("no")
    assert marimo[-1] == ""


def test_in_jupyter_one_place_is_drawn_again(clock, monkeypatch):
    pytest.importorskip("IPython")
    import IPython
    import IPython.display

    shown = []
    place = SimpleNamespace(update=lambda page: shown.append(page.data))
    monkeypatch.setattr(IPython, "get_ipython", lambda: SimpleNamespace(kernel="one"))
    monkeypatch.setattr(IPython.display, "display", lambda page, display_id: place)
    with steelyard.progress_bar() as progress:
        clock.seconds += 1
        progress("fitting the motion", 0.25)
    assert [bool(re.search("<progress", each)) for each in shown] == [True, True, False]
    assert "25 % fitting the motion" in shown[1]


def test_elsewhere_each_thing_is_said_once(capsys, monkeypatch):
    monkeypatch.delitem(sys.modules, "marimo", raising=False)
    with steelyard.progress_bar() as progress:
        for i in range(10):
            progress("fitting the motion", i / 10)
        progress("motion and forces", 1.0)
    captured = capsys.readouterr()
    assert (captured.out, captured.err) == ("", "fitting the motion\nmotion and forces\n")
