"""Bad input ends with exit status 2 and one sentence that says where, what was found and what to
do."""

import os
import re
import sys

import numpy as np
import polars as pl
import pytest
from recordings import save, table, write_small
from time_limits import bounded, finished

from steelyard.cli import main

pytestmark = pytest.mark.integration

LONGEST = 30  # [s] of computing after which a wrong input counts as hanging

IDENTIFY = "identify experiment.yaml --out results"
SIMULATE = "simulate robot.yaml --duration 2 --out results"

CABLES, IMU, TRACKER = (f"moving/{name}.csv" for name in ("cables", "imu", "tracker"))


# What is done to the small experiment


def change(file, old, new):
    """Replace the first occurrence of a text."""

    def corrupt(folder):
        path = folder / file
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new, 1))

    return corrupt


def write(file, content):
    def corrupt(folder):
        (folder / file).write_bytes(content if isinstance(content, bytes) else content.encode())

    return corrupt


def cell(file, line, column, value):
    """Set one cell; line 1 is the header."""

    def corrupt(folder):
        rows = table(folder / file)
        rows[line - 1][rows[0].index(column)] = value
        save(folder / file, rows)

    return corrupt


def columns(file, names, value):
    """Set whole columns, to a constant or to a function of the old number and the sample."""

    def corrupt(folder):
        rows = table(folder / file)
        for name in names:
            j = rows[0].index(name)
            for i, row in enumerate(rows[1:]):
                row[j] = repr(value(float(row[j]), i)) if callable(value) else value
        save(folder / file, rows)

    return corrupt


def without_columns(file, names):
    def corrupt(folder):
        rows = table(folder / file)
        keep = [j for j, name in enumerate(rows[0]) if name not in names]
        save(folder / file, [[row[j] for j in keep] for row in rows])

    return corrupt


def first_rows(file, n):
    def corrupt(folder):
        save(folder / file, table(folder / file)[: n + 1])

    return corrupt


def append(file, content):
    def corrupt(folder):
        before = (folder / file).read_bytes()
        (folder / file).write_bytes(
            before + (content if isinstance(content, bytes) else content.encode())
        )

    return corrupt


def remove(file):
    return lambda folder: (folder / file).unlink()


def mkdir(name):
    return lambda folder: (folder / name).mkdir()


def fifo(name):
    return lambda folder: os.mkfifo(folder / name)


def link(name, target):
    return lambda folder: (folder / name).symlink_to(target)


def parquet(file, frame, cut=None):
    def corrupt(folder):
        frame().write_parquet(folder / file)
        if cut is not None:
            content = (folder / file).read_bytes()
            (folder / file).write_bytes(cut(content))

    return corrupt


def steps(*all_of_them):
    def corrupt(folder):
        for each in all_of_them:
            each(folder)

    return corrupt


def nothing(folder):
    pass


EXPERIMENT, ROBOT = "experiment.yaml", "robot.yaml"
REST = "t,x,y,z,roll,pitch,yaw\n" + "".join(f"{t},0,0,2,0,0,0\n" for t in range(6))
FAR = "t,x,y,z,roll,pitch,yaw\n" + "".join(f"{t},{t},0,2,0,0,0\n" for t in range(8))
SENSORS = "instruments:\n  cables: {kind: tension, rate: 25}\n"
STATIC = """\
  - name: poses
    static: true
    cables: poses-cables.csv
    imu: poses-imu.csv
    tracker: poses-tracker.csv
"""


def poses(cables, imu):
    f = ",".join(f"f{i}" for i in range(1, 9))
    return steps(
        append(EXPERIMENT, STATIC),
        write("poses-cables.csv", f"{f}\n" + "600,600,600,600,600,600,600,600\n" * cables),
        write("poses-imu.csv", "roll,pitch,yaw\n" + "0,0,0\n" * imu),
        write("poses-tracker.csv", "x,y,z\n" + "0.1,0.2,3.1\n" * imu),
    )


def still(folder):
    """Nothing moves: constants with the noise of the instruments."""
    rng = np.random.default_rng(0)
    for file, value in (
        (
            IMU,
            {
                "wx": 0,
                "wy": 0,
                "wz": 0,
                "ax": 0,
                "ay": 0,
                "az": 9.81,
                "qw": 1,
                "qx": 0,
                "qy": 0,
                "qz": 0,
            },
        ),
        (TRACKER, {"x": 0.1, "y": 0.2, "z": 3.1}),
    ):
        for name, number in value.items():
            sigma = 0.0 if name.startswith("q") else {"w": 0.0017, "a": 0.03}.get(name[0], 0.0005)
            columns(file, [name], lambda _, i, c=number, s=sigma: c + s * rng.standard_normal())(
                folder
            )


def case(name, corrupt, pattern, arguments=IDENTIFY):
    return pytest.param(corrupt, pattern, arguments, id=name)


