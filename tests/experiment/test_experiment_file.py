"""What an experiment file may say, and that it is read as it is meant."""

import re
from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from recordings import RUN, save, simulated, table, write_small
from scipy.spatial.transform import Rotation

from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.experiment.read import read_experiment
from steelyard.experiment.recording import Run, Stream
from steelyard.experiment.surroundings import BendingForm
from steelyard.experiment.write import write_experiment
from steelyard.identification.identify import identify
from steelyard.identification.samples.preparation import prepare
from steelyard.instruments import Attitude, Imu, Position, Tension, Wrench
from steelyard.robot.file import read_robot

EXACT = 1e-12
"""Conversions of units and of rotations round in the last digits."""

CABLES, IMU, TRACKER = (f"{RUN}/{name}.csv" for name in ("cables", "imu", "tracker"))


@pytest.fixture
def small(tmp_path):
    """Path of the small experiment."""
    return write_small(tmp_path / "small")


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    """The small experiment as it is."""
    return read_experiment(write_small(tmp_path_factory.mktemp("original")))


def change(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def streams(experiment):
    return experiment.runs[0].streams


def assert_same_stream(one, other, atol=EXACT):
    np.testing.assert_allclose(one.time, other.time, rtol=0, atol=atol)
    assert one.values.keys() == other.values.keys()
    for name, values in one.values.items():
        np.testing.assert_allclose(values, other.values[name], rtol=EXACT, atol=atol, err_msg=name)


def assert_same_recording(one, other, atol=EXACT):
    assert streams(one).keys() == streams(other).keys()
    for name, stream in streams(one).items():
        assert_same_stream(stream, streams(other)[name], atol)


# What stands in the file


def test_what_stands_in_the_file_stands_in_the_experiment(original):
    assert original.name == "small"
    assert original.robot.name == "straight"
    assert original.robot.m == 8
    assert list(original.instruments) == ["cables", "imu", "tracker"]
    assert original.instruments["imu"].position == (0.047, -0.039, 0.299)
    assert original.instruments["imu"].noise.specific_force == 0.03
    assert original.instruments["tracker"].target == (0.098, 0.197, 1.1)
    assert [run.name for run in original.runs] == [RUN]
    run = original.runs[0]
    assert not run.static
    assert run.window is None
    assert run.sync == {
        name: simulated().runs[0].sync[name] for name in ("cables", "imu", "tracker")
    }
    for name, stream in run.streams.items():
        assert_same_stream(stream, simulated().runs[0].streams[name])


def test_a_stream_may_be_a_mapping_with_its_file(small, original):
    change(small, f"imu: {IMU}", f"imu: {{file: {IMU}}}")
    assert_same_recording(read_experiment(small), original)


def test_paths_are_relative_to_the_experiment_file(small, original, tmp_path, monkeypatch):
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert_same_recording(read_experiment("../small/experiment.yaml"), original)
    assert_same_recording(read_experiment(small.resolve()), original)


def test_a_bundled_robot_goes_by_its_name(small):
    change(small, "robot: robot.yaml", "robot: cogiro")
    np.testing.assert_array_equal(
        read_experiment(small).robot.anchors, read_robot("cogiro").anchors
    )


def test_without_a_name_the_folder_gives_it(small):
    change(small, "name: small\n", "")
    small.parent.rename(small.parent.with_name("forklift"))
    assert (
        read_experiment(small.parent.with_name("forklift") / "experiment.yaml").name == "forklift"
    )


def test_a_run_need_not_have_every_instrument(small, original):
    change(
        small, "instruments:\n", "instruments:\n  winches: {kind: length}\n  camera: {kind: pose}\n"
    )
    assert_same_recording(read_experiment(small), original)


def test_yaml_is_that_of_version_1_2(small):
    change(small, "name: small", "name: yes")
    change(small, "noise: 5.0", "noise: 5.0e-1")
    change(small, "noise: 0.0005", "noise: 5e-4")
    experiment = read_experiment(small)
    assert experiment.name == "yes"
    assert experiment.instruments["cables"].noise == 0.5
    assert experiment.instruments["tracker"].noise == 5e-4


def test_aliases_and_merges_of_yaml_are_followed(small, original):
    change(small, "offset: 5.0, gain: 0.0", "offset: &five 5.0, gain: 0.0")
    change(small, "noise: 5.0", "noise: *five")
    change(small, "  tracker:\n    kind: position\n", "  tracker:\n    <<: {kind: position}\n")
    change(small, "noise: *five", "noise: 5.0")
    experiment = read_experiment(small)
    assert experiment.instruments == original.instruments


@pytest.mark.integration
@pytest.mark.parametrize(
    "name", ["[2024-05-01] run", "all*", "what?", "{a,b}", "50%", "~", "Übung ☃", "a;b", "-"]
)
@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_folder_may_have_any_name(small, original, name, ending):
    path = small.parent / RUN
    if ending == "parquet":
        for file in path.iterdir():
            pl.read_csv(file).write_parquet(file.with_suffix(".parquet"))
        change(small, f"tracker: {TRACKER}", f"tracker: {RUN}/tracker.parquet")
    # What a pattern of the same letters would find as well.
    for other in ("2", "all-of-them", "whats", "a"):
        (path / "deeper").mkdir(exist_ok=True)
        (small.parent / other).mkdir(exist_ok=True)
        (small.parent / other / "tracker.csv").write_text("t,x,y,z\n1,2,3,4\n")
    path.rename(small.parent / name)
    small.write_text(
        small.read_text()
        .replace(f": {RUN}/", f': "{name}/')
        .replace(f".{ending}\n", f'.{ending}"\n')
        .replace(".csv\n", '.csv"\n')
    )
    assert_same_recording(read_experiment(small), original)


@pytest.mark.parametrize("mark", [b"\xef\xbb\xbf", b""])
@pytest.mark.parametrize("end", [b"\r\n", b"\n"])
def test_files_of_other_editors_are_read(small, original, mark, end):
    for path in (small, small.parent / "robot.yaml", *(small.parent / RUN).iterdir()):
        path.write_bytes(mark + path.read_bytes().replace(b"\n", end))
    assert_same_recording(read_experiment(small), original)


# What is known beforehand


def test_known_values_are_exact_or_have_a_sigma(small):
    known = (
        "{mass: {value: 161.1, sigma: 0.2}, center_of_gravity: {z: -0.1, x: {value: 0, sigma:"
        " 0.01}}, inertia: {xy: 0}}"
    )
    small.write_text(small.read_text() + f"known: {known}\n")
    assert read_experiment(small).known == {
        "mass": (161.1, 0.2),
        "cx": (0.0, 0.01),
        "cz": (-0.1, 0.0),
        "Jxy": (0.0, 0.0),
    }


def test_what_bends_is_stated_or_none(small, tmp_path):
    plain = small.read_text()
    assert read_experiment(small).surroundings.bending is None
    for number, (text, stated) in enumerate(
        {
            "0": 0.0,
            "{frequency: 7}": BendingForm(frequency=7.0, share=0.1),
            "{frequency: 7, share: 0.2}": BendingForm(frequency=7.0, share=0.2),
        }.items()
    ):
        small.write_text(plain + f"bending: {text}\n")
        found = read_experiment(small)
        assert found.surroundings.bending == stated
        folder = tmp_path / str(number)
        folder.mkdir()
        write_experiment(found, folder)
        again = read_experiment(folder / "experiment.yaml")
        assert again.surroundings.bending == stated


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("3", "expected 0, or a mapping of 'frequency' and 'share', found 3"),
        ("{share: 0.2}", "expected this key, found it missing; add 'frequency'"),
        ("{frequency: -1}", "expected a number above 0, found -1"),
        ("{frequency: 7, share: 2}", "'bending.share'"),
    ],
)
def test_what_is_no_bending_is_refused(small, text, what):
    small.write_text(small.read_text() + f"bending: {text}\n")
    with pytest.raises(InputError, match=re.escape(what)):
        read_experiment(small)


