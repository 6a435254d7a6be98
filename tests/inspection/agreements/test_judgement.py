"""Sound recordings raise no alarm: nothing that is left between two instruments is too much."""

import pytest
from simulated import sound, without

from steelyard.inspection.agreements.excerpt import excerpts
from steelyard.inspection.agreements.judgement import judged

pytestmark = pytest.mark.integration


@pytest.mark.parametrize("seed", range(1, 5))
def test_a_sound_recording_raises_no_alarm(seed):
    (excerpt,) = excerpts(sound(seed), 1)
    assert not judged(excerpt).bad


@pytest.mark.parametrize(
    ("instrument", "quantity"),
    [
        ("command", None),
        ("tracker", None),
        ("imu", "orientation"),
        ("imu", "angular_velocity"),
        ("imu", "specific_force"),
    ],
)
def test_fewer_instruments_raise_no_alarm_either(instrument, quantity):
    (excerpt,) = excerpts(without(sound(1), instrument, quantity), 1)
    assert not judged(excerpt).bad
