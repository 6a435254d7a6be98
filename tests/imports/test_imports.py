"""Robot files from other programs' formats: geometry, inertia and signs against other formulations,
and wrong input."""

import json
import math
import re

import casadi as ca
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from places import DATA
from scipy.spatial.transform import Rotation

from steelyard.errors import InputError
from steelyard.imports.formats import FORMATS, import_robot
from steelyard.inertia import BODY_PARAMETERS
from steelyard.robot import pulley
from steelyard.robot.file import read_robot

CASPR = DATA / "caspr"
MODELS = ("CAROCA", "CoGiRo", "IPAnema_1", "IPAnema_2")
TOLERANCE = 1e-12  # relative to numbers of order one: rounding of a few operations
SHEET = 0.025  # [kg m^2]: half a millimetre, to which the sheet gives the centre of gravity, times its first moment


def model(name):
    return [CASPR / name / f"{name}_{kind}.xml" for kind in ("bodies", "cables")]


def written(folder, **texts):
    """Files of the texts; a name's last underscore stands for the dot."""
    paths = []
    for name, text in texts.items():
        path = folder / ".".join(name.rsplit("_", 1))
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        paths.append(path)
    return paths


def body(imported):
    return imported.robot.platform.body_parameters


def noted(imported, pattern):
    return [note for note in imported.notes if re.search(pattern, note)]


# Small files of each format, of the same made-up robot


ANCHORS = [[-3.0, -2.0, 4.0], [3.0, -2.0, 4.5], [0.5, 2.5, 4.25]]
ATTACHMENTS = [[-0.3, -0.2, 0.4], [0.3, -0.2, 0.1], [0.1, 0.25, 0.2]]
ENTRIES = [[0.0, 0.0, 1.0], [0.0, -0.6, 0.8], [1.0, 0.0, 0.0]]
RADIUS = 0.05

MASSES = np.array([3.0, 5.0, 2.0, 4.0, 1.0])
PLACES = np.array(
    [[0.3, -0.1, 0.2], [0.2, 0.4, 0.1], [0.1, 0.2, -0.5], [-0.3, -0.3, 0.3], [0.6, 0.1, 0.4]]
)
MASS = MASSES.sum()
COG = MASSES @ PLACES / MASS


def integrals(about):
    """Moments and products of a cloud of points by their definitions: xx, yy, zz and +integral of
    yz, xz, xy."""
    x, y, z = (PLACES - about).T
    moments = [MASSES @ (y * y + z * z), MASSES @ (x * x + z * z), MASSES @ (x * x + y * y)]
    return moments, [MASSES @ (y * z), MASSES @ (x * z), MASSES @ (x * y)]


MOMENTS, PRODUCTS = integrals(COG)
CLOUD = np.array([MASS, *COG, *MOMENTS, *(-v for v in PRODUCTS)])
"""Of BODY_PARAMETERS, of the cloud."""


def spaced(values):
    return " ".join(repr(float(v)) for v in values)


def bodies_xml(
    *,
    reference="com",
    convention="integral",
    joint='type="SPATIAL_EULER_XYZ"',
    parent=(0, 0, 0),
    links=1,
):
    moments, products = integrals(COG if reference == "com" else np.zeros(3))
    sign = 1 if convention == "integral" else -1
    inertia = dict(
        zip(
            ("Ixx", "Iyy", "Izz", "Iyz", "Ixz", "Ixy"),
            [*moments, *(sign * v for v in products)],
            strict=True,
        )
    )
    link = f"""
  <link_rigid num="1" name="cloud">
    <joint {joint}/>
    <physical>
      <mass>{float(MASS)!r}</mass>
      <com_location>{spaced(COG)}</com_location>
      <end_location>0 0 0</end_location>
      <inertia ref="{reference}">{"".join(f"<{key}>{float(value)!r}</{key}>" for key, value in inertia.items())}</inertia>
    </physical>
    <parent><num>0</num><location>{spaced(parent)}</location></parent>
  </link_rigid>"""
    return (
        f'<?xml version="1.0"?>\n<bodies_system>\n <links>{link * links}\n'
        " </links>\n</bodies_system>\n"
    )


def cable_xml(
    i,
    *,
    tag="cable_ideal",
    reference="joint",
    pulleys=True,
    properties="",
    points=None,
    force=(10, 1000),
):
    base = (
        f"<base_rotating_pulley><fixed_location>{spaced(ANCHORS[i])}</fixed_location><pulley_radius>{RADIUS}</pulley_radius>"
        f"<cable_entry_vector>{spaced(ENTRIES[i])}</cable_entry_vector></base_rotating_pulley>"
        if pulleys
        else f"<attachment><link>0</link><location>{spaced(ANCHORS[i])}</location></attachment>"
    )
    place = np.array(ATTACHMENTS[i]) - (COG if reference == "com" else 0)
    end = f"<attachment><link>1</link><location>{spaced(place)}</location></attachment>"
    return (
        f'<{tag} name="cable {i}"'
        f' attachment_reference="{reference}"><properties><force_min>{force[0]}</force_min>'
        f"<force_max>{force[1]}</force_max>{properties}</properties><attachments>{points or base + end}</attachments></{tag}>\n"
    )


def cables_xml(*cables, default="main", **options):
    inside = "".join(cables or (cable_xml(i, **options) for i in range(3)))
    return (
        f'<cables default_cable_set="{default}">\n<cable_set'
        f' id="main">\n{inside}</cable_set>\n</cables>\n'
    )


def caspr(folder, **options):
    """Paths of a small model; options of the bodies begin with b_."""
    of_bodies = {key[2:]: value for key, value in options.items() if key.startswith("b_")}
    of_cables = {key: value for key, value in options.items() if not key.startswith("b_")}
    return written(
        folder, small_bodies_xml=bodies_xml(**of_bodies), small_cables_xml=cables_xml(**of_cables)
    )


def column(values):
    return json.dumps([[v] for v in values])


def irma_json(
    *, actuators=None, platform="", head='"motion_pattern": "THREE_R_THREE_T",', end="\n],"
):
    """Tabs and commas behind last items, as some of IRMA's files have them."""
    entries = actuators or "".join(
        f"""
\t{{ "active": true,
\t  "pulley": {{ "radius": {RADIUS}, "pos_OD_glob": {column(ANCHORS[i])}, "vers_i": [[1], [0], [0]], "vers_j": [[0], [1], [0]],
\t\t"vers_k": {column(ENTRIES[i])}, }},
\t  "winch": {{ "l0": 1, "pos_PA_loc": {column(ATTACHMENTS[i])} }}
\t}},"""
        for i in range(3)
    )
    Jxx, Jyy, Jzz, Jyz, Jxz, Jxy = CLOUD[4:]
    matrix = json.dumps([[Jxx, Jxy, Jxz], [Jxy, Jyy, Jyz], [Jxz, Jyz, Jzz]])
    return f"""{{ {head}
"actuator": [{entries}{end}
"platform": {{ "mass": {float(MASS)!r}, "gravity_axis": [[0], [0], [1]], "inertia_mat_G_loc": {matrix},
\t"pos_PG_loc": {column(COG)}, {platform} }}
}}
"""


def ros_yaml(*, inertia=None, extra="", indent=""):
    Jxx, Jyy, Jzz, Jyz, Jxz, Jxy = CLOUD[4:]
    values = inertia or f"inertia: {json.dumps([Jxx, Jyy, Jzz, Jxy, Jxz, Jyz])}"
    points = "\n".join(
        f"- frame: {a}\n  platform: {b}" for a, b in zip(ANCHORS, ATTACHMENTS, strict=True)
    )
    text = f"""\
cable: {{mass: 0.001, radius: 0.005}}
joints:
  actuated: {{damping: 1, effort: 10000, min: 50, velocity: 10}}
platform:
  {values}
  mass: {float(MASS)!r}
  position: {{rpy: [0, 0, 0], xyz: [0.9, 0.9, 0.2]}}
points:
{points}
{extra}"""
    return "".join(f"{indent}{line}\n" for line in text.splitlines())


