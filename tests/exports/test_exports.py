"""Every export loaded by its own consumer: the same body comes back, and no text of a file becomes
more than text."""

import itertools
import json
import re
import shutil
import subprocess
from dataclasses import replace
from xml.etree import ElementTree

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from lxml import etree
from places import DATA
from point_clouds import CLOUD, CLOUDS
from ruamel.yaml import YAML
from written_estimates import covariance, estimate_of, file_of

from steelyard.dynamics import platform_regressor, platform_wrench
from steelyard.errors import InputError
from steelyard.estimates.estimate import FORMAT, Verdict, judge, unassessed
from steelyard.estimates.file.estimate_file import read_estimate_file
from steelyard.exports.exported import Exported, exported_of, read_exported
from steelyard.exports.formats import FORMATS, export
from steelyard.exports.remarks import number
from steelyard.inertia import BODY_PARAMETERS, LINEAR_PARAMETERS
from steelyard.robot.file import read_robot

TOLERANCE = 1e-12  # of the largest of the numbers that belong together; only MuJoCo's axes need it
SCHEMAS = DATA / "sdformat"
WHOLE = [name for name, form in FORMATS.items() if form.whole]


# The bodies


def test_the_bodies_have_products_of_either_sign():
    assert {cloud.signs for cloud in CLOUDS} == set(itertools.product((-1, 1), repeat=3))
    assert min(abs(cloud.ten[7:]).min() / cloud.ten[4:7].max() for cloud in CLOUDS) > 1e-3


def text_of(folder, cloud, form, **options):
    return export(read_exported(str(file_of(folder, estimate_of(cloud.ten)))), form, **options)


def same(found, expected):
    found, expected = np.asarray(found, dtype=float), np.asarray(expected, dtype=float)
    np.testing.assert_allclose(found, expected, rtol=0, atol=TOLERANCE * np.abs(expected).max())


def exactly(found, ten):
    np.testing.assert_array_equal(np.asarray(found, dtype=float), ten)


# Each consumer


@pytest.mark.parametrize("cloud", CLOUDS)
def test_urdf_read_by_pinocchio_is_the_same_body(tmp_path, cloud):
    model = pin.buildModelFromXML(text_of(tmp_path, cloud, "urdf"), pin.JointModelFreeFlyer())
    body = model.inertias[1]
    same(body.mass, cloud.mass)
    same(body.lever, cloud.cog)
    same(body.inertia, cloud.about_cog)
    v = body.toDynamicParameters()
    same([v[1], v[2], v[3]], cloud.first_moment)
    same([[v[4], v[5], v[7]], [v[5], v[6], v[8]], [v[7], v[8], v[9]]], cloud.about_origin)


def compiled_body(text):
    """Mass, centre of gravity and inertia as MuJoCo has them."""
    model = mujoco.MjModel.from_xml_string(text)
    R = np.zeros(9)
    mujoco.mju_quat2Mat(R, model.body("platform").iquat)
    R = R.reshape(3, 3)
    body = model.body("platform")
    return body.mass[0], body.ipos, R @ np.diag(body.inertia) @ R.T


@pytest.mark.mujoco
@pytest.mark.parametrize("cloud", CLOUDS)
def test_mjcf_compiled_by_mujoco_is_the_same_body(tmp_path, cloud):
    mass, cog, inertia = compiled_body(text_of(tmp_path, cloud, "mjcf"))
    same(mass, cloud.mass)
    same(cog, cloud.cog)
    same(inertia, cloud.about_cog)


@pytest.mark.mujoco
def test_urdf_compiled_by_mujoco_is_the_same_body_as_mjcf(tmp_path):
    text = text_of(tmp_path, CLOUD, "urdf").replace(
        '<robot name="platform">',
        '<robot name="platform"><mujoco><compiler fusestatic="false"/></mujoco>',
    )
    for found, expected in zip(
        compiled_body(text), compiled_body(text_of(tmp_path, CLOUD, "mjcf")), strict=True
    ):
        same(found, expected)


