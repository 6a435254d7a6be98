"""What is wrong with streams themselves, found in made ones where it is known, and not found where
nothing is wrong."""

import numpy as np
import pytest
from recordings import RUN, save, table, write_small
from scipy.spatial.transform import Rotation

from steelyard.errors import InputError
from steelyard.experiment.faults.clock_steps import without_clock_steps
from steelyard.experiment.faults.held import held, without_held
from steelyard.experiment.faults.of_streams import clipped, faults_of, timing, without_doubles
from steelyard.experiment.faults.stuck import (
    StuckSettings,
    repeats,
    stuck,
    stuck_alone,
    without_stuck,
)
from steelyard.experiment.faults.words import left_out_in_words
from steelyard.experiment.read import read_experiment
from steelyard.experiment.recording import Stream
from steelyard.instruments import Command, Imu, Position, Tension

RATE = 100.0
TIME = np.arange(0, 10, 1 / RATE)
SMOOTH = np.column_stack([np.sin(2 * np.pi * f * TIME + f) for f in (0.3, 0.5, 0.7)])


def noisy(rng, sigma=0.01):
    return SMOOTH + rng.normal(0, sigma, SMOOTH.shape)


def there_and_back(rest):
    """One axis that moves smoothly between rests at both ends."""
    s = np.clip((TIME - rest) / (10 - 2 * rest), 0, 1)
    return s**3 * (10 - 15 * s + 6 * s**2)


class TestTiming:
    def test_even_sampling_has_no_faults(self):
        seen = timing(TIME)
        assert seen.rate == pytest.approx(RATE)
        assert (seen.repeated, seen.late, seen.dropped, seen.gaps) == (0, 0, 0, ())
        assert seen.jitter < 1e-9

    def test_dropped_packets_are_counted_and_a_gap_is_placed(self):
        keep = np.ones(len(TIME), dtype=bool)
        keep[[100, 101, 300]] = False
        keep[500:560] = False
        seen = timing(TIME[keep])
        assert seen.dropped == 3
        assert seen.gaps == (pytest.approx((4.99, 5.6)),)

    def test_a_late_sample_is_not_a_dropped_one(self):
        time = TIME.copy()
        time[200] += 0.008
        seen = timing(time)
        assert (seen.late, seen.dropped) == (1, 0)

    def test_repeated_times_are_counted(self):
        time = np.sort(np.concatenate([TIME, TIME[[5, 50, 500]]]))
        assert timing(time).repeated == 3

    def test_jitter_is_that_of_the_clock(self, rng):
        seen = timing(TIME + rng.normal(0, 5e-4, len(TIME)))
        assert seen.jitter == pytest.approx(5e-4 * np.sqrt(2), rel=0.1)
        assert (seen.dropped, seen.late, seen.gaps) == (0, 0, ())