EXPERIMENT_FILE = [
    case(
        "experiment file missing",
        remove(EXPERIMENT),
        r"experiment\.yaml: expected a file, found nothing there",
    ),
    case(
        "experiment file is a folder",
        steps(remove(EXPERIMENT), mkdir(EXPERIMENT)),
        r"experiment\.yaml: expected an experiment file, found a folder",
    ),
    case(
        "experiment file is a pipe",
        steps(remove(EXPERIMENT), fifo(EXPERIMENT)),
        r"experiment\.yaml: expected a file, found something that is no regular file",
    ),
    case(
        "experiment file empty",
        write(EXPERIMENT, ""),
        r"experiment\.yaml: expected a mapping .* found nothing",
    ),
    case(
        "experiment file is a list",
        write(EXPERIMENT, "- a\n- b\n"),
        r"experiment\.yaml: expected a mapping .*\[\"a\"",
    ),
    case(
        "missing key",
        change(EXPERIMENT, "robot: robot.yaml\n", ""),
        r"experiment\.yaml: 'robot': .*missing.*add",
    ),
    case(
        "no format",
        change(EXPERIMENT, "format: steelyard/1\n", ""),
        r"experiment\.yaml: 'format': .*missing",
    ),
    case(
        "wrong format number",
        change(EXPERIMENT, "steelyard/1", "steelyard/2"),
        r"experiment\.yaml:1: 'format': .*'steelyard/1', found 'steelyard/2'",
    ),
    case(
        "unknown key of experiment",
        change(EXPERIMENT, "name: small", "title: small"),
        r"experiment\.yaml:2: 'title': expected a known key, found 'title'",
    ),
    case(
        "unknown key of instrument",
        change(EXPERIMENT, "noise: 5.0", "nose: 5.0"),
        r"experiment\.yaml:9: 'instruments\.cables\.nose': .*did you mean 'noise'",
    ),
    case(
        "unknown key of calibration",
        change(EXPERIMENT, "gyro_bias", "gyro_heat"),
        r"experiment\.yaml:16: 'instruments\.imu\.calibration\.gyro_heat': .*found 'gyro_heat'",
    ),
    case(
        "unknown key of run",
        change(EXPERIMENT, "    sync:", "    comment: good one\n    sync:"),
        r"experiment\.yaml:26: 'runs\[0\]\.comment': expected the name of an instrument, found"
        r" 'comment'",
    ),
    case(
        "unknown key of noise",
        change(EXPERIMENT, "specific_force: 0.03", "acceleration: 0.03"),
        r"experiment\.yaml:15: 'instruments\.imu\.noise\.acceleration': .*found 'acceleration'",
    ),
    case(
        "unknown key of known",
        append(EXPERIMENT, "known: {weight: 3}\n"),
        r"experiment\.yaml:27: 'known\.weight': .*known here: mass",
    ),
    case(
        "number for text",
        change(EXPERIMENT, "name: small", "name: 12"),
        r"experiment\.yaml:2: 'name': expected text, found 12",
    ),
    case(
        "text for number",
        change(EXPERIMENT, "noise: 5.0", "noise: five"),
        r"experiment\.yaml:9: 'instruments\.cables\.noise': expected a number, found 'five'",
    ),
    case(
        "bool for number",
        change(EXPERIMENT, "noise: 5.0", "noise: true"),
        r"experiment\.yaml:9: 'instruments\.cables\.noise': expected a number, found true",
    ),
    case(
        "number for bool",
        change(EXPERIMENT, "    sync:", "    static: 1\n    sync:"),
        r"experiment\.yaml:26: 'runs\[0\]\.static': expected true or false, found 1",
    ),
    case(
        "two of three coordinates",
        change(EXPERIMENT, "[0.047, -0.039, 0.299]", "[0.047, -0.039]"),
        r"experiment\.yaml:14: 'instruments\.imu\.position.*': expected .*3.*found",
    ),
    case(
        "not a number in YAML",
        change(EXPERIMENT, "noise: 5.0", "noise: .nan"),
        r"experiment\.yaml:9: 'instruments\.cables\.noise': expected a number, found",
    ),
    case(
        "infinity in YAML",
        change(EXPERIMENT, "noise: 5.0", "noise: .inf"),
        r"experiment\.yaml:9: 'instruments\.cables\.noise': expected a number, found",
    ),
    case(
        "negative noise",
        change(EXPERIMENT, "noise: 5.0", "noise: -5.0"),
        r"experiment\.yaml:9: 'instruments\.cables\.noise': expected a number at least 0, found -5",
    ),
    case(
        "rate of zero",
        change(EXPERIMENT, "noise: 5.0", "rate: 0"),
        r"experiment\.yaml:9: 'instruments\.cables\.rate': expected a number above 0, found 0",
    ),
    case(
        "negative calibration sigma",
        change(EXPERIMENT, "offset: 5.0", "offset: {value: 0, sigma: -1}"),
        r"experiment\.yaml:10: 'instruments\.cables\.calibration\.offset.*': expected a number at"
        r" least 0, found -1",
    ),
    case(
        "calibration without sigma",
        change(EXPERIMENT, "offset: 5.0", "offset: {value: 3}"),
        r"experiment\.yaml:10: 'instruments\.cables\.calibration\.offset': expected the key"
        r" 'sigma'",
    ),
    case(
        "calibration of too few cables",
        change(EXPERIMENT, "offset: 5.0", "offset: [1, 2, 3]"),
        r"experiment\.yaml:10: 'instruments\.cables\.calibration\.offset': expected one sigma or 8"
        r" of them, found 3",
    ),
    case(
        "delay of one clock per axis",
        change(EXPERIMENT, "offset: 5.0", "offset: 5.0, delay: [0.1, 0.2]"),
        r"experiment\.yaml:10: 'instruments\.cables\.calibration\.delay.*': expected ",
    ),
    case(
        "delay of no value",
        change(EXPERIMENT, "offset: 5.0", "offset: 5.0, delay: {value: [], sigma: 1}"),
        r"experiment\.yaml:10: 'instruments\.cables\.calibration\.delay.*': expected ",
    ),
    case(
        "impossibly far away",
        change(EXPERIMENT, "position: [0.047", "position: [1.0e308"),
        r"experiment\.yaml:14: 'instruments\.imu\.position.*': expected .*found 1e\+308",
    ),
    case(
        "calibration per what",
        change(EXPERIMENT, "offset: 5.0", "offset: {sigma: 1, per: day}"),
        r"experiment\.yaml:10: 'instruments\.cables\.calibration\.offset\.per': .*'experiment' or"
        r" 'run', found 'day'",
    ),
    case(
        "unknown kind of instrument",
        change(EXPERIMENT, "kind: tension", "kind: tention"),
        r"experiment\.yaml:\d+: 'instruments\.cables.*': expected one of .*'tension'.*found"
        r" 'tention'",
    ),
    case(
        "instrument without kind",
        change(EXPERIMENT, "    kind: tension\n", ""),
        r"experiment\.yaml:6: 'instruments\.cables.*': expected the key 'kind'",
    ),
    case(
        "no instruments",
        write(EXPERIMENT, "format: steelyard/1\nrobot: cogiro\ninstruments: {}\nruns: []\n"),
        r"experiment\.yaml:3: 'instruments': expected ",
    ),
    case(
        "no runs",
        write(
            EXPERIMENT,
            "format: steelyard/1\nrobot: cogiro\ninstruments: {cables: {kind: tension}}\nruns:"
            " []\n",
        ),
        r"experiment\.yaml:4: 'runs': expected ",
    ),
    case(
        "run names an unknown instrument",
        change(EXPERIMENT, "    tracker: moving", "    laser: moving"),
        r"experiment\.yaml:25: 'runs\[0\]\.laser': .*found 'laser'; known here: cables, imu,"
        r" tracker",
    ),
    case(
        "two runs of one name",
        append(EXPERIMENT, f"  - {{name: moving, cables: {CABLES}, imu: {IMU}}}\n"),
        r"experiment\.yaml:27: 'runs\[1\]\.name': .*found 'moving' again",
    ),
    case(
        "run without name",
        change(EXPERIMENT, "  - name: moving\n    cables:", "  - cables:"),
        r"experiment\.yaml:2[12]: 'runs\[0\]\.name': .*missing",
    ),
    case(
        "run without forces",
        change(EXPERIMENT, f"    cables: {CABLES}\n", ""),
        r"experiment\.yaml:22: 'runs\[0\]': run 'moving': expected a stream of kind 'tension' or"
        r" 'wrench', found none",
    ),
    case(
        "run without motion",
        steps(
            change(EXPERIMENT, f"    imu: {IMU}\n", ""),
            change(EXPERIMENT, f"    tracker: {TRACKER}\n", ""),
        ),
        r"experiment\.yaml:22: 'runs\[0\]': run 'moving': expected a stream that measures the motion",
    ),
    case(
        "run without streams",
        append(EXPERIMENT, "  - name: nothing\n"),
        r"experiment\.yaml:27: 'runs\[1\]': expected streams of the instruments cables, imu,"
        r" tracker, found none",
    ),
    case(
        "cables and tracker without orientation",
        change(EXPERIMENT, f"    imu: {IMU}\n", ""),
        r"experiment\.yaml: run 'moving': expected an orientation.*found none",
    ),
    case(
        "window reversed",
        change(EXPERIMENT, "    sync:", "    window: [3, 1]\n    sync:"),
        r"experiment\.yaml:26: 'runs\[0\]\.window': expected start below end, found \[3\.0, 1\.0\]",
    ),
    case(
        "window outside",
        change(EXPERIMENT, "    sync:", "    window: [100, 200]\n    sync:"),
        r"experiment\.yaml:22: 'runs\[0\]': run 'moving': expected streams that overlap.*'window'",
    ),
    case(
        "window of a moment",
        change(EXPERIMENT, "    sync:", "    window: [1, 1.1]\n    sync:"),
        r"experiment\.yaml:22: 'runs\[0\]': run 'moving': expected at least 10 force samples"
        r" .*found [123]",
    ),
    case(
        "window of three",
        change(EXPERIMENT, "    sync:", "    window: [1, 2, 3]\n    sync:"),
        r"experiment\.yaml:26: 'runs\[0\]\.window.*': expected .*2",
    ),
    case(
        "sync without one instrument",
        change(EXPERIMENT, ", tracker: 0", ", tracker2: 0"),
        r"experiment\.yaml:26: 'runs\[0\]\.sync\.tracker2': expected the name of an instrument,"
        r" found 'tracker2'",
    ),
    case(
        "sync of all but one",
        lambda folder: (folder / EXPERIMENT).write_text(
            re.sub(r", tracker: 0\.\d+}", "}", (folder / EXPERIMENT).read_text())
        ),
        r"experiment\.yaml:26: 'runs\[0\]\.sync': expected a time for every instrument, found none"
        r" for 'tracker'",
    ),
    case(
        "sync other text",
        lambda folder: (folder / EXPERIMENT).write_text(
            re.sub(r"sync: .*", "sync: yes please", (folder / EXPERIMENT).read_text())
        ),
        r"experiment\.yaml:26: 'runs\[0\]\.sync': expected .*found 'yes please'",
    ),
    case(
        "streams do not overlap",
        lambda folder: (folder / EXPERIMENT).write_text(
            re.sub(r"tracker: 0\.\d+}", "tracker: 500}", (folder / EXPERIMENT).read_text())
        ),
        r"experiment\.yaml:22: 'runs\[0\]': run 'moving': expected streams that overlap in"
        r" time.*'sync'",
    ),
    case(
        "static run of unequal rows",
        poses(4, 3),
        r"experiment\.yaml:27: 'runs\[1\]': run 'poses': .*row by row.*'cables': 4, 'imu': 3",
    ),
    case(
        "topic of a table",
        change(EXPERIMENT, f"imu: {IMU}", f"imu: {{file: {IMU}, topic: /imu}}"),
        r"moving/imu\.csv: expected no 'topic' for a text file, found '/imu'; leave it out",
    ),
    case(
        "stream without file",
        change(EXPERIMENT, f"imu: {IMU}", "imu: {columns: {wx: a}}"),
        r"experiment\.yaml:24: 'runs\[0\]\.imu\.file': .*missing.*add 'file'",
    ),
    case(
        "tension on a robot without cables",
        steps(write(ROBOT, "name: none\ncables: []\n")),
        r"experiment\.yaml:7: 'instruments\.cables\.kind': expected a robot with cables.*'tension',"
        r" found none in robot 'none'",
    ),
]

