"""Single readings that stand alone are found, whatever bit has flipped; noise, knocks, steps, motion
and coarse readings have none."""

import struct

import numpy as np
import pytest
from places import ROOT
from recordings import RUN, save, table, write_small
from scipy.spatial.transform import Rotation

from steelyard.experiment.faults.spikes import no_rotations, spikes
from steelyard.experiment.read import read_experiment
from steelyard.experiment.streams.orientations import off_rotation

RATE = 100.0
TIME = np.arange(0, 20, 1 / RATE)
SMOOTH = 5 * np.sin(2 * np.pi * 0.4 * TIME) + 3 * np.sin(2 * np.pi * 1.1 * TIME + 1)


def flipped(value, bit):
    whole = struct.unpack("<Q", struct.pack("<d", value))[0] ^ (1 << (63 - bit))
    return struct.unpack("<d", struct.pack("<Q", whole))[0]


def found(values, time=TIME):
    return spikes(time, np.reshape(values, (len(time), -1)))


def test_a_bit_that_flips_anywhere_is_found_where_it_is_far(rng):
    noise = rng.normal(0, 0.05, len(TIME))
    for number in range(300):
        i, bit = int(rng.integers(8, len(TIME) - 8)), int(rng.integers(12))
        values = SMOOTH + noise
        values[i] = flipped(values[i], bit)
        if not abs(values[i]) < 1e30:  # readers refuse these
            continue
        far = abs(values[i] - SMOOTH[i] - noise[i])
        # Nothing else, and all that is larger than robust weights cope with.
        mask = found(values)
        assert set(np.flatnonzero(mask)) <= {i}, number
        assert mask[i] or far < 2.0, number


@pytest.mark.parametrize(
    "noise",
    [
        lambda rng, n: rng.normal(0, 1, n),
        lambda rng, n: rng.laplace(0, 1, n),
        lambda rng, n: rng.uniform(-1, 1, n),
        lambda rng, n: np.round(rng.normal(0, 0.4, n)),
        lambda rng, n: np.cumsum(rng.normal(0, 1, n)),
        lambda rng, n: rng.normal(0, 1, n) * (1 + 9 * (np.arange(n) % 500 < 100)),
    ],
    ids=["normal", "heavy tails", "even", "coarse", "walk", "louder now and then"],
)
def test_noise_has_none(rng, noise):
    alarms = sum(found(noise(rng, len(TIME))).sum() for _ in range(100))
    # Of two hundred thousand readings.
    assert alarms <= 1


def test_what_happens_is_none(rng):
    values = SMOOTH + rng.normal(0, 0.02, len(TIME))
    knock = np.where(TIME > 7, 40 * np.exp(-(TIME - 7) / 0.05) * np.cos(150 * (TIME - 7)), 0)
    push = 60 * np.exp(-(((TIME - 3) / 0.02) ** 2))
    step = 30.0 * (TIME > 11)
    stops = np.where(TIME < 13, values, values[1300])
    rests = np.where(np.abs(TIME - 10) < 6, 0.0, values)
    for each in (values + knock, values + push, values + step, stops, rests):
        assert not found(each).any()
    assert not found(np.round(values)).any()


def test_a_rotation_is_one_reading(rng):
    turned = Rotation.from_rotvec(np.column_stack([SMOOTH / 50, 0 * TIME, TIME / 10]))
    turned = turned * Rotation.from_rotvec(1e-3 * rng.standard_normal((len(TIME), 3)))
    R = turned.as_matrix()
    assert not found(R).any()
    R[500] = Rotation.from_rotvec([0, 0.2, 0]).as_matrix() @ R[500]
    np.testing.assert_array_equal(np.flatnonzero(found(R)), [500])


def off(quaternions):
    return np.abs(np.linalg.norm(quaternions, axis=1) - 1)


@pytest.mark.parametrize("digits", [4, 7, 16])
def test_a_quaternion_of_another_length_is_named_where_digits_show_it(rng, digits):
    q = Rotation.from_rotvec(np.column_stack([SMOOTH / 50, 0.1 + 0 * TIME, TIME / 10])).as_quat()
    written = np.round(q, digits)
    assert not no_rotations(off(written)).any()
    written[700, 1] = 0.0
    assert no_rotations(off(written))[700] == (abs(off(written)[700]) > 10.0 ** (2 - digits))
    written[::3] *= 1.001  # a log that is like this is like this
    assert not no_rotations(off(written)).any()


def test_matrices_and_gaps_of_a_log_are_looked_at_alike(rng):
    R = Rotation.from_rotvec(np.column_stack([SMOOTH / 50, 0 * TIME, TIME / 10])).as_matrix()
    raw = R.reshape(-1, 9).copy()
    raw[30:60] = np.nan
    raw[400, 4] *= 1.0001
    np.testing.assert_array_equal(np.flatnonzero(no_rotations(off_rotation(raw))), [400])


def test_gaps_and_empty_cells_are_none(rng):
    values = SMOOTH + rng.normal(0, 0.02, len(TIME))
    values[300:320] = np.nan
    keep = (TIME < 12) | (TIME > 12.5)
    assert not found(values[keep], TIME[keep]).any()


@pytest.mark.parametrize(
    "file", ["examples/kuka-tool/experiment.yaml", "tests/data/points-00/experiment.yaml"]
)
def test_recordings_have_none(file):
    for run in read_experiment(ROOT / file).runs:
        assert not [fault for fault in run.excluded if fault.kind == "spike"]


def test_a_flipped_bit_of_a_quaternion_is_left_out(tmp_path):
    path = write_small(tmp_path)
    log = tmp_path / RUN / "imu.csv"
    rows = table(log)
    column = rows[0].index("qy")
    moved = [abs(float(row[column])) for row in rows[1:]]
    i = int(np.argmin(np.where(np.array(moved) > 0.01, moved, np.inf)))
    rows[i + 1][column] = "0.0"
    save(log, rows)
    (read,) = read_experiment(path).runs
    named = [(f.kind, f.instrument, f.channel, f.count) for f in read.excluded]
    assert named == [("spike", "imu", "orientation", 1)]
    assert np.isnan(read.streams["imu"].values["orientation"][i]).all()
    assert not read.streams["imu"].off


@pytest.mark.integration
def test_a_flipped_bit_is_left_out_and_named(tmp_path, run):
    path = write_small(tmp_path)
    log = tmp_path / RUN / "cables.csv"
    rows = table(log)
    column = rows[0].index("f3")
    rows[41][column] = repr(flipped(float(rows[41][column]), 0))
    save(log, rows)
    (read,) = read_experiment(path).runs
    assert [(f.kind, f.instrument, f.channel, f.count) for f in read.excluded] == [
        ("spike", "cables", "tension 3", 1)
    ]
    assert np.isnan(read.streams["cables"].values["tension"][40, 2])
    out = run("identify", path, "--method", "two-step", "--json")[1]
    assert "1 readings of cables, tension 3, stand alone" in out
    assert "readings that stand alone, left out" in run("inspect", path)[1]
