from functools import cache
from itertools import product

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from steelyard.batch import Batched
from steelyard.robot.cable import CableSpec, by_length, by_tension
from steelyard.robot.catenary import (
    Catenary,
    forces,
    mean_of_near_end,
    near_end_of_mean,
    required_length,
    shallow_length,
    taut_tension,
)

TOLERANCE = 1e-8  # [m], relative force: what the module accepts as solved; the integration itself is good to 1e-11

WEIGHT, STIFFNESS = 0.064 * 9.81, 5e5  # [N/m], [N]
ANCHORS = {
    "above": [-7.2, -5.4, 5.4],
    "below": [6.0, 4.0, -2.5],
    "level": [3.0, -8.0, 1.2],
    "steep": [0.4, 0.3, 8.0],
}
UPS = {"upright": [0.0, 0.0, 1.0], "tilted": [0.06, -0.1, 0.99]}
POINT = np.array([0.3, -0.5, 1.2])
SIXTH_ORDER = [
    (1, 45),
    (-1, -45),
    (2, -9),
    (-2, 9),
    (3, 1),
    (-3, -1),
]  # of central differences, over 60 h


def unit(v):
    return np.asarray(v) / np.linalg.norm(v)


def cable_spec(
    anchor, up=(0, 0, 1), radius=0.0, axis=(0, 0, 1), weight=WEIGHT, stiffness=STIFFNESS
):
    return CableSpec(
        ca.DM(np.array(anchor)),
        unit(axis),
        radius,
        unit(up),
        weight,
        1 / stiffness if stiffness else 0.0,
    )


@cache
def function_of(form, numbers):
    """A form over points and values, built once for all who ask for a cable of these numbers."""
    anchor, axis, radius, up, weight, compliance = numbers
    cable = CableSpec(ca.DM(list(anchor)), np.array(axis), radius, np.array(up), weight, compliance)
    point, given = ca.SX.sym("point", 3), ca.SX.sym("value")
    shape = form(cable, point, given)
    return Batched("cable", {"point": point, "value": given}, shape._asdict())


def solved(form, cable, value, points=POINT[None]):
    vectors = (cable.anchor, cable.axis, cable.up)
    anchor, axis, up = (tuple(np.asarray(each, dtype=float).ravel()) for each in vectors)
    numbers = anchor, axis, cable.radius, up, cable.weight, cable.compliance
    values = function_of(form, numbers)(point=points, value=[value])
    return {key: v[0] if v.shape[1] > 1 else v.item() for key, v in values.items()}


def hang(start, force, length, up, weight, compliance):
    """Position and force at the far end of a cable integrated element by element from the platform
    end."""

    def element(s, y):
        pull = force + weight * s * up
        tension = np.linalg.norm(pull)
        return (1 + tension * compliance) * pull / tension

    end = solve_ivp(element, (0, length), start, method="DOP853", rtol=1e-13, atol=1e-13)
    return end.y[:, -1], force + weight * length * up


def assert_hangs(cable, shape, point=POINT):
    """The cable, integrated from the attachment, ends on the roller (or at the anchor) and leaves
    it tangentially."""
    on_roller = cable.radius * shape["wrap"] / (1 + shape["winch_tension"] * cable.compliance)
    force = shape["tension"] * shape["direction"]
    end, pull = hang(
        point, force, shape["length"] - on_roller, cable.up, cable.weight, cable.compliance
    )
    anchor = np.array(cable.anchor).ravel()
    outward = point - anchor - (point - anchor) @ cable.axis * cable.axis
    centre = anchor + cable.radius * unit(outward)
    if cable.radius:
        hinge = np.cross(cable.axis, unit(outward))
        radial = (end - centre) / cable.radius
        heading = np.cross(hinge, radial)
        assert np.linalg.norm(radial) == pytest.approx(1, abs=TOLERANCE / cable.radius)
        assert hinge @ radial == pytest.approx(0, abs=TOLERANCE / cable.radius)
        assert radial @ pull / np.linalg.norm(pull) == pytest.approx(
            0, abs=TOLERANCE / cable.radius
        )
        assert heading @ pull < 0  # the cable travels towards the platform
        angle = np.arctan2(
            np.cross(anchor - centre, end - centre) @ hinge, (anchor - centre) @ (end - centre)
        )
        assert shape["wrap"] % (2 * np.pi) == pytest.approx(
            angle % (2 * np.pi), abs=TOLERANCE / cable.radius
        )
    else:
        np.testing.assert_allclose(end, anchor, atol=TOLERANCE)
    np.testing.assert_allclose(end, shape["leave_point"], atol=TOLERANCE)
    assert np.linalg.norm(pull) == pytest.approx(shape["winch_tension"], rel=TOLERANCE)


