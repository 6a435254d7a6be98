from dataclasses import fields
from io import StringIO

import numpy as np
import pytest
from ruamel.yaml import YAML

from steelyard.errors import InputError
from steelyard.robot.file import bundled_names, bundled_text, read_robot, robot_file
from steelyard.robot.model import CableProperties, Limits, Robot

TOLERANCE = 1e-10  # angles go through degrees with nine digits

SMALL = """\
name: small
gravity: 9.81
cables:
  - {anchor: [0, 0, 5], attachment: [0.1, 0, 0]}
  - {anchor: [4, 0, 5], attachment: [0.2, 0, 0], pulley: {radius: 0.05, axis: [0, 3, 4]}}
tension: {min: 50, max: 5.0e3}
limits: {position: [[-1, -1, 0], [1, 1, 2]], rpy_deg: [[-35, -20, -5], [35, 20, 5]], speed: 3, angular_speed: 1.5}
platform: {mass: 10, center_of_gravity: [0, 0, 0.1], inertia: {xx: 1, yy: 2, zz: 2.5, xy: 0.25}}
"""
HALF_SIZE = """\
name: half-size
cables:
  - {anchor: [-3.59835, -2.7199, 2.6964], attachment: [0.2516, -0.2464, 0.0]}
  - {anchor: [-3.7393, -2.5772, 2.70045], attachment: [-0.25485, 0.1754, 0.4988]}
cable: {diameter: 0.002, axial_stiffness: 200000.0}
tension: {min: 10, max: 1000}
limits: {position: [[-2.0, -1.5, 0.25], [2.0, 1.5, 1.75]], rpy_deg: [[-35.0, -35.0, -35.0], [35.0, 35.0, 35.0]], speed: 3.0, acceleration: 3.0}
"""
CHAINS = """\
name: cogiro-chains
cables:
  - {anchor: [-7.1967, -5.4398, 5.3928], attachment: [0.5032, -0.4928, 0.0]}
  - {anchor: [7.4288, -5.2613, 5.3878], attachment: [0.5021, 0.275, -0.0007]}
cable: {diameter: 0.004, axial_stiffness: 250000.0, linear_density: 0.064}
tension: {min: 50, max: 5000}
"""
TILTED = "name: '12'\ngravity: [0.3, -0.1, -9.8]\ncables: []\n"
ROBOTS = {"small": SMALL, "half-size": HALF_SIZE, "chains": CHAINS, "tilted": TILTED}


def written(folder, text, name="robot.yaml"):
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return str(path)


def assert_same_values(one, other):
    for field in fields(one):
        a, b = getattr(one, field.name), getattr(other, field.name)
        if field.name == "platform" and a is not None:
            np.testing.assert_allclose(a.body_parameters, b.body_parameters, atol=TOLERANCE)
        elif field.name == "limits":
            for key in (f.name for f in fields(Limits)):
                assert (getattr(a, key) is None) == (getattr(b, key) is None)
                np.testing.assert_allclose(
                    np.array(getattr(a, key) or 0.0),
                    np.array(getattr(b, key) or 0.0),
                    atol=TOLERANCE,
                )
        elif isinstance(a, np.ndarray):
            np.testing.assert_allclose(a, b, atol=TOLERANCE)
        else:
            assert a == b


