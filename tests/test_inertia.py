import json
from dataclasses import FrozenInstanceError

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from steelyard.arrays import complex_step_jacobian
from steelyard.inertia import (
    BODY_PARAMETERS,
    LINEAR_PARAMETERS,
    Inertia,
    MujocoInertial,
    six,
    symmetric,
)
from steelyard.robot.file import read_robot

TOLERANCE = 1e-11  # rounding of sums and differences of numbers up to a few hundred

SETTINGS = settings(deadline=None, derandomize=True, max_examples=100)
NAMES = ("xx", "yy", "zz", "yz", "xz", "xy")
ENTRIES = {name: ("xyz".index(name[0]), "xyz".index(name[1])) for name in NAMES}

rng = np.random.default_rng(7)
MASSES, POSITIONS = (
    rng.uniform(0.5, 20.0, 12),
    rng.normal([0.2, -0.1, 0.4], [0.6, 0.3, 0.9], (12, 3)),
)
CLOUD = Inertia.from_points(MASSES, POSITIONS)
TABLE_III_NOMINAL = (
    161.058,
    (-0.001, -0.077, -0.118),
    (94.955, 88.859, 31.635, 4.136, -0.085, -0.393),
)
TABLE_III_ESTIMATED = (
    170.740,
    (0.112, -0.134, -0.125),
    (102.982, 52.744, 46.589, 8.588, -0.132, -3.672),
)


def body(mass, cog, moments):
    matrix = np.zeros((3, 3))
    for name, moment in zip(NAMES, moments, strict=True):
        i, j = ENTRIES[name]
        matrix[i, j] = matrix[j, i] = moment
    return Inertia(mass, np.array(cog), matrix)


def moments_of_points(masses, positions, about):
    """Moment by moment: sums of squared distances from an axis, minus sums of products."""
    x, y, z = (positions - about).T
    products = {"yz": y * z, "xz": x * z, "xy": x * y}
    moments = {"xx": y * y + z * z, "yy": x * x + z * z, "zz": x * x + y * y}
    return {n: float(masses @ v) for n, v in moments.items()} | {
        n: -float(masses @ v) for n, v in products.items()
    }


def assert_same(found, expected):
    np.testing.assert_allclose(found.mass, expected.mass, rtol=TOLERANCE)
    np.testing.assert_allclose(
        found.center_of_gravity, expected.center_of_gravity, rtol=TOLERANCE, atol=TOLERANCE
    )
    scale = np.abs(expected.inertia_about_origin).max()
    np.testing.assert_allclose(
        found.inertia, expected.inertia, rtol=TOLERANCE, atol=TOLERANCE * scale
    )


def test_point_masses_give_the_sums_about_origin_and_centre_of_gravity():
    cog = (MASSES[:, None] * POSITIONS).sum(axis=0) / MASSES.sum()
    assert pytest.approx(MASSES.sum(), rel=TOLERANCE) == CLOUD.mass
    np.testing.assert_allclose(CLOUD.center_of_gravity, cog, rtol=TOLERANCE)
    np.testing.assert_allclose(CLOUD.first_moment, MASSES @ POSITIONS, rtol=TOLERANCE)
    about_cog, about_origin = (
        moments_of_points(MASSES, POSITIONS, cog),
        moments_of_points(MASSES, POSITIONS, 0.0),
    )
    for name, entry in ENTRIES.items():
        assert CLOUD.inertia[entry] == pytest.approx(about_cog[name], rel=TOLERANCE)
        assert CLOUD.inertia[entry[::-1]] == CLOUD.inertia[entry]
        assert CLOUD.inertia_about_origin[entry] == pytest.approx(about_origin[name], rel=TOLERANCE)


def test_parameters_stand_in_the_order_of_their_names():
    about_origin = moments_of_points(MASSES, POSITIONS, 0.0)
    about_cog = moments_of_points(MASSES, POSITIONS, CLOUD.center_of_gravity)
    linear = {"m": MASSES.sum(), **dict(zip(("hx", "hy", "hz"), MASSES @ POSITIONS, strict=True))}
    linear |= {"J" + name: value for name, value in about_origin.items()}
    quoted = {
        "mass": MASSES.sum(),
        **dict(zip(("cx", "cy", "cz"), CLOUD.center_of_gravity, strict=True)),
    }
    quoted |= {"J" + name: value for name, value in about_cog.items()}
    np.testing.assert_allclose(
        CLOUD.parameters, [linear[name] for name in LINEAR_PARAMETERS], rtol=TOLERANCE
    )
    np.testing.assert_allclose(
        CLOUD.body_parameters, [quoted[name] for name in BODY_PARAMETERS], rtol=TOLERANCE
    )


