"""Exports for controllers, read back by parsers written from the documentation of each."""

import ast
import re

import numpy as np
import pytest
from point_clouds import CLOUD, CLOUDS
from ruamel.yaml import YAML
from written_estimates import estimate_of, file_of

from steelyard.errors import InputError
from steelyard.estimates.estimate import Verdict
from steelyard.exports.exported import read_exported
from steelyard.exports.formats import export
from steelyard.inertia import BODY_PARAMETERS

TOLERANCE = 1e-12  # of the largest of the numbers that belong together
FORMS = ("iec61131", "kuka", "abb", "ur", "franka", "ros")


def text_of(folder, ten, form, **options):
    return export(read_exported(str(file_of(folder, estimate_of(ten)))), form, **options)


def same(found, expected):
    found, expected = np.asarray(found, dtype=float), np.asarray(expected, dtype=float)
    np.testing.assert_allclose(found, expected, rtol=0, atol=TOLERANCE * np.abs(expected).max())


def code_of(text, mark):
    """Lines that are no comment."""
    return [line for line in text.splitlines() if line and not line.startswith(mark)]


# Parsers


def kuka(text):
    """KRL: STRUC LOAD REAL M, FRAME CM, INERTIA J; mm, degrees, R = Rz(A) Ry(B) Rx(C)."""
    (line,) = code_of(text, ";")
    number = r"(-?\d+\.\d+(?:[eE][+-]?\d+)?)"
    pattern = rf"LOAD_DATA\[1\]={{M {number},CM {{X {number},Y {number},Z {number},A {number},B {number},C {number}}},J {{X {number},Y {number},Z {number}}}}}"
    m, x, y, z, a, b, c, *J = map(float, re.fullmatch(pattern, line).groups())
    (ca, sa), (cb, sb), (cc, sc) = (
        (np.cos(np.pi * v / 180), np.sin(np.pi * v / 180)) for v in (a, b, c)
    )
    Rz = np.array([[ca, -sa, 0], [sa, ca, 0], [0, 0, 1]])
    Ry = np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]])
    Rx = np.array([[1, 0, 0], [0, cc, -sc], [0, sc, cc]])
    R = Rz @ Ry @ Rx
    return m, np.array([x, y, z]) / 1000, R @ np.diag(J) @ R.T


def abb(text):
    """RAPID: loaddata of mass, cog (mm), aom (quaternion, q1 the real part), ix, iy, iz."""
    (line,) = code_of(text, "!")
    data = ast.literal_eval(re.fullmatch(r"PERS loaddata \w+:=(\[.*\]);", line)[1])
    mass, cog, (w, x, y, z), *J = data
    assert w * w + x * x + y * y + z * z == pytest.approx(1, abs=1e-14)
    R = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return mass, np.array(cog) / 1000, R @ np.diag(J) @ R.T


def ur(text):
    """URScript: set_target_payload(m, cog, [Ixx, Iyy, Izz, Ixy, Ixz, Iyz])."""
    (line,) = code_of(text, "#")
    mass, cog, (xx, yy, zz, xy, xz, yz) = ast.literal_eval(
        re.fullmatch(r"set_target_payload(\(.*\))", line)[1]
    )
    return mass, cog, np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def franka(text):
    """franka_msgs/srv/SetLoad: mass, center_of_mass, load_inertia column by column."""
    values = YAML(typ="safe").load(text)
    assert list(values) == ["mass", "center_of_mass", "load_inertia"]
    return values["mass"], values["center_of_mass"], np.reshape(values["load_inertia"], (3, 3), "F")


def ros(text):
    """geometry_msgs/msg/InertiaStamped."""
    values = YAML(typ="safe").load(text)
    assert values["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": "platform"}
    i = values["inertia"]
    assert set(i) == {"m", "com", "ixx", "ixy", "ixz", "iyy", "iyz", "izz"}
    matrix = [
        [i["ixx"], i["ixy"], i["ixz"]],
        [i["ixy"], i["iyy"], i["iyz"]],
        [i["ixz"], i["iyz"], i["izz"]],
    ]
    return i["m"], [i["com"][axis] for axis in "xyz"], np.array(matrix)