XSD = "<xsd:schema xmlns:xsd='http://www.w3.org/2001/XMLSchema'>{}</xsd:schema>"
# What the schema of SDFormat says of numbers in a row: an exponent only behind a decimal point.
NUMBER = r"-?\d+(\.\d+([eE][\-+]?\d+)?)?"
TYPES = "".join(
    f"<xsd:simpleType name='{name}'><xsd:restriction base='xsd:string'><xsd:pattern"
    f" value='{NUMBER}( {NUMBER}){{{n}}}'/></xsd:restriction></xsd:simpleType>"
    for name, n in (("pose", 5), ("vector3", 2))
)


class Includes(etree.Resolver):
    """The schemas that are here, and nothing in place of the others."""

    def resolve(self, url, public_id, context):
        path = SCHEMAS / url.rsplit("/", 1)[-1]
        if path.exists():
            return self.resolve_filename(str(path), context)
        return self.resolve_string(
            XSD.format(
                TYPES
                if path.name == "types.xsd"
                else f"<xsd:element name='{path.stem}' type='xsd:byte'/>"
            ),
            context,
        )


@pytest.fixture(scope="module")
def sdf_schema():
    parser = etree.XMLParser(no_network=True)
    parser.resolvers.add(Includes())
    return etree.XMLSchema(etree.parse(str(SCHEMAS / "root.xsd"), parser))


@pytest.mark.parametrize("cloud", CLOUDS)
def test_sdf_keeps_its_schema_and_is_the_same_body(tmp_path, sdf_schema, cloud):
    text = text_of(tmp_path, cloud, "sdf")
    root = etree.fromstring(text.encode())
    sdf_schema.assertValid(root)
    assert root.get("version") == "1.9"
    (inertial,) = root.findall("model/link/inertial")
    x, y, z, *turned = map(float, inertial.findtext("pose").split())
    assert turned == [0, 0, 0]
    exactly([x, y, z], cloud.ten[1:4])
    # Each once: the schema does not count.
    names = [each.tag for each in inertial.find("inertia")]
    assert sorted(names) == ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"]
    values = [
        float(inertial.findtext(f"inertia/{name}"))
        for name in ("ixx", "iyy", "izz", "iyz", "ixz", "ixy")
    ]
    exactly([float(inertial.findtext("mass")), *cloud.cog, *values], cloud.ten)


def test_the_schema_would_refuse_another_file(tmp_path, sdf_schema):
    text = text_of(tmp_path, CLOUD, "sdf")
    for old, new in (
        ("<ixy>", "<ixy>x"),
        ("mass>", "weight>"),
        ("0 0 0</pose>", "0 0</pose>"),
        (' version="1.9"', ""),
    ):
        assert old in text
        assert not sdf_schema.validate(etree.fromstring(text.replace(old, new).encode()))


def test_exponents_stand_behind_a_decimal_point():
    for value, text in (
        (1e-5, "1.0e-05"),
        (-2.5e-7, "-2.5e-07"),
        (1e22, "1.0e+22"),
        (-0.0, "0.0"),
        (161.058, "161.058"),
    ):
        assert number(value) == text
        assert float(text) == value
    for value in (np.nan, np.inf):
        with pytest.raises(ValueError, match="expected a finite number"):
            number(value)


COMPILERS = {
    "c89": ["cc", "-std=c89"],
    "c99": ["cc", "-std=c99"],
    "c++98": ["c++", "-x", "c++", "-std=c++98"],
    "c++17": ["c++", "-x", "c++", "-std=c++17"],
}
PROGRAM = """
#include <stdio.h>
#include "body.h"
#include "body.h"
static void print(const double *v, int n) { int i; for (i = 0; i < n; i++) printf("%.17g\\n", v[i]); }
int main(void) {
  printf("%d\\n%d\\n%.17g\\n", PLATFORM_ACCEPTED, PLATFORM_PHYSICAL, PLATFORM_MASS);
  print(platform_center_of_gravity, 3); print(&platform_inertia[0][0], 9); print(platform_body_parameters, 10);
  print(platform_standard_deviation, 10); print(&platform_covariance[0][0], 100); print(platform_linear_parameters, 10);
  return 0;
}
"""