def test_uncertainty_of_the_robot_has_defaults(small, original):
    assert original.uncertainty == {"anchor": 0.0, "attachment": 0.0, "gravity": 0.0}
    change(
        small,
        "uncertainty: {anchor: 0.0, attachment: 0.0, gravity: 0.0}",
        "uncertainty: {anchor: 0.01}",
    )
    assert read_experiment(small).uncertainty == {
        "anchor": 0.01,
        "attachment": 0.002,
        "gravity": 0.005,
    }
    change(small, "uncertainty: {anchor: 0.01}\n", "")
    assert read_experiment(small).uncertainty == {
        "anchor": 0.002,
        "attachment": 0.002,
        "gravity": 0.005,
    }


def calibrated(small, text):
    change(small, "offset: 5.0", f"offset: {text}")
    terms = read_experiment(small).instruments["cables"].terms(8)
    return next(term for term in terms if term.key == "offset")


def test_calibration_is_a_sigma(small):
    term = calibrated(small, "3")
    np.testing.assert_array_equal(term.deviation, np.full(8, 3.0))
    np.testing.assert_array_equal(term.mean, np.zeros(8))
    assert term.prior.per == "experiment"


def test_calibration_is_a_value_with_its_sigma_drawn_per_run(small):
    term = calibrated(small, "{value: -7, sigma: 3, per: run}")
    np.testing.assert_array_equal(term.deviation, np.full(8, 3.0))
    np.testing.assert_array_equal(term.mean, np.full(8, -7.0))
    assert term.prior.per == "run"


