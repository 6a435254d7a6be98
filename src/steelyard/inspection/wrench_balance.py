"""Forces against the weight and the motion of a body that nobody has seen: its ten parameters are
chosen as they fit best.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from steelyard.arrays import Array
from steelyard.dynamics import platform_regressor
from steelyard.errors import InfeasibleError
from steelyard.identification.model.sources import Source
from steelyard.inspection.agreement import (
    InstrumentAgreement,
    Relation,
    attitudes,
    is_command,
    positions,
    specific_force,
    title,
)
from steelyard.inspection.excerpt import Excerpt
from steelyard.inspection.frames import (
    AttitudeMotion,
    OriginMotion,
    accelerometer,
    gyro,
    lever_of,
    mounting,
    moved,
    place,
    turning,
)
from steelyard.instruments import Tension, Wrench
from steelyard.robot.kinematics import cables_at
from steelyard.robot.model import Robot

_TEN = 10
_TOLERANCE, _TOLERANCE_COMMANDED = 0.05, 0.1
"""What may be left of the changes of a wrench."""
_OF_WEIGHT = 0.01
"""What may be left as a part of the force itself: geometry, sag, gains."""
_OFFSET = 0.02
"""1-sigma of the offset of a force sensor that is not stated, as a part of the median tension."""
_MASS = 0.45
"""How far a platform may be from its nominal mass, as a logarithm."""
_CENTRE = 0.35
"""How far its centre of gravity may be from the nominal one, in radii of the platform; without
cables in metres."""
_NEGATIVE = 7.0
"""Logarithm that stands for a mass below zero."""
_RANGE = 1.0
"""Logarithm by which tensions may lie beyond the limits of the robot file."""
_ACCELEROMETER = 0.1
"""1-sigma of what an accelerometer feels beside the motion: bias, misalignment [m/s^2]."""
_OFF_CENTRE = 0.5
"""Lever at which noise in the specific force becomes torque, in radii of the platform."""
_SLACK = 0.02
"""How far below zero a tension may read, as a part of the median."""


@dataclass(frozen=True, eq=False)
class MeasuredWrench:
    """A wrench of the cables, or of a sensor, beside a motion."""

    wrench: Array
    """On the platform about its origin, shape (n, 6)."""
    columns: Array
    """Its derivative by the constants of the sensors, shape (n, 6, c)."""
    sigma: Array
    """1-sigma of these, shape (c,)."""
    noise: tuple[float, float]
    """1-sigma left in force [N] and torque [N m]."""
    structure: Array | None
    """Structure matrix, shape (n, 6, m)."""


@dataclass(frozen=True, eq=False)
class BodyBalance:
    """A body chosen to fit, and what it leaves."""

    left: Array
    """Shape (n, 6)."""
    explained: Array
    """Wrench of the body and of the constants of the sensors, shape (n, 6)."""
    allowed: Array
    """Shape (6,)."""
    parameters: Array
    """The ten of :data:`steelyard.inertia.LINEAR_PARAMETERS`."""
    sigma: Array
    """Of them."""
    constants: Array
    """Of the sensors, in 1-sigmas."""
    carried: MeasuredWrench
    white: Array
    """What was solved: columns over all that was chosen, in their 1-sigmas, shape (n, 6, 10 +
    c)."""
    target: Array
    """Of these, shape (n, 6)."""
    scale: Array
    """1-sigmas of what was chosen, shape (10 + c,)."""


def force_relations(excerpt: Excerpt) -> Iterator[Relation]:
    """Which motions the forces can be held against: each account of it by itself."""
    turned, placed = attitudes(excerpt), positions(excerpt)
    # What an accelerometer feels goes with the gyro beside it, which tells angular acceleration
    # best.
    force_samples = [(f, *_beside(excerpt, f)) for f in excerpt.quantity("specific_force")]
    for force in excerpt.quantity("tension"):
        yield ("tensions", (force,))
        measured = [s for s in turned if not is_command(excerpt, s[0])]
        at = [s for s in placed if not is_command(excerpt, s[0])]
        for a in measured or turned[:1]:
            for p in at or placed[:1]:
                yield ("cables", (force, a, p))
                yield from (
                    ("cables", (force, a, p, *f)) for f in force_samples if not excerpt.static
                )
        if (
            turned
            and placed
            and (measured or at)
            and is_command(excerpt, turned[-1][0])
            and is_command(excerpt, placed[-1][0])
        ):
            # What was commanded is an account of its own.
            yield ("cables", (force, turned[-1], placed[-1]))
    for force in excerpt.quantity("force", "wrench"):
        torque = (force[0], "torque")
        at = [s for s in placed if not is_command(excerpt, s[0])] or placed[:1]
        for a in turned:
            yield from (("wrench", (force, torque, a, p)) for p in at)
            yield from (("wrench", (force, torque, a, *f)) for f in force_samples)
            if not at and (excerpt.static or not force_samples):
                yield ("wrench", (force, torque, a))
        if not turned:
            yield from (("wrench", (force, torque, *f)) for f in force_samples)


def _beside(excerpt: Excerpt, force_samples: Source) -> tuple[Source, ...]:
    """The gyro that goes with an accelerometer: its own, or any."""
    gyros = excerpt.quantity("angular_velocity")
    return (
        tuple(sorted(gyros, key=lambda s: s[0] != force_samples[0])[:1])
        if not excerpt.static
        else ()
    )


def force_agreement(excerpt: Excerpt, relation: Relation) -> InstrumentAgreement | None:
    """Evaluate one of :func:`force_relations`; None where it cannot be had."""
    kind, sources = relation
    if kind == "tensions":
        return tensions_alone(excerpt, sources[0])
    found = body_balance(excerpt, relation)
    return None if found is None else _agreement(excerpt, relation, found)


def tensions_alone(excerpt: Excerpt, source: Source) -> InstrumentAgreement:
    """Cables pull; and about as hard as the robot file allows."""
    read = excerpt.observations[source].value
    size = float(np.median(np.abs(read))) or 1.0
    below = np.sqrt(np.mean(np.minimum(read, 0.0) ** 2, axis=0))
    low, high = excerpt.robot.tension_limits
    beyond = max(0.0, float(np.log(size / high)) if np.isfinite(high) else 0.0)
    if low > 0:
        beyond = max(beyond, float(np.log(low / size)))
    return InstrumentAgreement(
        f"{title(source)} alone",
        (source,),
        (*(f"f{i + 1} above zero" for i in range(read.shape[1])), "range"),
        np.concatenate([below, [beyond]]),
        np.concatenate([np.full(read.shape[1], _SLACK * size), [_RANGE]]),
        "N",
        read,
        np.maximum(read, 0.0),
        True,
    )


@dataclass(frozen=True, eq=False)
class PlatformMotion:
    """One account of how the platform moves."""

    turned: AttitudeMotion | None
    where: OriginMotion | None
    force: Array
    """Specific force of the platform origin [m/s^2], shape (n, 3)."""
    omega: Array
    alpha: Array
    noise: tuple[float, float]
    """1-sigma left in specific force [m/s^2] and angular acceleration [rad/s^2]."""


def _motion(excerpt: Excerpt, sources: tuple[Source, ...]) -> PlatformMotion | None:
    """What some sources say of the motion; None where they do not say enough."""
    turned = next((turning(excerpt, s) for s in sources if s[1] == "orientation"), None)
    at = next((s for s in sources if s[1] == "position"), None)
    force_samples = next((s for s in sources if s[1] == "specific_force"), None)
    where = None if at is None or turned is None else place(excerpt, at, turned)
    turns = next((gyro(excerpt, s) for s in sources if s[1] == "angular_velocity"), None)
    if turns is not None:
        omega, alpha, jitter = turns.value, turns.rate, turns.noise[1]
    elif turned is not None:
        omega, alpha, jitter = turned.omega, turned.alpha, turned.noise[2]
    elif excerpt.static:
        omega, alpha, jitter = (
            np.zeros((len(excerpt.time), 3)),
            np.zeros((len(excerpt.time), 3)),
            0.0,
        )
    else:
        return None
    if force_samples is not None:
        rotation = (
            turned.rotation
            if turned is not None
            else np.broadcast_to(np.eye(3), (len(omega), 3, 3))
        )
        seen = accelerometer(excerpt, force_samples, rotation)
        lever = lever_of(excerpt, force_samples[0])
        force = moved(seen.value, omega, alpha, -lever)
        # A bias and a small misalignment are the accelerometer's own, and are allowed for
        # elsewhere.
        noise = float(
            np.sqrt(seen.noise[0] ** 2 + (np.linalg.norm(lever) * jitter) ** 2 + _ACCELEROMETER**2)
        )
        return PlatformMotion(turned, where, force, omega, alpha, (noise, jitter))
    if turned is None:
        return None
    noise = float(np.hypot(9.81 * turned.noise[0], 0.0 if where is None else where.noise[2]))
    return PlatformMotion(
        turned, where, specific_force(excerpt, turned, where), omega, alpha, (noise, jitter)
    )


def body_balance(excerpt: Excerpt, relation: Relation) -> BodyBalance | None:
    """The body that fits forces and one account of the motion best."""
    kind, sources = relation
    motion = _motion(excerpt, sources)
    if motion is None:
        return None
    if kind == "cables":
        if motion.turned is None or motion.where is None:
            return None
        carried = _of_cables(excerpt, sources[0], motion.turned, motion.where)
    else:
        carried = _of_sensor(excerpt, sources[0], sources[1])
    if carried is None:
        return None
    commanded = any(is_command(excerpt, name) for name, _ in sources)
    Y = platform_regressor(motion.force, motion.omega, motion.alpha)
    return _balanced(excerpt, carried, Y, motion.noise, commanded=commanded)


def _of_cables(
    excerpt: Excerpt, source: Source, turned: AttitudeMotion, where: OriginMotion
) -> MeasuredWrench | None:
    robot = excerpt.robot.with_straight_cables()
    read = excerpt.observations[source]
    try:
        W = _structures(robot, where, turned)
    except InfeasibleError:
        return None
    instrument = excerpt.instruments[source[0]]
    assert isinstance(instrument, Tension)
    offset = instrument.terms(robot.m)[0].deviation
    least = _OFFSET * float(np.median(np.abs(read.value)))
    sigma = np.full(robot.m, least) if offset is None else np.maximum(offset, least / 4)
    by_force = read.noise[0] * float(np.sqrt(np.mean(np.sum(W[:, :3] ** 2, axis=2))))
    by_torque = read.noise[0] * float(np.sqrt(np.mean(np.sum(W[:, 3:] ** 2, axis=2))))
    return MeasuredWrench(
        np.einsum("nkm,nm->nk", W, read.value), W, sigma, (by_force, by_torque), W
    )


@lru_cache(maxsize=32)
def _structures(robot: Robot, where: OriginMotion, turned: AttitudeMotion) -> Array:
    # Of straight cables: what sag does to the directions is less than what is allowed for.
    return cables_at(robot, where.position, turned.rotation, np.full(robot.m, 100.0)).structure


def _of_sensor(excerpt: Excerpt, of_force: Source, of_torque: Source) -> MeasuredWrench:
    instrument = excerpt.instruments[of_force[0]]
    assert isinstance(instrument, Wrench)
    R, lever = mounting(excerpt, of_force[0]), np.array(instrument.position)
    sign = 1.0 if instrument.acts_on == "body" else -1.0
    force, torque = (
        excerpt.observations[of_force].mapped(sign * R),
        excerpt.observations[of_torque].mapped(sign * R),
    )
    wrench = np.hstack([force.value, torque.value + np.cross(lever, force.value)])
    n = len(wrench)
    terms = {term.key: term for term in instrument.terms(0)}
    sigma = []
    for key, seen in (("offset.force", force), ("offset.torque", torque)):
        stated = terms[key].deviation
        sigma.append(np.full(3, float(np.abs(seen.value).max())) if stated is None else stated)
    columns = np.broadcast_to(np.eye(6), (n, 6, 6))
    noise = (
        force.noise[0],
        float(np.hypot(torque.noise[0], np.linalg.norm(lever) * force.noise[0])),
    )
    return MeasuredWrench(wrench, columns, np.maximum(np.concatenate(sigma), 1e-9), noise, None)


def _balanced(
    excerpt: Excerpt,
    carried: MeasuredWrench,
    Y: Array,
    noise: tuple[float, float],
    *,
    commanded: bool,
) -> BodyBalance:
    w = carried.wrench
    n = len(w)
    part = _TOLERANCE_COMMANDED if commanded else _TOLERANCE
    spread = w.std(axis=0)
    force = float(np.sqrt(np.mean(np.sum(w[:, :3] ** 2, axis=1))))
    if carried.structure is None:
        # Offsets are free: the force itself is not known.
        force = float(np.sqrt(np.sum(spread[:3] ** 2)))
    lever = float(np.linalg.norm(spread[3:])) / max(float(np.linalg.norm(spread[:3])), 1e-12)
    size = excerpt.robot.size if excerpt.robot.m else max(lever, 1e-3)
    mass = force / 9.81 if carried.structure is not None else max(force / 5.0, 1e-6)
    common = np.repeat([float(np.mean(spread[:3] ** 2)), float(np.mean(spread[3:] ** 2))], 3)
    whole = np.repeat([_OF_WEIGHT * force, _OF_WEIGHT * force * size], 3)
    by_motion = (
        mass * noise[0],
        mass * float(np.hypot(_OFF_CENTRE * size * noise[0], size**2 * noise[1])),
    )
    noisy = np.repeat(np.hypot(carried.noise, by_motion), 3)
    allowed = np.sqrt(
        noisy**2 + (part * spread) ** 2 + (0.5 * part) ** 2 * common + whole**2 + 1e-24
    )
    reach = excerpt.robot.size if excerpt.robot.m else max(size, 0.3)
    body = mass * np.concatenate([[10.0], np.full(3, 2 * reach), np.full(6, 2 * reach**2)])
    columns = np.concatenate([Y, -carried.columns], axis=2)
    sigma = np.concatenate([body, carried.sigma])
    white = columns / allowed[:, None] * sigma
    whole_b = w / allowed
    if excerpt.unread and carried.structure is not None:
        # What such a cable pulls is whatever it must.
        out = _across(carried.structure[:, :, sorted(excerpt.unread)] / allowed[:, None])
        white, whole_b = out @ white, np.einsum("nij,nj->ni", out, whole_b)
    A, b = white.reshape(n * 6, -1), whole_b.ravel()
    weight = 30.0 / n
    inverse = np.linalg.inv(weight * A.T @ A + np.eye(len(sigma)))
    value = inverse @ (weight * A.T @ b)
    explained = (columns @ (value * sigma)).reshape(n, 6)
    return BodyBalance(
        (whole_b - white @ value) * allowed,
        explained,
        allowed,
        (value * sigma)[:_TEN],
        (np.sqrt(np.diag(inverse)) * sigma)[:_TEN],
        value[_TEN:],
        carried,
        white,
        whole_b,
        sigma,
    )


def _across(directions: Array) -> Array:
    """Projections that take some directions out, shape (n, 6, 6)."""
    Q, _ = np.linalg.qr(directions)
    return np.asarray(np.eye(6) - Q @ Q.swapaxes(1, 2))


def _agreement(excerpt: Excerpt, relation: Relation, found: BodyBalance) -> InstrumentAgreement:
    sources = relation[1]
    robot, p = excerpt.robot, found.parameters
    names, left, allowed = (
        ["fx", "fy", "fz", "tx", "ty", "tz"],
        [*np.sqrt(np.mean(found.left**2, axis=0))],
        [*found.allowed],
    )
    m, sigma = float(p[0]), float(found.sigma[0])
    known = excerpt.experiment.known.get("mass")
    nominal = known[0] if known else robot.platform.mass if robot.platform else None
    if abs(m) > 3 * sigma:
        off = _NEGATIVE if m <= 0 else abs(float(np.log(m / nominal))) if nominal else 0.0
        names.append("mass")
        left.append(off)
        allowed.append(_MASS)
        if m > 0:
            centre = p[1:4] / m
            by = found.sigma[1:4] / m
            reach = robot.size if robot.m else 1.0
            expected = robot.platform.center_of_gravity if robot.platform else np.zeros(3)
            free = _CENTRE * reach if robot.platform else 1.5 * reach
            names.append("centre of gravity")
            left.append(float(np.linalg.norm(np.maximum(np.abs(centre - expected) - 2 * by, 0.0))))
            allowed.append(free)
            names.append("moments")
            left.append(_impossible(p, found.sigma))
            allowed.append(1.5)
    if found.carried.structure is not None:
        names.append("offsets")
        left.append(float(np.sqrt(np.mean(found.constants**2))))
        allowed.append(3.0)
    return InstrumentAgreement(
        title(*sources),
        sources,
        tuple(names),
        np.array(left),
        np.array(allowed),
        "N",
        found.carried.wrench,
        found.explained,
        True,
    )


def _impossible(p: Array, sigma: Array) -> float:
    """By how many 1-sigmas the moments about the origin are below what the first moment alone asks
    for.
    """
    m, h = p[0], p[1:4]
    square = float(h @ h) / m
    least = square - h**2 / m
    short = (least - p[4:7]) / (sigma[4:7] + 1e-12)
    return float(max(0.0, short.max()))