def numbers_in_c(folder, header, standard):
    """What a program prints that includes a header: accepted, physical, mass, centre of gravity,
    inertia, ten, sigmas, covariance, linear ones."""
    compiler = COMPILERS[standard]
    if shutil.which(compiler[0]) is None:
        pytest.skip(f"no compiler '{compiler[0]}' here")
    (folder / "body.h").write_text(header)
    (folder / "main.c").write_text(PROGRAM)
    flags = ["-Wall", "-Wextra", "-pedantic", "-Werror"]
    subprocess.run([*compiler, *flags, "main.c", "-o", "main"], cwd=folder, check=True)
    lines = subprocess.run(
        [str(folder / "main")], capture_output=True, text=True, check=True
    ).stdout.split()
    values = np.array([float(line) for line in lines])
    return np.split(values, np.cumsum([1, 1, 1, 3, 9, 10, 10, 100]))


@pytest.mark.parametrize(
    ("standard", "cloud"),
    [*(("c89", cloud) for cloud in CLOUDS), *((s, CLOUD) for s in COMPILERS if s != "c89")],
)
def test_c_prints_the_same_body(tmp_path, standard, cloud):
    accepted, physical, mass, cog, inertia, ten, sigma, matrix, linear = numbers_in_c(
        tmp_path, text_of(tmp_path, cloud, "c"), standard
    )
    assert (accepted, physical) == (1, 1)
    exactly(mass, [cloud.mass])
    exactly(cog, cloud.cog)
    exactly(inertia.reshape(3, 3), cloud.about_cog)
    exactly(ten, cloud.ten)
    same(matrix.reshape(10, 10), covariance(cloud.ten))
    np.testing.assert_allclose(sigma, np.sqrt(np.diag(covariance(cloud.ten))), rtol=1e-12)
    assert_linear(linear, cloud)


def assert_linear(linear, cloud):
    """The linear parameters are those about the origin, in the order of the regressor."""
    same(linear[:1], [cloud.mass])
    same(linear[1:4], cloud.first_moment)
    J = cloud.about_origin
    same(linear[4:], [J[0, 0], J[1, 1], J[2, 2], J[1, 2], J[0, 2], J[0, 1]])
    motion = np.random.default_rng(5).normal(size=(3, 4, 3))
    expected = platform_wrench(np.array([cloud.mass, *cloud.first_moment, *linear[4:]]), *motion)
    np.testing.assert_allclose(
        platform_regressor(*motion) @ linear,
        expected,
        rtol=1e-9,
        atol=1e-9 * np.abs(expected).max(),
    )


def parsed(text, form):
    return json.loads(text) if form == "json" else YAML(typ="safe", pure=True).load(text)


def no_number(text):
    raise AssertionError(f"JSON has no {text}")


@pytest.mark.parametrize("form", ["yaml", "json"])
@pytest.mark.parametrize("cloud", CLOUDS)
def test_plain_forms_hold_the_same_body(tmp_path, form, cloud):
    found = parsed(text_of(tmp_path, cloud, form), form)
    platform = found["platform"]
    exactly(
        [
            platform["mass"],
            *platform["center_of_gravity"],
            *(platform["inertia"][k] for k in ("xx", "yy", "zz", "yz", "xz", "xy")),
        ],
        cloud.ten,
    )
    sigma = found["standard_deviation"]
    flat = [
        sigma["mass"],
        *sigma["center_of_gravity"],
        *(sigma["inertia"][k] for k in ("xx", "yy", "zz", "yz", "xz", "xy")),
    ]
    np.testing.assert_allclose(flat, np.sqrt(np.diag(covariance(cloud.ten))), rtol=1e-12)
    assert found["covariance"]["parameters"] == list(BODY_PARAMETERS)
    same(found["covariance"]["matrix"], covariance(cloud.ten))
    linear = found["linear"]
    assert linear["parameters"] == list(LINEAR_PARAMETERS)
    assert_linear(np.array(linear["values"]), cloud)
    assert [linear["values"][0], *linear["first_moment"], *linear["inertia"].values()] == linear[
        "values"
    ]
    assert list(linear["inertia"]) == ["xx", "yy", "zz", "yz", "xz", "xy"]
    assert found["verdict"]["accepted"] is True
    assert found["verdict"]["parameters"] == dict.fromkeys(BODY_PARAMETERS, "data")
    assert found["method"] == "maximum-likelihood"