def test_calibration_may_differ_from_cable_to_cable(small):
    term = calibrated(small, "{value: [1, 2, 3, 4, 5, 6, 7, 8], sigma: [0, 0, 0, 0, 1, 1, 1, 1]}")
    np.testing.assert_array_equal(term.mean, np.arange(1.0, 9.0))
    np.testing.assert_array_equal(term.deviation, [0, 0, 0, 0, 1, 1, 1, 1])


def test_calibration_of_zero_is_exact(small):
    np.testing.assert_array_equal(calibrated(small, "0").deviation, np.zeros(8))


# Columns and units


def test_columns_may_have_other_names(small, original):
    file = small.parent / IMU
    rows = table(file)
    contract = rows[0]
    rows[0] = ["stamp" if c == "t" else f"imu/{c}.value [SI]" for c in rows[0]]
    save(file, rows)
    names = ", ".join(f'{c}: "imu/{c}.value [SI]"' for c in contract if c != "t")
    change(small, f"imu: {IMU}", f"imu: {{file: {IMU}, columns: {{t: stamp, {names}}}}}")
    assert_same_recording(read_experiment(small), original)


def test_columns_that_nobody_asks_for_do_no_harm(small, original):
    file = small.parent / TRACKER
    rows = table(file)
    notes = ["note"] + [("°C" if i % 2 else "17") if i < 500 else "" for i in range(len(rows) - 1)]
    save(file, [[note, *row] for note, row in zip(notes, rows, strict=True)])
    assert_same_recording(read_experiment(small), original)


@pytest.mark.parametrize("behind", [True, False])
def test_a_comma_in_a_quoted_name_separates_nothing(small, original, behind):
    file = small.parent / TRACKER
    lines = file.read_text().splitlines()
    first = [f'"wall clock, local",{lines[0]}', *(f"7,{line}" for line in lines[1:])]
    file.write_text(
        "\n".join(
            f"{line},{'more' if i == 0 else 9}" if behind else line for i, line in enumerate(first)
        )
    )
    assert_same_recording(read_experiment(small), original)


def test_signs_of_another_encoding_in_columns_that_nobody_asks_for_do_no_harm(small, original):
    file = small.parent / TRACKER
    lines = file.read_text().splitlines()
    text = "\n".join(f"{line},{'T [°C]' if i == 0 else '20 °C'}" for i, line in enumerate(lines))
    file.write_bytes(text.encode("latin-1"))
    assert_same_recording(read_experiment(small), original)


@pytest.mark.parametrize("named", ["in the log", "in the contract"])
def test_units_are_turned_to_si(small, original, named):
    file = small.parent / IMU
    rows = table(file)
    factors = {"w": np.pi / 180, "a": 9.80665}
    for row in rows[1:]:
        for j, name in enumerate(rows[0]):
            if name[0] in factors:
                row[j] = repr(float(row[j]) / factors[name[0]])
    rows[0] = [f"log_{name}" for name in rows[0]]
    save(file, rows)
    contract = [name.removeprefix("log_") for name in rows[0]]
    columns = ", ".join(f"{name}: log_{name}" for name in contract)
    prefix = "log_" if named == "in the log" else ""
    units = ", ".join(
        f"{prefix}{name}: {'deg/s' if name[0] == 'w' else 'g'}"
        for name in contract
        if name[0] in "wa"
    )
    change(
        small, f"imu: {IMU}", f"imu: {{file: {IMU}, columns: {{{columns}}}, units: {{{units}}}}}"
    )
    assert_same_recording(read_experiment(small), original, atol=1e-11)