class TestStuck:
    @pytest.mark.parametrize("length", [10, 40, 200])
    def test_a_noisy_channel_that_stops_is_found_but_for_its_last_reading(self, rng, length):
        values = noisy(rng)[:, :1]
        values[301 : 301 + length] = values[300]
        assert np.flatnonzero(stuck(values)).tolist() == list(range(301, 301 + length))

    def test_a_channel_without_noise_that_stops_and_jumps_is_found(self):
        values = SMOOTH[:, 2:].copy()
        values[401:440] = values[400]
        assert np.flatnonzero(stuck(values)).tolist() == list(range(401, 440))

    def test_a_rotation_that_stops_is_found(self, rng):
        R = Rotation.from_rotvec(0.3 * noisy(rng)).as_matrix()
        R[601:650] = R[600]
        assert np.flatnonzero(stuck(R.reshape(len(R), 9))).tolist() == list(range(601, 650))

    @pytest.mark.parametrize("rest", [1.0, 3.0])
    def test_a_platform_at_rest_is_no_fault(self, rest):
        assert not stuck(there_and_back(rest)[:, None]).any()

    def test_an_axis_that_never_moves_is_no_fault(self):
        assert not stuck(np.zeros((1000, 1))).any()

    def test_an_axis_that_moves_only_in_a_part_is_no_fault(self):
        moves = np.where(TIME > 5, np.sin(TIME - 5) ** 3, 0.0)
        assert not stuck(moves[:, None]).any()

    @pytest.mark.parametrize("step", [1e-3, 1e-2, 0.1])
    def test_a_coarse_converter_is_no_fault(self, rng, step):
        at_rest = there_and_back(2.0) + rng.normal(0, 0.2 * step, len(TIME))
        assert not stuck(step * np.round(at_rest / step)[:, None]).any()
        assert not stuck(step * np.round(SMOOTH[:, :1] / step)).any()

    def test_noise_is_no_fault(self, rng):
        assert not any(stuck(noisy(rng)[:, i : i + 1]).any() for i in range(3))

    def test_repeats_are_five_in_a_row_at_least(self):
        values = np.arange(40.0)
        values[11:16], values[21:25] = values[10], values[20]
        assert repeats(values[:, None]) == [(11, 16)]
        values[12] = np.nan
        assert repeats(values[:, None]) == []

    def test_channels_that_stop_alone_are_found_and_an_instrument_that_stops_is_not(self, rng):
        values = noisy(rng)
        values[301:340, 1] = values[300, 1]
        expected = np.zeros(values.shape, dtype=bool)
        expected[301:340, 1] = True
        values[601:640] = values[600]
        np.testing.assert_array_equal(stuck_alone(values), expected)
        assert not stuck_alone(values, StuckSettings(chance=1e-300)).any()

    def test_a_channel_that_has_never_worked_is_found_beside_noisy_ones(self, rng):
        values = noisy(rng)
        values[:, 1] = 0.3
        np.testing.assert_array_equal(stuck_alone(values).all(axis=0), [False, True, False])
        # A winch may stand still, and without noise an axis that never moves is none.
        assert not stuck_alone(values, may_rest=True).any()
        assert not stuck_alone(np.column_stack([SMOOTH[:, :2], np.ones(len(SMOOTH))])).any()

    def test_a_channel_that_dies_early_is_found_beside_noisy_ones(self, rng):
        values = noisy(rng)
        values[301:, 1] = values[300, 1]
        assert np.flatnonzero(stuck_alone(values)[:, 1]).tolist() == list(range(301, len(values)))

    def test_a_dead_axis_takes_its_vector_with_it_and_a_dead_cell_only_itself(self, rng):
        values, other = noisy(rng), noisy(rng)
        values[:, 1] = 0.3
        streams = {
            "cables": Stream(TIME, {"tension": values}, "cables"),
            "imu": Stream(TIME, {"angular_velocity": values, "specific_force": other}, "imu"),
            "tracker": Stream(TIME, {"position": values}, "tracker"),
        }
        instruments = {
            "cables": Tension(kind="tension"),
            "imu": Imu(kind="imu"),
            "tracker": Position(kind="position"),
        }
        kept, faults = without_stuck(streams, instruments)
        assert [(f.kind, f.instrument, f.channel, f.count) for f in faults] == [
            ("dead", "cables", "tension 2", len(TIME)),
            ("dead", "imu", "angular_velocity 2", len(TIME)),
            ("dead", "tracker", "position 2", len(TIME)),
        ]
        assert np.isfinite(kept["cables"].values["tension"]).all(axis=0).tolist() == [1, 0, 1]
        assert list(kept["imu"].values) == ["specific_force"]
        assert "reads the same in all" in left_out_in_words("a", faults[0])

    def test_what_stops_is_taken_out_of_a_run_and_kept_in_mind(self, rng):
        values = noisy(rng)
        values[301:350, 1] = values[300, 1]
        tracker = Position(kind="position")
        streams, faults = without_stuck(
            {"tracker": Stream(TIME, {"position": values}, "log")}, {"tracker": tracker}
        )
        left = streams["tracker"].values["position"]
        assert np.isnan(left[301:350, 1]).all()
        assert np.isfinite(np.delete(left, 1, axis=1)).all()
        assert np.isnan(left).sum() == 49
        (fault,) = faults
        assert (fault.kind, fault.instrument, fault.channel, fault.count) == (
            "stuck",
            "tracker",
            "position 2",
            49,
        )
        assert fault.start == pytest.approx(3.01)

    def test_reading_an_experiment_leaves_it_out(self, tmp_path):
        path = write_small(tmp_path)
        log = tmp_path / RUN / "cables.csv"
        rows = table(log)
        column = rows[0].index("f3")
        for row in rows[41:61]:
            row[column] = rows[40][column]
        save(log, rows)
        (run,) = read_experiment(path).runs
        assert [(f.instrument, f.channel, f.count) for f in run.excluded] == [
            ("cables", "tension 3", 20)
        ]
        assert np.isnan(run.streams["cables"].values["tension"][40:60, 2]).all()

    def test_reading_a_sound_experiment_changes_nothing(self, tmp_path):
        (run,) = read_experiment(write_small(tmp_path)).runs
        assert run.excluded == ()
        assert all(np.isfinite(v).all() for s in run.streams.values() for v in s.values.values())


