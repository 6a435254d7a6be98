"""The balance of forces along an arc against differences of itself, and against a dense constrained
least-squares problem."""

from contextlib import contextmanager, nullcontext
from dataclasses import replace
from unittest import mock

import numpy as np
import pytest
from balanced import (
    CONSTRAINED,
    DIFFERENCES,
    END,
    FORCES,
    GRID,
    HOSES,
    RARE,
    ROLLERS,
    SIGMAS,
    START,
    SURROUNDINGS,
    Case,
    assert_derivatives,
    central_differences,
)
from scipy.integrate import solve_ivp
from scipy.interpolate import BSpline
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from simulated import BODY, ROBOT

from steelyard.identification.model.balance import (
    balance,
    force_readings,
    part_of,
    parts_of,
)
from steelyard.identification.model.calibration_parameters import (
    DRAG,
    CalibrationValues,
)
from steelyard.identification.model.force_residuals import (
    BALANCE,
    sample_weight,
)
from steelyard.identification.model.motion_segment import CarriedTensions
from steelyard.identification.model.segment import POSE, spread
from steelyard.identification.model.tensions.carried import carried_tensions
from steelyard.identification.tally import Tally, limit
from steelyard.instruments.base import LATENCY, TIME_CONSTANT
from steelyard.robot.file import read_robot
from steelyard.smoothing import DEGREE

AT_REST = ("attached", "bending.force")  # of what pulls beside the cables, or bends
CASES = {
    **{force: {"force": force} for force in FORCES},
    "rollers": {"force": "platform end", "robot": ROBOT},
    "in the time of the forces": {"force": "platform end", "reference": "recorder"},
    "platform end at rest": {"force": "platform end", "static": True},
    "wrench at rest": {"force": "wrench", "static": True},
    "disturbed": {"force": "platform end", "disturbed": True},
    "disturbed wrench": {"force": "wrench", "disturbed": True},
    "pulled by a hose": {"force": "platform end", "pulled": True},
    "drifting sensors": {"force": "platform end", "drifting": True},
    "drifting sensors beside a disturbance": {
        "force": "platform end",
        "drifting": True,
        "disturbed": True,
    },
    "late by the clock that they share": {"force": "platform end", "shared": True},
    "drifting wrench": {"force": "wrench", "drifting": True},
    "held by two hoses that are stated": {"force": "platform end", "hoses": HOSES},
    "a wrench sensor with a hose": {"force": "wrench", "hoses": HOSES[:1]},
    "something moves in the load": {"force": "platform end", "loose": True},
    "something moves in the load, at rest": {
        "force": "platform end",
        "loose": True,
        "static": True,
    },
    "something moves in the load below a wrench sensor": {"force": "wrench", "loose": True},
}


@pytest.fixture(scope="module", params=CASES)
def case(request):
    """A case, its rows, and the whitener, which is held in differences."""
    found = Case(**CASES[request.param])
    return found, found.rows(), found.balance().whitener


def test_balanced_forces_leave_nothing(case):
    found, rows, _ = case
    np.testing.assert_allclose(rows.residual, 0, atol=1e-8)
    np.testing.assert_allclose(found.balance().correction, 0, atol=1e-8)
    assert rows.label == found.segment.label("forces", BALANCE)


@contextmanager
def rollers_held(found):
    """What the rollers remember follows neither motion nor geometry: that it does is of no account."""
    with mock.patch.object(balance, "remembered", return_value=found.balance().rolled):
        yield