@pytest.mark.parametrize("cloud", CLOUDS)
def test_the_platform_of_a_plain_form_is_that_of_a_robot_file(tmp_path, cloud):
    lines = text_of(tmp_path, cloud, "yaml").splitlines()
    start = lines.index("platform:")
    stop = next(i for i in range(start + 1, len(lines)) if not lines[i].startswith(" "))
    (tmp_path / "robot.yaml").write_text(
        "\n".join(["name: pasted", "cables: []", *lines[start:stop]]) + "\n"
    )
    exactly(read_robot(str(tmp_path / "robot.yaml")).platform.body_parameters, cloud.ten)


# What goes along


def comment_of(text, form):
    """What a reader of the file is told beside the numbers, in one line."""
    if form == "json":
        return text
    marks = {"yaml": "# ", "ur": "# ", "franka": "# ", "ros": "# ", "kuka": "; ", "abb": "! "}
    if form in marks:
        lines = [line[2:] for line in text.splitlines() if line.startswith(marks[form])]
    else:
        pairs = {"c": ("/*", "*/"), "iec61131": ("(*", "*)")}
        opening, closing = pairs.get(form, ("<!--", "-->"))
        lines = [
            line.removeprefix(" * ")
            for line in text.split(opening, 1)[1].split(closing, 1)[0].splitlines()
        ]
    return " ".join(" ".join(lines).split())


@pytest.mark.parametrize("form", [each for each in FORMATS if each != "json"])
def test_comments_say_where_from_and_how_well(tmp_path, form):
    verdict = Verdict(
        False,
        ("the runs disagree by 5 sigma",),
        {**dict.fromkeys(BODY_PARAMETERS, "data"), "Jxy": "prior"},
    )
    path = file_of(tmp_path, estimate_of(CLOUD.ten, verdict=verdict), experiment="moves in spring")
    told = comment_of(export(read_exported(str(path)), form, anyway=True), form)
    assert "steelyard 0.1.0" in told
    assert "maximum-likelihood, experiment 'moves in spring', from estimate.json (sha256 " in told
    assert "NOT ACCEPTED" in told
    assert "the runs disagree by 5 sigma" in told
    sigma = np.sqrt(np.diag(covariance(CLOUD.ten)))
    for name, value, deviation in zip(BODY_PARAMETERS, CLOUD.ten, sigma, strict=True):
        label = "prior" if name == "Jxy" else "data"
        assert re.search(
            rf"{name} {re.escape(f'{value:.6g}')} \+- {re.escape(f'{deviation:.3g}')} (kg"
            rf" m\^2|kg|m), {label}",
            told,
        )
    assert "about the centre of gravity" in told
    # Principal axes have no products.
    assert ("x y dm" in told) == (form not in ("kuka", "abb"))
    assert "correlations" not in told.split("Convention")[0]


@pytest.mark.parametrize("form", FORMATS)
def test_accepted_estimates_say_so(tmp_path, form):
    text = text_of(tmp_path, CLOUD, form)
    assert ('"accepted": true' if form == "json" else "Verdict: accepted.") in text
    assert "NO BODY" not in text
    assert text.endswith("\n")


@pytest.mark.parametrize("form", FORMATS)
def test_the_same_input_gives_the_same_bytes(tmp_path, form):
    assert text_of(tmp_path, CLOUD, form) == text_of(tmp_path, CLOUD, form)


@pytest.mark.parametrize("form", FORMATS)
def test_estimates_in_memory_are_exported_as_well(tmp_path, form):
    text = export(Exported(estimate_of(CLOUD.ten)), form)
    assert str(number(CLOUD.mass)) in text
    assert "sha256 " not in text
    with pytest.raises(InputError, match=r"^estimate 'two-step': expected all ten"):
        export(Exported(estimate_of(UNIDENTIFIABLE, method="two-step")), form)


@pytest.mark.parametrize("form", FORMATS)
def test_sigmas_alone_are_told_as_such(tmp_path, form):
    path = file_of(tmp_path, estimate_of(CLOUD.ten))
    values = json.loads(path.read_text())
    del values["estimates"]["maximum-likelihood"]["covariance"]
    path.write_text(json.dumps(values))
    text = export(read_exported(str(path)), form)
    if form in ("json", "yaml"):
        assert parsed(text, form)["covariance"]["correlations"] == "not known"
    if form != "json":
        assert "correlations are not known" in comment_of(text, form)


# Refusals