def integrated(H, V, compliance, length=9.0):
    """Span of a cable of known forces, by integration, and the cable in terms of the mean of its
    end tensions."""
    up = np.array([0, 0, 1])
    end, pull = hang(np.zeros(3), np.array([H, 0, V]), length, up, WEIGHT, compliance)
    mean = (np.hypot(H, V) + np.linalg.norm(pull)) / 2
    return end[0], end[2], Catenary(ca.DM(mean), ca.DM(length), WEIGHT, compliance)


FORCES = pytest.mark.parametrize(
    ("H", "V"), [(600, 400), (50, -30), (5, 0), (2000, -2500), (0.5, 3)]
)
COMPLIANCES = pytest.mark.parametrize("compliance", [0.0, 2e-6, 1e-4])


@COMPLIANCES
@FORCES
def test_forces_are_those_of_the_cable_integrated_to_the_same_span(H, V, compliance):
    run, rise, cable = integrated(H, V, compliance)
    level, mean_vertical = forces(cable, run, rise)
    assert float(level) == pytest.approx(H, rel=TOLERANCE)
    assert float(mean_vertical) == pytest.approx(V + WEIGHT * 9.0 / 2, rel=TOLERANCE)


@COMPLIANCES
@FORCES
def test_required_length_is_that_of_the_integrated_cable(H, V, compliance):
    run, rise, cable = integrated(H, V, compliance)
    assert float(required_length(cable, run**2, rise).value) == pytest.approx(9.0, rel=TOLERANCE)


@COMPLIANCES
@FORCES
def test_mean_tension_and_that_of_the_near_end_follow_from_each_other(H, V, compliance):
    _, rise, cable = integrated(H, V, compliance)
    assert float(mean_of_near_end(np.hypot(H, V), rise, WEIGHT, compliance)) == pytest.approx(
        float(cable.mean), rel=TOLERANCE
    )
    assert float(near_end_of_mean(cable.mean, rise, WEIGHT, compliance)) == pytest.approx(
        np.hypot(H, V), rel=TOLERANCE
    )


@COMPLIANCES
@pytest.mark.parametrize("length", [9.0, 14.0])  # of a taut and of a slack one
def test_derivatives_of_the_required_length_are_those_of_casadi(length, compliance):
    mean, free = ca.SX.sym("mean"), ca.SX.sym("free")
    required = required_length(Catenary(mean, free, WEIGHT, compliance), 70.0, -4.0)
    stated = ca.vertcat(required.by_mean, required.by_length)
    derived = ca.gradient(required.value, ca.vertcat(mean, free))
    stated, derived = ca.Function("derivatives", [mean, free], [stated, derived])(11.0, length)
    np.testing.assert_allclose(stated, derived, rtol=TOLERANCE)


@pytest.mark.parametrize("tension", [30.0, 300.0])
def test_a_shallow_cable_is_its_parabola(tension):
    """The next term is of fourth order in the weight over the tension."""
    shallow = float(shallow_length(tension, 64.0, 3.0, WEIGHT, 2e-6))
    cable = Catenary(ca.DM(tension), ca.DM(shallow), WEIGHT, 2e-6)
    assert (
        abs(float(required_length(cable, 64.0, 3.0).value) - shallow)
        < shallow * (WEIGHT * shallow / 2 / tension) ** 4
    )


@pytest.mark.parametrize("stiffness", [STIFFNESS, None], ids=["elastic", "inextensible"])
@pytest.mark.parametrize("tension", [10.0, 50.0, 600.0, 5000.0])
@pytest.mark.parametrize("up", UPS.values(), ids=UPS)
@pytest.mark.parametrize("anchor", ANCHORS.values(), ids=ANCHORS)
def test_a_cable_of_known_tension_reaches_its_anchor(anchor, up, tension, stiffness):
    cable = cable_spec(anchor, up, stiffness=stiffness)
    shape = solved(by_tension, cable, tension)
    assert shape["residual"] < TOLERANCE
    assert shape["tension"] == pytest.approx(tension, rel=TOLERANCE)
    assert_hangs(cable, shape)