def without_comments(text):
    """Structured text without what stands between (* and *)."""
    assert "(*" not in re.sub(r"\(\*.*?\*\)", "", text, flags=re.DOTALL)
    return re.sub(r"\(\*.*?\*\)", "", text, flags=re.DOTALL)


def initialised(text):
    """Name -> value of the constant structure."""
    body = re.search(r"PLATFORM : ST_Platform := \((.*?)\);", without_comments(text), re.DOTALL)[1]
    pairs = re.findall(r"(\w+) := (\[[^\]]*\]|[^,\s]+)", body)
    return {
        name: value == "TRUE" if value in ("TRUE", "FALSE") else ast.literal_eval(value)
        for name, value in pairs
    }


def iec61131(text):
    values = initialised(text)
    return values["Mass"], values["CenterOfGravity"], np.reshape(values["Inertia"], (3, 3))


PARSERS = {"kuka": kuka, "abb": abb, "ur": ur, "franka": franka, "ros": ros, "iec61131": iec61131}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("cloud", CLOUDS)
def test_the_same_body_comes_back(tmp_path, cloud, form):
    mass, cog, inertia = PARSERS[form](text_of(tmp_path, cloud.ten, form))
    same(mass, cloud.mass)
    same(cog, cloud.cog)
    same(inertia, cloud.about_cog)


@pytest.mark.parametrize("form", ["kuka", "abb"])
def test_axes_of_the_platform_are_kept(tmp_path, form):
    ten = np.array([12.0, 0.1, -0.2, 0.3, 3.0, 2.0, 4.0, 0, 0, 0])
    text = text_of(tmp_path, ten, form)
    same(PARSERS[form](text)[2], np.diag([3.0, 2.0, 4.0]))
    assert "A 0.0,B 0.0,C 0.0" in text or "[1.0,0.0,0.0,0.0],3.0,2.0,4.0" in text


# The function block


def run_block(text, values, motion):
    """What a controller does with the statements of the function block."""
    block = without_comments(text).split("FUNCTION_BLOCK FB_PlatformWrench")[1]
    statements = [line for line in block.splitlines() if ":=" in line]
    memory = {"w": {}, "Force": {}, "Torque": {}}

    def value(term):
        name, place = re.fullmatch(r"-?([\w.]+)\[(\d+)\]", term).groups()
        own = {**memory, **motion, "PLATFORM.LinearParameters": values["LinearParameters"]}[name]
        number = own[int(place)] if isinstance(own, dict) else own[int(place) - 1]
        return -number if term.startswith("-") else number

    for line in statements:
        name, place, right = re.fullmatch(r"(\w+)\[(\d+)\] := (.*);", line).groups()
        parts = right.split(" ")
        result = value(parts[0])
        if len(parts) == 3:
            other = value(parts[2])
            result = {"+": result + other, "-": result - other, "*": result * other}[parts[1]]
        memory[name][int(place)] = result
    return [memory[name][i] for name in ("Force", "Torque") for i in (1, 2, 3)]


def test_the_block_is_the_wrench_of_its_points(tmp_path, rng):
    masses = rng.uniform(1, 5, 9)
    points = rng.normal(size=(9, 3))
    cloud = type(CLOUD)(masses, points)
    text = text_of(tmp_path, cloud.ten, "iec61131")
    s, omega, alpha = rng.normal(size=(3, 3))
    felt = s + np.cross(alpha, points) + np.cross(omega, np.cross(omega, points))
    forces = masses[:, None] * felt
    expected = [*forces.sum(axis=0), *np.cross(points, forces).sum(axis=0)]
    motion = {"SpecificForce": s, "Omega": omega, "Alpha": alpha}
    np.testing.assert_allclose(
        run_block(text, initialised(text), motion), expected, rtol=1e-11, atol=1e-11
    )