YAML_FILE = [
    case(
        "not YAML",
        change(EXPERIMENT, "name: small", "name: [small"),
        r"experiment\.yaml:\d+: expected YAML",
    ),
    case(
        "tab in YAML",
        change(EXPERIMENT, "name: small", "\tname: small"),
        r"experiment\.yaml:2: expected YAML",
    ),
    case(
        "two documents",
        append(EXPERIMENT, "---\nformat: steelyard/1\n"),
        r"experiment\.yaml:\d+: expected YAML.*document",
    ),
    case(
        "duplicate key",
        change(EXPERIMENT, "name: small", "name: small\nname: large"),
        r"experiment\.yaml:3: expected YAML.*duplicate key \"name\"",
    ),
    case(
        "duplicate key inside",
        change(EXPERIMENT, "noise: 5.0", "noise: 5.0\n    noise: 6.0"),
        r"experiment\.yaml:10: expected YAML.*duplicate key \"noise\"",
    ),
    case(
        "binary garbage as YAML",
        write(EXPERIMENT, bytes(range(256)) * 20),
        r"experiment\.yaml: expected UTF-8 text, found a byte that is not at 128",
    ),
    case(
        "control characters as YAML",
        write(EXPERIMENT, b"a: \x00\x01\x02\n"),
        r"experiment\.yaml.*: expected YAML",
    ),
    case(
        "UTF-16 as YAML",
        write(EXPERIMENT, "format: steelyard/1".encode("utf-16")),
        r"experiment\.yaml: .*UTF-8",
    ),
    case(
        "alias bomb",
        write(
            EXPERIMENT,
            "a: &a [x, x, x, x, x, x, x, x, x, x]\n"
            + "".join(
                f"{this}: &{this} [{', '.join([f'*{last}'] * 10)}]\n"
                for last, this in zip("abcdefgh", "bcdefghi", strict=True)
            ),
        ),
        r"experiment\.yaml: expected at most \d+ values, found more",
    ),
    case("alias of itself", write(EXPERIMENT, "a: &a [*a]\n"), r"experiment\.yaml: .*expected "),
    case(
        "alias of itself in a known key",
        change(EXPERIMENT, "name: small", "name: &a {b: *a}"),
        r"experiment\.yaml.*: expected ",
    ),
    case(
        "deep nesting",
        write(EXPERIMENT, "a: " + "[" * 10_000 + "]" * 10_000 + "\n"),
        r"experiment\.yaml.*: expected YAML",
    ),
    case(
        "less deep nesting",
        change(EXPERIMENT, "name: small", "name: " + "[" * 60 + "]" * 60),
        r"experiment\.yaml:2: 'name': expected text, found \[\[",
    ),
    case(
        "nesting in between",
        change(EXPERIMENT, "name: small", "name: " + "[" * 240 + "]" * 240),
        r"experiment\.yaml.*: expected (?!.*JSON)",
    ),
    case(
        "10 MB",
        append(EXPERIMENT, "# " + "x" * 10_000_000 + "\n"),
        r"experiment\.yaml: expected at most 512 KiB.*found 9",
    ),
    case(
        "4 MB of values",
        append(EXPERIMENT, "known:\n" + "- 1\n" * 1_000_000),
        r"experiment\.yaml.*: expected at most .*found ",
    ),
    case(
        "tagged object",
        change(EXPERIMENT, "small", "!!python/object/apply:os.system [ls]"),
        r"experiment\.yaml:2: ",
    ),
    case(
        "number of 10000 digits",
        change(EXPERIMENT, "noise: 5.0", "noise: " + "9" * 10_000),
        r"experiment\.yaml.*: expected ",
    ),
    case(
        "hexadecimal number of 10000 digits",
        change(EXPERIMENT, "noise: 5.0", "noise: 0x" + "f" * 10_000),
        r"experiment\.yaml.*: expected ",
    ),
    case(
        "half a character",
        change(EXPERIMENT, "name: small", r'name: "\ud800"'),
        r"experiment\.yaml.*: expected (?!.*JSON)",
    ),
    case(
        "noise whose square is nothing",
        change(EXPERIMENT, "noise: 5.0", "noise: 5.0e-320"),
        r"experiment\.yaml:9: 'instruments\.cables\.noise': expected 0 or a number of a possible size",
    ),
    case(
        "commands for the terminal in a value",
        change(EXPERIMENT, "noise: 5.0", r'noise: "\e]0;title\a"'),
        r"experiment\.yaml:9: 'instruments\.cables\.noise': expected text that can be printed, found .* U\+001B",
    ),
    case(
        "commands for the terminal in a key",
        change(EXPERIMENT, "noise: 5.0", r'"\e[31mred": 5.0'),
        r"'instruments\.cables': expected text that can be printed, found the character U\+001B",
    ),
]