IMPOSSIBLE = np.array(
    [170.74, 0.112, -0.134, -0.125, 102.982, 52.744, 46.589, 8.588, -0.132, -3.672]
)
"""Table III of the paper."""
UNIDENTIFIABLE = np.array([*CLOUD.ten[:4], *[np.nan] * 6])


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("reasons", [("runs disagree", "residuals are coloured"), ()])
def test_what_is_not_accepted_is_refused_unless_anyway(tmp_path, form, reasons):
    verdict = Verdict(False, reasons, dict.fromkeys(BODY_PARAMETERS, "data"))
    exported = read_exported(str(file_of(tmp_path, estimate_of(CLOUD.ten, verdict=verdict))))
    named = "; ".join(reasons) or "its verdict gives no reason"
    with pytest.raises(
        InputError,
        match=(
            rf"estimate 'maximum-likelihood': expected an accepted .*\({named}\).* with anyway=True$"
        ),
    ):
        export(exported, form)
    assert export(exported, form, anyway=True)


@pytest.mark.parametrize("form", FORMATS)
def test_a_baseline_is_refused_unless_anyway_and_said_to_be_one(tmp_path, form):
    verdict = unassessed(judge(CLOUD.ten))
    exported = read_exported(str(file_of(tmp_path, estimate_of(CLOUD.ten, verdict=verdict))))
    with pytest.raises(InputError, match="found a baseline that was not assessed"):
        export(exported, form)
    text = export(exported, form, anyway=True)
    said = "BASELINE, NOT ASSESSED, exported all the same"
    assert ('"accepted": null' if form == "json" else said) in text


@pytest.mark.mujoco
@pytest.mark.parametrize("accepted", [True, False])
@pytest.mark.parametrize("form", FORMATS)
def test_a_body_that_cannot_exist_is_refused_unless_anyway_and_told_loudly(
    tmp_path, form, accepted
):
    verdict = replace(
        judge(IMPOSSIBLE), accepted=accepted, reasons=() if accepted else judge(IMPOSSIBLE).reasons
    )
    exported = read_exported(str(file_of(tmp_path, estimate_of(IMPOSSIBLE, verdict=verdict))))
    with pytest.raises(
        InputError, match=r"found one that is not \(no body has this inertia.*anyway=True"
    ) as refused:
        export(exported, form)
    assert str(refused.value).count("no body has this inertia") == 1
    text = export(exported, form, anyway=True)
    assert ('"warning": [' if form == "json" else "NO BODY CAN HAVE THESE NUMBERS") in text
    if form == "mjcf":
        with pytest.raises(ValueError, match=re.escape("A + B >= C")):
            mujoco.MjModel.from_xml_string(text)
    if form == "urdf":
        same(
            pin.buildModelFromXML(text, pin.JointModelFreeFlyer()).inertias[1].lever,
            IMPOSSIBLE[1:4],
        )


def test_negative_numbers_are_one_token_in_c(tmp_path):
    ten = np.array([-3.0, *IMPOSSIBLE[1:]])
    exported = read_exported(str(file_of(tmp_path, estimate_of(ten))))
    accepted, physical, mass, *_ = numbers_in_c(tmp_path, export(exported, "c", anyway=True), "c89")
    assert (accepted, physical, mass) == (0, 0, -3)


@pytest.mark.parametrize("anyway", [True, False])
@pytest.mark.parametrize("form", WHOLE)
def test_numbers_that_are_not_there_are_never_written(tmp_path, form, anyway):
    exported = read_exported(str(file_of(tmp_path, estimate_of(UNIDENTIFIABLE))))
    with pytest.raises(
        InputError,
        match=(
            r"do not tell Jxx, Jyy, Jzz, Jyz, Jxz, Jxy; choose another method or record more"
            r" motion.*anyway=True does not help"
        ),
    ):
        export(exported, form, anyway=anyway)


@pytest.mark.parametrize("form", ["yaml", "json"])
def test_plain_forms_write_null_anyway(tmp_path, form):
    exported = read_exported(str(file_of(tmp_path, estimate_of(UNIDENTIFIABLE))))
    with pytest.raises(InputError, match=r"do not tell Jxx.*null in their place with anyway=True"):
        export(exported, form)
    found = parsed(export(exported, form, anyway=True), form)
    assert set(found["platform"]["inertia"].values()) == {None}
    assert found["platform"]["mass"] == CLOUD.mass
    same(found["linear"]["values"][:4], [CLOUD.mass, *CLOUD.first_moment])
    assert found["linear"]["values"][4:] == [None] * 6
    assert found["covariance"]["matrix"][9] == [None] * 10