TURNS = [
    np.eye(3),
    Rotation.from_euler("ZYX", [0.7, -0.4, 0.3]).as_matrix(),
    Rotation.from_rotvec([1, 2, 0.5]).as_matrix(),
]
ROLLS = [Rotation.from_euler("x", angle).as_matrix() for angle in (0.0, 1.1, math.pi)]


def cdpyr_values(*, convention="matrix", about=COG):
    moments, products = integrals(about)
    yz, xz, xy = ((-1 if convention == "matrix" else 1) * v for v in products)
    order = [2, 0, 1]  # of the anchors of the platform, to be put right by the chains
    return {
        "name": "cloud",
        "frame": {
            "anchors": [
                {
                    "position": ANCHORS[i],
                    "dcm": TURNS[i].tolist(),
                    "pulley": {"radius": RADIUS, "dcm": ROLLS[i].tolist(), "inertia": None},
                    "drivetrain": None,
                }
                for i in range(3)
            ]
        },
        "platforms": [
            {
                "name": "default",
                "anchors": [{"position": ATTACHMENTS[i], "dcm": np.eye(3).tolist()} for i in order],
                "motion_pattern": {"translation": 3, "rotation": 3},
                "center_of_gravity": COG.tolist(),
                "inertia": {
                    "linear": (MASS * np.eye(3)).tolist(),
                    "angular": [[moments[0], xy, xz], [xy, moments[1], yz], [xz, yz, moments[2]]],
                },
            }
        ],
        "cables": (
            [{"name": "Dyneema", "diameter": 0.006, "breaking_load": math.inf, "density": math.inf}]
            * 3
        ),
        "kinematic_chains": [
            {"frame_anchor": i, "platform": 0, "platform_anchor": order.index(i), "cable": i}
            for i in range(3)
        ],
    }


def cdpyr_json(**options):
    return json.dumps(cdpyr_values(**options), indent=2)


def attributes(names, values):
    return " ".join(f'{name}="{float(value)!r}"' for name, value in zip(names, values, strict=True))


TURN = [f"a{row}{column}" for row in "123" for column in "123"]


def wcrfx(
    *,
    root="models",
    robot='name="cloud" motionpattern="3R3T"',
    radius=RADIUS,
    turned=True,
    body=None,
    after='<controller ipo_clock="4"/></robot><cable name="Dyneema" elasticity="5e+10"'
    ' radius="0.003" weight="0.03" breaking_load="20000"/><winch name="IPAnema-Winch"/>',
    geometry=None,
):
    """A file as WireX writes it, of numbers with all their digits."""
    chains = "".join(
        f'<chain id="{i + 1}" winchtype="IPAnema-Winch"><base {attributes("xyz", ANCHORS[i])}'
        + (f" {attributes(TURN, (TURNS[i] @ ROLLS[i]).ravel())}" if turned else "")
        + (f' radius="{radius}"' if radius is not None else "")
        + f"/><platform {attributes('xyz', ATTACHMENTS[i])}/></chain>\n"
        for i in range(3)
    )
    if body is None:
        yz, xz, xy = (-v for v in PRODUCTS)
        tensor = [MOMENTS[0], xy, xz, xy, MOMENTS[1], yz, xz, yz, MOMENTS[2]]
        body = wcrfx_body(MASS, COG, tensor)
    chains = chains if geometry is None else geometry
    return (
        f'<{root} version="0.32"><robot {robot}>\n<geometry>{chains}</geometry>\n{body}{after}'
        f"</{root}>"
    )


def wcrfx_body(mass, cog, tensor):
    names = [f"I{row}{column}" for row in "xyz" for column in "xyz"]
    return (
        f'<platform name="p" mass="{float(mass)!r}" swing_angle="50"><inertiatensor'
        f" {attributes(names, tensor)}/><centerofgravity {attributes('xyz', cog)}/></platform>"
    )


# CASPR's own models


@pytest.mark.parametrize("name", MODELS)
def test_models_become_robot_files(name, run, tmp_path):
    status, out, err = run("import", *reversed(model(name)), "--out", tmp_path / "robot.yaml")
    assert (status, err) == (0, "")
    robot = read_robot(str(tmp_path / "robot.yaml"))
    assert robot.m == 8
    assert out.startswith(f"{tmp_path / 'robot.yaml'}: {robot.name}, 8 cables, from CASPR XML\n")
    np.testing.assert_array_equal(robot.gravity, [0, 0, -9.81])


def test_cogiro_is_the_bundled_one_but_for_its_shifted_anchors():
    imported, bundled = import_robot(model("CoGiRo")), read_robot("cogiro-cuboid")
    np.testing.assert_array_equal(body(imported), bundled.platform.body_parameters)
    np.testing.assert_allclose(
        imported.robot.attachments, bundled.attachments, atol=1.01e-4
    )  # one digit of the table
    apart = imported.robot.anchors - bundled.anchors
    np.testing.assert_allclose(
        1e3 * apart.mean(axis=0), [17.25, 5.125, -0.3125], atol=1e-9
    )  # [mm], of another survey
    assert np.linalg.norm(apart - apart.mean(axis=0), axis=1).max() < 3.2e-3
    assert imported.robot.tension_limits == (100.0, 5000.0)
    assert imported.robot.limits.position == ((-7, -5, 0), (7, 5, 5))
    assert imported.convention == "integral"
    assert noted(
        imported,
        r"yz -1\.539, xz 3\.012, xy -0\.453 are read as \+integral.*turned.*--products matrix",
    )
    assert noted(imported, "physics cannot decide the sign")


def test_the_two_matrices_of_the_sheet_are_one_body_only_with_its_signs(tmp_path):
    bodies, cables = model("CoGiRo")
    text = bodies.read_text().replace('inertia ref="com"', 'inertia ref="joint"')
    about_origin = {
        "Ixx": 42.955,
        "Iyy": 42.427,
        "Izz": 25.557,
        "Ixy": -0.414,
        "Ixz": 2.205,
        "Iyz": -1.849,
    }  # Eq. (2) of the sheet
    for key, value in about_origin.items():
        text = re.sub(f"<{key}>.*?</{key}>", f"<{key}>{value}</{key}>", text)
    paths = [*written(tmp_path, origin_xml=text), cables]
    expected = read_robot("cogiro-cuboid").platform.body_parameters
    np.testing.assert_allclose(body(import_robot(paths)), expected, atol=SHEET)
    assert (
        np.abs(body(import_robot(paths, products="matrix"))[7:] + expected[7:]).max() > 20 * SHEET
    )


def test_the_other_sign_is_taken_when_asked_for():
    imported = import_robot(model("CoGiRo"), products="matrix")
    np.testing.assert_array_equal(body(imported)[7:], [-1.539, 3.012, -0.453])
    assert imported.convention == "matrix"
    assert noted(
        imported,
        "are read as elements of the inertia matrix, as in a robot file: as --products says",
    )


def test_sets_of_cables_can_be_chosen():
    default, rollers = (
        import_robot(model("CAROCA")),
        import_robot(model("CAROCA"), cable_set="with_rotating_pulleys"),
    )
    assert noted(
        default,
        r"cable set 'original'; there are also with_rotating_pulleys, gazebo_sim \(--cables\)",
    )
    np.testing.assert_array_equal(default.robot.pulley_radius, np.zeros(8))
    np.testing.assert_array_equal(rollers.robot.pulley_radius, np.full(8, 0.045))
    np.testing.assert_array_equal(rollers.robot.pulley_axis, np.tile([0, 0, 1], (8, 1)))
    np.testing.assert_array_equal(rollers.robot.anchors, default.robot.anchors)
    assert default.robot.tension_limits == (0, 1000)


def test_limits_that_differ_are_those_that_all_cables_keep():
    imported = import_robot(model("IPAnema_1"), cable_set="IROS_CASPR_2016")
    assert imported.robot.tension_limits == (0, 200)
    assert noted(imported, "tension 0 to 200 N is what all cables allow: their limits differ")