def test_derivatives_by_the_motion_are_those_of_differences(case):
    found, rows, whitener = case
    x = found.segment.coefficients
    ways = np.random.default_rng(1).normal(size=(12, *x.shape))
    with rollers_held(found):
        expected = whitener @ central_differences(
            lambda c: found.balance(coefficients=c).left_over, x, ways
        )
    own = rows.first[:, None] + np.arange(rows.by_motion.shape[2] // found.segment.block)
    along = np.einsum("nki,dni->nkd", rows.by_motion, ways[:, own].reshape(len(ways), len(own), -1))
    assert_derivatives(along, expected)


@pytest.mark.parametrize("force", ["platform end", "wrench"])
def test_what_pulls_along_the_axes_of_the_world_is_followed(force):
    found = Case(force, loose=True, disturbed=True)
    rows, whitener = found.rows(), found.balance().whitener
    x = found.segment.coefficients
    ways = np.random.default_rng(1).normal(size=(12, *x.shape))
    ways[:, :, :POSE] = 0.0  # how it follows the rotation is of no account
    expected = whitener @ central_differences(
        lambda c: found.balance(coefficients=c).left_over, x, ways
    )
    own = rows.first[:, None] + np.arange(rows.by_motion.shape[2] // found.segment.block)
    along = np.einsum("nki,dni->nkd", rows.by_motion, ways[:, own].reshape(len(ways), len(own), -1))
    assert_derivatives(along, expected)
    # The force is the same in the world, however the platform is turned.
    at = found.balance()
    pulls = next(each for each in found.segment.processes if each.upright)
    world = found.segment.disturbance(pulls, found.segment.basis(at.time))
    turned = np.einsum("nij,nj->ni", at.motion["rotation"], at.disturbance[:, :3])
    np.testing.assert_allclose(turned, world, atol=1e-12)


def test_derivatives_by_the_body_are_those_of_differences(case):
    found, rows, whitener = case
    expected = whitener @ central_differences(
        lambda p: found.balance(parameters=p).left_over, found.parameters, 100 * np.eye(10)
    )
    full = np.zeros((*rows.residual.shape, 10 + len(found.calibration_parameters)))
    full[:, :, rows.columns] = rows.by_errors
    assert_derivatives(100 * full[:, :, :10], expected)


def test_derivatives_by_every_systematic_error_are_those_of_differences(case):
    found, rows, whitener = case
    full = np.zeros((*rows.residual.shape, 10 + len(found.calibration_parameters)))
    full[:, :, rows.columns] = rows.by_errors
    rng, acting = np.random.default_rng(2), set()
    for (owner, key, run), place in found.calibration_parameters.places.items():
        if key == TIME_CONSTANT:
            # There is none below zero, see the tests of the filter.
            continue
        way = np.zeros(len(found.calibration_parameters))
        way[place] = rng.normal(size=len(way[place]))
        with nullcontext() if key in ROLLERS else rollers_held(found):
            expected = central_differences(
                lambda v: found.balance(values=v).left_over, found.calibration.values, [way]
            )
        expected = whitener @ expected
        along = full[:, :, 10:] @ way
        np.testing.assert_allclose(
            along[:, :, None],
            expected,
            atol=DIFFERENCES * max(np.abs(expected).max(), 0.1),
            err_msg=f"{owner} {key} {run}",
        )
        if np.abs(expected).max() > 0:
            acting.add((owner, key))
    # So that nothing was compared with nothing.
    terms = {
        ("forces", term.key)
        for term in found.experiment.instruments["forces"].terms(found.robot.m)
        if term.key != TIME_CONSTANT
    }
    clocks = set()
    if ("forces", LATENCY, None) in found.calibration_parameters.places:
        clocks |= {("forces", LATENCY)}
    elif not found.segment.static and found.segment.reference is None:
        clocks |= {("recorder", "delay"), ("attitude", "delay")}
    fixed = set()
    if found.robot.m:
        keys = {key for owner, key, _ in found.calibration_parameters.places if owner == "robot"}
        still = found.segment.static
        outside = {key for key in keys if key.startswith(AT_REST if still else SURROUNDINGS)}
        fixed = {("robot", key) for key in {"anchor", "attachment"} | outside}
    hoses = [k for o, k, _ in found.calibration_parameters.places if k.startswith("hose")]
    if found.experiment.moves_within("run"):
        fixed |= {("robot", "apparent.liquid")}
    # A slack hose does nothing, but its weight does.
    fixed |= {("robot", key) for key in hoses}
    assert acting == terms | clocks | fixed | {("robot", "gravity")}


# Cables that have weight

STRETCHED = 1e-5  # relative: a cable of a length under tension is a little shorter without
SAGGING = 0.02  # relative: how sag changes with pose and geometry is of no account by the module's own word


@pytest.fixture(scope="module")
def heavy():
    found = Case(
        "platform end", replace(read_robot("cogiro"), pulley_radius=np.zeros(8)), n=4, seed=4
    )
    return found, found.rows(), found.balance().whitener


def test_cables_with_inertia_are_dragged_along(heavy):
    found, rows, whitener = heavy
    place = found.calibration_parameters.places["robot", DRAG, None]
    way = np.zeros(len(found.calibration_parameters))
    way[place] = 1.0
    expected = whitener @ central_differences(
        lambda v: found.balance(values=v).left_over, found.calibration.values, [way]
    )
    assert np.abs(expected).max() > 0.1
    assert_derivatives(rows.by_errors[:, :, rows.columns == 10 + place.start], expected)


def test_what_cables_drag_is_what_a_third_of_them_weighs_across(heavy):
    # Point masses at the attachments, felt across the cable only.
    found, _, _ = heavy
    values = found.calibration.values.copy()
    place = found.calibration_parameters.places["robot", DRAG, None]
    still, dragging = (
        found.balance(values=np.where(np.arange(len(values)) == place.start, each, values))
        for each in (0.0, 1.0)
    )
    motion, robot, n = still.motion, found.robot, len(still.time)
    R, omega, alpha = motion["rotation"], motion["omega"], motion["alpha"]
    gravity = values[found.calibration_parameters.places["robot", "gravity", None]]
    expected = np.zeros((n, 6))
    for anchor, corner in zip(robot.anchors, robot.attachments, strict=True):
        line = anchor - motion["position"] - R @ corner
        length = np.linalg.norm(line, axis=1, keepdims=True)
        along = np.einsum("nji,nj->ni", R, line / length)
        moved = motion["specific_force"] + np.einsum("nji,j->ni", R, gravity)
        moved = moved + np.cross(alpha, corner) + np.cross(omega, np.cross(omega, corner))
        across = moved - along * np.sum(along * moved, axis=1, keepdims=True)
        force = -robot.cable.linear_density * length / 3 * across
        expected += np.hstack([force, np.cross(corner, force)])
    np.testing.assert_allclose(
        dragging.left_over - still.left_over, expected, atol=STRETCHED * np.abs(expected).max()
    )


def test_derivatives_with_heavy_cables_are_nearly_those_of_differences(heavy):
    found, rows, whitener = heavy
    full = np.zeros((*rows.residual.shape, 10 + len(found.calibration_parameters)))
    full[:, :, rows.columns] = rows.by_errors
    rng = np.random.default_rng(2)
    for key in (
        ("forces", "offset", None),
        ("forces", "gain", None),
        ("robot", "anchor", None),
        ("robot", "gravity", None),
    ):
        way = np.zeros(len(found.calibration_parameters))
        place = found.calibration_parameters.places[key]
        way[place] = rng.normal(size=len(way[place]))
        expected = whitener @ central_differences(
            lambda v: found.balance(values=v).left_over, found.calibration.values, [way]
        )
        np.testing.assert_allclose(
            (full[:, :, 10:] @ way)[:, :, None],
            expected,
            atol=SAGGING * np.abs(expected).max(),
            err_msg=str(key),
        )


def test_cables_that_rest_drag_nothing():
    found = Case(
        "platform end", replace(read_robot("cogiro"), pulley_radius=np.zeros(8)), n=3, static=True
    )
    place = found.calibration_parameters.places["robot", DRAG, None]
    values = found.calibration.values.copy()
    values[place] += 1.0
    np.testing.assert_array_equal(found.balance(values=values).left_over, found.balance().left_over)
    rows = found.rows()
    assert not np.any(rows.by_errors[:, :, rows.columns == 10 + place.start])


# Readings that are corrected until they balance


def stated_motion(found):
    """Pose, rate and acceleration at the times of the forces, and omega and alpha in platform
    axes."""
    e = {
        (o, k): found.calibration.values[p]
        for (o, k, _), p in found.calibration_parameters.places.items()
    }
    # The motion is told in the time of the attitude's clock, as it is known beforehand.
    time = found.time - e["recorder", "delay"] + e["attitude", "delay"]
    pose, rate, acceleration = (
        BSpline(GRID, found.segment.coefficients, DEGREE)(time, nu=k) for k in range(3)
    )
    q, dq, ddq = pose[:, 3:], rate[:, 3:], acceleration[:, 3:]

    def vector_part(a, b):
        return a[:, :1] * b[:, 1:] - b[:, :1] * a[:, 1:] - np.cross(a[:, 1:], b[:, 1:])

    square = np.sum(q**2, axis=1, keepdims=True)
    R = Rotation.from_quat(q, scalar_first=True).as_matrix()
    omega = 2 * vector_part(q, dq) / square
    alpha = (
        2 * vector_part(q, ddq) / square
        - 2 * np.sum(q * dq, axis=1, keepdims=True) / square * omega
    )
    return pose, rate, acceleration, R, omega, alpha


def stated_balance(found):
    """Structure matrices and the wrenches that move the body, written out once more in NumPy;
    shapes (n, 6, m), (n, 6)."""
    e = {
        (o, k): found.calibration.values[p]
        for (o, k, _), p in found.calibration_parameters.places.items()
    }
    pose, _, acceleration, R, omega, alpha = stated_motion(found)
    s = np.einsum("nji,nj->ni", R, acceleration[:, :3] - e["robot", "gravity"])
    J, h, m = BODY.inertia_about_origin, BODY.first_moment, BODY.mass
    force = m * s + np.cross(alpha, h) + np.cross(omega, np.cross(omega, h))
    torque = np.cross(h, s) + alpha @ J + np.cross(omega, omega @ J)
    moving = np.hstack([force, torque])
    if not found.robot.m:
        return None, moving
    anchors, corners = e["robot", "anchor"].reshape(-1, 3), e["robot", "attachment"].reshape(-1, 3)
    line = anchors - pose[:, None, :3] - np.einsum("nij,mj->nmi", R, corners)
    pull = np.einsum("nji,nmj->nmi", R, line / np.linalg.norm(line, axis=2, keepdims=True))
    return np.concatenate([pull, np.cross(corners, pull)], axis=2).transpose(0, 2, 1), moving


def gains(found):
    """Reading over tension but for the offset, by the contract: at the winch the rollers take their
    part, shape (n, m)."""
    e = {
        k: found.calibration.values[p]
        for (o, k, _), p in found.calibration_parameters.places.items()
        if o == "forces"
    }
    gain = np.tile(e["gain"] * e["common_gain"], (len(found.time), 1))
    if "friction" not in e:
        return gain
    pose, _, _, R, *_ = stated_motion(found)
    points = found.calibration.geometry
    anchors, attachments = (points[f"{key}s"].reshape(-1, 3) for key in ("anchor", "attachment"))
    arms = np.einsum("nij,mj->nmi", R, attachments)
    lengths = np.linalg.norm(pose[:, None, :3] + arms - anchors, axis=2)
    built_up = np.zeros_like(lengths)
    built_up[0] = e["presliding_start"]
    for i, travel in enumerate(np.diff(lengths, axis=0)):
        # The solution of Dahl's equation where a cable runs one way.
        end = np.sign(travel)
        built_up[i + 1] = end - (end - built_up[i]) * np.exp(-np.abs(travel) / e["presliding"])
    return gain * (1 - e["friction"] * built_up)


def as_tension(found, readings):
    """Tensions that readings say, by the contract, shape (n, m)."""
    return (
        readings
        - found.calibration.values[found.calibration_parameters.places["forces", "offset", None]]
    ) / gains(found)


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize("force", ["platform end", "winch end"])
def test_readings_are_corrected_as_a_constrained_least_squares_problem_has_it(force):
    found = Case(force)
    forces = found.noisy(3)
    at = found.balance(forces=forces)
    W, moving = stated_balance(found)
    size = np.array([100.0] * 3 + [50.0] * 3)
    for i, readings in enumerate(forces.readings["tension"]):

        def unbalanced(correction, i=i, readings=readings):
            return (W[i] @ as_tension(found, readings - SIGMAS * correction)[i] - moving[i]) / size

        solved = minimize(
            lambda c: c @ c, np.zeros(8), jac=lambda c: 2 * c, method="SLSQP",
            constraints={"type": "eq", "fun": unbalanced}, options={"ftol": 1e-14, "maxiter": 200},
        )  # fmt: skip
        assert np.abs(unbalanced(solved.x)).max() < 1e-8
        np.testing.assert_allclose(at.correction[i], solved.x, atol=CONSTRAINED)
        np.testing.assert_allclose(
            at.carried[i],
            as_tension(found, readings - SIGMAS * solved.x)[i],
            atol=CONSTRAINED * SIGMAS.max(),
        )


@pytest.mark.parametrize("force", ["platform end", "winch end"])
def test_what_is_carried_moves_the_body_and_leaves_the_inner_tension_free(force):
    found = Case(force)
    forces = found.noisy(4)
    at = found.balance(forces=forces)
    W, moving = stated_balance(found)
    np.testing.assert_allclose(np.einsum("nkm,nm->nk", W, at.carried), moving, atol=1e-6)
    # A tension that only tightens the platform is not corrected.
    inner = np.array([np.linalg.svd(w)[2][-1] for w in W])
    tighter = {"tension": forces.readings["tension"] + 80 * inner * gains(found)}
    again = found.balance(forces=replace(forces, readings=tighter))
    np.testing.assert_allclose(again.left_over, at.left_over, atol=1e-6)
    np.testing.assert_allclose(again.correction, at.correction, atol=1e-6)


def test_a_wrench_that_is_read_is_corrected_to_the_one_that_moves_the_body():
    found = Case("wrench")
    forces = found.noisy(5)
    at = found.balance(forces=forces)
    _, moving = stated_balance(found)
    np.testing.assert_allclose(at.carried, moving, atol=1e-6)
    # Six readings, six equations: the correction is the error itself.
    error = np.hstack([forces.readings[q] - found.forces.readings[q] for q in ("force", "torque")])
    np.testing.assert_allclose(at.correction, error / forces.sigma, atol=1e-6)
    assert at.structure is None


@pytest.mark.parametrize("force", ["platform end", "wrench"])
def test_the_cost_is_the_squared_length_of_the_correction(force):
    found = Case(force)
    forces, tally = found.noisy(6), Tally()
    at, rows = found.balance(forces=forces), found.rows(forces=forces, tally=tally)
    whitened = np.einsum("nij,nj->ni", at.whitener, at.left_over)
    np.testing.assert_allclose(
        np.sum(at.correction**2, axis=1), np.sum(whitened**2, axis=1), rtol=1e-8
    )
    np.testing.assert_allclose(rows.residual, whitened, rtol=1e-8)
    assert tally.cost == pytest.approx(np.sum(at.correction**2), rel=1e-8)


@pytest.mark.parametrize("force", ["platform end", "wrench"])
def test_the_whitener_makes_the_noise_of_the_readings_white(force):
    found = Case(force)
    factors = {("forces", quantity): 1.7 for quantity in found.forces.readings}
    for given, factor in (({}, 1.0), (factors, 1.7)):
        at = found.balance(factors=given)
        noise = at.by_reading * found.forces.sigma * factor
        white = at.whitener @ (noise @ noise.transpose(0, 2, 1)) @ at.whitener.transpose(0, 2, 1)
        np.testing.assert_allclose(white, np.tile(np.eye(6), (len(white), 1, 1)), atol=1e-8)


@pytest.mark.parametrize("force", ["platform end", "wrench"])
def test_what_is_left_over_follows_the_readings_as_stated(force):
    found = Case(force)
    forces, rng = found.noisy(7), np.random.default_rng(8)
    change = rng.normal(size=forces.left_out.shape)
    one = found.balance(forces=forces)
    other = found.balance(forces=replace(forces, readings=found.changed(change)))
    base = found.balance()
    expected = np.einsum("nkr,nr->nk", base.by_reading, change)
    np.testing.assert_allclose(other.left_over - base.left_over, expected, atol=1e-7)
    np.testing.assert_allclose(one.by_reading, base.by_reading, rtol=1e-9, atol=1e-12)


# Readings that are left out

LOUD = 1000.0  # [N]
HARDLY = (
    0.5  # in 1-sigma of six numbers: how far a reading that is left out may move what is left over
)
MUTE = 1e-3  # in 1-sigma: how far it may pull at the body


@pytest.mark.parametrize("cable", range(8))
def test_a_reading_that_is_left_out_has_no_say(cable):
    found = Case("platform end")
    left_out = np.zeros((len(found.time), 8), dtype=bool)
    left_out[2, cable] = True
    quiet = replace(found.noisy(9), left_out=left_out)
    loud = {"tension": quiet.readings["tension"] + LOUD * left_out}
    before, after = found.rows(forces=quiet), found.rows(forces=replace(quiet, readings=loud))
    change = after.residual - before.residual
    np.testing.assert_allclose(
        change, np.where(np.arange(len(change)) == 2, change.T, 0.0).T, atol=1e-9
    )
    assert np.abs(change).max() < HARDLY
    # What pulls at the parameters, in units of the noise that pulls at them anyway.
    ten = before.by_errors[:, :, np.isin(before.columns, np.arange(10))]
    pull = np.einsum("nkc,nk->c", ten, change) / np.sqrt(np.einsum("nkc,nkc->c", ten, ten))
    assert np.abs(pull).max() < MUTE


def test_a_cable_that_is_left_out_is_told_by_the_others():
    found = Case("platform end")
    left_out = np.zeros((len(found.time), 8), dtype=bool)
    left_out[:, 3] = True
    wrong = {"tension": found.forces.readings["tension"] + LOUD * left_out}
    at = found.balance(forces=replace(found.forces, readings=wrong, left_out=left_out))
    expected = as_tension(found, found.forces.readings["tension"])
    # Inner tension is what cannot be told: it stays as the others say.
    np.testing.assert_allclose(at.carried, expected, atol=0.01)


def test_a_sample_that_is_left_out_as_a_whole_says_next_to_nothing():
    found = Case("wrench")
    left_out = np.zeros((len(found.time), 6), dtype=bool)
    left_out[1] = True
    rows = found.rows(forces=replace(found.noisy(10), left_out=left_out))
    whole = found.rows(forces=found.noisy(10))
    # Its 1-sigma is then a hundred times the largest reading.
    assert np.abs(rows.by_motion[1]).max() < 1e-2 * np.abs(whole.by_motion[1]).max()
    np.testing.assert_array_equal(rows.by_motion[[0, 2]], whole.by_motion[[0, 2]])


# What counts how much


def test_a_push_pulls_no_more_than_noise_may():
    found = Case("platform end")
    at = found.balance()
    push = np.zeros((len(found.time), 6))
    push[3] = [300.0, 0.0, 100.0, 0.0, 50.0, 0.0]
    off = np.einsum("nri,ni->nr", np.linalg.pinv(at.by_reading), push)
    rows, calm = found.rows(forces=replace(found.forces, readings=found.changed(off))), found.rows()
    size = np.linalg.norm(at.whitener[3] @ push[3])
    assert size > 3 * limit(6)
    assert np.linalg.norm(rows.residual[3]) == pytest.approx(np.sqrt(size * limit(6)))
    # Pull on the motion: derivative times residual, both under the root of the weight; tensions
    # differ by what has pushed.
    unit = at.whitener[3] @ push[3] / size
    by_body = np.isin(rows.columns, np.arange(10))
    pull = rows.by_errors[3][:, by_body].T @ rows.residual[3]
    np.testing.assert_allclose(
        pull, limit(6) * calm.by_errors[3][:, by_body].T @ unit, rtol=1e-6, atol=1e-9
    )
    np.testing.assert_allclose(rows.residual[[0, 1, 2, 4, 5]], 0, atol=1e-8)


def test_samples_weigh_as_huber_has_it():
    size = np.array([0.0, 0.5, 1.0, 2.0, 50.0]) * limit(6)
    residual = size[:, None] * np.eye(6)[2]
    np.testing.assert_allclose(sample_weight(residual), [1.0, 1.0, 1.0, 0.5, 0.02])


def test_forces_outside_the_arc_count_nothing():
    found = Case("platform end")
    time = found.time.copy()
    time[0], time[-1] = START - 1, END + 1
    tally = Tally()
    rows = found.rows(forces=replace(found.noisy(11), time=time), tally=tally)
    for each in (rows.residual, rows.by_motion, rows.by_errors):
        np.testing.assert_array_equal(each[[0, -1]], 0.0)
        assert np.all(np.any(each[1:-1], axis=(1,) if each.ndim == 2 else (1, 2)))
    assert tally.count["forces", "tension"] == pytest.approx(6 * (len(time) - 2), rel=1e-9)


@pytest.mark.parametrize("force", ["platform end", "wrench"])
def test_corrections_are_as_large_as_they_are_counted(force):
    found = Case(force, n=400)
    tally = Tally()
    found.rows(forces=found.noisy(12), tally=tally)
    sizes = {q: v.shape[1] for q, v in found.forces.readings.items()}
    assert tally.count == pytest.approx(
        {("forces", q): 400 * 6 * k / sum(sizes.values()) for q, k in sizes.items()}
    )
    low, high = chi2.ppf([RARE, 1 - RARE], 400 * 6)
    assert low < sum(tally.square.values()) < high
    assert tally.cost == pytest.approx(sum(tally.square.values()), rel=1e-3)


def test_a_noise_that_is_larger_than_it_counts_as_shows_as_such():
    found, tally = Case("platform end", n=400), Tally()
    found.rows(forces=found.noisy(12, 2.0), tally=tally)
    # Twofold, fourfold in variance, within what four hundred samples scatter by.
    assert 3.6 < tally.square["forces", "tension"] / tally.count["forces", "tension"] < 4.4


def test_where_most_samples_stand_far_none_is_the_exception():
    found, tally = Case("platform end", n=400), Tally()
    found.rows(forces=found.noisy(12, 10.0), tally=tally)
    assert tally.count["forces", "tension"] > 6 * 300
    assert tally.square["forces", "tension"] / tally.count["forces", "tension"] == pytest.approx(
        100, rel=0.1
    )


def test_a_reading_that_is_left_out_takes_an_equation_with_it():
    found = Case("platform end", n=400)
    left_out = np.zeros((400, 8), dtype=bool)
    left_out[:, 2] = True
    noisy, tally = found.noisy(13), Tally()
    found.rows(forces=replace(noisy, left_out=left_out), tally=tally)
    assert tally.count["forces", "tension"] == pytest.approx(5 * 400, rel=1e-3)
    low, high = chi2.ppf([RARE, 1 - RARE], 5 * 400)
    assert low < tally.square["forces", "tension"] < high
    assert tally.far["forces", "tension"] == 400


STRETCHING = {
    "platform end": {"force": "platform end"},
    "winch end": {"force": "winch end"},
    "at rest": {"force": "platform end", "static": True},
    "drifting sensors": {"force": "platform end", "drifting": True},
}


def followed(found, later=0.0, factors=None, **change):
    """Tensions that lengths would follow, at the times of the forces or so much later."""
    lengths = replace(found.segment.readings[0], follows=True)
    segment = replace(found.segment, readings=(lengths,), **change)
    columns = 10 + np.arange(len(found.calibration_parameters))
    at = carried_tensions(
        found.experiment,
        segment,
        found.forces,
        found.calibration,
        columns,
        found.parameters,
        factors or {},
    )
    return at(found.balance().time + later)


@pytest.fixture(scope="module", params=STRETCHING)
def stretching(request):
    found = Case(**STRETCHING[request.param])
    return found, followed(found)


def test_tensions_that_lengths_follow_are_those_that_carry_the_body(stretching):
    found, at = stretching
    np.testing.assert_allclose(at.values, found.balance().carried)


def test_beyond_the_forces_they_follow_no_motion():
    found = Case(force="winch end")
    at, time = followed(found), found.balance().time
    later = followed(found, later=0.1)
    beyond = time + 0.1 > time[-1]
    # Of lengths that are read after the last force, the motion there changes nothing.
    np.testing.assert_allclose(later.values[beyond], np.tile(at.values[-1], (beyond.sum(), 1)))
    for derivative in (later.by_state, later.by_rate, later.by_acceleration):
        assert not derivative[beyond].any()
    assert later.by_acceleration[~beyond].any()
    # Body and gains change them as they change the last ones.
    last = np.tile(at.by_border[-1], (beyond.sum(), 1, 1))
    np.testing.assert_allclose(later.by_border[beyond], last)


@pytest.mark.parametrize("force", ["platform end", "winch end"])
@pytest.mark.parametrize("later", [0.0, 0.1])
@pytest.mark.parametrize("louder", [1.0, 3.0])
def test_tensions_the_body_and_gains_may_all_be_larger_alike(force, later, louder):
    """Lengths on cables that stretch more by as much read the same: whatever is taken off them, no
    derivative may say otherwise. Where one did, gains and mass were off by five of their 1-sigma."""
    found = Case(force=force, n=60)
    found.forces = found.noisy(5)
    label = found.segment.label("forces", "tension")
    at = followed(found, later=later, factors={label: louder})
    off = np.einsum("nij,nj->ni", at.kept, np.random.default_rng(3).normal(size=at.values.shape))
    places, values = found.calibration_parameters.places, found.calibration.values
    common, own = (places["forces", key, None] for key in ("common_gain", "gain"))
    for gain in (common, own):
        larger = np.zeros(10 + len(values))
        larger[:10] = -found.parameters
        larger[10 + gain.start : 10 + gain.stop] = values[gain]
        for tensions in (at,) if later else (at, at.without(off)):
            along = tensions.by_border @ larger[tensions.columns]
            np.testing.assert_allclose(along, -tensions.values, rtol=1e-9)
    assert np.abs(at.without(off).by_border - at.by_border).max() > 0


def test_they_follow_the_motion_as_differences_do(stretching):
    found, at = stretching
    x = found.segment.coefficients
    ways = np.random.default_rng(1).normal(size=(8, *x.shape))
    with rollers_held(found):
        expected = central_differences(lambda c: found.balance(coefficients=c).carried, x, ways)
    local = found.segment.basis(found.balance().time)
    block = found.segment.block
    by = spread(local, at.by_state, at.by_rate, at.by_acceleration, block=block)
    own = local.first[:, None] + np.arange(by.shape[2] // block)
    along = np.einsum("nki,dni->nkd", by, ways[:, own].reshape(len(ways), len(own), -1))
    assert_derivatives(along, expected)


@pytest.mark.integration
def test_they_follow_body_and_systematic_errors_as_differences_do(stretching):
    found, at = stretching
    by_border = np.zeros((*at.values.shape, 10 + len(found.calibration_parameters)))
    by_border[:, :, at.columns] = at.by_border
    expected = central_differences(
        lambda p: found.balance(parameters=p).carried, found.parameters, 100 * np.eye(10)
    )
    assert_derivatives(100 * by_border[:, :, :10], expected)
    # Of when something was read, and of filters, see the next test.
    places = [
        place
        for (owner, key, _), place in found.calibration_parameters.places.items()
        if key not in {"delay", TIME_CONSTANT, *ROLLERS} and not key.startswith(SURROUNDINGS)
    ]
    places = np.concatenate([np.arange(p.start, p.stop) for p in places])
    ways = np.eye(len(found.calibration_parameters))[places]
    with rollers_held(found):
        expected = central_differences(
            lambda v: found.balance(values=v).carried, found.calibration.values, ways
        )
    assert_derivatives(by_border[:, :, 10 + places], expected)


@pytest.mark.parametrize("force", ["platform end", "winch end"])
def test_what_they_are_at_a_time_follows_when_readings_were_read(force):
    """What carries the body stays; the inner tension is that of other readings."""
    found = Case(force, n=180)
    # Tensions that change smoothly, and carry the body.
    inner = 700 + 300 * np.sin(2 * np.pi * 0.8 * found.time[:, None] + np.arange(8))
    found.forces = found.force_samples({"tension": inner}, found.forces.sigma)
    found.balanced()
    place = found.calibration_parameters.places["forces", TIME_CONSTANT, None]
    values = found.calibration.values.copy()
    values[place] = 0.02
    found.calibration = CalibrationValues(found.calibration_parameters, values)
    inside = slice(20, -20)
    times = found.balance().time[inside] + 0.004
    columns = 10 + np.arange(len(values))
    lengths = replace(found.segment.readings[0], follows=True)
    segment = replace(found.segment, readings=(lengths,))

    def at(values):
        calibration = CalibrationValues(found.calibration_parameters, values)
        return carried_tensions(
            found.experiment, segment, found.forces, calibration, columns, found.parameters, {}
        )(times)

    here = at(values)
    by_border = np.zeros((*here.values.shape, 10 + len(columns)))
    by_border[:, :, here.columns] = here.by_border
    delay = found.calibration_parameters.places["recorder", "delay", "run"]
    for own in (place, delay):
        ends = []
        for step in (1e-3, -1e-3):
            moved = values.copy()
            moved[own] += step
            ends.append(at(moved).values)
        expected = (ends[0] - ends[1]) / 2e-3
        off = by_border[:, :, 10 + own.start] - expected
        assert np.sqrt(np.mean(off**2)) < 0.1 * np.sqrt(np.mean(expected**2))


def test_their_variance_is_what_the_balance_leaves_of_the_noise(stretching):
    found, at = stretching
    variance = np.zeros_like(at.values)
    for r, sigma in enumerate(found.forces.sigma):
        way = 1e-3 * sigma * np.eye(len(found.forces.sigma))[r]
        ends = [
            found.balance(
                forces=replace(
                    found.forces, readings=found.changed(np.tile(s * way, (len(at.values), 1)))
                )
            ).carried
            for s in (1, -1)
        ]
        variance += ((ends[0] - ends[1]) / 2e-3) ** 2
    np.testing.assert_allclose(at.variance, variance, rtol=1e-4, atol=1e-4 * variance.max())


# Ropes that damp


def damped(frequency, *, slope=0.0):
    """Tensions of two cables that swing [Hz] on a slope [N/s], with what they follow, none of it but
    a gain."""
    time, omega = np.linspace(0.0, 2.0, 201), 2 * np.pi * frequency
    size = np.array([100.0, -60.0])
    swing = np.outer(np.sin(omega * time), size)
    values = 1000.0 + slope * time[:, None] + swing
    none = np.zeros((len(time), 2, POSE))
    rate = slope + omega * np.outer(np.cos(omega * time), size)
    return time, CarriedTensions(
        values,
        *(none, none, none),
        values[:, :, None],
        np.array([3]),
        np.ones((*values.shape, 1)),
        np.broadcast_to(np.eye(2), (*values.shape, 2)),
        np.zeros((*values.shape, 0)),
        np.zeros(0, dtype=int),
        rate,
        -(omega**2) * swing,
        0.02 * values,
    )


@pytest.mark.parametrize("frequency", [0.2, 1.0, 2.0])
def test_ropes_that_damp_stretch_as_a_spring_beside_a_damper(frequency):
    lag = 0.015
    time, tensions = damped(frequency, slope=-30.0)
    found = tensions.behind(np.array([lag, 0.0]), np.array([-1, -1]))

    def shortfall(t, stretched):
        pull = [np.interp(t, time, each) for each in tensions.values.T]
        return (np.array(pull) - stretched) / lag

    # From any beginning, which is forgotten within some time constants.
    spring = solve_ivp(shortfall, (0.0, 2.0), tensions.values[0], t_eval=time, max_step=1e-3)
    forgotten = time > 10 * lag
    third_order = 100.0 * (2 * np.pi * frequency * lag) ** 3 + 0.05
    assert np.abs(found.values - spring.y.T)[forgotten].max() < third_order
    assert np.abs(found.values - tensions.values).max() > 3 * third_order
    assert found.columns.tolist() == [3]


def test_what_is_fed_takes_a_part_where_a_damper_spans_the_cable():
    # The whole stretch T l / k obeys the equation of a spring beside a damper: with constant tension
    # it is what is fed that changes it.
    _, tensions = damped(0.0)
    found = tensions.behind(np.array([0.015, 0.015]), np.array([-1, -1]))
    np.testing.assert_allclose(found.values, tensions.values * (1 - 0.015 * 0.02))


def test_both_lags_act_as_differences_show():
    _, tensions = damped(0.7)
    lags, columns = np.array([0.012, 0.005]), np.array([7, 8])
    found = tensions.behind(lags, columns)
    assert found.columns.tolist() == [3, 7, 8]
    for i, step in enumerate(1e-6 * np.eye(2)):
        ends = [tensions.behind(lags + sign * step, columns).values for sign in (1, -1)]
        np.testing.assert_allclose(
            found.by_border[:, :, 1 + i], (ends[0] - ends[1]) / 2e-6, rtol=1e-6, atol=1e-4
        )
    np.testing.assert_array_equal(found.by_border[:, :, 0], tensions.values)
    (alone,) = {tensions.behind(lags, np.array([-1, 8])).by_border.shape[2]}
    assert alone == 2


def test_rates_of_tensions_are_those_of_lines_about_each_time():
    found = Case(force="platform end", n=60)
    at, time = followed(found), found.balance().time
    for i in (0, 20, 59):
        near = np.abs(time - time[i]) <= 0.1
        near[max(i - 1, 0) : i + 2] = True
        for rates, values in ((at.rate, at.values), (at.bend, at.rate)):
            slope = np.polyfit(time[near] - time[i], values[near], 1)[0]
            np.testing.assert_allclose(rates[i], slope, rtol=1e-6, atol=1e-6)
    assert np.abs(at.feed).max() > 0


def test_at_rest_nothing_lags():
    at = followed(Case(force="platform end", static=True))
    for rates in (at.rate, at.bend, at.feed):
        assert not rates.any()


@pytest.mark.parametrize("force", ["platform end", "winch end"])
def test_a_balance_in_parts_is_the_whole(force, monkeypatch):
    found = Case(force)
    whole = found.balance()
    monkeypatch.setattr(force_readings, "_AT_ONCE", 3)
    parts = list(parts_of(found.experiment, found.segment, found.forces, found.calibration))
    assert len(parts) > 1
    told = np.concatenate([found.balance(forces=each).left_over for each in parts])
    np.testing.assert_allclose(told, whole.left_over, rtol=1e-9, atol=1e-9)
    later = part_of(
        found.experiment, found.segment, found.forces, found.calibration, slice(4, None)
    )
    np.testing.assert_allclose(
        found.balance(forces=later).left_over, whole.left_over[4:], rtol=1e-9, atol=1e-9
    )
