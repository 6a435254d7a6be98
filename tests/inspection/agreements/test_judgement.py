"""Sound recordings raise no alarm: nothing that is left between two instruments is too much."""

import pytest
from simulated import sound, without

from steelyard.inspection.agreements.excerpt import excerpts
from steelyard.inspection.agreements.judgement import judged
from steelyard.inspection.settings import AgreementSettings, BalanceSettings

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


def test_what_may_be_left_can_be_set():
    experiment = sound(1)
    (strict,) = excerpts(experiment, 1, AgreementSettings(bad=0.01))
    assert judged(strict).bad
    tight = AgreementSettings(balance=BalanceSettings(measured=1e-4, weight=1e-6, cross=0.0))
    worst = [
        judged(*excerpts(experiment, 1, settings)).worst_of_forces
        for settings in (tight, AgreementSettings())
    ]
    assert worst[0] > 1.1 * worst[1]


def test_offsets_and_accelerometers_may_be_worse():
    loose = AgreementSettings(
        balance=BalanceSettings(accelerometer=1.0, sensor_offset=0.2, least_offset=1.0)
    )
    worst = [
        judged(*excerpts(sound(1), 1, settings)).worst_of_forces
        for settings in (loose, AgreementSettings())
    ]
    assert worst[0] < worst[1]