# Inertia of a cloud of points, written in every way


@pytest.mark.parametrize("convention", ["integral", "matrix"])
@pytest.mark.parametrize("reference", ["com", "joint"])
def test_caspr_inertia_is_that_of_the_cloud(reference, convention, tmp_path):
    paths = caspr(tmp_path, b_reference=reference, b_convention=convention)
    imported = import_robot(paths, products=None if convention == "integral" else "matrix")
    np.testing.assert_allclose(
        body(imported), CLOUD, rtol=TOLERANCE, atol=10 * TOLERANCE, err_msg=str(BODY_PARAMETERS)
    )


@pytest.mark.parametrize("reference", ["com", "joint"])
def test_caspr_attachments_are_measured_from_where_the_file_says(reference, tmp_path):
    imported = import_robot(caspr(tmp_path, reference=reference))
    np.testing.assert_allclose(imported.robot.attachments, ATTACHMENTS, atol=TOLERANCE)
    assert bool(noted(imported, "measured from the centre of gravity: .* was added")) == (
        reference == "com"
    )


def test_irma_inertia_is_that_of_the_cloud(tmp_path):
    imported = import_robot(written(tmp_path, small_json=irma_json()))
    np.testing.assert_allclose(body(imported), CLOUD, rtol=TOLERANCE)
    assert imported.convention == "matrix"


def test_ros_inertia_is_that_of_the_cloud_at_the_origin(tmp_path):
    imported = import_robot(written(tmp_path, small_yaml=ros_yaml()))
    np.testing.assert_allclose(
        body(imported), np.where(np.isin(np.arange(10), (1, 2, 3)), 0, CLOUD), rtol=TOLERANCE
    )
    assert noted(imported, "centre of gravity at the origin")
    assert noted(imported, "products of inertia .* as the controllers of these packages")


@pytest.mark.parametrize("convention", ["integral", "matrix"])
@pytest.mark.parametrize(("about", "point"), [(None, COG), ("cog", COG), ("origin", np.zeros(3))])
def test_cdpyr_inertia_is_that_of_the_cloud(about, point, convention, tmp_path):
    paths = written(tmp_path, small_json=cdpyr_json(convention=convention, about=point))
    imported = import_robot(paths, products=convention, about=about)
    np.testing.assert_allclose(body(imported), CLOUD, rtol=TOLERANCE, atol=10 * TOLERANCE)
    assert noted(imported, "which is assumed" if about is None else "as --inertia-about says")


# Signs


@pytest.mark.parametrize(
    ("files", "asked"),
    [
        ({"small_json": cdpyr_json()}, r"small\.json:\d+: 'platforms\[0\]\.inertia'"),
        (
            {"small_yaml": ros_yaml(inertia="inertial: {xx: 2, yy: 2, zz: 2, xy: 0.25}")},
            r"small\.yaml:4: 'platform'",
        ),
    ],
)
def test_signs_that_a_format_does_not_tell_are_asked_for(files, asked, run, tmp_path):
    paths = written(tmp_path, **files)
    status, out, err = run("import", *paths, "--out", tmp_path / "robot.yaml")
    assert (status, out) == (2, "")
    assert re.search(
        f"{asked}: expected products of inertia whose sign is known, found .* say with --products"
        " matrix .* or with --products",
        err,
    )
    assert not (tmp_path / "robot.yaml").exists()
    status, out, err = run(
        "import", *paths, "--out", tmp_path / "robot.yaml", "--products", "integral"
    )
    assert (status, err) == (0, "")
    assert "as --products says" in out


def test_products_of_zero_need_no_sign(tmp_path):
    imported = import_robot(
        written(tmp_path, small_yaml=ros_yaml(inertia="inertial: {xx: 2, yy: 2, zz: 2}"))
    )
    assert imported.convention is None
    assert not noted(imported, "products")
    assert '"xy": -0.0' not in json.dumps(imported.values)


PHYSICS = [
    # moments and products (xy, xz, yz) that are a body as they stand, with the other sign, with
    # both, with neither
    (
        "[1, 1, 1, 0.45, 0.45, 0.45]",
        "matrix",
        False,
        "with products of the other sign .--products integral. a body can exist",
    ),
    ("[1, 1, 1, 0.45, 0.45, 0.45]", "integral", True, "the sign of the products is that of a body"),
    ("[1, 1, 1, 0.1, 0.1, 0.1]", "matrix", True, "physics cannot decide the sign"),
    ("[1, 1, 5, 0.1, 0.1, 0.1]", "matrix", False, "nor can one with products of the other sign"),
]


@pytest.mark.parametrize(("inertia", "products", "physical", "said"), PHYSICS)
def test_physics_is_reported_and_what_it_says_of_the_sign(
    inertia, products, physical, said, tmp_path
):
    imported = import_robot(
        written(tmp_path, small_yaml=ros_yaml(inertia=f"inertia: {inertia}")), products=products
    )
    assert imported.robot.platform.is_physical == imported.to_dict()["physical"] == physical
    assert bool(noted(imported, "no solid body has this inertia: its principal moments are ")) == (
        not physical
    )
    assert noted(imported, said)


# Rollers: where the cable leaves, by each program's own construction


def unit(vector):
    return np.asarray(vector) / np.linalg.norm(vector)


def leaves_as_in_caspr(entry, direction, target):
    """Point of tangency of the circle beside the entry point, in the plane of entry and target."""
    normal = unit(np.cross(direction, target - entry))
    centre = entry + RADIUS * unit(np.cross(normal, direction))
    to_target = target - centre
    share = RADIUS / np.linalg.norm(to_target)
    return (
        centre
        + share**2 * to_target
        - share * math.sqrt(1 - share**2) * np.cross(normal, to_target)
    )


def leaves_as_in_irma(swivel_point, k, target):
    """Swivel angle in the plane square to k, tangent angle by the half-angle formula, exit point D
    + r (u + n)."""
    d = target - swivel_point
    u = unit(d - (d @ k) * k)
    slope = (d @ k) / (d @ u)
    psi = 2 * math.atan(slope + math.sqrt(1 - 2 * RADIUS / (d @ u) + slope**2))
    return swivel_point + RADIUS * (u + u * math.cos(psi) + k * math.sin(psi))


def leaves_as_in_cdpyr(anchor, R_world_roller, target):
    """Radius and free length as a 2 x 2 system in the turned frame of the roller."""
    x, y, z = R_world_roller.T @ (target - anchor)
    swivel = math.atan2(y, x)
    outward = math.hypot(x, y) - RADIUS
    free = math.sqrt(outward**2 + z**2 - RADIUS**2)
    cos, sin = np.linalg.solve([[RADIUS, free], [-free, RADIUS]], [outward, z])
    local = np.array([RADIUS + RADIUS * cos, 0, RADIUS * sin])
    return anchor + R_world_roller @ Rotation.from_euler("z", swivel).apply(local)


def leaves_as_in_wirex(anchor, R_world_base, target):
    """Wrap angle by two arc cosines seen from the centre; the exit point is the entry point turned
    by it about the local y axis."""
    x, y, z = R_world_base.T @ (target - anchor)
    outward = math.hypot(x, y) - RADIUS
    distance = math.hypot(outward, z)
    free = math.sqrt(distance**2 - RADIUS**2)
    wrap = math.acos(free / distance) + math.acos(z / distance)
    turned = Rotation.from_euler("y", wrap).apply([-RADIUS, 0, 0])
    swivelled = Rotation.from_euler("z", math.atan2(y, x)).apply(np.add(turned, [RADIUS, 0, 0]))
    return anchor + R_world_base @ swivelled


def leaves_in_steelyard(robot, i, target):
    roller = pulley.swivel(
        ca.DM(robot.anchors[i]), ca.DM(robot.pulley_axis[i]), robot.pulley_radius[i], ca.DM(target)
    )
    point = pulley.leave_point(roller, pulley.straight_wrap(roller, ca.DM(target)))
    return np.array(point).ravel()


