import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from steelyard.batch import Batched
from steelyard.robot import pulley
from steelyard.robot.cable import CableSpec, by_tension

TOLERANCE = 1e-9  # [m] or of a unit vector: bisection ends at 1e-15, the sixth-order differences are good to 1e-11

AXES = {"up": [0, 0, 1], "down": [0, 0, -1], "level": [1, 0, 0], "slanting": [2, -1, 2]}
ANCHOR = np.array([-1.0, 2.0, 3.0])


def unit(v):
    return np.asarray(v) / np.linalg.norm(v)


def module_cable(axis, radius, compliance=0.0):
    point, tension = ca.SX.sym("point", 3), ca.SX.sym("tension")
    cable = CableSpec(ca.DM(ANCHOR), unit(axis), radius, np.array([0.0, 0.0, 1.0]), 0.0, compliance)
    batched = Batched(
        "cable", {"point": point, "tension": tension}, by_tension(cable, point, tension)._asdict()
    )
    return lambda points, tension=1.0: batched(point=points, tension=[tension])


class WrappedCable:
    """A cable laid on the roller by turning the roller's radius about its hinge until the rest
    points at the target."""

    def __init__(self, axis, radius, point):
        self.axis, self.radius, self.point = unit(axis), radius, point
        self.outward = unit(np.cross(self.axis, np.cross(point - ANCHOR, self.axis)))
        hinge = np.cross(self.axis, self.outward)
        self.centre = ANCHOR + radius * self.outward
        # Vectors square to the hinge, each with itself a quarter turn ahead.
        self.ahead = self.axis, np.cross(hinge, self.axis)
        self.away = self.outward, np.cross(hinge, self.outward)
        self.spoke = ANCHOR - self.centre, np.cross(hinge, ANCHOR - self.centre)
        grid = np.linspace(0, 2 * np.pi, 180)
        miss, ahead = self.miss_and_ahead(grid)
        (found,) = np.flatnonzero((miss[:-1] * miss[1:] <= 0) & (ahead[:-1] > 0))
        self.wrap = self.bisect(grid[found], grid[found + 1])
        self.leave = self.contact(self.wrap)
        self.length = radius * self.wrap + np.linalg.norm(point - self.leave)

    @staticmethod
    def turned(vector, angle):
        """A vector square to the hinge, turned about it."""
        start, quarter = vector
        along = np.multiply.outer(np.cos(angle), start)
        return along + np.multiply.outer(np.sin(angle), quarter)

    def contact(self, angle):
        return self.centre + self.turned(self.spoke, angle)

    def miss_and_ahead(self, angle):
        rest = self.point - self.contact(angle)
        miss = np.sum(self.turned(self.away, angle) * rest, -1)
        return miss, np.sum(self.turned(self.ahead, angle) * rest, -1)

    def bisect(self, low, high):
        """Forty-way section: each round looks at forty angles at once."""
        for _ in range(10):
            angles = np.linspace(low, high, 41)
            miss, _ = self.miss_and_ahead(angles)
            found = np.flatnonzero(miss[:-1] * miss[1:] <= 0)[0]
            low, high = angles[found], angles[found + 1]
        return (low + high) / 2


def points_around(axis, radius, turns):
    """Points which a cable reaches after the given wrap angles, at random distances and in random
    planes."""
    rng = np.random.default_rng(11)
    side = unit(np.cross(unit(axis), [0.3, 0.5, -0.8]))
    points = []
    for b in turns:
        out = Rotation.from_rotvec(rng.uniform(0, 2 * np.pi) * unit(axis)).apply(side)
        contact = radius * ((1 - np.cos(b)) * out + np.sin(b) * unit(axis))
        longest = (
            8.0 if np.sin(b) >= 0 else radius * (1 - np.cos(b)) / -np.sin(b)
        )  # not past the swivel axis
        free = rng.uniform(0.5, 0.9) * longest
        points.append(ANCHOR + contact + free * (np.sin(b) * out + np.cos(b) * unit(axis)))
    return np.array(points)


TURNS = np.radians([2, 30, 60, 89, 91, 120, 150, 175, 185, 220, 260])


@pytest.mark.parametrize("radius", [0.05, 0.4])
@pytest.mark.parametrize("axis", AXES.values(), ids=AXES)
def test_leaves_where_a_bisected_cable_leaves(axis, radius):
    points = points_around(axis, radius, TURNS)
    found = module_cable(axis, radius)(points)
    for i, point in enumerate(points):
        expected = WrappedCable(axis, radius, point)
        assert expected.wrap == pytest.approx(TURNS[i], abs=TOLERANCE)
        np.testing.assert_allclose(found["wrap"][i], expected.wrap, atol=TOLERANCE)
        np.testing.assert_allclose(found["leave_point"][i], expected.leave, atol=TOLERANCE)
        np.testing.assert_allclose(found["length"][i], expected.length, atol=TOLERANCE)