@pytest.mark.parametrize("axis", [(0, 0, 1), (1, 2, 2), (0, 0, -1)], ids=["up", "slanting", "down"])
@pytest.mark.parametrize("tension", [50.0, 5000.0])
@pytest.mark.parametrize("up", UPS.values(), ids=UPS)
@pytest.mark.parametrize("anchor", ANCHORS.values(), ids=ANCHORS)
def test_a_cable_of_known_tension_leaves_its_roller_tangentially(anchor, up, tension, axis):
    cable = cable_spec(anchor, up, radius=0.05, axis=axis)
    shape = solved(by_tension, cable, tension)
    assert shape["residual"] < TOLERANCE
    assert_hangs(cable, shape)


@pytest.mark.parametrize("radius", [0.0, 0.05])
@pytest.mark.parametrize("tension", [10.0, 20.0, 50.0, 600.0, 5000.0])
@pytest.mark.parametrize("anchor", ANCHORS.values(), ids=ANCHORS)
def test_a_cable_of_known_length_reaches_its_anchor(anchor, tension, radius):
    cable = cable_spec(anchor, radius=radius)
    fed = solved(by_tension, cable, tension)["length"]
    shape = solved(by_length, cable, fed)
    assert shape["residual"] < TOLERANCE
    assert shape["length"] == pytest.approx(fed, rel=TOLERANCE)
    assert_hangs(cable, shape)


@pytest.mark.parametrize("axis", [(0, 0, 1), (1, 2, 2)], ids=["up", "slanting"])
@pytest.mark.parametrize(
    ("radius", "slack"),
    [*product([0.0, 0.05, 0.3], [0.995, 1.0, 1.01, 1.03]), (0.0, 1.1), (0.0, 1.3)],
)
@pytest.mark.parametrize("anchor", [ANCHORS[name] for name in ("above", "below", "level")])
def test_a_cable_of_known_length_hangs_from_taut_to_slack(anchor, slack, radius, axis):
    straight = solved(
        by_tension, cable_spec(anchor, radius=radius, axis=axis, weight=0.0, stiffness=None), 1.0
    )
    cable = cable_spec(anchor, radius=radius, axis=axis)
    shape = solved(by_length, cable, slack * straight["length"])
    assert shape["residual"] < TOLERANCE
    assert shape["length"] == pytest.approx(slack * straight["length"], rel=TOLERANCE)
    assert_hangs(cable, shape)


@pytest.mark.parametrize("radius", [0.0, 0.05])
@pytest.mark.parametrize("tension", [20.0, 300.0])
def test_derivatives_through_the_steps_are_those_of_the_solution(tension, radius):
    """Instruments differentiate the expressions; sixth-order differences of a length of ten metres
    are good to 1e-9."""
    cable, h = cable_spec(ANCHORS["above"], radius=radius), 0.02
    point, given = ca.SX.sym("point", 3), ca.SX.sym("tension")
    length = by_tension(cable, point, given).length
    gradient = np.array(
        ca.Function("g", [point, given], [ca.gradient(length, point)])(POINT, tension)
    ).ravel()
    for e, derived in zip(np.eye(3), gradient, strict=True):
        moved = [
            c * solved(by_tension, cable, tension, (POINT + k * h * e)[None])["length"]
            for k, c in SIXTH_ORDER
        ]
        assert derived == pytest.approx(sum(moved) / (60 * h), abs=1e-8)


def test_constants_of_a_cable_may_be_symbols():
    numbers = cable_spec(ANCHORS["above"], UPS["tilted"], radius=0.05, axis=(1, 2, 2))
    symbols = CableSpec(
        *[ca.SX.sym(name, ca.DM(value).numel()) for name, value in numbers._asdict().items()]
    )
    expected = by_tension(numbers, ca.DM(POINT), 300.0)
    found = ca.Function("shape", list(symbols), list(by_tension(symbols, ca.DM(POINT), 300.0)))(
        *map(ca.DM, numbers)
    )
    for name, value, wanted in zip(expected._fields, found, expected, strict=True):
        np.testing.assert_allclose(
            np.array(value), np.array(ca.DM(wanted)), rtol=TOLERANCE, atol=TOLERANCE, err_msg=name
        )