ROLLERS = {
    "caspr": (
        caspr,
        lambda i, target: leaves_as_in_caspr(np.array(ANCHORS[i]), np.array(ENTRIES[i]), target),
    ),
    "irma": (
        lambda folder: written(folder, small_json=irma_json()),
        lambda i, target: leaves_as_in_irma(np.array(ANCHORS[i]), np.array(ENTRIES[i]), target),
    ),
    "cdpyr": (
        lambda folder: written(folder, small_json=cdpyr_json()),
        lambda i, target: leaves_as_in_cdpyr(np.array(ANCHORS[i]), TURNS[i] @ ROLLS[i], target),
    ),
    "wirecenter": (
        lambda folder: written(folder, small_wcrfx=wcrfx()),
        lambda i, target: leaves_as_in_wirex(np.array(ANCHORS[i]), TURNS[i] @ ROLLS[i], target),
    ),
}


@pytest.mark.parametrize("name", ROLLERS)
def test_cables_leave_the_rollers_where_the_other_program_has_it(name, tmp_path, rng):
    files, leaves = ROLLERS[name]
    robot = import_robot(files(tmp_path), products="matrix").robot
    np.testing.assert_array_equal(robot.pulley_radius, np.full(3, RADIUS))
    for i in range(3):
        for _ in range(20):
            R, p = (
                Rotation.random(random_state=rng).as_matrix(),
                rng.uniform([-1, -1, 0.5], [1, 1, 2.5]),
            )
            target = p + R @ robot.attachments[i]
            np.testing.assert_allclose(
                leaves_in_steelyard(robot, i, target), leaves(i, target), atol=1e-10
            )


# What else the formats hold


def test_all_small_files_are_the_same_robot(tmp_path):
    found = [
        import_robot(paths, products=products).robot
        for paths, products in (
            (caspr(tmp_path), None),
            (written(tmp_path, small_json=irma_json()), None),
            (written(tmp_path, small_yaml=ros_yaml()), None),
            (written(tmp_path, other_json=cdpyr_json()), "matrix"),
            (written(tmp_path, small_wcrfx=wcrfx()), "matrix"),
        )
    ]
    for robot in found:
        np.testing.assert_array_equal(robot.anchors, ANCHORS)
        np.testing.assert_array_equal(robot.attachments, ATTACHMENTS)
    assert [robot.name for robot in found] == ["cloud", "small", "small", "cloud", "cloud"]


@pytest.mark.parametrize("name", ["renamed.txt", "model.yaml", "no-ending"])
def test_formats_are_known_by_their_content(name, tmp_path):
    (tmp_path / name).write_text(irma_json())
    assert import_robot([tmp_path / name]).format == "IRMA JSON"


@pytest.mark.parametrize("about", ["cog", "origin"])
@pytest.mark.parametrize("convention", ["matrix", "integral"])
def test_wirecenter_inertia_is_that_of_the_cloud(about, convention, tmp_path):
    moments, products = integrals(COG if about == "cog" else np.zeros(3))
    yz, xz, xy = ((-1 if convention == "matrix" else 1) * v for v in products)
    tensor = [moments[0], xy, xz, xy, moments[1], yz, xz, yz, moments[2]]
    text = wcrfx(body=wcrfx_body(MASS, COG, tensor))
    paths = written(tmp_path, small_wcrfx=text)
    found = import_robot(paths, products=convention, about=about)
    np.testing.assert_allclose(body(found), CLOUD, atol=1e3 * TOLERANCE)
    with pytest.raises(InputError, match="expected products of inertia whose sign is known"):
        import_robot(paths)


def test_what_wirecenter_writes_of_itself_is_no_robot(tmp_path):
    """Its reader takes the geometry alone, its writer adds the cable and the body of the program."""
    defaults = wcrfx_body(25, (0, 1, 0.2), np.diag([2, 3, 4]).ravel())
    found = import_robot(written(tmp_path, a_wcrfx=wcrfx(body=defaults, radius=0.1)))
    assert found.robot.platform is None
    assert found.robot.cable.axial_stiffness is None
    assert noted(found, r"no platform: the file has the one that WireX begins with \(25 kg")
    assert noted(found, r"all rollers have the 0\.1 m that WireX begins with: check them")
    E_A = 5e10 * math.pi * 0.003**2
    stiffness = re.escape(f"{E_A:.4g}")
    assert noted(found, rf"cable left out \(elasticity 5e\+10.*axial_stiffness is {stiffness} N")
    assert noted(found, "gravity 9.81 m/s\\^2 along -z: WireX's constant")
    stated = import_robot(written(tmp_path, b_wcrfx=wcrfx()), products="matrix")
    assert not noted(stated, "begins with|no platform|no orientation")


def test_wirecenter_files_without_rollers_or_orientations(tmp_path):
    points = import_robot(written(tmp_path, a_wcrfx=wcrfx(radius=None)), products="matrix")
    assert not points.robot.pulley_radius.any()
    assert noted(points, r"rollers of 3 cables left out: no radius is stated \(WireX .* 0\.1 m\)")
    zero = import_robot(written(tmp_path, b_wcrfx=wcrfx(radius=0.0)), products="matrix")
    assert not zero.robot.pulley_radius.any()
    upright = import_robot(written(tmp_path, c_wcrfx=wcrfx(turned=False)), products="matrix")
    np.testing.assert_array_equal(upright.robot.pulley_axis, [[0, 0, 1]] * 3)
    assert noted(upright, "rollers swivel about z, along which the cables come")
    no_mass = wcrfx(body="<platform name='p'/>")
    assert noted(import_robot(written(tmp_path, d_wcrfx=no_mass)), "no mass of it")
    no_tensor = wcrfx(body="<platform mass='3'/>")
    assert noted(import_robot(written(tmp_path, e_wcrfx=no_tensor)), "no inertia or no centre")
    of_cdpyr = wcrfx(body=wcrfx_body(3, COG, [math.inf] * 9))
    assert noted(import_robot(written(tmp_path, f_wcrfx=of_cdpyr)), "infinite, .* cdpyr")


def test_a_wirecenter_file_of_six_digits_is_read(tmp_path):
    """WireX writes numbers with six significant digits, so that its rotations are none by 1e-6."""
    text = re.sub(r'"(-?\d+\.\d+)"', lambda found: f'"{float(found[1]):g}"', wcrfx())
    found = import_robot(written(tmp_path, small_wcrfx=text), products="matrix").robot
    exact = import_robot(written(tmp_path, exact_wcrfx=wcrfx()), products="matrix").robot
    np.testing.assert_allclose(found.pulley_axis, exact.pulley_axis, atol=2e-6)


WIRECENTER = {
    "the older form": (
        '<models><wireRobot><systemParameter units="8"/></wireRobot></models>',
        r"expected 'robot' inside, found 'wireRobot', the older form; load it in WireCenter",
    ),
    "a planar robot": (
        wcrfx(robot='name="cloud" motionpattern="1R2T"'),
        r"expected the motionpattern '3R3T', found '1R2T'",
    ),
    "no chain": (wcrfx(geometry="", body=""), r"expected cables, found none"),
    "a chain without base": (
        wcrfx(geometry='<chain id="1"><platform x="0" y="0" z="0"/></chain>'),
        r"'chain': expected 'base' inside, found none",
    ),
    "a base without height": (
        wcrfx().replace('z="4.0"', "", 1),
        r"'base': expected the attribute 'z', found none",
    ),
    "a radius below zero": (wcrfx(radius=-0.1), r"expected a radius at least 0, found -0\.1"),
    "half an orientation": (
        wcrfx().replace('a33="1.0"', "", 1),
        r"'base': expected the attribute 'a33', found none",
    ),
    "an orientation that is none": (
        wcrfx().replace('a11="1.0"', 'a11="2.0"', 1),
        r"'base': expected a rotation matrix in a11 to a33",
    ),
    "a platform without weight": (
        wcrfx(body=wcrfx_body(0, COG, np.eye(3).ravel())),
        r"'platform': expected a mass above 0, found 0",
    ),
    "a tensor that is not symmetric": (
        wcrfx(body=wcrfx_body(3, COG, [1, 0.5, 0, 0, 1, 0, 0, 0, 1])),
        r"'inertiatensor': expected a symmetric matrix",
    ),
    "two robots": (
        wcrfx().replace("<robot", "<robot/><robot", 1),
        r"expected one 'robot' in 'models', found 2",
    ),
}