def test_what_stands_in_the_file_stands_in_the_robot(tmp_path):
    robot = read_robot(written(tmp_path, SMALL))
    assert robot.name == "small"
    np.testing.assert_array_equal(robot.gravity, [0, 0, -9.81])
    np.testing.assert_array_equal(robot.anchors, [[0, 0, 5], [4, 0, 5]])
    np.testing.assert_array_equal(robot.attachments, [[0.1, 0, 0], [0.2, 0, 0]])
    np.testing.assert_array_equal(robot.pulley_radius, [0, 0.05])
    np.testing.assert_allclose(robot.pulley_axis, [[0, 0, 1], [0, 0.6, 0.8]], atol=TOLERANCE)
    assert robot.tension_limits == (50.0, 5000.0)
    assert robot.limits.position == ((-1, -1, 0), (1, 1, 2))
    np.testing.assert_allclose(
        robot.limits.rpy, np.radians([[-35, -20, -5], [35, 20, 5]]), atol=TOLERANCE
    )
    assert (robot.limits.speed, robot.limits.angular_speed) == (3.0, 1.5)
    assert robot.platform.mass == 10
    np.testing.assert_array_equal(robot.platform.inertia, [[1, 0.25, 0], [0.25, 2, 0], [0, 0, 2.5]])


def test_what_does_not_stand_there_is_as_the_contract_says(tmp_path):
    robot = read_robot(
        written(tmp_path, "name: bare\ncables:\n- {anchor: [0, 0, 5], attachment: [0, 0, 0]}\n")
    )
    np.testing.assert_array_equal(robot.gravity, [0, 0, -9.81])
    assert robot.cable == CableProperties(None, None, None, 0.02)
    assert robot.limits == Limits()
    assert robot.tension_limits == (0.0, np.inf)
    assert robot.platform is None
    np.testing.assert_array_equal(robot.pulley_radius, [0])


def test_a_robot_without_cables_is_a_body_on_a_sensor(tmp_path):
    robot = read_robot(written(tmp_path, TILTED))
    assert robot.m == 0
    assert robot.size == 1.0
    np.testing.assert_array_equal(robot.gravity, [0.3, -0.1, -9.8])


@pytest.mark.parametrize("name", bundled_names())
def test_bundled_robots_load_and_carry_their_platform(name):
    robot = read_robot(name)
    assert robot.name == name
    assert robot.m == 8
    assert robot.platform.is_physical
    assert len({tuple(a) for a in robot.anchors.tolist()}) == 8


def test_cogiro_is_that_of_the_paper():
    robot, cuboid = read_robot("cogiro"), read_robot("cogiro-cuboid")
    assert bundled_names() == ["cogiro", "cogiro-cuboid"]
    np.testing.assert_array_equal(robot.anchors[6], [7.4288, -5.2613, 5.3878])  # Table II
    np.testing.assert_array_equal(robot.attachments[6], [0.5021, 0.2750, -0.0007])
    np.testing.assert_array_equal(robot.pulley_radius, np.full(8, 0.05))
    assert robot.platform.mass == 161.058
    assert (cuboid.platform.mass, cuboid.platform.inertia[0, 2]) == (91.058, -3.012)
    assert robot.cable == CableProperties(0.004, 5e5, 0.064, 0.02)


@pytest.mark.parametrize("name", [*bundled_names(), *ROBOTS])
def test_a_robot_written_to_a_file_is_read_back(name, tmp_path):
    robot = read_robot(written(tmp_path, ROBOTS[name] if name in ROBOTS else bundled_text(name)))
    stream = StringIO()
    YAML(typ="safe", pure=True).dump(robot_file(robot), stream)
    assert_same_values(read_robot(written(tmp_path, stream.getvalue(), "again.yaml")), robot)


def test_paths_start_at_the_folder(tmp_path):
    written(tmp_path, SMALL, "mine.yml")
    written(tmp_path, SMALL, "no-ending")
    assert (
        read_robot("mine.yml", tmp_path).name == read_robot("no-ending", tmp_path).name == "small"
    )


def test_anchors_and_aliases_of_yaml_may_be_used(tmp_path):
    text = SMALL.replace("attachment: [0.1", "pulley: &p {radius: 0.03}, attachment: [0.1")
    alias = text.replace("{radius: 0.05, axis: [0, 3, 4]}", "*p")
    merged = text.replace("{radius: 0.05, axis: [0, 3, 4]}", "{<<: *p}")
    for given in (alias, merged):
        np.testing.assert_array_equal(
            read_robot(written(tmp_path, given)).pulley_radius, [0.03, 0.03]
        )


