"""Messages are data: what is not as it should be is refused whole, in one sentence."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simulated import PAPER

from steelyard.errors import InputError
from steelyard.live.message import MessageError, arrivals_of

CABLES = {"instrument": "cables", "t": 1.5, **{f"f{i}": 200.0 + i for i in range(1, 9)}}
IMU = {"instrument": "imu", "t": 1.5, **dict.fromkeys(("wx", "wy", "wz"), 0.1)}
IMU |= {"ax": 0.0, "ay": 0.0, "az": 9.81}


def arrivals(message):
    return arrivals_of(json.dumps(message).encode(), PAPER, 8)


def test_one_sample_of_one_instrument():
    (found,) = arrivals(CABLES)
    assert found.instrument == "cables"
    assert found.stream.time.tolist() == [1.5]
    assert found.stream.values["tension"].tolist() == [[200.0 + i for i in range(1, 9)]]


def test_several_samples_of_several_instruments():
    batch = {
        k: v if k == "instrument" else [v, None if k == "f3" else v + 0.5]
        for k, v in CABLES.items()
    }
    cables, imu = arrivals([batch, IMU])
    assert cables.stream.time.tolist() == [1.5, 2.0]
    assert np.isnan(cables.stream.values["tension"][1, 2])
    assert imu.stream.values["specific_force"][0, 2] == 9.81
    assert "orientation" not in imu.stream.values


def test_an_orientation_in_any_of_its_forms():
    (found,) = arrivals({**IMU, "qw": 1.0, "qx": 0.0, "qy": 0.0, "qz": 0.0})
    assert found.stream.values["orientation"][0] == pytest.approx(np.eye(3))
    (found,) = arrivals({**IMU, "roll": 0.0, "pitch": 0.0, "yaw": np.pi / 2})
    assert found.stream.values["orientation"][0, 1, 0] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("message", "said"),
    [
        ({**CABLES, "instrument": "scales"}, "expected one of cables, imu"),
        ({k: v for k, v in CABLES.items() if k != "t"}, "expected 't'"),
        ({k: v for k, v in CABLES.items() if k != "f8"}, "expected columns f1"),
        ({**CABLES, "f9": 1.0}, "leave out what it does not have"),
        ({**CABLES, "f1": "210"}, "expected numbers"),
        ({**CABLES, "f1": True}, "expected numbers"),
        ({**CABLES, "f1": 1e300}, "expected a reading"),
        ({**CABLES, "f1": 10**400}, "expected a reading"),
        ({**CABLES, "t": None}, "expected times"),
        ({**CABLES, "t": 1e13}, "expected times"),
        ({**CABLES, "t": [1.0, 2.0]}, "as many numbers in every column"),
        ({**CABLES, "f1": []}, "expected 1 to"),
        ({**IMU, "qw": 0.5, "qx": 0.0, "qy": 0.0, "qz": 0.0}, "unit quaternions"),
        ([1, 2, 3], "expected an object"),
        ("cables", "expected an object"),
    ],
)
def test_what_is_no_sample_is_refused(message, said):
    with pytest.raises(InputError, match=said):
        arrivals(message)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"{",
        b"\xff\xfe\x00",
        b'{"instrument": "cables", "t": NaN}',
        b'{"instrument": "cables", "t": Infinity}',
        b"[" * 100_000,
        b"[" * 500_000 + b"]" * 500_000,
        b" " * (1 << 21),
    ],
    ids=["empty", "cut", "binary", "nan", "infinity", "deep", "deep and whole", "large"],
)
def test_what_is_no_message_is_refused(data):
    with pytest.raises(MessageError):
        arrivals_of(data, PAPER, 8)


@settings(deadline=None, derandomize=True)
@given(st.binary(max_size=200))
def test_random_bytes_end_in_a_refusal(data):
    with pytest.raises(InputError):
        arrivals_of(data, PAPER, 8)


@settings(deadline=None, derandomize=True)
@given(
    st.dictionaries(
        st.sampled_from(["instrument", "t", "f1", "f2", "wx", "x"]),
        st.one_of(
            st.none(), st.floats(), st.integers(), st.text(max_size=5), st.lists(st.floats())
        ),
    )
)
def test_random_objects_end_in_a_refusal(found):
    with pytest.raises(InputError):
        arrivals_of(json.dumps(found).encode(), PAPER, 8)