ROBOT_FILE = [
    case("unknown robot", change(EXPERIMENT, "robot.yaml", "cogito"), r"'cogito'.*one of .*cogiro"),
    case(
        "robot file missing",
        change(EXPERIMENT, "robot.yaml", "other.yaml"),
        r"other\.yaml: expected a file, found nothing",
    ),
    case(
        "robot is a device",
        change(EXPERIMENT, "robot.yaml", "/dev/zero"),
        r"/dev/zero: expected a file, found something that is no regular file",
    ),
    case(
        "robot links to a device",
        steps(remove(ROBOT), link(ROBOT, "/dev/zero")),
        r"robot\.yaml: expected a file, found something that is no regular file",
    ),
    case(
        "robot is a pipe",
        steps(remove(ROBOT), fifo(ROBOT)),
        r"robot\.yaml: expected a file, found something that is no regular file",
    ),
    case(
        "robot is a folder",
        change(EXPERIMENT, "robot.yaml", "moving"),
        r"moving: expected a file, found a folder",
    ),
    case(
        "path with NUL",
        change(EXPERIMENT, "robot.yaml", r'"robot\0.yaml"'),
        r"'robot': expected text that can be printed, found the character U\+0000",
    ),
    case(
        "very long path",
        change(EXPERIMENT, "robot.yaml", "r" * 5000 + ".yaml"),
        r"r…r+\.yaml: expected a file, found .*too long",
    ),
    case(
        "missing key of robot",
        change(ROBOT, "name: straight\n", ""),
        r"robot\.yaml: 'name': .*missing; add 'name'",
    ),
    case(
        "unknown key of robot",
        change(ROBOT, "gravity: 9.81", "gravitation: 9.81"),
        r"robot\.yaml:2: 'gravitation': .*did you mean 'gravity'",
    ),
    case(
        "unknown key of cable",
        change(ROBOT, "attachment", "attached"),
        r"robot\.yaml:[45]: 'cables\[0\]\.attach(ed|ment)': expected ",
    ),
    case(
        "wrong type in robot",
        change(ROBOT, "-7.1967", "left"),
        r"robot\.yaml:4: 'cables\[0\]\.anchor\[0\]': expected a number, found 'left'",
    ),
    case(
        "negative gravity",
        change(ROBOT, "gravity: 9.81", "gravity: -9.81"),
        r"robot\.yaml:2: 'gravity'.*found -9\.81",
    ),
    case(
        "no gravity",
        change(ROBOT, "gravity: 9.81", "gravity: [0, 0, 0]"),
        r"robot\.yaml:2: 'gravity': .*length 0",
    ),
    case(
        "anchors that coincide",
        change(ROBOT, "[-7.4786, -5.1544, 5.4009]", "[-7.1967, -5.4398, 5.3928]"),
        r"robot\.yaml:9: 'cables\[1\]\.anchor': expected anchors that differ, found cable 2 at the"
        r" anchor of cable 1",
    ),
    case(
        "roller without axis",
        change(ROBOT, "axis: [0.0, 0.0, 1.0]", "axis: [0.0, 0.0, 0.0]"),
        r"robot\.yaml:8: 'cables\[0\]\.pulley\.axis': expected a direction",
    ),
    case(
        "tensions reversed",
        change(ROBOT, "{min: 50.0, max: 5000.0}", "{min: 5000.0, max: 50.0}"),
        r"robot\.yaml:\d+: 'tension': expected min below max, found 5000 and 50 N",
    ),
    case(
        "limits reversed",
        change(ROBOT, "[4.0, 3.0, 3.5]", "[-5.0, 3.0, 3.5]"),
        r"robot\.yaml:\d+: 'limits\.position': expected the lowest corner first",
    ),
    case(
        "impossibly large robot",
        change(ROBOT, "-7.1967", "1.0e308"),
        r"robot\.yaml:4: 'cables\[0\]\.anchor.*': expected .*found 1e\+308",
    ),
    case(
        "mass of zero",
        change(ROBOT, "161.058", "0"),
        r"robot\.yaml:\d+: 'platform\.mass': expected a number above 0, found 0",
    ),
    case(
        "65 cables",
        write(
            ROBOT,
            "name: many\ncables:\n"
            + "".join(f"- {{anchor: [{i}, 0, 0], attachment: [0, 0, 0]}}\n" for i in range(65)),
        ),
        r"robot\.yaml:2: 'cables': expected .*64",
    ),
]