def test_units_belong_to_the_columns_of_the_log_where_axes_are_exchanged(small, original):
    # The device calls x what is y here, and gives its own x in g.
    file = small.parent / IMU
    rows = table(file)
    x, y = rows[0].index("ax"), rows[0].index("ay")
    for row in rows[1:]:
        row[x], row[y] = repr(float(row[y]) / 9.80665), row[x]
    save(file, rows)
    change(
        small, f"imu: {IMU}", f"imu: {{file: {IMU}, columns: {{ax: ay, ay: ax}}, units: {{ax: g}}}}"
    )
    assert_same_recording(read_experiment(small), original, atol=1e-11)


def test_time_stamps_of_sixteen_digits_in_microseconds(small, original):
    start = 1_700_000_000_000_000
    file = small.parent / TRACKER
    rows = table(file)
    ticks = [start + round(float(row[0]) * 1e6) for row in rows[1:]]
    save(
        file, [rows[0]] + [[str(tick), *row[1:]] for tick, row in zip(ticks, rows[1:], strict=True)]
    )
    change(small, f"tracker: {TRACKER}", f"tracker: {{file: {TRACKER}, units: {{t: us}}}}")
    event = original.runs[0].sync["tracker"] + start * 1e-6
    change(small, f"tracker: {original.runs[0].sync['tracker']!r}", f"tracker: {event!r}")
    experiment = read_experiment(small)
    run = experiment.runs[0]
    assert len(str(ticks[0])) == 16
    # A double of 1.7e9 s has steps of .24 microseconds.
    expected = original.common_time(original.runs[0], "tracker")
    np.testing.assert_allclose(experiment.common_time(run, "tracker"), expected, atol=1.5e-6)
    assert (np.diff(run.streams["tracker"].time) > 0).all()


def test_parquet_is_read_like_csv(small, original):
    for name in ("cables", "imu", "tracker"):
        path = small.parent / f"{RUN}/{name}.csv"
        pl.read_csv(path).write_parquet(path.with_suffix(".parquet"))
        path.unlink()
        change(small, f"{RUN}/{name}.csv", f"{RUN}/{name}.parquet")
    assert_same_recording(read_experiment(small), original)


def test_parquet_may_hold_whole_numbers_and_nulls(small):
    n = len(table(small.parent / TRACKER)) - 1
    x = [None if i == 3 else float("nan") if i == 5 else i * 0.01 for i in range(n)]
    columns = {
        "t": pl.Series(range(0, 4000 * n, 4000), dtype=pl.Int64),
        "x": pl.Series(x, dtype=pl.Float32),
        "y": pl.Series(range(n), dtype=pl.UInt32),
        "z": pl.Series([None, *range(1, n)], dtype=pl.Int16),
    }
    pl.DataFrame(columns).write_parquet(small.parent / RUN / "tracker.parquet")
    change(small, TRACKER, f"{{file: {RUN}/tracker.parquet, units: {{t: us, x: mm, y: cm}}}}")
    stream = streams(read_experiment(small))["tracker"]
    np.testing.assert_allclose(stream.time, 0.004 * np.arange(n), rtol=EXACT)
    expected = np.column_stack([np.arange(n) * 1e-5, np.arange(n) * 1e-2, np.arange(n)])
    expected[[3, 5], 0] = expected[0, 2] = np.nan
    np.testing.assert_allclose(stream.values["position"], expected, rtol=1e-6)


DRESSINGS = {
    "quotes around names": lambda text: '"t","x","y","z"' + text.removeprefix("t,x,y,z"),
    "blanks around names": lambda text: " t , x,y ,z" + text.removeprefix("t,x,y,z"),
    "quotes around blanks": lambda text: '" t ","x",y," z"' + text.removeprefix("t,x,y,z"),
    "blanks around quotes": lambda text: 't, "x", "y", "z"' + text.removeprefix("t,x,y,z"),
    "blanks around numbers": lambda text: text.replace(",", " , "),
    "tabs around numbers": lambda text: text.replace(",", "\t,\t"),
    "plus signs": lambda text: text.replace(",0.", ",+0."),
    "no zero before the point": lambda text: text.replace(",0.", ",."),
    "no newline at the end": lambda text: text.rstrip("\n"),
    "a comma at the end of every line": lambda text: text.replace("\n", ",\n"),
    "empty lines at the end": lambda text: text + "\n\n",
    "a line of blanks at the end": lambda text: text + "   \n",
}


@pytest.mark.parametrize("dressing", DRESSINGS)
def test_csv_as_other_programs_write_it(small, original, dressing):
    file = small.parent / TRACKER
    file.write_bytes(DRESSINGS[dressing](file.read_text()).encode())
    assert_same_recording(read_experiment(small), original)