def test_linear_parameters_need_only_what_is_in_them(tmp_path):
    ten = CLOUD.ten.copy()
    ten[[1, 8]] = np.nan  # cx, Jxz
    linear = read_exported(str(file_of(tmp_path, estimate_of(ten)))).linear_parameters
    known = np.isfinite(linear)
    assert [name for name, k in zip(LINEAR_PARAMETERS, known, strict=True) if k] == [
        "m",
        "hy",
        "hz",
        "Jxx",
        "Jyz",
    ]
    J = CLOUD.about_origin
    same(linear[[4, 7]], [J[0, 0], J[1, 2]])


def test_one_estimate_at_a_time(tmp_path):
    path = file_of(tmp_path, estimate_of(CLOUD.ten), estimate_of(UNIDENTIFIABLE, method="two-step"))
    assert read_exported(f"{tmp_path}:two-step").estimate.method == "two-step"
    assert read_exported(str(path), "two-step").estimate.method == "two-step"
    for place, method in ((f"{path}:all", None), (str(path), "all")):
        with pytest.raises(
            InputError,
            match=(
                r"expected one estimate to export, found 'all' \(maximum-likelihood, two-step\);"
                r" name one with methods"
            ),
        ):
            read_exported(place, method)
    with pytest.raises(InputError, match="expected an estimate of method 'consistent'"):
        read_exported(str(path), "consistent")


def test_formats_are_named(tmp_path):
    with pytest.raises(
        InputError,
        match=r"format: expected one of urdf, sdf, mjcf, yaml, json, c, iec61131, .* found 'stl'",
    ):
        text_of(tmp_path, CLOUD, "stl")


# Text from files stays text

HOSTILE = (
    "--><script>alert(1)</script><!--",
    "*/ #error /* \\",
    "---",
    "a-",
    "]]>&lol;<?x?>",
    "line\nbreak\r\n# x: y\t\x00\x1b[31m\x7f",
    "\u202e\u2028\ufeff\ud800",
    "??/??/ \\\\",
    "*??/\n/ #error",
    "'\"`${x}{{y}}%s",
    "Köln 実験",
    "*" * 50 + "/" * 50 + "-" * 301,
    "12e4567",
    "",
)


def hostile_file(folder, text):
    """An estimate with a text everywhere it may have one."""
    verdict = {
        "accepted": False,
        "reasons": [text, f"x{text}"],
        "parameters": dict.fromkeys(BODY_PARAMETERS, "data"),
    }
    entry = estimate_of(CLOUD.ten).to_dict() | {"verdict": verdict, "notes": [text]}
    values = {"format": FORMAT, "experiment": text, "result": text, "estimates": {text: entry}}
    path = folder / "estimate.json"
    path.write_text(json.dumps(values))
    (each,) = read_estimate_file(path).estimates.values()
    return exported_of(each)


@pytest.mark.mujoco
@pytest.mark.parametrize("text", HOSTILE)
def test_text_of_files_stays_text(tmp_path, text):
    exported = hostile_file(tmp_path, text)
    written = {form: export(exported, form, anyway=True) for form in FORMATS}
    for each in written.values():
        assert all(c == "\n" or c.isprintable() for c in each)
        each.encode()
    for form, tags in {
        "urdf": ["robot", "link", "inertial", "origin", "mass", "inertia"],
        "mjcf": ["mujoco", "worldbody", "body", "freejoint", "inertial"],
    }.items():
        assert [element.tag for element in ElementTree.fromstring(written[form]).iter()] == tags
    exactly(
        pin.buildModelFromXML(written["urdf"], pin.JointModelFreeFlyer()).inertias[1].mass,
        CLOUD.mass,
    )
    assert compiled_body(written["mjcf"])[0] == CLOUD.mass
    assert len(etree.fromstring(written["sdf"].encode()).findall(".//inertial")) == 1
    for form in ("yaml", "json"):
        found = parsed(written[form], form)
        assert found["platform"]["mass"] == CLOUD.mass
        assert found["experiment"] == exported.experiment
        assert len(found["verdict"]["reasons"]) == 2


