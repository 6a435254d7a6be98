"""What is known at an instant, as a line of JSON and as a table."""

import json
from dataclasses import replace
from io import StringIO

import numpy as np
from rich.console import Console

from steelyard.live.record import Record
from steelyard.report.forms.live_table import live_table

RECORD = Record(12.3456, "load 2", np.arange(1.0, 11.0), np.full(10, 0.1), None)


def shown(record):
    console = Console(width=80, record=True, file=StringIO())
    console.print(live_table(record))
    return console.export_text()


def test_nothing_is_said_of_later_where_nobody_asked():
    assert "seconds_until" not in json.loads(RECORD.line)
    assert "as well as is wanted" not in shown(RECORD)


def test_how_long_it_will_take_is_in_line_and_table():
    record = replace(RECORD, until={"mass": 12.34, "cz": None, "Jxx": 0.0})
    assert json.loads(record.line)["seconds_until"] == {"mass": 12.34, "cz": None, "Jxx": 0.0}
    text = shown(record)
    assert "mass: known as well as is wanted after 12 s more of this motion" in text
    assert "cog z: not known as well as is wanted by this motion" in text
    assert "Jxx: known as well as is wanted\n" in text
    assert max(len(line) for line in text.splitlines()) <= 80