def test_quoted_numbers_are_numbers(small, original):
    file = small.parent / TRACKER
    rows = table(file)
    save(file, [rows[0]] + [[f'"{cell}"' for cell in row] for row in rows[1:]])
    assert_same_recording(read_experiment(small), original)


@pytest.mark.parametrize("missing", ["", "NaN", "nan", " NaN ", "null", '""', "  "])
def test_an_empty_cell_or_nan_is_no_sample_of_its_column(small, original, missing):
    file = small.parent / IMU
    rows = table(file)
    rows[7][rows[0].index("wy")] = missing
    rows[9][rows[0].index("qw")] = missing
    save(file, rows)
    stream, whole = streams(read_experiment(small))["imu"], streams(original)["imu"]
    np.testing.assert_array_equal(stream.time, whole.time)
    omega = whole.values["angular_velocity"].copy()
    omega[6, 1] = np.nan
    np.testing.assert_array_equal(stream.values["angular_velocity"], omega)
    np.testing.assert_array_equal(stream.values["specific_force"], whole.values["specific_force"])
    assert np.isnan(stream.values["orientation"][8]).all()
    others = np.arange(len(stream)) != 8
    np.testing.assert_array_equal(
        stream.values["orientation"][others], whole.values["orientation"][others]
    )


def result(path):
    return identify(read_experiment(path)).estimates["two-step"]


def assert_near(estimate, other):
    """Within two of the larger 1-sigma: the data are the same but for a few samples."""
    sigma = np.maximum(estimate.standard_deviation, other.standard_deviation)
    assert np.isfinite(estimate.value).all()
    assert (np.abs(estimate.value - other.value) < 2 * sigma).all()


@pytest.mark.slow
@pytest.mark.integration
def test_missing_repeated_and_uneven_samples_change_little(small):
    whole = result(small)
    rng = np.random.default_rng(8)
    for name in (CABLES, IMU, TRACKER):
        rows = table(small.parent / name)
        body = []
        for row in rows[1:]:
            if rng.random() < 0.05:
                continue
            if rng.random() < 0.05:
                row = [row[0], *(cell if rng.random() < 0.8 else "" for cell in row[1:])]
            body += [row] * (2 if rng.random() < 0.05 else 1)
        save(small.parent / name, [rows[0], *body])
    experiment = read_experiment(small)
    # What was written twice counts once.
    doubled = {f.instrument for f in experiment.runs[0].excluded if f.kind == "doubled"}
    assert doubled == {"cables", "imu", "tracker"}
    for stream in streams(experiment).values():
        steps = np.diff(stream.time)
        assert steps.min() > 0
        assert steps.max() > 1.5 * np.median(steps)
    assert_near(result(small), whole)


# Orientations


def orientation(form, R):
    if form == "roll pitch yaw":
        return R.as_euler("ZYX")[:, ::-1]
    if form == "quaternions":
        return R.as_quat(scalar_first=True)
    if form == "quaternions of either sign":
        return R.as_quat(scalar_first=True) * np.where(np.arange(len(R)) % 2, -1, 1)[:, None]
    return R.as_matrix().reshape(-1, 9)


FORMS = {
    "quaternions": "qw qx qy qz",
    "quaternions of either sign": "qw qx qy qz",
    "roll pitch yaw": "roll pitch yaw",
    "matrices": "r11 r12 r13 r21 r22 r23 r31 r32 r33",
}


@pytest.mark.parametrize("form", FORMS)
def test_orientations_in_every_form_are_the_same(small, original, form):
    matrices = streams(original)["imu"].values["orientation"]
    numbers = orientation(form, Rotation.from_matrix(matrices))
    header = ["t", *FORMS[form].split()]
    time = streams(original)["imu"].time
    rows = [
        [repr(float(t)), *(repr(float(v)) for v in row)]
        for t, row in zip(time, numbers, strict=True)
    ]
    save(small.parent / IMU, [header, *rows])
    stream = streams(read_experiment(small))["imu"]
    assert set(stream.values) == {"orientation"}
    np.testing.assert_allclose(stream.values["orientation"], matrices, atol=1e-12)