@pytest.mark.parametrize("standard", ["c89", "c++17"])
def test_text_of_files_stays_text_in_c(tmp_path, standard):
    both = " ".join(HOSTILE)
    for text in (both, HOSTILE[1], HOSTILE[8]):
        header = export(hostile_file(tmp_path, text), "c", anyway=True)
        assert header.isascii()
        assert header.count("#error") == header.split("*/", 1)[0].count("#error")
        exactly(numbers_in_c(tmp_path, header, standard)[2], [CLOUD.mass])


# The verb


@pytest.mark.parametrize("form", FORMATS)
def test_the_verb_writes_one_file_and_says_its_convention(run, tmp_path, form):
    file_of(tmp_path, estimate_of(CLOUD.ten))
    out = tmp_path / "out" / "body"
    status, told, err = run("export", tmp_path, "--format", form, "--out", out)
    assert (status, err) == (0, "")
    assert told.count("\n") == 1
    assert told.startswith(f"{out}: 'maximum-likelihood' as {FORMATS[form].title}, ")
    assert (
        "principal moments about the centre of gravity and their axes"
        if form in ("kuka", "abb")
        else "about the centre of gravity in platform axes, products are elements of the matrix"
    ) in told
    assert out.read_text() == text_of(tmp_path, CLOUD, form)
    assert list(out.parent.iterdir()) == [out]


def test_the_verb_as_json(run, tmp_path):
    verdict = Verdict(False, ("runs disagree",), dict.fromkeys(BODY_PARAMETERS, "data"))
    file_of(tmp_path, estimate_of(CLOUD.ten, verdict=verdict))
    status, told, err = run(
        "export", tmp_path, "--format", "urdf", "--out", tmp_path / "b.urdf", "--anyway", "--json"
    )
    assert (status, err) == (0, "")
    found = json.loads(told, parse_constant=no_number)
    assert found["written"] == str(tmp_path / "b.urdf")
    assert found["format"] == "urdf"
    assert (found["accepted"], found["physical"], found["reasons"], found["unknown"]) == (
        False,
        True,
        ["runs disagree"],
        [],
    )


@pytest.mark.parametrize(
    ("ten", "options", "message"),
    [
        (UNIDENTIFIABLE, ["--format", "c"], "do not tell Jxx"),
        (IMPOSSIBLE, ["--format", "sdf"], "expected an accepted estimate"),
        (CLOUD.ten, ["--format", "urdf", "--robot", "cogiro"], "--robot: expected --format mjcf"),
        (CLOUD.ten, ["--format", "mjcf", "--pose", *"000000"], "--pose: expected --robot beside it"),
        (CLOUD.ten, ["--format", "mjcf", "--robot", "cogiro", "--pose", "nan", *"00000"], "--pose: expected six finite numbers"),
        (CLOUD.ten, ["--format", "mjcf", "--robot", "nobody"], "robot 'nobody': expected"),
        (CLOUD.ten, ["--format", "step"], "'step' is not one of"),
        (CLOUD.ten, ["--format", "urdf", "--method", "two-step"], "expected an estimate of method 'two-step'"),
    ],
)  # fmt: skip
def test_what_is_wrong_ends_with_one_sentence_and_no_file(run, tmp_path, ten, options, message):
    file_of(tmp_path, estimate_of(ten))
    status, told, err = run("export", tmp_path, *options, "--out", tmp_path / "new" / "body")
    assert (status, told) == (2, "")
    assert err.startswith("steelyard: ")
    assert err.count("\n") == 1
    assert message in err
    assert [path.name for path in tmp_path.iterdir()] == ["estimate.json"]


def test_nothing_is_overwritten_without_force_and_never_the_estimate(run, tmp_path):
    path = file_of(tmp_path, estimate_of(CLOUD.ten))
    before, out = path.read_bytes(), tmp_path / "body.json"
    out.write_text("mine")
    status, _, err = run("export", path, "--format", "json", "--out", out)
    assert (status, out.read_text()) == (2, "mine")
    assert "--force" in err
    assert run("export", path, "--format", "json", "--out", out, "--force")[0] == 0
    assert json.loads(out.read_text())["platform"]["mass"] == CLOUD.mass
    status, _, err = run("export", path, "--format", "json", "--out", path, "--force")
    assert (status, path.read_bytes()) == (2, before)
    assert "expected another file than the estimate" in err