class TestDoubles:
    def test_rows_that_were_written_twice_count_once(self, tmp_path, run):
        path = write_small(tmp_path)
        (sound,) = read_experiment(path).runs
        for log in sorted((tmp_path / RUN).glob("*.csv")):
            head, *rows = table(log)
            save(log, [head, *(row for row in rows for _ in range(2))])
        (found,) = read_experiment(path).runs
        assert {f.kind for f in found.excluded} == {"doubled"}
        for name, stream in found.streams.items():
            np.testing.assert_array_equal(stream.time, sound.streams[name].time)
            for key, values in stream.values.items():
                np.testing.assert_array_equal(values, sound.streams[name].values[key])
        status, out, err = run("identify", path, "--method", "two-step", "--json")
        assert status == 0, err
        assert "samples of cables say once more what the one before them said" in out + err

    def test_a_part_that_was_joined_twice_is_found_and_a_coarse_clock_is_none(self, rng):
        values = noisy(rng)
        use = np.sort(np.concatenate([np.arange(len(TIME)), np.arange(200, 300)]))
        twice = Stream(TIME[use], {"position": values[use]}, "log")
        kept, (fault,) = without_doubles({"tracker": twice})
        np.testing.assert_array_equal(kept["tracker"].values["position"], values)
        assert (fault.kind, fault.count) == ("doubled", 100)
        coarse = Stream(np.floor(TIME * 40) / 40, {"position": values}, "log")
        some = Stream(np.floor(TIME * 80) / 80, {"position": values}, "log")
        assert without_doubles({"tracker": some}) == ({"tracker": some}, ())
        with pytest.raises(InputError, match=r"^log: expected a time of its own for every sample"):
            without_doubles({"tracker": coarse})


def clock_set(time, at, by):
    """Times of a clock that is set while it runs [s]."""
    return np.where(time > at, time + by, time)


TRACKER = {"tracker": Position(kind="position"), "imu": Imu(kind="imu")}