STREAMS = [
    case("stream missing", remove(IMU), r"moving/imu\.csv: expected a log, found nothing there"),
    case(
        "stream is a folder",
        steps(remove(IMU), mkdir(IMU)),
        r"moving/imu\.csv: expected a log, found a folder",
    ),
    case(
        "stream is a pipe",
        steps(remove(IMU), fifo(IMU)),
        r"moving/imu\.csv: expected a log, found something",
    ),
    case(
        "stream is a device",
        steps(remove(IMU), link(IMU, "/dev/zero")),
        r"moving/imu\.csv: expected a log, found something",
    ),
    case(
        "unknown format",
        steps(change(EXPERIMENT, IMU, "moving/imu.xyz"), write("moving/imu.xyz", "t,wx\n0,0\n")),
        r"moving/imu\.xyz: expected a log in one of the formats \.csv.*found '\.xyz'",
    ),
    case("empty stream", write(IMU, ""), r"moving/imu\.csv: expected .*found .*no columns"),
    case(
        "header only",
        first_rows(IMU, 0),
        r"moving/imu\.csv: expected rows of numbers, found none below the header",
    ),
    case(
        "header without newline",
        write(TRACKER, "t,x,y,z"),
        r"moving/tracker\.csv: expected rows of numbers, found none",
    ),
    case(
        "missing column",
        without_columns(TRACKER, ["y"]),
        r"moving/tracker\.csv: expected columns x, y, z.*found no y among t, x, z",
    ),
    case(
        "no column for time",
        without_columns(TRACKER, ["t"]),
        r"moving/tracker\.csv: expected a column 't' with the time",
    ),
    case(
        "incomplete orientation",
        without_columns(IMU, ["qz"]),
        r"moving/imu\.csv: expected columns qw, qx, qy, qz.*found no qz",
    ),
    case(
        "nothing of an imu",
        write(IMU, "t,a,b\n0,1,2\n"),
        r"moving/imu\.csv: expected at least one group of columns of kind 'imu' .*found t, a, b",
    ),
    case(
        "fewer cables in the log than in the robot",
        without_columns(CABLES, ["f7", "f8"]),
        r"moving/cables\.csv: expected columns f1, .* for the 8 cables of the robot, found no"
        r" f7, f8",
    ),
    case(
        "text for a number",
        cell(IMU, 17, "ay", "high"),
        r"moving/imu\.csv:17: column 'ay': expected a number, found 'high'",
    ),
    case(
        "text for a time",
        cell(CABLES, 3, "t", "12:30:01"),
        r"moving/cables\.csv:3: column 't': expected a number, found '12:30:01'",
    ),
    case(
        "decimal comma",
        cell(TRACKER, 4, "z", '"3,1"'),
        r"moving/tracker\.csv:4: column 'z': expected a number, found '3,1'",
    ),
    case(
        "text after a blank line",
        steps(cell(IMU, 17, "ay", "high"), change(IMU, "\n", "\n\n")),
        r"moving/imu\.csv:18: column 'ay': expected a number, found 'high'",
    ),
    case(
        "text in the last row of a long log",
        cell(TRACKER, 950, "x", "0x1F"),
        r"moving/tracker\.csv:950: column 'x': expected a number, found '0x1F'",
    ),
    case(
        "column without a number",
        columns(IMU, ["wy"], "NaN"),
        r"moving/imu\.csv: column 'wy': expected numbers, found not a single one",
    ),
    case(
        "column of empty cells",
        columns(CABLES, ["f3"], ""),
        r"moving/cables\.csv: column 'f3': expected numbers, found not a single one",
    ),
    case(
        "infinity",
        cell(CABLES, 12, "f5", "inf"),
        r"moving/cables\.csv:12: column 'f5': expected a finite number, found infinity",
    ),
    case(
        "minus infinity",
        cell(IMU, 12, "wx", "-Infinity"),
        r"moving/imu\.csv:12: column 'wx': expected a finite number",
    ),
    case(
        "number beyond all numbers",
        cell(IMU, 12, "wx", "1e400"),
        r"moving/imu\.csv:12: column 'wx': expected a finite",
    ),
    case(
        "impossibly large numbers",
        columns(CABLES, ["f1"], "1e300"),
        r"moving/cables\.csv.*: .*(expected|found)",
    ),
    case(
        "time running backwards",
        cell(IMU, 30, "t", "0.1"),
        r"moving/imu\.csv:30: column 't': expected time that never decreases, found 0\.1 s after",
    ),
    case(
        "NaN in time",
        cell(IMU, 30, "t", "nan"),
        r"moving/imu\.csv:30: column 't': expected a time, found none",
    ),
    case(
        "empty time",
        cell(IMU, 2, "t", ""),
        r"moving/imu\.csv:2: column 't': expected a time, found none",
    ),
    case("time stands still", columns(IMU, ["t"], "1.5"), r"expected "),
    case(
        "too few samples",
        first_rows(CABLES, 5),
        r"run 'moving': expected at least 10 force samples .*found \d",
    ),
    case("one sample", first_rows(IMU, 1), r"run 'moving': expected streams that overlap"),
    case(
        "two complete samples of many",
        columns(IMU, ["ax"], lambda x, i: x if i in (10, 80) else float("nan")),
        r"run 'moving': expected ",
    ),
    case(
        "no complete sample of the forces",
        steps(
            columns(CABLES, ["f1"], lambda x, i: x if i % 2 else float("nan")),
            columns(CABLES, ["f2"], lambda x, i: float("nan") if i % 2 else x),
        ),
        r"moving/cables\.csv: expected at least 2 complete samples of tension, found 0",
    ),
    case(
        "too little motion",
        still,
        r"run 'moving': expected a motion, found a platform \(nearly\) at rest",
    ),
    case(
        "unknown unit",
        change(EXPERIMENT, f"imu: {IMU}", f"imu: {{file: {IMU}, units: {{ax: furlong}}}}"),
        r"moving/imu\.csv: unit of column 'ax': expected one of m/s\^2.*found 'furlong'",
    ),
    case(
        "unit of another kind",
        change(EXPERIMENT, f"imu: {IMU}", f"imu: {{file: {IMU}, units: {{ax: N}}}}"),
        r"moving/imu\.csv: unit of column 'ax': expected one of m/s\^2.*found 'N'",
    ),
    case(
        "unit of a column that is not read",
        change(EXPERIMENT, f"imu: {IMU}", f"imu: {{file: {IMU}, units: {{mag_x: g}}}}"),
        r"moving/imu\.csv: 'units': expected a column that is read, found 'mag_x'",
    ),
    case(
        "column name that the kind does not have",
        change(EXPERIMENT, f"imu: {IMU}", f"imu: {{file: {IMU}, columns: {{accx: ax}}}}"),
        r"moving/imu\.csv: 'columns': expected names of the kind 'imu', found 'accx'",
    ),
    case(
        "column that is not there",
        change(EXPERIMENT, f"imu: {IMU}", f"imu: {{file: {IMU}, columns: {{ax: acc_x}}}}"),
        r"moving/imu\.csv: expected columns acc_x, ay, az.*found no acc_x",
    ),
    case(
        "quaternions of length 2",
        columns(IMU, ["qw", "qx", "qy", "qz"], lambda x, i: 2 * x),
        r"moving/imu\.csv:2: columns qw to qz: expected unit quaternions, found one that is off"
        r" by 1",
    ),
    case(
        "quaternion of zeros",
        steps(*[cell(IMU, 5, q, "0") for q in ("qw", "qx", "qy", "qz")]),
        r"moving/imu\.csv:5: columns qw to qz: expected unit quaternions",
    ),
    case(
        "matrices that do not rotate",
        steps(
            change(EXPERIMENT, "kind: imu", "kind: attitude"),
            lambda folder: (folder / EXPERIMENT).write_text(
                re.sub(
                    r"    (position|noise: {ang|calibration: {gyro).*\n",
                    "",
                    (folder / EXPERIMENT).read_text(),
                )
            ),
            write(
                IMU,
                "t,r11,r12,r13,r21,r22,r23,r31,r32,r33\n0.6,1,0,0,0,1,0,0,0,1\n0.7,1,0,0,0,1,0,0,0,-1\n",
            ),
        ),
        r"moving/imu\.csv:3: columns r11 to r33: expected rotation matrices",
    ),
    case(
        "binary garbage as CSV",
        write(IMU, bytes((i * 7919 + i // 256) % 256 for i in range(5000))),
        r"moving/imu\.csv: expected ",
    ),
    case(
        "binary garbage below a header",
        steps(first_rows(TRACKER, 0), append(TRACKER, bytes(range(256)) * 20)),
        r"moving/tracker\.csv.*: .*expected ",
    ),
    case(
        "row longer than the header",
        append(TRACKER, "9,1,2,3,4,5\n"),
        r"moving/tracker\.csv:\d+: expected (?!.*Schema)",
    ),
    case(
        "quotation mark that opens and does not close",
        cell(TRACKER, 50, "y", '"0.2'),
        r"moving/tracker\.csv.*: expected ",
    ),
    case(
        "quotation marks that swallow rows",
        lambda folder: save(
            folder / TRACKER,
            [
                [*row, "note" if i == 0 else '5" pipe']
                for i, row in enumerate(table(folder / TRACKER))
            ],
        ),
        r"moving/tracker\.csv.*: expected ",
    ),
    case(
        "header of a megabyte",
        lambda folder: (folder / TRACKER).write_text(
            "q" * 1_000_000 + "".join(f" {i}" for i in range(9999)) + "\n1\n"
        ),
        r"moving/tracker\.csv: expected columns x, y, z",
    ),
    case(
        "semicolons",
        change(TRACKER, "t,x,y,z", "t;x;y;z"),
        r"moving/tracker\.csv:1: expected .*found .*t;x;y;z",
    ),
    case(
        "column twice",
        change(TRACKER, "t,x,y,z", "t,x,y,y"),
        r"moving/tracker\.csv: expected .*(twice|again|z)",
    ),
    case(
        "needed column twice",
        lambda folder: save(folder / TRACKER, [[*row, row[1]] for row in table(folder / TRACKER)]),
        r"moving/tracker\.csv.*: expected .*'x'.*twice",
    ),
    case(
        "CSV as Parquet",
        steps(
            change(EXPERIMENT, TRACKER, "moving/t.parquet"),
            write("moving/t.parquet", "t,x,y,z\n1,2,3,4\n"),
        ),
        r"moving/t\.parquet: expected a Parquet file, found something else",
    ),
    case(
        "Parquet of text",
        steps(
            change(EXPERIMENT, TRACKER, "moving/t.parquet"),
            parquet(
                "moving/t.parquet",
                lambda: pl.DataFrame({"t": [1.0], "x": ["a"], "y": [1.0], "z": [1.0]}),
            ),
        ),
        r"moving/t\.parquet: column 'x': expected numbers, found String",
    ),
    case(
        "Parquet cut in half",
        steps(
            change(EXPERIMENT, TRACKER, "moving/t.parquet"),
            parquet(
                "moving/t.parquet",
                lambda: pl.DataFrame({c: [i * 0.37 % 1 for i in range(999)] for c in "txyz"}),
                lambda content: content[: len(content) // 2],
            ),
        ),
        r"moving/t\.parquet: expected a Parquet file, found something else",
    ),
    case(
        "Parquet with broken pages",
        steps(
            change(EXPERIMENT, TRACKER, "moving/t.parquet"),
            parquet(
                "moving/t.parquet",
                lambda: pl.DataFrame({c: [i * 0.37 % 1 for i in range(999)] for c in "txyz"}),
                lambda content: content[:4] + b"\xff" * 200 + content[204:],
            ),
        ),
        r"moving/t\.parquet: expected a Parquet file, found something else",
    ),
    case(
        "Parquet without rows",
        steps(
            change(EXPERIMENT, TRACKER, "moving/t.parquet"),
            parquet(
                "moving/t.parquet",
                lambda: pl.DataFrame({c: pl.Series([], dtype=pl.Float64) for c in "txyz"}),
            ),
        ),
        r"moving/t\.parquet: expected rows of numbers, found none",
    ),
]

SIMULATIONS = [
    case(
        "robot to simulate missing",
        nothing,
        r"none\.yaml: expected a file, found nothing",
        "simulate none.yaml --out results",
    ),
    case(
        "unknown robot to simulate",
        nothing,
        r"'cogito': expected ",
        "simulate cogito --out results",
    ),
    case(
        "unknown trajectory",
        nothing,
        r"--trajectory: expected .paper., .multisine. or .*found .circle.",
        SIMULATE.replace("--duration 2", "--trajectory circle"),
    ),
    case(
        "trajectory file missing",
        nothing,
        r"a\.csv: expected a log, found nothing",
        "simulate cogiro --trajectory a.csv --out results",
    ),
    case(
        "trajectory beyond the limits",
        write("far.csv", FAR),
        r"trajectory 'far': expected a motion within the limits .*position\[0\] 0 to 7 of -4"
        r" to 4 m",
        "simulate cogiro --trajectory far.csv --out results",
    ),
    case(
        "trajectory of a few rows",
        write("few.csv", "\n".join(REST.splitlines()[:3])),
        r"few\.csv: expected at least 4 rows with different times, found 2",
        "simulate cogiro --trajectory few.csv --out results",
    ),
    case(
        "trajectory with a hole",
        write("hole.csv", REST.replace("3,0,0", "3,,0")),
        r"hole\.csv:5: expected a pose in every row, found an empty cell",
        "simulate cogiro --trajectory hole.csv --out results",
    ),
    case(
        "trajectory of a moment",
        steps(
            write(
                "blink.csv",
                "t,x,y,z,roll,pitch,yaw\n" + "".join(f"{t * 1e-3},0,0,2,0,0,0\n" for t in range(6)),
            ),
            change(ROBOT, "limits:", "limits: {}\n#limits:"),
            lambda folder: (folder / ROBOT).write_text(
                re.sub(
                    r"limits: {}\n(.*\n)*?platform",
                    "limits: {}\nplatform",
                    (folder / ROBOT).read_text(),
                )
            ),
        ),
        r"blink.*: expected ",
        "simulate robot.yaml --trajectory blink.csv --out results",
    ),
    case(
        "trajectory of a century",
        write(
            "age.csv",
            "t,x,y,z,roll,pitch,yaw\n" + "".join(f"{t}e9,0,0,2,0,0,0\n" for t in range(6)),
        ),
        r"age.*: expected ",
        "simulate cogiro --trajectory age.csv --out results",
    ),
    case(
        "duration with a trajectory from a file",
        write("rest.csv", REST),
        r"--duration: expected none with a trajectory from a file",
        "simulate cogiro --trajectory rest.csv --duration 3 --out results",
    ),
    case(
        "duration absurd",
        nothing,
        r"--duration: expected .* s, found 1e\+09",
        "simulate cogiro --duration 1e9 --out results",
    ),
    case(
        "duration negative",
        nothing,
        r"--duration: expected .* s, found -1",
        "simulate cogiro --duration -1 --out results",
    ),
    case(
        "duration of nothing",
        nothing,
        r"--duration: expected .* s, found 0",
        "simulate cogiro --duration 0 --out results",
    ),
    case(
        "duration not a number",
        nothing,
        r"--duration: expected .* s, found nan",
        "simulate cogiro --duration nan --out results",
    ),
    case(
        "a move faster than the limits",
        nothing,
        r"trajectory 't\d-\w+': expected a motion within the limits .*; choose a longer --duration",
        "simulate cogiro --trajectory paper --duration 0.5 --out results",
    ),
    case(
        "loads missing",
        nothing,
        r"none\.yaml: expected a file, found nothing",
        f"{SIMULATE} --loads none.yaml",
    ),
    case(
        "load of no body",
        write("loads.yaml", "loads: {empty: {}, part: {}}\n"),
        r"loads\.yaml: load 'part': expected the whole body to simulate, found no mass; add .nominal.",
        f"{SIMULATE} --loads loads.yaml",
    ),
    case(
        "order of loads that are not there",
        write("loads.yaml", "loads: {empty: {}}\norder: [empty, full]\n"),
        r"loads\.yaml:2: 'order\[1\]': expected the name of a load, found 'full'; known here: empty",
        f"{SIMULATE} --loads loads.yaml",
    ),
    case(
        "unknown sensors",
        nothing,
        r"--sensors: expected .*found 'cheap'",
        f"{SIMULATE} --sensors cheap",
    ),
    case(
        "sensors file missing",
        nothing,
        r"s\.yaml: expected a file, found nothing",
        f"{SIMULATE} --sensors s.yaml",
    ),
    case(
        "sensors without rate",
        write("s.yaml", SENSORS.replace(", rate: 25", "")),
        r"s\.yaml:2: 'instruments\.cables': expected the key 'rate'",
        f"{SIMULATE} --sensors s.yaml",
    ),
    case(
        "sensors without forces",
        write("s.yaml", "instruments:\n  tracker: {kind: position, rate: 25}\n"),
        r"s\.yaml:1: 'instruments': expected an instrument of kind 'tension' or 'wrench', found"
        r" none",
        f"{SIMULATE} --sensors s.yaml",
    ),
    case(
        "sensors with an unknown key",
        write("s.yaml", SENSORS + "  imu: {kind: imu, rate: 25, bias: 1}\n"),
        r"s\.yaml:3: 'instruments\.imu\.bias': expected a known key",
        f"{SIMULATE} --sensors s.yaml",
    ),
    case(
        "sensors with calibration of too few cables",
        write(
            "s.yaml",
            "instruments:\n  cables: {kind: tension, rate: 25, calibration: {offset: [1, 2]}}\n",
        ),
        r"s\.yaml:2: 'instruments\.cables\.calibration\.offset': expected one sigma or 8 of them,"
        r" found 2",
        f"{SIMULATE} --sensors s.yaml",
    ),
    case(
        "sensors with a negative clock error",
        write("s.yaml", SENSORS + "  imu: {kind: imu, rate: 25, sync: -1}\n"),
        r"s\.yaml:3: 'instruments\.imu\.sync': expected a number at least 0, found -1",
        f"{SIMULATE} --sensors s.yaml",
    ),
    case(
        "sensors with a key of our own making",
        write("s.yaml", SENSORS + "own_sync: {cables: 1}\n"),
        r"s\.yaml:3: 'own_sync': expected a known key, found 'own_sync'",
        f"{SIMULATE} --sensors s.yaml",
    ),
    case(
        "sensors that leave the folder",
        write("s.yaml", SENSORS + "  ../../../escaped: {kind: position, rate: 25}\n"),
        r"s\.yaml:3: 'instruments\.\.\./\.\./\.\./escaped': expected ",
        f"{SIMULATE} --sensors s.yaml",
    ),
    case(
        "sensors with the name of a key of runs",
        write("s.yaml", SENSORS + "  window: {kind: position, rate: 25}\n"),
        r"s\.yaml:3: 'instruments\.window': expected ",
        f"{SIMULATE} --sensors s.yaml",
    ),
    case(
        "sensors too slow for a single sample",
        write("s.yaml", SENSORS + "  tracker: {kind: position, rate: 0.0001}\n"),
        r"(s\.yaml|tracker).*: expected ",
        f"{SIMULATE} --sensors s.yaml",
    ),
    case(
        "tension sensors on a robot without cables",
        steps(
            write("s.yaml", SENSORS),
            write(
                ROBOT,
                "name: none\ncables: []\nplatform: {mass: 1, center_of_gravity: [0, 0, 0], inertia:"
                " {xx: 1, yy: 1, zz: 1}}\n",
            ),
        ),
        r"s\.yaml:2: 'instruments\.cables\.kind': expected a robot with cables.*, found none in"
        r" robot 'none'",
        f"{SIMULATE} --sensors s.yaml",
    ),
    case(
        "platform missing",
        lambda folder: (folder / ROBOT).write_text(
            (folder / ROBOT).read_text().split("platform:")[0]
        ),
        r"robot 'straight': expected a nominal platform to simulate, found none; add 'platform'",
        SIMULATE,
    ),
    case(
        "stiffness missing",
        change(ROBOT, "axial_stiffness: 500000.0, ", ""),
        r"robot 'straight': expected 'cable\.axial_stiffness' for a simulation, found none",
        SIMULATE,
    ),
    case(
        "platform that cannot exist",
        change(ROBOT, "xx: 94.955", "xx: 294.955"),
        r"robot 'straight': expected a platform that can exist, found one whose inertia no"
        r" body has",
        SIMULATE,
    ),
    case(
        "five cables",
        lambda folder: (folder / ROBOT).write_text(
            re.sub(r"(- anchor(.*\n){5}){3}", "", (folder / ROBOT).read_text(), count=1)
        ),
        r"robot 'straight': expected ",
        SIMULATE,
    ),
    case(
        "cables all parallel",
        write(
            ROBOT,
            "name: parallel\ncables:\n"
            + "".join(
                f"- {{anchor: [{i}, {i % 3}, 5], attachment: [{i}, {i % 3}, 0]}}\n"
                for i in range(8)
            )
            + "cable: {axial_stiffness: 5.0e5}\n"
            + "platform: {mass: 10, center_of_gravity: [0, 0, 0], inertia: {xx: 1, yy: 1, zz:"
            " 1}}\n",
        ),
        r"robot 'parallel': expected ",
        SIMULATE,
    ),
    case(
        "rollers larger than the robot",
        lambda folder: (folder / ROBOT).write_text(
            (folder / ROBOT).read_text().replace("radius: 0.05", "radius: 50")
        ),
        r"robot.*: expected ",
        SIMULATE,
    ),
]

COMMAND_LINE = [
    case("unknown verb", nothing, r"[Nn]o such command 'weigh'", "weigh experiment.yaml"),
    case("no verb", nothing, r"see '.*--help'", ""),
    case("unknown option", nothing, r"[Nn]o such option.*--fast", f"{IDENTIFY} --fast"),
    case("missing argument", nothing, r"Missing argument 'EXPERIMENT'", "identify --out results"),
    case("missing option", nothing, r"Missing option '--out'", "simulate cogiro"),
    case("one argument too many", nothing, r"unexpected extra argument", f"{IDENTIFY} more.yaml"),
    case(
        "option without value",
        nothing,
        r"--out.*requires an argument",
        "identify experiment.yaml --out",
    ),
    case(
        "text for a number on the command line",
        nothing,
        r"--duration.*'long'",
        "simulate cogiro --duration long --out results",
    ),
    case("negative seed", nothing, r"--seed.*-1", "simulate cogiro --seed -1 --out results"),
    case(
        "wrong method",
        nothing,
        r"--method: expected one of two-step.*found 'magic'",
        f"{IDENTIFY} --method magic",
    ),
    case(
        "wrong method beside all",
        nothing,
        r"--method: expected .*found 'magic'",
        f"{IDENTIFY} --method all --method magic",
    ),
    case(
        "wrong run",
        nothing,
        r"--run: expected one of moving, found 'resting'",
        f"{IDENTIFY} --run resting",
    ),
    case("wrong acceleration", nothing, r"--acceleration.*'gps'", f"{IDENTIFY} --acceleration gps"),
    case(
        "unknown robot to print",
        nothing,
        r"'cogito': expected the path of a robot file or one of cogiro",
        "robots cogito",
    ),
    case(
        "path for a robot to print",
        nothing,
        r"'\.\./robot': expected the path of a robot file or one of cogiro",
        "robots ../robot",
    ),
    case(
        "results folder not empty",
        nothing,
        r"moving: expected a new or empty folder for the results, found files; .*--force",
        "identify experiment.yaml --out moving",
    ),
    case(
        "results folder of a simulation not empty",
        nothing,
        r"moving: expected a new or empty folder for the results, found files; .*--force",
        "simulate cogiro --duration 2 --out moving",
    ),
    case(
        "results folder is a file",
        nothing,
        r"robot\.yaml: expected a folder for the results, found a file",
        "identify experiment.yaml --out robot.yaml",
    ),
    case(
        "results folder is a file, forced",
        nothing,
        r"robot\.yaml: expected a folder for the results, found a file",
        "identify experiment.yaml --force --out robot.yaml",
    ),
    case(
        "results folder below a file",
        nothing,
        r"robot\.yaml/results: expected a place that can be written to, found none",
        "identify experiment.yaml --out robot.yaml/results",
    ),
    case(
        "name of results folder too long",
        nothing,
        r"too long",
        f"identify experiment.yaml --out {'r' * 300}",
    ),
    case(
        "name of experiment too long",
        nothing,
        r"too long",
        f"identify {'e' * 5000}.yaml --out results",
    ),
]

CASES = [*EXPERIMENT_FILE, *YAML_FILE, *ROBOT_FILE, *STREAMS, *SIMULATIONS, *COMMAND_LINE]


def contents(folder):
    """Every path below a folder, with the bytes of its files."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in folder.rglob("*")
    }


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The small experiment, two levels down, as working directory."""
    inner = tmp_path / "some" / "where"
    inner.mkdir(parents=True)
    write_small(inner)
    monkeypatch.chdir(inner)
    return inner


@pytest.fixture
def limited():
    """A test that hangs fails instead."""

    with bounded(LONGEST):
        yield


def assert_one_sentence(status, stdout, stderr, pattern):
    assert status == 2
    assert stdout == ""
    assert stderr.endswith("\n")
    message = stderr.removesuffix("\n")
    assert message.startswith("steelyard: ")
    assert "Traceback" not in message
    assert message.isprintable(), "control characters from a file reach the terminal"
    assert re.search(r"[.!] [A-Z]", message) is None, f"more than one sentence: {message}"
    assert re.search(pattern, message), message
    assert len(message) < 1000


@pytest.mark.slow
@pytest.mark.usefixtures("limited")
@pytest.mark.parametrize(("corrupt", "pattern", "arguments"), CASES)
def test_bad_input_ends_with_one_sentence(
    corrupt, pattern, arguments, folder, tmp_path, monkeypatch, capsys
):
    corrupt(folder)
    before = contents(tmp_path)
    monkeypatch.setattr(sys, "argv", ["steelyard", *arguments.split()])
    with pytest.raises(SystemExit) as end:
        main()
    out, err = capsys.readouterr()
    # Paths of thousands of letters stand in the message as they are.
    assert_one_sentence(end.value.code, out, re.sub(r"[er]{250,}", "…", err), pattern)
    assert contents(tmp_path) == before


@pytest.mark.slow
@pytest.mark.parametrize(
    ("corrupt", "pattern", "arguments"),
    [each for each in CASES if each.id in {"text for a number", "robot is a pipe", "unknown verb"}],
)
def test_bad_input_ends_a_process_in_the_same_way(corrupt, pattern, arguments, folder, tmp_path):
    corrupt(folder)
    before = contents(tmp_path)
    command = [sys.executable, "-m", "steelyard", *arguments.split()]
    ended = finished(command, capture_output=True, text=True)
    assert_one_sentence(ended.returncode, ended.stdout, ended.stderr, pattern)
    assert contents(tmp_path) == before


def test_the_experiment_that_is_corrupted_above_is_a_good_one(folder, monkeypatch, capsys):
    poses(4, 4)(folder)
    monkeypatch.setattr(sys, "argv", ["steelyard", *IDENTIFY.split(), "--method", "two-step"])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 0
    assert "two-step: baseline, not assessed" in capsys.readouterr().out


@pytest.mark.parametrize("allowed", [300_000, 600_000, 1_500_000])
def test_little_memory_is_one_sentence(tmp_path, allowed):
    write_small(tmp_path)
    command = ["sh", "-c", f'ulimit -v {allowed}; exec "$@"', "sh"]
    command += [sys.executable, "-m", "steelyard", *IDENTIFY.split()]
    done = finished(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr.startswith("steelyard: memory: expected at least 1900 MiB")
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "results").exists()