@pytest.mark.parametrize("what", WIRECENTER)
def test_wrong_wirecenter_files_are_one_sentence(what, run, tmp_path):
    text, pattern = WIRECENTER[what]
    assert_refused(run, written(tmp_path, small_wcrfx=text), pattern, tmp_path)


def test_caspr_springs_tell_the_stiffness(tmp_path):
    alike = import_robot(
        caspr(
            tmp_path, tag="cable_linear_spring", properties="<K>13000</K><diameter>0.002</diameter>"
        )
    )
    assert (alike.robot.cable.axial_stiffness, alike.robot.cable.diameter) == (13000, 0.002)
    assert noted(
        alike, "axial_stiffness is K of 'cable_linear_spring', which CASPR divides by the length"
    )
    cables = [
        cable_xml(i, tag="cable_linear_spring", properties=f"<K>{i + 1}000</K>") for i in range(3)
    ]
    differing = import_robot(written(tmp_path, b_xml=bodies_xml(), c_xml=cables_xml(*cables)))
    assert differing.robot.cable.axial_stiffness is None
    assert noted(
        differing, r"axial_stiffness left out: it differs between the cables \(1000 to 3000\)"
    )
    variable = import_robot(
        caspr(tmp_path, tag="cable_vsd_polynomial", properties="<force_error>1</force_error>")
    )
    assert noted(variable, "stiffness of 3 cables left out: it depends on the tension")


def test_caspr_limits_of_the_joint(tmp_path):
    half = 'type="SPATIAL_EULER_XYZ" q_min="-1 -2 0 {0} {0} {0}" q_max="1 2 {1} {2} {2} {2}"'
    free = import_robot(
        caspr(tmp_path, b_joint=half.format(-3.1416, 3, 3.1416), b_parent=(0.5, 0, 1))
    )
    assert free.robot.limits.position == ((-0.5, -2, 1), (1.5, 2, 4))
    assert not noted(free, "limits of")
    turning = import_robot(caspr(tmp_path, b_joint=half.format(-0.5, 3, 0.5)))
    assert turning.robot.limits.rpy is None
    assert noted(turning, "limits of rotation left out: CASPR's angles are R = Rx Ry Rz")
    endless = import_robot(caspr(tmp_path, b_joint=half.format(-4, "Inf", 4)))
    assert endless.robot.limits.position is None
    assert noted(endless, "limits of position left out")


def test_caspr_points_of_routing_are_left_out(tmp_path):
    def point(link, place):
        return f"<attachment><link>{link}</link><location>{spaced(place)}</location></attachment>"

    ways = [
        point(0, [9, 9, 9]) + point(0, ANCHORS[0]) + point(1, ATTACHMENTS[0]),
        point(1, ATTACHMENTS[1]) + point(0, ANCHORS[1]),
        point(0, ANCHORS[2]) + point(1, ATTACHMENTS[2]) + point(1, [9, 9, 9]),
    ]
    cables = [cable_xml(i, points=points) for i, points in enumerate(ways)]
    imported = import_robot(written(tmp_path, b_xml=bodies_xml(), c_xml=cables_xml(*cables)))
    np.testing.assert_array_equal(imported.robot.anchors, ANCHORS)
    np.testing.assert_array_equal(imported.robot.attachments, ATTACHMENTS)
    assert noted(
        imported,
        "of 2 cables, points before the last on the base and after the first on the platform are"
        " left out",
    )


def test_caspr_forces_without_bounds(tmp_path):
    imported = import_robot(caspr(tmp_path, force=(5, "inf")))
    assert imported.robot.tension_limits == (0, math.inf)
    assert noted(imported, "lowest tension left out: there is no highest one")
    empty = import_robot(caspr(tmp_path, force=(500, 400)))
    assert noted(empty, r"no tension is allowed in all cables \(at least 500, at most 400 N\)")
    pushing = import_robot(caspr(tmp_path, force=(-5, 400)))
    assert pushing.robot.tension_limits == (0, 400)
    assert noted(pushing, "lowest tension -5 N is read as 0")


def test_irma_gravity_may_be_tilted(tmp_path):
    tilted = irma_json().replace("[[0], [0], [1]]", "[[0], [0.6], [0.8]]", 10)
    np.testing.assert_allclose(
        import_robot(written(tmp_path, t_json=tilted)).robot.gravity,
        [0, -0.6 * 9.80665, -0.8 * 9.80665],
    )
    older = import_robot(written(tmp_path, o_json=irma_json().replace("gravity_axis", "grav_ax")))
    np.testing.assert_array_equal(older.robot.gravity, [0, 0, -9.80665])
    none = import_robot(written(tmp_path, n_json=irma_json().replace("gravity_axis", "axis")))
    np.testing.assert_array_equal(none.robot.gravity, [0, 0, -9.80665])
    assert noted(none, "gravity 9.80665 m/s.2 along -z: the file has no 'gravity_axis'")


def test_irma_actuators_that_are_not_active_are_left_out(tmp_path):
    imported = import_robot(
        written(tmp_path, small_json=irma_json().replace('"active": true', '"active": false', 1))
    )
    np.testing.assert_array_equal(imported.robot.anchors, ANCHORS[1:])
    assert noted(imported, r"actuators 0 \(counted from 0\) are not active and left out")


def test_irma_rollers_on_the_platform_are_left_out(tmp_path):
    text = irma_json().replace("pos_OD_glob", "pos_OA_glob").replace("pos_PA_loc", "pos_PD_loc")
    imported = import_robot(written(tmp_path, small_json=text))
    np.testing.assert_array_equal(imported.robot.anchors, ANCHORS)
    np.testing.assert_array_equal(imported.robot.attachments, ATTACHMENTS)
    np.testing.assert_array_equal(imported.robot.pulley_radius, np.zeros(3))
    assert noted(
        imported, "winches are on the platform: .* rollers of radius up to 0.05 m are left out"
    )


def test_older_irma_files(tmp_path):
    cables = ", ".join(
        f'{{"swivel_pulley_r": {RADIUS}, "pos_OD_glob": {column(a)}, "pos_PA_loc": {b}, "vers_k":'
        f" {column(k)}}}"
        for a, b, k in zip(ANCHORS, ATTACHMENTS, ENTRIES, strict=True)
    )
    text = irma_json(actuators=cables, end="],").replace('"actuator"', '"cable"')
    old, new = (import_robot(written(tmp_path, o_json=each)).robot for each in (text, irma_json()))
    for key in ("anchors", "attachments", "pulley_radius", "pulley_axis"):
        np.testing.assert_array_equal(getattr(old, key), getattr(new, key))


def test_irma_loads_are_told(tmp_path):
    imported = import_robot(
        written(tmp_path, small_json=irma_json(platform='"ext_force_loc": [[0], [0], [-5]],'))
    )
    assert noted(imported, r"constant load on the platform left out: ext_force_loc \(0, 0, -5\)")


def test_ros_files_may_have_the_robot_under_model(tmp_path):
    paths = written(
        tmp_path,
        small_yaml="controllers: {}\nmodel:\n" + ros_yaml(indent="  "),
        plain_yaml=ros_yaml(),
    )
    nested, plain = (import_robot([path]) for path in paths)
    assert nested.values == {**plain.values, "name": "small"}
    assert plain.robot.tension_limits == (50, 10000)
    assert plain.robot.cable.diameter == 0.01
    assert plain.robot.limits.cable_speed == 10
    assert noted(plain, r"not read: .*platform\.position.*cable\.mass")
    assert noted(plain, "gravity 9.81 m/s.2 along -z is assumed")


