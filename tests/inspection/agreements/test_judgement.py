"""Sound recordings raise no alarm: nothing that is left between two instruments is too much."""

from dataclasses import replace

import numpy as np
import pytest
from simulated import sound, without

from steelyard.inspection.agreements.excerpt import excerpts
from steelyard.inspection.agreements.judgement import judged
from steelyard.inspection.agreements.settings import AgreementSettings, BalanceSettings

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


@pytest.mark.parametrize(
    ("name", "quantity"), [("tracker", "position"), ("imu", "orientation"), ("cables", "tension")]
)
def test_empty_cells_are_a_gap_as_missing_rows_are(name, quantity):
    experiment = sound(1)
    (run,) = experiment.runs
    stream = run.streams[name]
    since = stream.time - stream.time[0]
    values = stream.values[quantity].copy()
    values[(since > 2.5) & (since < 3.5)] = np.nan
    stream = replace(stream, values={**stream.values, quantity: values})
    run = replace(run, streams={**run.streams, name: stream})
    (excerpt,) = excerpts(replace(experiment, runs=(run,)), 1)
    assert not judged(excerpt).bad
    start, end = excerpt.window
    assert start > 3.0 or end < 3.0


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
