"""JSON as data: what the standard library writes comes back, everything else is one sentence."""

import json
import math
import os

import pytest

from steelyard.errors import InputError
from steelyard.files.json_file import read_json


def test_what_was_written_comes_back(tmp_path):
    data = {"a": [1.5, -2e-300, None, True], "ä": {"b": "x"}}
    path = tmp_path / "a.json"
    path.write_text(json.dumps(data))
    assert read_json(path) == data


def test_whole_numbers_are_floats_however_long(tmp_path):
    path = tmp_path / "a.json"
    path.write_text(f"[3, 1{'0' * 5000}]")
    three, huge = read_json(path)
    assert isinstance(three, float)
    assert math.isinf(huge)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"{", r"a\.json:1: expected JSON, found a mistake in it \(expecting property name"),
        (b"[1,\n2,,]", r"a\.json:2: expected JSON"),
        (b"\xff", "expected UTF-8 text, found a byte that is not at 0"),
        (b"[NaN]", "found NaN, which JSON does not have"),
        (b"[" * 90_000, "lists too deep"),
        (b'{"x":[' + b"[]," * 200_000 + b"1]}", "at most 2000000 values and 100000 lists"),
        (b'{"accepted": false, "accepted": true}', "expected every key once, found 'accepted'"),
    ],
)
def test_mistakes_are_one_sentence(tmp_path, content, message):
    path = tmp_path / "a.json"
    path.write_bytes(content)
    with pytest.raises(InputError, match=message):
        read_json(path)


def test_half_a_character_is_replaced_and_a_whole_one_stays(tmp_path):
    path = tmp_path / "a.json"
    path.write_text(r'["\ud83d\ude00", "\ud83d", "\ude00\ud83d", "\\ud83d", "\udb40\udc01"]')
    whole, first, exchanged, escaped, hidden = read_json(path)
    assert whole == "\N{GRINNING FACE}"
    assert first == hidden == "\ufffd"  # a language tag is not seen
    assert exchanged == "\ufffd\ufffd"
    assert escaped == r"\ud83d"


def test_nothing_steers_a_terminal(tmp_path):
    path = tmp_path / "a.json"
    path.write_text(
        '["\x7f\u202ea\u200fb\x9b", "\\u001bc\\\\u001b\\b\\n\\u0085\\"\\u00e4"]', encoding="utf-8"
    )
    assert read_json(path) == ["\ufffd\ufffda\ufffdb\ufffd", '\ufffdc\\u001b\ufffd\n\ufffd"ä']


def test_what_is_no_file_is_not_opened(tmp_path):
    os.mkfifo(tmp_path / "a.json")
    with pytest.raises(InputError, match="something that is no regular file"):
        read_json(tmp_path / "a.json")