def test_roll_pitch_yaw_are_those_of_the_contract(small):
    save(
        small.parent / IMU,
        [
            ["t", "roll", "pitch", "yaw"],
            *[[str(0.6 + 0.1 * i), "30", "-20", "100"] for i in range(40)],
        ],
    )
    change(
        small, f"imu: {IMU}", f"imu: {{file: {IMU}, units: {{roll: deg, pitch: deg, yaw: deg}}}}"
    )
    R = streams(read_experiment(small))["imu"].values["orientation"][0]
    expected = Rotation.from_rotvec([0, 0, np.radians(100)])
    expected = (
        expected
        * Rotation.from_rotvec([0, np.radians(-20), 0])
        * Rotation.from_rotvec([np.radians(30), 0, 0])
    )
    np.testing.assert_allclose(R, expected.as_matrix(), atol=EXACT)


# Several instruments in one file


def together(small):
    """All columns side by side in one file, at the times of the IMU."""
    cables, imu = table(small.parent / CABLES), table(small.parent / IMU)
    save(small.parent / "all.csv", [[*a, *b[1:]] for a, b in zip(cables, imu, strict=True)])


def test_instruments_of_one_file_share_it(small, original):
    together(small)
    change(small, f"cables: {CABLES}", "cables: all.csv")
    change(small, f"imu: {IMU}", "imu: {file: all.csv}")
    experiment = read_experiment(small)
    for name in ("cables", "imu"):
        assert_same_stream(streams(experiment)[name], streams(original)[name])


def test_instruments_of_one_file_share_its_clock(small, original):
    together(small)
    change(small, "    kind: imu\n    clock: recorder\n", "    kind: imu\n")
    change(small, f"cables: {CABLES}", "cables: all.csv")
    change(small, f"imu: {IMU}", "imu: all.csv")
    sync = original.runs[0].sync
    change(small, f"imu: {sync['imu']!r}, ", "")
    assert read_experiment(small).runs[0].sync == sync


def test_an_attitude_claims_the_orientation_of_a_file(small, original):
    change(small, "  tracker:\n    kind", "  attitude: {kind: attitude}\n  tracker:\n    kind")
    change(small, f"    imu: {IMU}\n", f"    imu: {IMU}\n    attitude: {IMU}\n")
    change(small, "sync: {", "sync: {attitude: 0.1, ")
    both = streams(read_experiment(small))
    assert set(both["imu"].values) == {"angular_velocity", "specific_force"}
    assert set(both["attitude"].values) == {"orientation"}
    np.testing.assert_array_equal(
        both["attitude"].values["orientation"], streams(original)["imu"].values["orientation"]
    )


def test_an_attitude_with_columns_of_its_own_leaves_those_of_the_imu(small, original):
    rows = table(small.parent / IMU)
    turned = Rotation.from_rotvec([0.3, -0.2, 0.5])
    quaternion = [repr(float(v)) for v in turned.as_quat(scalar_first=True)]
    extra = [["q0", "q1", "q2", "q3"], *[quaternion] * (len(rows) - 1)]
    save(small.parent / IMU, [[*row, *more] for row, more in zip(rows, extra, strict=True)])
    change(small, "  tracker:\n    kind", "  attitude: {kind: attitude}\n  tracker:\n    kind")
    columns = "columns: {qw: q0, qx: q1, qy: q2, qz: q3}"
    change(
        small, f"    imu: {IMU}\n", f"    imu: {IMU}\n    attitude: {{file: {IMU}, {columns}}}\n"
    )
    change(small, "sync: {", "sync: {attitude: 0.1, ")
    both = streams(read_experiment(small))
    np.testing.assert_allclose(
        both["attitude"].values["orientation"][0], turned.as_matrix(), atol=EXACT
    )
    assert_same_stream(both["imu"], streams(original)["imu"])


# Clocks


def test_with_sync_common_time_counts_from_the_event(original):
    run = original.runs[0]
    for name, stream in run.streams.items():
        np.testing.assert_allclose(
            original.common_time(run, name), stream.time - run.sync[name], atol=EXACT
        )


def test_without_sync_common_time_counts_from_the_first_force_sample(small, original):
    small.write_text(small.read_text().split("    sync:")[0])
    experiment = read_experiment(small)
    run = experiment.runs[0]
    assert not run.sync
    first = streams(original)["cables"].time[0]
    assert experiment.common_time(run, "cables")[0] == 0
    for name, stream in run.streams.items():
        np.testing.assert_allclose(
            experiment.common_time(run, name), stream.time - first, atol=EXACT
        )


@pytest.mark.slow
@pytest.mark.integration
def test_clocks_that_agree_need_no_sync(small):
    whole = result(small)
    sync = read_experiment(small).runs[0].sync
    for name, file in (("cables", CABLES), ("imu", IMU), ("tracker", TRACKER)):
        rows = table(small.parent / file)
        save(
            small.parent / file,
            [rows[0]] + [[repr(float(row[0]) - sync[name]), *row[1:]] for row in rows[1:]],
        )
    small.write_text(small.read_text().split("    sync:")[0])
    np.testing.assert_allclose(result(small).value, whole.value, rtol=1e-6, atol=1e-6)