@pytest.mark.parametrize("axis", AXES.values(), ids=AXES)
def test_pulls_along_the_gradient_of_the_length_of_the_bisected_cable(axis):
    radius, h = 0.4, 0.002
    points = points_around(axis, radius, TURNS[1:-1])
    direction = module_cable(axis, radius)(points)["direction"]
    for i, point in enumerate(points):

        def length(step, start=point):
            return WrappedCable(axis, radius, start + step).length

        gradient = [
            sum(c * (length(k * h * e) - length(-k * h * e)) for k, c in ((1, 45), (2, -9), (3, 1)))
            / (60 * h)
            for e in np.eye(3)
        ]
        np.testing.assert_allclose(direction[i], -np.array(gradient), atol=TOLERANCE)
        assert np.linalg.norm(direction[i]) == pytest.approx(1, abs=TOLERANCE)


def test_leaves_tangentially_and_touches_the_circle():
    points = points_around(AXES["slanting"], 0.2, TURNS)
    axis, found = unit(AXES["slanting"]), module_cable(AXES["slanting"], 0.2)(points)
    for point, leave, direction in zip(
        points, found["leave_point"], found["direction"], strict=True
    ):
        roller = WrappedCable(axis, 0.2, point)
        assert np.linalg.norm(leave - roller.centre) == pytest.approx(0.2, abs=TOLERANCE)
        assert (leave - roller.centre) @ direction == pytest.approx(0, abs=TOLERANCE)


def test_length_follows_the_point_without_jumps():
    angle = np.linspace(
        -0.15, np.pi + 0.15, 2000
    )  # around the centre of the roller, from above it to below it
    points = ANCHOR + np.stack([0.1 + 0.6 * np.sin(angle), 0 * angle, 0.6 * np.cos(angle)], axis=1)
    found = module_cable(AXES["up"], 0.1)(points)
    travelled = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert np.degrees(np.ptp(found["wrap"])) > 170
    assert (np.abs(np.diff(found["length"][:, 0])) <= travelled * (1 + TOLERANCE)).all()
    assert np.abs(np.diff(found["wrap"][:, 0])).max() < 0.01


def test_a_point_on_the_way_of_the_incoming_cable_needs_no_roller():
    found = module_cable(AXES["slanting"], 0.3)([ANCHOR + 4 * unit(AXES["slanting"])])
    np.testing.assert_allclose(found["wrap"], 0, atol=TOLERANCE)
    np.testing.assert_allclose(found["leave_point"], [ANCHOR], atol=TOLERANCE)
    np.testing.assert_allclose(found["direction"], [-unit(AXES["slanting"])], atol=TOLERANCE)


def test_a_roller_without_radius_is_a_point():
    points = np.random.default_rng(2).normal(size=(20, 3)) * 4
    found = module_cable(AXES["up"], 0.0)(points)
    np.testing.assert_allclose(
        found["length"][:, 0], np.linalg.norm(points - ANCHOR, axis=1), atol=TOLERANCE
    )
    np.testing.assert_allclose(
        found["leave_point"], np.broadcast_to(ANCHOR, (20, 3)), atol=TOLERANCE
    )


def test_the_whole_way_stretches():
    point = points_around(AXES["up"], 0.05, [1.9])
    found = module_cable(AXES["up"], 0.05, compliance=1 / 2e5)(point, tension=2000.0)
    strained = WrappedCable(AXES["up"], 0.05, point[0]).length
    assert found["length"].item() * (1 + 2000.0 / 2e5) == pytest.approx(strained, abs=TOLERANCE)


def test_swivel_turns_the_centre_towards_the_point_square_to_the_axis():
    point = ca.SX.sym("p", 3)
    roller = pulley.swivel(ca.DM(ANCHOR), ca.DM(unit(AXES["slanting"])), 0.2, point)
    outward = np.array(ca.Function("outward", [point], [roller.outward])([4.0, -1.0, 0.5])).ravel()
    expected = WrappedCable(AXES["slanting"], 0.2, np.array([4.0, -1.0, 0.5])).outward
    np.testing.assert_allclose(outward, expected, atol=TOLERANCE)