CHANGES = [
    (
        "speed: 3,",
        "sped: 3,",
        r":7: 'limits\.sped': expected a known key, found 'sped'; did you mean 'speed'\?",
    ),
    (
        "name: small",
        "name: small\ncolour: red",
        r":2: 'colour': expected a known key, found 'colour'; known here: name, ",
    ),
    ("name: small\n", "", r"'name': expected this key, found it missing; add 'name'"),
    (
        ", attachment: [0.1, 0, 0]",
        "",
        r":4: 'cables\[0\]\.attachment': expected this key, found it missing",
    ),
    (", zz: 2.5", "", r":8: 'platform\.inertia\.zz': expected this key"),
    ("9.81", "heavy", r":2: 'gravity': expected a number, found 'heavy'; write a number"),
    ("max: 5.0e3", "max: '5000'", r":6: 'tension\.max': expected a number, found '5000'"),
    ("max: 5.0e3", "max: true", r":6: 'tension\.max': expected a number, found true"),
    ("max: 5.0e3", "max: .inf", r":6: 'tension\.max': expected a number, found Infinity"),
    (
        "anchor: [0, 0",
        "anchor: [.nan, 0",
        r":4: 'cables\[0\]\.anchor\[0\]': expected a number, found NaN",
    ),
    ("9.81", ".nan", r":2: 'gravity': expected a number, found NaN"),
    ("9.81", "-9.81", r":2: 'gravity': expected a number above 0, found -9\.81"),
    ("9.81", "[0, 0, 0]", r":2: 'gravity': expected a vector, found one of length 0"),
    ("9.81", "1" * 400, r":2: 'gravity': expected a number, found 1111"),
    ("mass: 10", "mass: 0", r":8: 'platform\.mass': expected a number above 0, found 0"),
    (
        "0.05",
        "-0.05",
        r":5: 'cables\[1\]\.pulley\.radius': expected a number at least 0, found -0\.05",
    ),
    (
        "[4, 0, 5]",
        "[0, 0, 5]",
        (
            r":5: 'cables\[1\]\.anchor': expected anchors that differ, found cable 2 at the anchor"
            r" of cable 1"
        ),
    ),
    (
        "[4, 0, 5]",
        "[2600004, 0, 5]",
        r":5: 'cables\[1\]\.anchor': expected coordinates of at most 100000 m, found 2600004; subtract",
    ),
    ("[4, 0, 5]", "[4, 0]", r":5: 'cables\[1\]\.anchor': expected at least 3 values, found 2"),
    (
        "[4, 0, 5]",
        "[4, 0, 5, 6]",
        r":5: 'cables\[1\]\.anchor': expected at most 3 values, found \[4, 0, 5, 6\]",
    ),
    (
        "[0, 3, 4]",
        "[0, 0, 0]",
        r":5: 'cables\[1\]\.pulley\.axis': expected a direction, found a vector of length 0",
    ),
    ("min: 50", "min: 6000", r":6: 'tension': expected min below max, found 6000 and 5000 N"),
    ("[-1, -1, 0]", "[2, -1, 0]", r":7: 'limits\.position': expected the lowest corner first"),
    ("[-35, -20", "[-35, 20", r":7: 'limits\.rpy_deg': expected the lowest corner first"),
    ("name: small", "name: 12", r":1: 'name': expected text, found 12; put it in quotes"),
    (
        "9.81",
        "9.81\ngravity: 9.8",
        r":3: expected YAML, found a mistake in it \(found duplicate key",
    ),
    ("9.81", "!!python/object/apply:os.system ['false']", r":2: 'gravity.*expected a number"),
]


