"""Messages in JSON, against Python's own reader and arithmetic."""

import bz2
import json
from fractions import Fraction

import lz4.frame
import pytest
import zstandard

from steelyard.logs.messages.blocks import unpacked
from steelyard.logs.messages.json_message import decode_json

MESSAGE = {"a": {"x": 1.5, "on": True, "name": "text"}, "data": [1, 2.5, None], "empty": {}}


def test_numbers_by_name():
    found = decode_json(json.dumps(MESSAGE).encode())
    assert found == {"a.x": 1.5, "a.on": 1.0, "data[0]": 1.0, "data[1]": 2.5}


@pytest.mark.parametrize("keys", [("sec", "nanosec"), ("sec", "nsec"), ("nsecs", "secs")])
def test_stamps_are_the_nearest_number_of_seconds(keys):
    parts = {"s": 1_700_000_000, "n": 123_456_789}
    text = json.dumps({"stamp": {key: parts[key[0]] for key in keys}})
    exact = Fraction(parts["s"]) + Fraction(parts["n"], 10**9)
    assert decode_json(text.encode()) == {"stamp": float(exact)}


def test_what_only_looks_like_a_stamp_is_two_numbers():
    assert decode_json(b'{"a": {"sec": 1.5, "nsec": 2}}') == {"a.sec": 1.5, "a.nsec": 2.0}


def test_an_image_is_no_column():
    assert decode_json(json.dumps({"image": [0] * 2000, "x": 1}).encode()) == {"x": 1.0}


PACKERS = {
    "": bytes,
    "none": bytes,
    "bz2": bz2.compress,
    "lz4": lz4.frame.compress,
    "zstd": zstandard.ZstdCompressor().compress,
}


@pytest.mark.parametrize("method", PACKERS)
def test_blocks_unpack_to_what_was_packed(method):
    block = bytes(range(256)) * 20
    packed = PACKERS[method](block)
    assert unpacked(packed, method, len(block)) == block
    with pytest.raises(ValueError, match="a block that"):
        unpacked(packed, method, len(block) - 1)
    if method not in {"", "none"}:
        with pytest.raises(ValueError, match=r"a block that cannot be unpacked|does not unpack"):
            unpacked(packed[: len(packed) // 2], method, len(block))


def test_an_unknown_method():
    with pytest.raises(ValueError, match="compression 'snappy'"):
        unpacked(b"", "snappy", 0)