def test_a_delay_that_is_known_is_taken_off(small, original):
    change(
        small,
        "    kind: position\n",
        "    kind: position\n    calibration: {delay: {value: 0.3, sigma: 0.01}}\n",
    )
    experiment = read_experiment(small)
    late = original.common_time(original.runs[0], "tracker") - experiment.common_time(
        experiment.runs[0], "tracker"
    )
    np.testing.assert_allclose(late, 0.3, atol=EXACT)


def test_instruments_of_one_clock_need_one_sync(small, original):
    sync = original.runs[0].sync
    change(small, f", imu: {sync['imu']!r}", "")
    assert read_experiment(small).runs[0].sync == sync


def test_a_window_is_read(small):
    change(small, "    sync:", "    window: [1, 3.5]\n    sync:")
    assert read_experiment(small).runs[0].window == (1.0, 3.5)


def test_only_the_window_is_used(small, original):
    run = replace(original.runs[0], window=(1.0, 3.0))
    inside, whole = prepare(original, run), prepare(original, original.runs[0])
    assert 1.0 <= inside.time.min() < 1.2
    assert 2.8 < inside.time.max() <= 3.0
    assert whole.time.min() < 0.5
    assert whole.time.max() > 3.5


ON_RECORDER = {"clock": "recorder"}
INSTRUMENTS = {
    "cables": Tension(kind="tension", **ON_RECORDER),
    "imu": Imu(kind="imu", **ON_RECORDER),
    "gyro": Imu(kind="imu", clock="own"),
    "tracker": Position(kind="position"),
    "late": Attitude(kind="attitude", calibration={"delay": {"value": 0.2, "sigma": 0.01}}),
    "exact": Attitude(kind="attitude", calibration={"delay": 0.0}),
    "sensor": Wrench(kind="wrench"),
    "stated": Tension(kind="tension", calibration={"delay": 0.004}),
}


@pytest.mark.parametrize(
    ("recorded", "instrument", "sigma"),
    [
        (["cables", "imu", "tracker"], "cables", 0.0),
        (["cables", "imu", "tracker"], "imu", 0.0),
        (["cables", "imu", "tracker"], "tracker", 0.05),
        (["cables", "gyro"], "gyro", 0.05),
        (["cables", "late"], "late", 0.01),
        (["cables", "exact"], "exact", 0.0),
        (["sensor", "imu"], "sensor", 0.0),
        (["sensor", "imu"], "imu", 0.05),
        (["cables", "sensor"], "sensor", 0.05),
        (["stated", "tracker"], "stated", 0.004),
        (["imu", "tracker"], "imu", 0.05),
    ],
)
def test_default_delay_is_that_of_the_contract(recorded, instrument, sigma):
    stream = Stream(np.arange(3.0), {}, "")
    run = Run("run", dict.fromkeys(recorded, stream))
    experiment = Experiment("", read_robot("cogiro"), INSTRUMENTS, (run,))
    prior = experiment.delay(run, instrument)
    assert prior.sigma == sigma
    assert prior.value == (0.2 if instrument == "late" else None)


# Poses at rest


def pose_rows(n):
    rng = np.random.default_rng(4)
    return (
        rng.uniform(300, 700, (n, 8)).round(3),
        rng.uniform(-0.3, 0.3, (n, 3)).round(3),
        rng.uniform(1, 2, (n, 3)).round(3),
    )


def write_poses(small, n, time):
    f, angles, place = pose_rows(n)
    header = [*(f"f{i + 1}" for i in range(8)), "roll", "pitch", "yaw", "x", "y", "z"]
    rows = [
        [repr(float(v)) for v in [*a, *b, *c]] for a, b, c in zip(f, angles, place, strict=True)
    ]
    if time:
        header = ["t", *header]
        rows = [[str(t), *row] for t, row in zip(time, rows, strict=True)]
    save(small.parent / "poses.csv", [header, *rows])
    streams = "".join(f"    {name}: poses.csv\n" for name in ("cables", "imu", "tracker"))
    small.write_text(small.read_text() + "  - name: poses\n    static: true\n" + streams)