def test_pseudo_inertia_is_the_sum_of_homogeneous_outer_products():
    homogeneous = np.column_stack([POSITIONS, np.ones(len(MASSES))])
    expected = sum(m * np.outer(r, r) for m, r in zip(MASSES, homogeneous, strict=True))
    np.testing.assert_allclose(CLOUD.pseudo_inertia, expected, rtol=TOLERANCE)


@pytest.mark.parametrize(
    "form", ["parameters", "body_parameters", "pseudo_inertia", "log_cholesky"]
)
@pytest.mark.parametrize("whole", [CLOUD, body(*TABLE_III_NOMINAL)], ids=["cloud", "nominal"])
def test_every_form_gives_the_body_back(whole, form):
    assert_same(getattr(Inertia, f"from_{form}")(getattr(whole, form)), whole)


@pytest.mark.parametrize("form", ["parameters", "body_parameters", "pseudo_inertia"])
def test_a_body_that_cannot_exist_has_all_forms_but_one(form):
    estimated = body(*TABLE_III_ESTIMATED)
    assert_same(getattr(Inertia, f"from_{form}")(getattr(estimated, form)), estimated)
    with pytest.raises(ValueError, match="expected a body that can exist"):
        _ = estimated.log_cholesky


@SETTINGS
@given(st.lists(st.floats(-2, 2), min_size=10, max_size=10))
def test_any_ten_numbers_are_a_body_that_can_exist(numbers):
    a, d1, d2, d3, s12, s23, s13, t1, t2, t3 = numbers
    U = np.exp(a) * np.array(
        [[np.exp(d1), s12, s13, t1], [0, np.exp(d2), s23, t2], [0, 0, np.exp(d3), t3], [0, 0, 0, 1]]
    )
    found = Inertia.from_log_cholesky(numbers)
    P = U @ U.T
    np.testing.assert_allclose(
        found.pseudo_inertia, P, rtol=TOLERANCE, atol=TOLERANCE * np.abs(P).max()
    )
    assert found.is_physical
    assert found.triangle_margin > 0
    np.testing.assert_allclose(
        found.log_cholesky, numbers, atol=1e5 * TOLERANCE
    )  # thin bodies: e^-4 against 12


@pytest.mark.parametrize("far", [5.0, 30.0, 300.0])
def test_a_small_body_far_from_the_origin_can_exist_too(far):
    found = Inertia.from_log_cholesky([1.0, -4.0, -4.5, -5.0, 0.0, 0.0, 0.0, far, 0.0, -far])
    assert found.is_physical
    expected = np.sort(np.exp([-8.0, -9.0, -10.0]) @ (1 - np.eye(3)))
    np.testing.assert_allclose(found.principal_moments / found.mass, expected, rtol=1e5 * TOLERANCE)


@SETTINGS
@given(st.lists(st.floats(-2, 2), min_size=6, max_size=6), st.floats(0.5, 200))
def test_is_physical_exactly_where_the_pseudo_inertia_is_positive_definite(numbers, mass):
    any_body = Inertia(mass, np.array([0.1, -0.2, 0.3]), symmetric(numbers))
    lowest = np.linalg.eigvalsh(any_body.pseudo_inertia)[0]
    if abs(lowest) > 1e3 * TOLERANCE:
        assert any_body.is_physical == (lowest > 0)


def test_parallel_axes():
    shift = np.array([0.7, -1.1, 0.4])
    moved = Inertia(CLOUD.mass, CLOUD.center_of_gravity + shift, CLOUD.inertia)
    assert_same(moved, Inertia.from_points(MASSES, POSITIONS + shift))
    assert_same(
        Inertia.from_points([3.0, 5.0], [[1, 2, 3], [1, 2, 3]]),
        Inertia(8.0, np.array([1, 2, 3]), np.zeros((3, 3))),
    )


def test_estimate_of_table_iii_is_no_body_and_its_nominal_value_is_one():
    estimated, nominal = body(*TABLE_III_ESTIMATED), body(*TABLE_III_NOMINAL)
    np.testing.assert_allclose(estimated.principal_moments, [40.48, 58.58, 103.26], atol=0.005)
    assert estimated.triangle_margin == pytest.approx(-4.2, abs=0.05)
    assert not estimated.is_physical
    assert nominal.is_physical
    assert_same(read_robot("cogiro").platform, nominal)