def test_every_name_of_the_block_is_declared(tmp_path):
    block = without_comments(text_of(tmp_path, CLOUD.ten, "iec61131")).split("FUNCTION_BLOCK ")[1]
    size = int(re.search(r"w : ARRAY\[0\.\.(\d+)\]", block)[1])
    assert max(map(int, re.findall(r"\bw\[(\d+)\]", block))) <= size
    assert block.count("VAR_INPUT") == block.count("VAR_OUTPUT") == 1
    assert block.count("END_VAR") == 3


# Words


@pytest.mark.parametrize("form", FORMS)
def test_what_is_not_accepted_is_refused_unless_anyway(tmp_path, form):
    verdict = Verdict(False, ("*) runs (* disagree é\n",), dict.fromkeys(BODY_PARAMETERS, "data"))
    exported = read_exported(str(file_of(tmp_path, estimate_of(CLOUD.ten, verdict=verdict))))
    with pytest.raises(InputError, match="expected an accepted estimate"):
        export(exported, form)
    text = export(exported, form, anyway=True)
    assert "NOT ACCEPTED" in text
    assert text.isascii()
    same(PARSERS[form](text)[0], CLOUD.mass)
    if form == "iec61131":
        assert initialised(text)["Accepted"] is False


@pytest.mark.parametrize("form", FORMS)
def test_what_is_not_known_has_no_place(tmp_path, form):
    ten = CLOUD.ten.copy()
    ten[5] = np.nan
    with pytest.raises(InputError, match="has no place for what is not known"):
        text_of(tmp_path, ten, form, anyway=True)


# The verb


@pytest.mark.parametrize(
    ("name", "form"),
    [("a.st", "iec61131"), ("a.urdf", "urdf"), ("a.SDF", "sdf"), ("b.h", "c"), ("c.yml", "yaml"), ("d.script", "ur"), ("e.mod", "abb"), ("f.dat", "kuka"), ("g.json", "json")],
)  # fmt: skip
def test_the_ending_says_the_format(run, tmp_path, name, form):
    path = file_of(tmp_path, estimate_of(CLOUD.ten))
    assert run("export", path, "--out", tmp_path / name)[0] == 0
    assert (tmp_path / name).read_text() == text_of(tmp_path, CLOUD.ten, form)


def test_an_export_may_be_printed(run, tmp_path):
    path = file_of(tmp_path, estimate_of(CLOUD.ten))
    status, out, err = run("export", path, "--format", "ros", "--out", "-")
    assert (status, err) == (0, "")
    assert out == text_of(tmp_path, CLOUD.ten, "ros")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--out", "body.xml"], "expected an ending that says the format"),
        (["--out", "-"], "--format: expected one with --out -"),
        (["--out", "-", "--format", "ros", "--json"], "--json: expected a file to write beside it"),
        (["--out", "a.urdf", "--link", "two words"], "--link: expected a name of letters"),
        (
            ["--out", "a.h", "--link", "fork"],
            "--link: expected a format with names of bodies, found c",
        ),
    ],
)
def test_what_is_wrong_is_said(run, tmp_path, monkeypatch, words, said):
    path = file_of(tmp_path, estimate_of(CLOUD.ten))
    monkeypatch.chdir(tmp_path)
    status, out, err = run("export", path, *words)
    assert (status, out) == (2, "")
    assert said in err
    assert [each.name for each in tmp_path.iterdir()] == ["estimate.json"]


@pytest.mark.parametrize("form", ["urdf", "sdf", "mjcf", "ros"])
def test_the_body_has_the_name_that_is_wished(run, tmp_path, form):
    path = file_of(tmp_path, estimate_of(CLOUD.ten))
    status, out, _ = run("export", path, "--format", form, "--out", "-", "--link", "tool0_load")
    assert status == 0
    body = re.sub(r"<!--.*?-->|^#.*?$", "", out, flags=re.DOTALL | re.MULTILINE)
    assert '"tool0_load"' in body
    assert '"platform"' not in body
