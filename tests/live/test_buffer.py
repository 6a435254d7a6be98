"""Samples in the order of their times, whatever the order they arrive in."""

import numpy as np
import pytest

from steelyard.experiment.recording import Stream
from steelyard.live.buffer import Buffer
from steelyard.live.message import Arrival


def samples(*times, name="tracker"):
    time = np.array(times, dtype=float)
    return Arrival(name, Stream(time, {"position": np.column_stack([time] * 3)}, "test"))


def filled(*arrivals, used=None):
    found = Buffer()
    for each in arrivals:
        found = found.with_arrivals([each], used or {})
    return found


def test_samples_in_any_order_are_sorted():
    found = filled(samples(0.0, 0.1), samples(0.3, 0.2), samples(0.15))
    stream = found.streams["tracker"]
    assert stream.time.tolist() == [0.0, 0.1, 0.15, 0.2, 0.3]
    assert stream.values["position"][:, 0].tolist() == stream.time.tolist()
    assert found.counts.taken == 5


def test_doubled_and_late_samples_are_counted():
    found = filled(samples(0.0, 0.1, 0.2), samples(0.1, 0.1, 0.3))
    assert found.streams["tracker"].time.tolist() == [0.0, 0.1, 0.2, 0.3]
    assert found.counts.doubled == 2
    found = found.with_arrivals([samples(0.05, 0.4)], {"tracker": 0.25})
    assert found.counts.late == 1
    assert found.streams["tracker"].time[-1] == 0.4


def test_a_time_far_ahead_is_taken_once_several_agree():
    found = filled(samples(0.0, 0.1), samples(1e6))
    assert found.streams["tracker"].time[-1] == 0.1
    found = found.with_arrivals([samples(0.2)], {})
    assert found.streams["tracker"].time[-1] == 0.2
    # One that stands alone is forgotten as soon as the clock has really moved on.
    found = found.with_arrivals([samples(100.0, 100.1, 100.2, 100.3, 100.4)], {})
    found = found.with_arrivals([samples(100.5, 100.6, 100.7, 100.8, 100.9)], {})
    assert found.streams["tracker"].time[-1] == 100.9
    assert found.counts.ahead == 1


def test_much_that_comes_at_once_is_not_ahead():
    burst = samples(*np.arange(0.1, 600.0, 0.1))
    found = filled(samples(0.0), burst)
    assert found.counts.taken == 6000
    assert found.counts.ahead == 0
    # After a connection that was lost for a while, too; what stands alone beyond it does not count.
    found = found.with_arrivals([samples(*np.arange(700.0, 900.0, 0.1), 1e6)], {})
    assert found.streams["tracker"].time[-1] == pytest.approx(899.9)
    assert (found.counts.taken, found.counts.ahead) == (8000, 1)


def test_what_has_been_used_is_let_go():
    found = filled(samples(*np.arange(0.0, 5.0, 0.1))).since({"tracker": 4.0})
    assert found.streams["tracker"].time[0] >= 4.0 - 1e-9


def test_instruments_may_lack_quantities_now_and_then():
    one = Arrival("imu", Stream(np.array([0.0]), {"omega": np.ones((1, 3))}, "test"))
    both = Stream(np.array([0.1]), {"omega": np.ones((1, 3)), "force": np.ones((1, 3))}, "test")
    found = filled(one, Arrival("imu", both)).streams["imu"]
    assert np.isnan(found.values["force"][0]).all()
    assert found.values["force"][1].tolist() == [1.0] * 3