class TestClockSteps:
    @pytest.mark.parametrize("by", [0.1, 0.3, 1.0, 3600.0])
    def test_readings_go_on_while_the_clock_is_set(self, rng, by):
        stream = Stream(clock_set(TIME, 4.0, by), {"position": noisy(rng)}, "log")
        kept, (fault,) = without_clock_steps({"tracker": stream}, TRACKER, {})
        assert kept["tracker"].time == pytest.approx(TIME, abs=1e-6)
        assert (fault.kind, fault.instrument, fault.count) == ("set", "tracker", 599)
        assert (fault.start, fault.end) == pytest.approx((4.0, 4.01 + by))
        said = left_out_in_words("run", fault)
        assert "the clock of tracker was set from 4.000 to" in said

    def test_times_about_the_event_stay(self, rng):
        stream = Stream(clock_set(TIME, 4.0, 1.0), {"position": noisy(rng)}, "log")
        kept, _ = without_clock_steps({"tracker": stream}, TRACKER, {"tracker": 8.0})
        assert kept["tracker"].time == pytest.approx(TIME + 1.0, abs=1e-6)

    @pytest.mark.parametrize("pause", [0.3, 1.0, 3.0])
    def test_a_pause_of_the_logger_is_none(self, rng, pause):
        since = TIME - 4.0
        use = (since <= 0) | (since > pause)
        stream = Stream(TIME[use], {"position": noisy(rng)[use]}, "log")
        assert without_clock_steps({"tracker": stream}, TRACKER, {}) == ({"tracker": stream}, ())

    def test_neither_is_a_pause_at_a_turn_nor_what_a_logger_catches_up(self, rng):
        there = np.abs(TIME - 5.0)[:, None] * [1.0, -0.5, 0.3] + rng.normal(0, 1e-3, (len(TIME), 3))
        use = np.abs(TIME - 5.0) > 0.2
        turn = Stream(TIME[use], {"position": there[use]}, "log")
        assert not without_clock_steps({"tracker": turn}, TRACKER, {})[1]
        late = TIME.copy()
        late[400:430] = TIME[430] + 1e-4 * np.arange(-30, 0)
        caught_up = Stream(late, {"position": noisy(rng)}, "log")
        assert not without_clock_steps({"tracker": caught_up}, TRACKER, {})[1]

    def test_where_a_logger_pauses_often_nobody_knows(self, rng):
        use = np.ones(len(TIME), dtype=bool)
        for first in (100, 500, 700):
            use[first : first + 30] = False
        time = clock_set(TIME, 4.0, 1.0)[use]
        stream = Stream(time, {"position": noisy(rng)[use]}, "log")
        assert not without_clock_steps({"tracker": stream}, TRACKER, {})[1]

    def test_where_nothing_moves_nobody_knows(self, rng):
        values = there_and_back(3.0)[:, None] + rng.normal(0, 1e-3, (len(TIME), 3))
        stream = Stream(clock_set(TIME, 1.5, 1.0), {"position": values}, "log")
        assert not without_clock_steps({"tracker": stream}, TRACKER, {})[1]

    def test_streams_of_one_clock_are_put_right_together(self, rng):
        time = clock_set(TIME, 4.0, 1.0)
        streams = {
            "tracker": Stream(time, {"position": noisy(rng)}, "log"),
            # Noise hides what its readings do.
            "imu": Stream(time[::2], {"specific_force": noisy(rng, 1.0)[::2]}, "log"),
        }
        kept, faults = without_clock_steps(streams, TRACKER, {})
        assert {each.instrument for each in faults} == {"tracker", "imu"}
        assert kept["tracker"].time == pytest.approx(TIME, abs=0.006)
        assert kept["imu"].time == pytest.approx(kept["tracker"].time[::2], abs=1e-9)

    def test_a_recording_whose_clock_was_set_is_read_as_if_it_had_not_been(self, tmp_path, run):
        path = write_small(tmp_path)
        (sound,) = read_experiment(path).runs
        log = tmp_path / RUN / "imu.csv"
        head, *rows = table(log)
        half = float(rows[len(rows) // 2][0])
        save(log, [head, *((repr(float(t) + 5.0 * (float(t) > half)), *c) for t, *c in rows)])
        (found,) = read_experiment(path).runs
        assert {f.kind for f in found.excluded} == {"set"}
        assert found.streams["imu"].time == pytest.approx(sound.streams["imu"].time, abs=1e-3)
        status, out, err = run("identify", path, "--method", "two-step", "--json")
        assert status == 0, err
        assert "the clock of imu was set" in out + err


class TestRange:
    def test_readings_at_the_end_of_a_range_are_found(self, rng):
        values = noisy(rng)[:, 0]
        mask = clipped(np.minimum(values, 0.8))
        assert np.array_equal(mask, values >= 0.8)

    def test_noise_rest_and_coarse_converters_are_no_fault(self, rng):
        assert not clipped(noisy(rng)[:, 0]).any()
        assert not clipped(there_and_back(2.0)).any()
        assert not clipped(0.05 * np.round(SMOOTH[:, 0] / 0.05)).any()


CELLS = {"cells": Tension(kind="tension"), "imu": Imu(kind="imu")}


class TestHeld:
    """Sensors that are logged more often than they read."""

    def test_a_slow_sensor_that_is_written_often_is_seen(self, rng):
        assert held(np.repeat(noisy(rng)[:250, :1], 4, axis=0)) == pytest.approx(4.0)
        assert held(noisy(rng)[:, :1]) is None

    def test_every_reading_stays_once_at_its_first_time(self, rng):
        read = noisy(rng)
        stream = Stream(TIME, {"tension": np.repeat(read[:250], 4, axis=0)}, "log")
        kept, (fault,) = without_held({"cells": stream}, CELLS)
        np.testing.assert_array_equal(kept["cells"].values["tension"], read[:250])
        np.testing.assert_array_equal(kept["cells"].time, TIME[::4])
        assert (fault.kind, fault.channel, fault.count) == ("held", "", 750)
        assert not [f for f in faults_of("cells", kept["cells"]) if f.kind == "held"]

    def test_rates_that_do_not_divide_each_other(self, rng):
        read = noisy(rng)
        of = np.floor(TIME * 42.0).astype(int)
        stream = Stream(TIME, {"tension": read[of]}, "log")
        kept, _ = without_held({"cells": stream}, CELLS)
        np.testing.assert_array_equal(kept["cells"].values["tension"], read[np.unique(of)])

    def test_a_quantity_beside_faster_ones_is_missing_between(self, rng):
        turned = Rotation.from_rotvec(noisy(rng)).as_matrix()
        slow = np.repeat(turned[:200], 5, axis=0)
        values = {"angular_velocity": noisy(rng), "orientation": slow}
        kept, (fault,) = without_held({"imu": Stream(TIME, values, "log")}, CELLS)
        assert (fault.channel, fault.count) == ("orientation", 800)
        there = np.isfinite(kept["imu"].values["orientation"]).all(axis=(1, 2))
        assert np.array_equal(np.flatnonzero(there), np.arange(0, 1000, 5))
        assert kept["imu"].values["angular_velocity"] is values[
            "angular_velocity"
        ] or np.array_equal(kept["imu"].values["angular_velocity"], values["angular_velocity"])

    def test_a_whole_sensor_is_named_once(self, rng):
        values = {
            quantity: np.repeat(noisy(rng)[:250], 4, axis=0)
            for quantity in ("angular_velocity", "specific_force")
        }
        kept, (fault,) = without_held({"imu": Stream(TIME, values, "log")}, CELLS)
        assert (fault.channel, fault.count, len(kept["imu"])) == ("", 750, 250)

    def test_equal_readings_one_after_the_other_are_two(self, rng):
        read = noisy(rng)[:250]
        read[100] = read[99]
        stream = Stream(TIME, {"tension": np.repeat(read, 4, axis=0)}, "log")
        kept, _ = without_held({"cells": stream}, CELLS)
        np.testing.assert_array_equal(kept["cells"].values["tension"], read)

    def test_coarse_encoders_rest_and_commands_are_none(self, rng):
        coarse = 0.02 * np.round(SMOOTH[:, :1] / 0.02)
        assert held(coarse) is None
        rest = there_and_back(2.0)[:, None] + np.zeros((1, 3))
        assert held(rest) is None
        flicker = 1e-4 * np.round(rng.normal(0, 0.2, (1000, 4)))
        assert held(flicker) is None
        setpoints = Stream(TIME, {"position": np.repeat(noisy(rng)[:250], 4, axis=0)}, "log")
        command = {"setpoints": Command(kind="command")}
        kept, faults = without_held({"setpoints": setpoints}, command)
        assert kept["setpoints"] is setpoints
        assert not faults

    @pytest.mark.integration
    def test_identify_says_what_it_has_left_out(self, tmp_path, run):
        path = write_small(tmp_path)
        log = tmp_path / RUN / "cables.csv"
        header, *rows = table(log)
        for i, row in enumerate(rows):
            row[1:] = rows[i - i % 4][1:]
        save(log, [header, *rows])
        experiment = read_experiment(path)
        (own,) = experiment.runs
        assert len(own.streams["cables"]) == -(-len(rows) // 4)
        _, out, _ = run("identify", path, "--method", "two-step")
        assert "cables is logged more often than it reads" in " ".join(out.split())
        _, out, _ = run("inspect", path)
        assert "readings written again before the next one" in " ".join(out.split())


def test_all_faults_of_a_stream_have_a_place(rng):
    keep = np.ones(len(TIME), dtype=bool)
    keep[500:560] = False
    values = noisy(rng)
    values[100:110, 0] = np.nan
    values[:, 1] = np.minimum(values[:, 1], 0.8)
    faults = list(faults_of("tracker", Stream(TIME[keep], {"position": values[keep]}, "log")))
    assert {(f.kind, f.channel) for f in faults} == {
        ("gap", ""),
        ("missing", "position 1"),
        ("clipped", "position 2"),
    }
    gap = next(f for f in faults if f.kind == "gap")
    assert (gap.start, gap.end, gap.count) == (pytest.approx(4.99), pytest.approx(5.6), 60)