def test_pinocchio_holds_the_same_ten_numbers():
    theirs = pin.Inertia(CLOUD.mass, CLOUD.center_of_gravity.copy(), CLOUD.inertia.copy())
    np.testing.assert_allclose(
        CLOUD.to_pinocchio(), theirs.toDynamicParameters(), rtol=1e-12, atol=1e-12
    )
    assert_same(Inertia.from_pinocchio(theirs.toDynamicParameters()), CLOUD)
    back = pin.Inertia.FromDynamicParameters(np.array(CLOUD.to_pinocchio()))
    np.testing.assert_allclose(back.inertia, CLOUD.inertia, rtol=TOLERANCE)


@pytest.mark.mujoco
def test_mujoco_compiles_the_same_body():
    mass, pos, full = CLOUD.to_mujoco()
    numbers = {
        "mass": repr(mass),
        "pos": " ".join(map(repr, pos)),
        "full": " ".join(repr(float(v)) for v in full),
    }
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><compiler autolimits='true'/><worldbody><body name='b'><freejoint/>"
        "<inertial mass='{mass}' pos='{pos}' fullinertia='{full}'/></body></worldbody></mujoco>".format(
            **numbers
        )
    )
    R = np.zeros(9)
    mujoco.mju_quat2Mat(R, model.body_iquat[1])
    R = R.reshape(3, 3)
    found = Inertia(
        model.body_mass[1], model.body_ipos[1], R @ np.diag(model.body_inertia[1]) @ R.T
    )
    assert_same(found, CLOUD)
    assert_same(Inertia.from_mujoco(MujocoInertial(mass, pos, full)), CLOUD)


def test_urdf_read_by_pinocchio_is_the_same_body():
    u = CLOUD.to_urdf()
    moments = " ".join(
        f'{name}="{float(getattr(u, name))!r}"'
        for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    urdf = (
        '<robot name="r"><link name="platform"><inertial><origin'
        f' xyz="{" ".join(map(repr, u.origin_xyz))}" rpy="0 0 0"/><mass'
        f' value="{u.mass!r}"/><inertia {moments}/></inertial></link></robot>'
    )
    model = pin.buildModelFromXML(urdf, pin.JointModelFreeFlyer())
    assert_same(Inertia.from_pinocchio(model.inertias[1].toDynamicParameters()), CLOUD)
    assert_same(Inertia.from_urdf(u), CLOUD)


def test_six_and_symmetric_follow_the_names():
    matrix = symmetric([11, 22, 33, 23, 13, 12])
    for name, (i, j) in ENTRIES.items():
        assert (
            matrix[i, j]
            == matrix[j, i]
            == 10 * ("xyz".index(name[0]) + 1) + "xyz".index(name[1]) + 1
        )
    np.testing.assert_array_equal(six(matrix), [11, 22, 33, 23, 13, 12])


def test_a_body_is_read_only_and_keeps_its_own_copies():
    cog, J = np.array([1.0, 2.0, 3.0]), np.eye(3)
    given_body = Inertia(2, cog, J)
    cog[:], J[:] = 0, 0
    np.testing.assert_array_equal(given_body.center_of_gravity, [1, 2, 3])
    np.testing.assert_array_equal(given_body.inertia, np.eye(3))
    for array in (given_body.center_of_gravity, given_body.inertia):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 5
    with pytest.raises(FrozenInstanceError):
        given_body.mass = 3.0


def test_plain_numbers_for_files():
    values = CLOUD.to_dict()
    assert list(values) == ["mass", "center_of_gravity", "inertia"]
    assert_same(Inertia(values["mass"], values["center_of_gravity"], values["inertia"]), CLOUD)
    assert json.loads(json.dumps(values)) == values


@pytest.mark.parametrize(
    ("cog", "matrix", "message"),
    [
        ([0, 0], np.eye(3), r"center_of_gravity: expected shape 3, found \(2,\)"),
        ([0, 0, np.nan], np.eye(3), "center_of_gravity: expected finite numbers"),
        ([0, 0, 0], np.eye(2), r"inertia: expected shape 3 x 3, found \(2, 2\)"),
        ([0, 0, 0], [[1, 2, 0], [0, 1, 0], [0, 0, 1]], "inertia: expected a symmetric matrix"),
    ],
)
def test_what_is_no_body_at_all_is_refused(cog, matrix, message):
    with pytest.raises(ValueError, match=message):
        Inertia(1.0, cog, matrix)


def test_derivative_by_a_complex_step_is_the_one_by_hand():
    at = np.array([0.7, -1.3, 2.1])
    found = complex_step_jacobian(lambda x: np.array([x[0] * x[1] ** 3, np.sin(x[2]) / x[0]]), at)
    by_hand = [
        [at[1] ** 3, 3 * at[0] * at[1] ** 2, 0],
        [-np.sin(at[2]) / at[0] ** 2, 0, np.cos(at[2]) / at[0]],
    ]
    np.testing.assert_allclose(found, by_hand, rtol=4e-16, atol=0)