def test_a_ros_file_without_inertia_is_a_robot_without_platform(tmp_path):
    imported = import_robot(written(tmp_path, small_yaml=ros_yaml(inertia="color: Blue")))
    assert imported.robot.platform is None
    assert noted(imported, "no platform: the file has no inertia of it")
    assert imported.to_dict()["physical"] is None


def test_cdpyr_files_of_yaml_are_those_of_json(tmp_path):
    values = cdpyr_values()
    text = json.dumps(values).replace("Infinity", ".inf")
    tagged = re.sub(r"\[", "!!python/tuple [", text)
    paths = written(tmp_path, a_json=json.dumps(values), b_yaml=text, c_yaml=tagged)
    first, *others = (import_robot([path], products="matrix") for path in paths)
    assert all(each.values == first.values for each in others)


def test_a_cdpyr_platform_without_inertia_is_left_out(tmp_path):
    values = cdpyr_values()
    values["platforms"][0]["inertia"]["angular"] = np.diag([math.inf] * 3).tolist()
    imported = import_robot(written(tmp_path, small_json=json.dumps(values)))
    assert imported.robot.platform is None
    assert noted(imported, "its inertia is infinite, which is how cdpyr says that it was not given")


# The file that is written


def test_the_robot_file_says_where_it_comes_from(run, tmp_path):
    run("import", *model("CoGiRo"), "--out", tmp_path / "robot.yaml")
    head = [
        line for line in (tmp_path / "robot.yaml").read_text().splitlines() if line.startswith("#")
    ]
    text = " ".join(line.removeprefix("#").strip() for line in head)
    assert re.match(
        r"From CoGiRo_bodies\.xml \(sha256 [0-9a-f]{16}\) and CoGiRo_cables\.xml \(sha256"
        r" [0-9a-f]{16}\), CASPR XML",
        text,
    )
    for note in import_robot(model("CoGiRo")).notes:
        assert note in text


def test_json_has_the_notes(run, tmp_path):
    status, out, err = run(
        "import", *model("CoGiRo"), "--out", tmp_path / "robot.yaml", "--json", "--quiet"
    )
    assert (status, err) == (0, "")
    summary = json.loads(out)
    assert summary["robot"] == str(tmp_path / "robot.yaml")
    assert (
        summary["name"],
        summary["format"],
        summary["cables"],
        summary["products"],
        summary["physical"],
    ) == (
        "CoGiRo",
        "CASPR XML",
        8,
        "integral",
        True,
    )
    assert summary["files"] == [str(path) for path in model("CoGiRo")]
    assert summary["notes"] == list(import_robot(model("CoGiRo")).notes)


def test_the_same_files_give_the_same_bytes(run, tmp_path):
    for name in ("a.yaml", "b.yaml"):
        run("import", *model("CAROCA"), "--out", tmp_path / name)
    assert (tmp_path / "a.yaml").read_bytes() == (tmp_path / "b.yaml").read_bytes()


def test_files_are_replaced_only_when_asked_for(run, tmp_path):
    target = tmp_path / "robot.yaml"
    target.write_text("mine")
    status, out, err = run("import", *model("CoGiRo"), "--out", target)
    assert (status, out, target.read_text()) == (2, "", "mine")
    assert "expected a new file, found one of that name" in err
    assert "--force" in err
    assert run("import", *model("CoGiRo"), "--out", target, "--force")[0] == 0
    assert read_robot(str(target)).name == "CoGiRo"
    assert [path.name for path in tmp_path.iterdir()] == ["robot.yaml"]


def test_a_file_that_is_read_is_not_replaced(run, tmp_path):
    (path,) = written(tmp_path, small_json=irma_json())
    status, _, err = run("import", path, "--out", path, "--force")
    assert (status, path.read_text()) == (2, irma_json())
    assert "expected another file than those that are read" in err


def test_nothing_is_written_where_something_is_wrong(run, tmp_path):
    (path,) = written(tmp_path, small_json=irma_json().replace('"mass"', '"weight"'))
    assert run("import", path, "--out", tmp_path / "new" / "robot.yaml")[0] == 2
    assert [each.name for each in tmp_path.iterdir()] == ["small.json"]


# Wrong and hostile input


BOMB = '<!DOCTYPE b [<!ENTITY a "aaaaaaaaaa">' + "".join(
    f'<!ENTITY {chr(98 + i)} "{f"&{chr(97 + i)};" * 10}">' for i in range(12)
)


def fields(old, new, text):
    assert old in text, old
    return text.replace(old, new, 1)


XML = {
    "entities that grow": (
        f"{BOMB}]><bodies_system>&m;</bodies_system>",
        r":1: expected XML without entities and attribute lists of its own",
    ),
    "an external entity": (
        '<!DOCTYPE b [<!ENTITY x SYSTEM "file:///etc/passwd">]><bodies_system>&x;</bodies_system>',
        r":1: expected XML without entities and attribute lists of its own",
    ),
    "an entity of the missing definition": (
        '<!DOCTYPE bodies_system SYSTEM "bodies.dtd">\n<bodies_system>&x;</bodies_system>',
        r":2: expected XML without entities of its own, found 'x'",
    ),
    "a parameter entity": (
        '<!DOCTYPE b [<!ENTITY % p "x">]><bodies_system/>',
        r"expected XML without entities",
    ),
    "a tag that is not closed": (
        "<bodies_system><links></bodies_system>",
        r":1: expected XML, found a mistake in it \(mismatched tag\)",
    ),
    "a cut file": (bodies_xml()[:500], r":\d+: expected XML, found a mistake in it"),
    "deep": (
        "<a>" * 1000 + "</a>" * 1000,
        r"expected at most 100000 elements, 64 deep, found more",
    ),
    "many elements": ("<a>" + "<b/>" * 100_001 + "</a>", r"expected at most 100000 elements"),
    "large": ("<a>" + " " * (1 << 22) + "</a>", r"expected at most 4 MiB of XML, found 4 MiB"),
    "an unknown encoding": (
        '<?xml version="1.0" encoding="klingon"?><a/>',
        r"found an encoding that is not known",
    ),
    "binary": (b"<\x00\x01\x02", r"expected XML, found a mistake in it"),
    "another root": (
        "<robot/>",
        (
            r"expected one of CASPR XML .*IRMA JSON.*cdpyr.*ROS-style YAML.*, found XML with the"
            r" root 'robot'"
        ),
    ),
    "many links": (
        bodies_xml(links=2),
        r"expected one 'link_rigid', found 2 links; a robot file describes one platform",
    ),
    "another joint": (
        bodies_xml(joint='type="S_EULER_XYZ"'),
        r"'joint': expected a joint that carries nothing .*found 'S_EULER_XYZ'",
    ),
    "an actuated joint": (
        bodies_xml(joint='type="SPATIAL_EULER_XYZ" actuated="true"'),
        r"expected a joint without actuator",
    ),
    "limits of three": (
        bodies_xml(joint='type="SPATIAL_EULER_XYZ" q_min="0 0 0" q_max="1 1 1"'),
        r"'joint': expected 6 numbers, found '0 0 0'",
    ),
    "no mass": (
        fields("<mass>15.0</mass>", "", bodies_xml()),
        r":6: 'physical': expected 'mass' inside, found none; add it",
    ),
    "two masses": (
        fields("<mass>", "<mass>1</mass><mass>", bodies_xml()),
        r"expected one 'mass' in 'physical', found 2",
    ),
    "a mass of zero": (
        fields("15.0", "0", bodies_xml()),
        r"'mass': expected a number above 0, found 0",
    ),
    "a mass that is no number": (
        fields("15.0", "nan", bodies_xml()),
        r":7: 'mass': expected a number, found 'nan'",
    ),
    "a mass beyond everything": (
        fields("15.0", "1e300", bodies_xml()),
        r"'mass': expected a number, found '1e300'",
    ),
    "a number with an underscore": (
        fields("15.0", "1_5", bodies_xml()),
        r"'mass': expected a number, found '1_5'",
    ),
    "a vector of two": (
        fields("<end_location>0 0 0", "<end_location>0 0", bodies_xml()),
        r"'end_location': expected 3 numbers, found '0 0'",
    ),
    "another reference of the inertia": (
        fields('ref="com"', 'ref="world"', bodies_xml()),
        r"'inertia': expected ref 'com' or 'joint', found 'world'",
    ),
}