@pytest.mark.parametrize(
    "time", [None, [5, 1, 3, 2], ["", "", "", ""], ["9:00", "9:05", "9:10", "9:20"]]
)
def test_static_runs_need_no_time(small, time):
    write_poses(small, 4, time)
    run = read_experiment(small).runs[1]
    f, angles, place = pose_rows(4)
    assert run.static
    for stream in run.streams.values():
        np.testing.assert_array_equal(stream.time, np.arange(4.0))
    np.testing.assert_array_equal(run.streams["cables"].values["tension"], f)
    np.testing.assert_array_equal(run.streams["tracker"].values["position"], place)
    expected = Rotation.from_euler("ZYX", angles[:, ::-1]).as_matrix()
    np.testing.assert_allclose(run.streams["imu"].values["orientation"], expected, atol=EXACT)


# To a file and back


def assert_same_experiment(one, other):
    assert one.name == other.name
    assert one.robot.name == other.robot.name
    for name in ("anchors", "attachments", "gravity", "pulley_radius", "pulley_axis"):
        np.testing.assert_allclose(getattr(one.robot, name), getattr(other.robot, name), atol=EXACT)
    np.testing.assert_allclose(
        one.robot.platform.body_parameters, other.robot.platform.body_parameters
    )
    assert dict(one.instruments) == dict(other.instruments)
    assert dict(one.uncertainty) == dict(other.uncertainty)
    assert dict(one.known) == dict(other.known)
    assert len(one.runs) == len(other.runs)
    for a, b in zip(one.runs, other.runs, strict=True):
        assert (a.name, a.static, a.window) == (b.name, b.static, b.window)
        assert dict(a.sync) == dict(b.sync)
        assert a.streams.keys() == b.streams.keys()
        for name, stream in a.streams.items():
            np.testing.assert_array_equal(stream.time, b.streams[name].time)
            for quantity, values in stream.values.items():
                # Vectors keep every digit; rotations go through quaternions or angles.
                np.testing.assert_allclose(
                    values,
                    b.streams[name].values[quantity],
                    rtol=0,
                    atol=0 if values.ndim == 2 else EXACT,
                )


def written_and_read(experiment, folder):
    folder.mkdir()
    write_experiment(experiment, folder)
    return read_experiment(folder / "experiment.yaml")


def test_an_experiment_comes_back_from_its_files(tmp_path):
    experiment = simulated()
    assert_same_experiment(experiment, written_and_read(experiment, tmp_path / "copy"))


def test_missing_samples_come_back_as_missing(tmp_path, small):
    rows = table(small.parent / IMU)
    rows[7][rows[0].index("wy")] = ""
    rows[9][rows[0].index("qw")] = ""
    save(small.parent / IMU, rows)
    experiment = read_experiment(small)
    assert_same_experiment(experiment, written_and_read(experiment, tmp_path / "copy"))


def test_static_runs_come_back(tmp_path, small):
    write_poses(small, 4, None)
    experiment = read_experiment(small)
    assert_same_experiment(experiment, written_and_read(experiment, tmp_path / "copy"))


def test_windows_and_errors_of_single_cables_come_back(tmp_path, original):
    per_cable = {"value": tuple(range(8)), "sigma": 1.0, "per": "run"}
    cables = Tension(kind="tension", clock="recorder", calibration={"offset": per_cable})
    experiment = replace(
        original,
        instruments={**original.instruments, "cables": cables},
        runs=(replace(original.runs[0], window=(0.5, 3.5)),),
    )
    assert_same_experiment(experiment, written_and_read(experiment, tmp_path / "copy"))


def test_known_values_come_back(tmp_path, small):
    small.write_text(
        small.read_text() + "known: {mass: {value: 161.1, sigma: 0.2}, inertia: {xy: 0}}\n"
    )
    experiment = read_experiment(small)
    assert_same_experiment(experiment, written_and_read(experiment, tmp_path / "copy"))


def test_a_robot_that_only_has_the_name_of_a_bundled_one_comes_back(tmp_path, original):
    own = replace(original.robot, name="cogiro", anchors=original.robot.anchors + 0.1)
    experiment = replace(original, robot=own)
    assert_same_experiment(experiment, written_and_read(experiment, tmp_path / "copy"))


def test_a_written_file_is_the_same_whoever_writes_it(tmp_path, original):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        write_experiment(original, tmp_path / name)
    files = sorted(
        p.relative_to(tmp_path / "one") for p in (tmp_path / "one").rglob("*") if p.is_file()
    )
    assert len(files) == 5
    for file in files:
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes()