@pytest.mark.parametrize(
    ("old", "new", "message"), CHANGES, ids=[f"{i}-{c[1][:20]}" for i, c in enumerate(CHANGES)]
)
def test_a_mistake_is_named_with_its_line_and_key(old, new, message, tmp_path):
    assert SMALL.count(old) == 1
    with pytest.raises(InputError, match=r"robot\.yaml.*" + message):
        read_robot(written(tmp_path, SMALL.replace(old, new)))


BOMB = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{this}: &{this} [{', '.join(['*' + last] * 9)}]\n"
    for last, this in zip("abcdefgh", "bcdefghi", strict=True)
)
NO_ROBOTS = {
    "not YAML": ("name: [unclosed", r"robot\.yaml:1: expected YAML, found a mistake in it"),
    "tabs": ("name:\n\t- x", r"robot\.yaml:2: expected YAML"),
    "empty": ("", "expected a mapping of keys to values, found nothing"),
    "list": ("- 1\n- 2", r"expected a mapping of keys to values, found \[1, 2\]"),
    "two documents": (SMALL + "---\n" + SMALL, "expected YAML, found a mistake in it"),
    "alias bomb": (BOMB, "expected at most 200000 values, found more; remove nested aliases"),
    "alias of itself": (
        "&a {name: *a}",
        "expected at most 200000 values, found more; remove nested aliases",
    ),
    "merge of itself": ("name: &a {<<: *a}", "expected YAML"),
    "unknown alias": ("name: *a", "expected YAML, found a mistake in it"),
    "deep": ("name: " + "[" * 1200, "expected YAML, found something that cannot be read"),
    "control character": ("name: \x07", "expected YAML"),
    "escape": (
        'name: "\\e[2J"',
        r":1: 'name': expected text that can be printed, found .* U\+001B",
    ),
    "direction": ('name: "\\u202E"', r"found the character U\+202E; remove it"),
    "escape in a key": ('"\\x9b": 1', r"found the character U\+009B; remove it"),
    "a letter beyond the last": ('name: "\\UFFFFFFFF"', "found something that cannot be read"),
    "many values": ("name:\n" + "- 1\n" * 40_000, "expected at most 40000 lines"),
    "not UTF-8": (b"name: \xff\xfe", "expected UTF-8 text, found a byte that is not at 6"),
    "number of 5000 digits": (
        "gravity: " + "9" * 5000,
        "expected YAML, found something that cannot be read",
    ),
    "5 MiB": ("#" * (5 * 2**20), "expected at most 512 KiB of YAML, found 5120 KiB"),
    "65 cables": (
        "name: x\ncables:\n"
        + "".join(f"- {{anchor: [{i}, 0, 0], attachment: [0, 0, 0]}}\n" for i in range(65)),
        r"'cables': expected at most 64 values",
    ),
}


LONG = {"alias bomb"}
"""Of these, those that take about a second."""


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, marks=pytest.mark.integration if case in LONG else ())
        for case in NO_ROBOTS
    ],
)
def test_what_is_no_robot_file_is_refused_in_one_sentence(case, tmp_path):
    text, message = NO_ROBOTS[case]
    with pytest.raises(InputError, match=message):
        read_robot(written(tmp_path, text))


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("missing.yaml", r"missing\.yaml: expected a file, found nothing there; check the path"),
        ("folder", "folder: expected a file, found a folder"),
        (
            "cogir",
            (
                "robot 'cogir': expected the path of a robot file or one of cogiro, cogiro-cuboid,"
                " found neither"
            ),
        ),
    ],
)
def test_what_is_no_file_is_refused(path, message, tmp_path):
    (tmp_path / "folder").mkdir()
    with pytest.raises(InputError, match=message):
        read_robot(path, tmp_path)


def test_one_cable_shows_how_large_a_platform_is_about_its_origin():
    anchor = [[0.0, 0.0, 5.0]]
    assert Robot("one", anchor, [[0.0, 0.3, 0.4]]).size == pytest.approx(0.5)
    assert Robot("one", anchor, [[0.0, 0.0, 0.0]]).size == 1.0