@pytest.mark.parametrize("what", XML)
def test_wrong_bodies_are_one_sentence(what, run, tmp_path):
    text, pattern = XML[what]
    assert_refused(
        run,
        written(tmp_path, small_bodies_xml=text, small_cables_xml=cables_xml()),
        pattern,
        tmp_path,
    )


def two(**options):
    return [cable_xml(i, **(options if i == 1 else {})) for i in range(3)]


CABLES = {
    "no sets": ("<cables/>", r"'cables': expected a 'cable_set', found none"),
    "an unknown default": (
        cables_xml(default="x").replace("</cables>", '<cable_set id="b"></cable_set></cables>'),
        r"expected 'default_cable_set' to be one of main, b, found 'x'",
    ),
    "two sets of one name": (
        cables_xml().replace("</cables>", '<cable_set id="main"></cable_set></cables>'),
        r"expected each 'cable_set' with an id of its own, found main, main",
    ),
    "an empty set": ('<cables><cable_set id="main"/></cables>', r"expected cables, found none"),
    "a passive spring": (
        cables_xml(*two(tag="cable_passive_linear_spring")),
        r"expected one of cable_ideal, .* found 'cable_passive_linear_spring'",
    ),
    "another reference": (
        cables_xml().replace('attachment_reference="joint"', 'attachment_reference="world"', 1),
        r"expected attachment_reference 'joint' or 'com', found 'world'",
    ),
    "no reference": (
        cables_xml().replace(' attachment_reference="joint"', "", 1),
        r"expected the attribute 'attachment_reference'",
    ),
    "a moving anchor": (
        cables_xml().replace("base_rotating_pulley", "screw_base_rotating_pulley"),
        r"expected 'attachment' or 'base_rotating_pulley', found 'screw_base_rotating_pulley'",
    ),
    "one point": (
        cables_xml(
            *two(points="<attachment><link>0</link><location>0 0 0</location></attachment>")
        ),
        r"expected points on link 0 and then on link 1, found links 0;",
    ),
    "a cable that goes back": (
        cables_xml(
            *two(
                points="".join(
                    f"<attachment><link>{i}</link><location>{i} 0 0</location></attachment>"
                    for i in (0, 1, 0)
                )
            )
        ),
        r"expected points on link 0 and then on link 1, found links 0, 1, 0;",
    ),
    "a roller without direction": (
        cables_xml().replace("<cable_entry_vector>0.0 0.0 1.0", "<cable_entry_vector>0 0 0", 1),
        r"'cable_entry_vector': expected a direction, found a vector of length 0",
    ),
    "a negative radius": (
        cables_xml().replace(f"{RADIUS}</p", "-1</p", 1),
        r"'pulley_radius': expected a number at least 0, found -1",
    ),
    "anchors that coincide": (
        cables_xml(pulleys=False).replace(spaced(ANCHORS[1]), spaced(ANCHORS[0])),
        (
            r"small_cables\.xml:4: 'cable_ideal': expected anchors that differ, found cable 2 at"
            r" the anchor of cable 1"
        ),
    ),
    "65 cables": (
        cables_xml(
            *(cable_xml(0, pulleys=False).replace("-3.0", f"-{3 + i}.0") for i in range(65))
        ),
        r"'cables': expected at most 64 values",
    ),
}


@pytest.mark.parametrize("what", CABLES)
def test_wrong_cables_are_one_sentence(what, run, tmp_path):
    text, pattern = CABLES[what]
    assert_refused(
        run,
        written(tmp_path, small_bodies_xml=bodies_xml(), small_cables_xml=text),
        pattern,
        tmp_path,
    )


def changed(values, *keys, to):
    inner = values
    for key in keys[:-1]:
        inner = inner[key]
    inner[keys[-1]] = to
    return json.dumps(values)


DOCUMENTS = {
    "an empty file": ("", r"found no mapping of keys to values"),
    "a list": ("[1, 2]", r"found no mapping of keys to values"),
    "a robot file": (
        "name: a\ncables: []\n",
        r"expected one of CASPR XML .*found the keys 'name', 'cables'",
    ),
    "no text": (b"\xff\x00\xfe", r"expected UTF-8 text"),
    "deep": ("[" * 3000, r"expected XML, JSON or YAML, found something that cannot be read"),
    "a list for a key": (
        "{[[1]]: 2}",
        r"expected XML, JSON or YAML, found something that cannot be read",
    ),
    "keys that are said twice": (
        irma_json(head='"platform": 1,'),
        r"found a mistake in it \(found duplicate key",
    ),
    "a cut file": (irma_json()[:400], r"expected XML, JSON or YAML, found a mistake in it"),
    "no number": (
        irma_json(platform='"mass": NaN,').replace('"mass": 15.0,', ""),
        r"'platform\.mass': expected a number, found 'NaN'",
    ),
    "an infinite number": (
        fields("15.0", "1e999", irma_json()),
        r"'platform\.mass': expected a number, found ",
    ),
    "a large number": (
        fields("15.0", "1e99", irma_json()),
        r"'platform\.mass': expected a number of a possible size, found 1e\+99",
    ),
    "text for a number": (
        fields("15.0", '"15"', irma_json()),
        r"'platform\.mass': expected a number, found '15'",
    ),
    "a mass of zero": (
        fields("15.0", "0", irma_json()),
        r"'platform\.mass': expected a number above 0, found 0",
    ),
    "a mass that is missing": (
        fields('"mass"', '"weight"', irma_json()),
        r"'platform\.mass': expected this key, found it missing",
    ),
    "a point of two numbers": (
        fields("[[-3.0], [-2.0], [4.0]]", "[[-3.0], [-2.0]]", irma_json()),
        r":4: 'actuator\[0\]\.pulley\.pos_OD_glob': expected at least 3",
    ),
    "a point without its partner": (
        fields("pos_PA_loc", "pos_PD_loc", irma_json()),
        (
            r":3: 'actuator\[0\]': expected pulley\.pos_OD_glob and winch\.pos_PA_loc, or .* found"
            r" only one of them"
        ),
    ),
    "an axis of length zero": (
        fields("[[0.0], [0.0], [1.0]]", "[0, 0, 0]", irma_json()),
        r"vers_k': expected a direction",
    ),
    "an axis that is missing": (
        fields('"vers_k"', '"vers_l"', irma_json()),
        (
            r"'actuator\[0\]\.pulley\.vers_k': expected the swivel axis of the roller, found it"
            r" missing; add 'vers_k'"
        ),
    ),
    "gravity of length zero": (
        fields('"gravity_axis": [[0], [0], [1]]', '"gravity_axis": [0, 0, 0]', irma_json()),
        r"'platform\.gravity_axis': expected a direction",
    ),
    "a negative radius": (
        fields(str(RADIUS), "-1", irma_json()),
        r"'actuator\[0\]\.pulley\.radius': expected a number at least 0",
    ),
    "a matrix that is not symmetric": (
        fields(repr(float(CLOUD[9])), "9.0", irma_json()),
        r"'platform\.inertia_mat_G_loc': expected a symmetric matrix, found 9 and",
    ),
    "a planar platform": (
        irma_json(head='"motion_pattern": "ONE_R_TWO_T",'),
        r"'motion_pattern': expected a platform that cables alone hold",
    ),
    "no active actuators": (irma_json().replace("true", "false"), r"expected cables, found none"),
    "points without platform": (
        fields("  platform: [-0.3", "  form: [-0.3", ros_yaml()),
        r"'points\[0\]\.platform': expected this key",
    ),
    "an inertia of five": (
        ros_yaml(inertia="inertia: [1, 1, 1, 0, 0]"),
        r":5: 'platform\.inertia': expected |:5: 'platform\.inertia\[5\]",
    ),
    "two platforms": (
        changed(cdpyr_values(), "platforms", to=2 * cdpyr_values()["platforms"]),
        r"'platforms': expected one platform, found 2",
    ),
    "a platform on a plane": (
        changed(cdpyr_values(), "platforms", 0, "motion_pattern", "translation", to=2),
        (
            r"'platforms\[0\]\.motion_pattern\.translation': expected a platform that cables alone"
            r" hold"
        ),
    ),
    "a chain to an anchor that is not there": (
        changed(cdpyr_values(), "kinematic_chains", 1, "frame_anchor", to=3),
        (
            r"'kinematic_chains\[1\]\.frame_anchor': expected one of the 3 that there are, counted"
            r" from 0, found 3"
        ),
    ),
    "a turned frame that is none": (
        changed(cdpyr_values(), "frame", "anchors", 1, "dcm", to=(2 * np.eye(3)).tolist()),
        r"'frame\.anchors\[1\]\.dcm': expected a rotation matrix",
    ),
    "a mirrored frame": (
        changed(cdpyr_values(), "frame", "anchors", 1, "pulley", "dcm", to=(-np.eye(3)).tolist()),
        r"'frame\.anchors\[1\]\.pulley\.dcm': expected a rotation matrix",
    ),
    "masses that differ": (
        changed(
            cdpyr_values(),
            "platforms",
            0,
            "inertia",
            "linear",
            to=np.diag([1.0, 2.0, 3.0]).tolist(),
        ),
        r"'platforms\[0\]\.inertia\.linear': expected one mass above 0 on the diagonal",
    ),
    "a matrix of cdpyr that is not symmetric": (
        changed(
            cdpyr_values(),
            "platforms",
            0,
            "inertia",
            "angular",
            to=[[1, 0.5, 0], [0, 1, 0], [0, 0, 1]],
        ),
        r"'platforms\[0\]\.inertia\.angular': expected a symmetric matrix",
    ),
}