@pytest.mark.parametrize("weight", [0.0, WEIGHT])
@pytest.mark.parametrize("radius", [0.0, 0.05])
@pytest.mark.parametrize("tension", [50.0, 400.0, 5000.0])
def test_length_and_tension_answer_each_other(tension, radius, weight):
    cable = cable_spec(ANCHORS["above"], radius=radius, weight=weight)
    forth = solved(by_tension, cable, tension)
    back = solved(by_length, cable, forth["length"])
    assert back["tension"] == pytest.approx(tension, rel=TOLERANCE)
    np.testing.assert_allclose(back["direction"], forth["direction"], atol=TOLERANCE)
    np.testing.assert_allclose(back["leave_point"], forth["leave_point"], atol=TOLERANCE)


@pytest.mark.parametrize("stretch", [0.999, 1.0])
def test_stiffness_of_a_cable_is_symmetric_since_its_force_has_a_potential(stretch):
    anchor, point, fed = np.array(ANCHORS["above"]), ca.SX.sym("point", 3), ca.SX.sym("fed")
    shape = by_length(cable_spec(anchor), point, fed)
    stiffness = ca.jacobian(shape.tension * shape.direction, point)
    K = np.array(
        ca.Function("K", [point, fed], [stiffness])(POINT, stretch * np.linalg.norm(anchor - POINT))
    )
    np.testing.assert_allclose(K, K.T, atol=TOLERANCE * np.abs(K).max())
    assert (np.linalg.eigvalsh((K + K.T) / 2) < 0).all()  # it pulls back


@pytest.mark.parametrize("radius", [0.0, 0.05])
def test_without_weight_the_cable_becomes_straight(radius):
    def hanging(weight):
        cable = cable_spec(ANCHORS["above"], radius=radius, weight=weight, stiffness=None)
        return solved(by_tension, cable, 1000.0)

    straight = hanging(0.0)
    for weight in (1e-1, 1e-2, 1e-3):
        light = hanging(weight)
        half_weight = weight * straight["length"] / 2 / 1000.0
        turned = np.linalg.norm(light["direction"] - straight["direction"])
        # Half the weight hangs on the platform's end, nearly square to the cable; the sag lengthens
        # it in second order.
        assert 0.7 * half_weight < turned < 1.001 * half_weight
        assert (
            0
            < light["length"] - straight["length"]
            < straight["length"] / 6 * half_weight**2 + TOLERANCE
        )


@pytest.mark.parametrize("weight", [1e-4, 1e-6, 1e-9])
def test_a_cable_of_nearly_no_weight_is_solved_too(weight):
    straight = solved(by_tension, cable_spec(ANCHORS["above"], weight=0.0), 1000.0)
    light = solved(by_tension, cable_spec(ANCHORS["above"], weight=weight), 1000.0)
    assert light["residual"] < TOLERANCE
    np.testing.assert_allclose(
        light["direction"], straight["direction"], atol=weight * 0.01 + TOLERANCE
    )


def test_a_cable_that_hangs_plumb_carries_its_own_weight():
    anchor = POINT + np.array([0, 0, 6.0])
    shape = solved(by_tension, cable_spec(anchor), 300.0)
    assert shape["residual"] < TOLERANCE
    np.testing.assert_allclose(
        shape["direction"], [0, 0, 1], atol=1e-6
    )  # the micrometre of the module over metres
    free = brentq(lambda L: L * (1 + (300.0 + WEIGHT * L / 2) / STIFFNESS) - 6.0, 1, 10, xtol=1e-14)
    assert shape["length"] == pytest.approx(free, abs=TOLERANCE)
    assert shape["winch_tension"] == pytest.approx(300.0 + WEIGHT * free, abs=TOLERANCE)


@pytest.mark.parametrize("length", [9.9, 9.99, 10.0, 10.05])
def test_taut_tension_is_the_positive_root_of_its_cubic(length):
    stretch, sag = STIFFNESS * (10.0 / length - 1), STIFFNESS * (WEIGHT * 10.0) ** 2 / 24
    roots = np.roots([1, -stretch, 0, -sag])
    expected = roots[np.isreal(roots)].real.max()
    assert float(taut_tension(10.0, length, WEIGHT, STIFFNESS)) == pytest.approx(
        expected, rel=TOLERANCE
    )
