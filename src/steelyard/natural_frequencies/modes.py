r"""Natural modes of a body that hangs on cables.

Small swings about the equilibrium: :math:`M \ddot x + K x = 0`. Cables that keep their length take
out the directions in which they would change; their tensions times the second derivative of the
lengths are in K, beside the weight [Goldstein2002]_. Cables that stretch add their stiffness.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import eigh, null_space
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array, readonly
from steelyard.dynamics import platform_wrench
from steelyard.errors import InfeasibleError, InputError
from steelyard.inertia import TEN, Inertia
from steelyard.natural_frequencies.equilibrium import Equilibrium, at_rest, rigid_cables, settled
from steelyard.natural_frequencies.hanging_body import Place, forces, mass_matrix
from steelyard.robot.kinematics import cables_at
from steelyard.robot.model import DIRECTIONS, Robot
from steelyard.robot.tension import distribute

_STEP = 1e-4
"""Relative step of a body parameter that shows how frequencies follow it."""
_UNSTABLE = 1e-6
"""Part of the largest squared frequency that a negative one may have by rounding."""
_MOVED = 1e-5
"""Step of a coordinate [m]."""
_AT_THE_EDGE = (
    "expected an equilibrium that stays where body or robot change a little, found a cable at the"
    " edge of slack; choose another pose"
)
_TURNS = 3
"""Tensions and directions of sagging cables in turn."""


@dataclass(frozen=True, eq=False)
class NaturalModes:
    """A body at rest on cables, and its natural modes."""

    cables: Robot
    """As they act: of constant length, or elastic."""
    body: Inertia
    lengths: Array
    """Unstrained [m], shape (m,)."""
    rest: Equilibrium
    asked: Place | None
    """Pose whose lengths the cables have; None: their lengths were given."""
    frequencies: Array
    """Ascending [Hz], shape (k,)."""
    shapes: tuple[Array, ...]
    """See :class:`Mode`."""
    elastic: bool


def natural(
    robot: Robot,
    body: Inertia,
    *,
    pose: ArrayLike | None = None,
    lengths: ArrayLike | None = None,
    elastic: bool = False,
) -> NaturalModes:
    """Natural modes of a body; arguments and errors of :func:`frequencies`."""
    if (pose is None) == (lengths is None):
        raise InputError(
            "expected either a pose or the lengths of the cables, found"
            f" {'neither' if pose is None else 'both'}; give one of --pose and --lengths"
        )
    if not robot.m:
        raise InputError(f"robot '{robot.name}': expected cables, found none; use another robot")
    elastic = elastic or robot.m >= DIRECTIONS
    if elastic and robot.cable.axial_stiffness is None:
        raise InputError(
            f"robot '{robot.name}': expected 'axial_stiffness' under 'cable', found none; state it"
            + (", or leave --elastic out" if robot.m < DIRECTIONS else "")
        )
    rest, own, asked = _rest(robot, body, pose, lengths, elastic=elastic)
    cables = robot if elastic else rigid_cables(robot)
    return NaturalModes(cables, body, own, rest, asked, *_modes(cables, body, rest), elastic)


def _rest(
    robot: Robot,
    body: Inertia,
    pose: ArrayLike | None,
    lengths: ArrayLike | None,
    *,
    elastic: bool,
) -> tuple[Equilibrium, Array, Place | None]:
    """Where the body comes to rest, the lengths of the cables [m], shape (m,), and the pose that
    these are of, where it hangs beside one.
    """
    if lengths is not None:
        own = np.asarray(lengths, dtype=np.float64)
        if own.shape != (robot.m,) or not (np.isfinite(own) & (own > 0)).all():
            raise InputError(
                f"--lengths: expected {robot.m} lengths above zero [m], found"
                f" {', '.join(f'{v:g}' for v in np.ravel(own))}; give one for every cable"
            )
        return at_rest(robot, body, own, None, elastic=elastic), own, None
    given = np.asarray(pose, dtype=np.float64)
    if given.shape != (DIRECTIONS,) or not np.isfinite(given).all():
        raise InputError(
            "--pose: expected x, y, z [m], roll, pitch, yaw [rad], found"
            f" {', '.join(f'{v:g}' for v in np.ravel(given))}; correct it"
        )
    place = Place(
        readonly(given[:3], (3,), "position"),
        Rotation.from_euler("ZYX", given[:2:-1]).as_matrix(),
    )
    if robot.m >= DIRECTIONS:
        return *_held(robot, body, place), None
    own = _lengths_at(rigid_cables(robot), body, place)
    return at_rest(robot, body, own, place, elastic=elastic), own, place


def _held(robot: Robot, body: Inertia, place: Place) -> tuple[Equilibrium, Array]:
    """A body at rest in a pose that its cables can hold, and their unstrained lengths [m]."""
    still = np.zeros((1, 3))
    felt = -(place.rotation.T @ robot.gravity)[None]
    wrench = platform_wrench(body.parameters, felt, still, still)
    # Sagging cables pull a little lower than straight ones: their direction follows the tension.
    cables, tension = robot.with_straight_cables(), np.ones(robot.m)
    for _ in range(_TURNS):
        structure = cables_at(cables, place.position[None], place.rotation[None], tension).structure
        try:
            tension = distribute(structure, wrench, robot.tension_limits)[0]
        except InfeasibleError:
            low, high = robot.tension_limits
            raise InputError(
                f"--pose: expected a pose in which the cables of '{robot.name}' can hold"
                f" {body.mass:.4g} kg with {low:g} to {high:g} N, found that they cannot; choose"
                " another"
            ) from None
        cables = robot
    length = forces(robot, body, place, tension, np.zeros(6)).length
    found = settled(robot, body, length, Equilibrium(place, tension))
    if found is None:
        raise InputError(
            "--pose: expected a pose in which the body comes to rest, found none; choose another"
        )
    return found, length


def beside(found: NaturalModes, body: Inertia) -> NaturalModes | None:
    """The same of another body on the same lengths, which comes to rest near by; None: it does not.

    Raises:
        InputError: It would fall from there.
    """
    scaled = replace(found.rest, tension=found.rest.tension * body.mass / found.body.mass)
    rest = settled(found.cables, body, found.lengths, scaled)
    if rest is None:
        return None
    at = forces(found.cables, body, rest.place, rest.tension, np.zeros(6))
    slack = rest.tension == 0
    if (at.length[slack] > found.lengths[slack]).any():
        return None
    hertz, shapes = _modes(found.cables, body, rest)
    return replace(found, body=body, rest=rest, frequencies=hertz, shapes=shapes)


def sensitivity(found: NaturalModes) -> Array:
    """How frequencies [Hz] follow the ten body parameters on the same lengths, shape (k, 10).

    Raises:
        InputError: A cable is at the edge of slack.
    """
    cables, body, rest = found.cables, found.body, found.rest
    value, size = body.body_parameters, _size(cables)
    steps = _STEP * np.array([body.mass, *[size] * 3, *[body.mass * size**2] * 6])
    hertz, ways = _swings(cables, body, rest)
    mass = mass_matrix(body, rest.place.rotation)
    slopes = np.zeros((len(found.frequencies), TEN))
    for i, step in enumerate(steps):
        if i < 4:
            sides = []
            for sign in (1.0, -1.0):
                near = _with(value, i, sign * step)
                start = replace(rest, tension=rest.tension * near.mass / body.mass)
                sides.append(_near(cables, near, found.lengths, start))
            slopes[:, i] = (sides[0] - sides[1]) / (2 * step)
        else:
            # Where a body hangs does not ask for its inertia, and the kinetic energy is linear in
            # it.
            other = mass_matrix(_with(value, i, step), rest.place.rotation)
            kinetic = np.einsum("ik,ij,jk->k", ways, (other - mass) / step, ways)
            slopes[:, i] = -hertz / 2 * kinetic
    return slopes


def _with(value: Array, i: int, step: float) -> Inertia:
    """The body of ten body parameters, one of which is larger by a step."""
    other = value.copy()
    other[i] += step
    return Inertia.from_body_parameters(other)


def by_points(found: NaturalModes) -> Array:
    """How frequencies [Hz] follow the coordinates of anchors and attachments, shape (k, 6 m).

    Cables whose lengths were given keep them, those of a pose have them by this geometry.

    Raises:
        InputError: A cable is at the edge of slack.
    """
    robot, slopes = found.cables, []
    points = np.array([robot.anchors, robot.attachments])
    for place in np.ndindex(points.shape):
        sides = []
        for sign in (1.0, -1.0):
            own = points.copy()
            own[place] += sign * _MOVED
            cables = replace(robot, anchors=own[0], attachments=own[1])
            lengths = found.lengths
            if found.asked is not None:
                lengths = _lengths_at(cables, found.body, found.asked)
            sides.append(_near(cables, found.body, lengths, found.rest))
        slopes.append((sides[0] - sides[1]) / (2 * _MOVED))
    return np.column_stack(slopes)


def _near(cables: Robot, body: Inertia, lengths: Array, rest: Equilibrium) -> Array:
    """Frequencies [Hz] of a body and cables that differ little from those with an equilibrium."""
    moved = settled(cables, body, lengths, rest)
    if moved is None:
        raise InputError(_AT_THE_EDGE)
    return _swings(cables, body, moved)[0]


def _modes(robot: Robot, body: Inertia, rest: Equilibrium) -> tuple[Array, tuple[Array, ...]]:
    """Frequencies [Hz], ascending, and the shapes of the modes."""
    hertz, ways = _swings(robot, body, rest)
    size = _size(robot)
    return hertz, tuple(_shape(each, rest.place.rotation, size) for each in ways.T)


def _swings(robot: Robot, body: Inertia, rest: Equilibrium) -> tuple[Array, Array]:
    """Frequencies [Hz], ascending, shape (k,), and the changes of the pose in each mode, of which
    the mass matrix makes 1, shape (6, k).
    """
    at = forces(robot, body, rest.place, rest.tension, np.zeros(6))
    taut = rest.taut
    stiffness = -at.by_pose
    across = np.eye(DIRECTIONS)
    turns = at.length_by_pose[taut]
    yields = at.length_by_tension[np.ix_(taut, taut)]
    if yields.any():
        stiffness = stiffness + at.by_tension[:, taut] @ np.linalg.solve(yields, turns)
    else:
        across = null_space(turns)
    if not across.shape[1]:
        raise InputError(
            f"expected fewer than {DIRECTIONS} taut cables, so that the platform can swing, found"
            f" {len(taut)}; give --elastic"
        )
    mass = mass_matrix(body, rest.place.rotation)
    reduced = across.T @ (stiffness + stiffness.T) @ across / 2
    squares, vectors = eigh(reduced, across.T @ mass @ across)
    if squares[0] < -_UNSTABLE * abs(squares[-1]):
        raise InputError(
            "expected an equilibrium that is stable, found one from which the platform falls; check"
            " the lengths or the pose"
        )
    return np.sqrt(np.maximum(squares, 0.0)) / (2 * np.pi), across @ vectors


def _size(robot: Robot) -> float:
    """Radius of the platform [m]; of one that hangs on a single point a metre."""
    return robot.size if robot.size > 0 else 1.0


def _shape(change: Array, rotation: Array, size: float) -> Array:
    """A change of the pose along the axes of the world, of unit length, its largest part
    positive.
    """
    twist = np.concatenate([change[:3], rotation @ change[3:]])
    scaled = twist * np.array([1.0] * 3 + [size] * 3)
    largest = scaled[np.argmax(np.abs(scaled))]
    return np.asarray(twist / (np.sign(largest) * np.linalg.norm(scaled)))


def _lengths_at(cables: Robot, body: Inertia, place: Place) -> Array:
    """Of cables of constant length at a pose [m], shape (m,)."""
    return forces(cables, body, place, np.ones(cables.m), np.zeros(6)).length