@pytest.mark.parametrize("what", DOCUMENTS)
def test_wrong_documents_are_one_sentence(what, run, tmp_path):
    text, pattern = DOCUMENTS[what]
    assert_refused(run, written(tmp_path, small_json=text), pattern, tmp_path)


COMMANDS = {
    "no file": ([], [], r"Missing argument 'FILE\.\.\.'"),
    "a file that is not there": (
        ["nothing.xml"],
        [],
        r"nothing\.xml: expected a file, found nothing there",
    ),
    "a folder": (["."], [], r"expected a file, found a folder"),
    "bodies alone": (
        ["small_bodies.xml"],
        [],
        r"expected a second file, \*_cables\.xml of CASPR with the root 'cables', found none",
    ),
    "bodies twice": (
        ["small_bodies.xml", "small_bodies.xml"],
        [],
        r"expected one file with this root, found ",
    ),
    "two formats": (
        ["small_bodies.xml", "small.json"],
        [],
        r"expected files of one robot, found IRMA JSON beside CASPR XML",
    ),
    "two robots": (["small.json", "small.json"], [], r"expected one file of IRMA JSON, found 2"),
    "a set that is not there": (
        ["small_bodies.xml", "small_cables.xml"],
        ["--cables", "x"],
        r"--cables: expected one of main, found 'x'",
    ),
    "a set of a format without": (
        ["small.json"],
        ["--cables", "main"],
        r"--cables: expected none, as IRMA JSON has one set of cables",
    ),
    "a point that the format tells": (
        ["small.json"],
        ["--inertia-about", "origin"],
        r"--inertia-about: expected none, as the files say",
    ),
    "signs of another kind": (["small.json"], ["--products", "plus"], r"--products"),
}


@pytest.mark.parametrize("what", COMMANDS)
def test_wrong_commands_are_one_sentence(what, run, tmp_path, monkeypatch):
    files, options, pattern = COMMANDS[what]
    caspr(tmp_path)
    written(tmp_path, small_json=irma_json())
    monkeypatch.chdir(tmp_path)
    assert_refused(run, [*files, *options], pattern, tmp_path)


@pytest.mark.parametrize("target", ["folder", "link", "small.json/robot.yaml"])
def test_places_that_cannot_be_written_to(target, run, tmp_path):
    (path,) = written(tmp_path, small_json=irma_json())
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to("nowhere")
    status, out, err = run("import", path, "--out", tmp_path / target, "--force")
    assert (status, out) == (2, "")
    assert re.search(r"expected a (file to write|place that can be written to), found ", err)


def assert_refused(run, arguments, pattern, folder):
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    status, out, err = run("import", *arguments, "--out", folder / "new.yaml")
    assert (status, out) == (2, ""), err
    message = err.removesuffix("\n")
    assert message.startswith("steelyard: ")
    assert message.isprintable()
    assert re.search(r"[.!] [A-Z]", message) is None, f"more than one sentence: {message}"
    assert re.search(pattern, message), message
    assert len(message) < 1000
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


def test_texts_of_a_file_steer_no_terminal_and_end_no_comment(run, tmp_path):
    name = "a\x1b[31m\u2028cables: []\x85#" + "b" * 300
    text = changed(cdpyr_values(), "name", to=name)
    text = text.replace('"breaking_load"', '"\\u2028breaking\\nload"')
    (path,) = written(tmp_path, small_json=text)
    status, out, err = run("import", path, "--out", tmp_path / "robot.yaml", "--products", "matrix")
    assert (status, err) == (0, "")
    assert all(line.isprintable() for line in out.splitlines())
    robot = read_robot(str(tmp_path / "robot.yaml"))
    assert robot.m == 3
    assert len(robot.name) == 100


FUZZED = {
    "caspr": {"small_bodies_xml": bodies_xml(), "small_cables_xml": cables_xml()},
    "irma": {"small_json": irma_json()},
    "cdpyr": {"small_json": cdpyr_json()},
    "wirecenter": {"small_wcrfx": wcrfx()},
    "ros": {"small_yaml": ros_yaml()},
    "printer": {"small_g": "M669 K6 A0:-1604.5:-114.1 B1312.5:1270.9:-162.2 C-1440:741:-161 D2345"},
    "platform": {
        "small_xml": '<mujoco><worldbody><body name="a"><inertial pos="0.1 -0.2 0.3"'
        ' quat="0.9 0.1 -0.3 0.2" mass="12" diaginertia="2 3 4"/></body></worldbody></mujoco>'
    },
}
assert len(FUZZED) == len(FORMATS)

PIECES = st.sampled_from(
    [
        "",
        "0",
        "-1",
        "1e99",
        "1e-320",
        "nan",
        ".inf",
        "true",
        "null",
        '"x"',
        "[]",
        "{}",
        "[",
        "}",
        "<a>",
        "&x;",
        "\x00",
        "\n",
        "é",
        ",",
        ": ",
        "'",
        "1" * 400,
    ]
)


@pytest.mark.integration
@pytest.mark.parametrize("name", FUZZED)
@settings(
    max_examples=60,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(data=st.data())
def test_damaged_files_are_refused_or_read(name, data, tmp_path):
    texts = dict(FUZZED[name])
    for _ in range(data.draw(st.integers(1, 3))):
        key = data.draw(st.sampled_from(sorted(texts)))
        words = re.split(r"(\W+)", texts[key])
        at = data.draw(st.integers(0, len(words) - 1))
        kept = data.draw(st.sampled_from([0, 1, 1, 1, 1, 30]))
        words[at : at + kept] = [data.draw(PIECES)]
        texts[key] = "".join(words)
    paths = written(tmp_path, **texts)
    found = imported_or_refused(paths, data.draw(st.sampled_from([None, "matrix", "integral"])))
    if isinstance(found, str):
        assert ": expected " in found
    else:
        (again,) = written(tmp_path, again_yaml=found.to_text())
        assert read_robot(str(again)).m == found.robot.m


def imported_or_refused(paths, products):
    try:
        return import_robot(paths, products=products)
    except InputError as error:
        return str(error)
