"""Measured forces against weight and motion of a body that nobody knows: its ten parameters are
chosen as they fit best.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.dynamics import platform_regressor
from steelyard.identification.model.sources import Source
from steelyard.identification.model.unknown_body import BODY, unknown_body
from steelyard.inspection.agreements.agreement import InstrumentAgreement, is_command, title
from steelyard.inspection.agreements.excerpt import Excerpt
from steelyard.inspection.agreements.measured_wrench import (
    MeasuredWrench,
    of_cables,
    of_sensor,
    platform_motion,
)
from steelyard.inspection.agreements.motion import Relation
from steelyard.inspection.agreements.settings import BalanceSettings


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
    measured: MeasuredWrench
    white: Array
    """What was solved: columns over all that was chosen, in their 1-sigmas, shape (n, 6, 10 +
    c)."""
    target: Array
    """Of these, shape (n, 6)."""
    scale: Array
    """1-sigmas of what was chosen, shape (10 + c,)."""


def force_relations(excerpt: Excerpt) -> Iterator[Relation]:
    """Which motions the forces can be compared with: each account of them by itself."""
    turned, placed = excerpt.quantity("orientation"), excerpt.quantity("position")
    measured = [s for s in turned if not is_command(excerpt, s)]
    at = [s for s in placed if not is_command(excerpt, s)]
    # An accelerometer goes with the gyro beside it, which gives angular acceleration best.
    force_samples = [(f, *_beside(excerpt, f)) for f in excerpt.quantity("specific_force")]
    for force in excerpt.quantity("tension"):
        if excerpt.instruments[force[0]].stands_in(excerpt.robot.m):
            continue
        yield ("tensions", (force,))
        for a in measured or turned[:1]:
            for p in at or placed[:1]:
                yield ("cables", (force, a, p))
                if not excerpt.static:
                    yield from (("cables", (force, a, p, *f)) for f in force_samples)
        if len(turned) > len(measured) and len(placed) > len(at) and (measured or at):
            # What was commanded is an account of its own.
            yield ("cables", (force, turned[-1], placed[-1]))
    for force in excerpt.quantity("force"):
        torque = (force[0], "torque")
        for a in turned:
            yield from (("wrench", (force, torque, a, p)) for p in at or placed[:1])
            yield from (("wrench", (force, torque, a, *f)) for f in force_samples)
            if not placed and (excerpt.static or not force_samples):
                yield ("wrench", (force, torque, a))
        if not turned:
            yield from (("wrench", (force, torque, *f)) for f in force_samples)


def has_body(relation: Relation) -> bool:
    """Whether forces are compared with a motion, so that there is a body to be fitted."""
    return relation[0] in {"cables", "wrench"}


def _beside(excerpt: Excerpt, of_force: Source) -> tuple[Source, ...]:
    """The gyro that goes with an accelerometer in motion: its own, or any."""
    if excerpt.static:
        return ()
    return tuple(
        sorted(excerpt.quantity("angular_velocity"), key=lambda s: s[0] != of_force[0])[:1]
    )


def force_agreement(excerpt: Excerpt, relation: Relation) -> InstrumentAgreement | None:
    """Evaluate one of :func:`force_relations`; None where it cannot be had."""
    if not has_body(relation):
        return _tensions_alone(excerpt, relation[1][0])
    found = body_balance(excerpt, relation)
    return None if found is None else _agreement(excerpt, relation, found)


def _tensions_alone(excerpt: Excerpt, source: Source) -> InstrumentAgreement:
    """Cables pull; and about as hard as the robot file allows."""
    settings, read = excerpt.settings.balance, excerpt.observations[source].value
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
        np.concatenate([np.full(read.shape[1], settings.slack * size), [settings.range]]),
        "N",
        read,
        np.maximum(read, 0.0),
        True,
        excerpt.settings.bad,
    )


def body_balance(excerpt: Excerpt, relation: Relation) -> BodyBalance | None:
    """The body that fits forces and one account of the motion best."""
    kind, sources = relation
    motion = platform_motion(excerpt, sources)
    if motion is None:
        return None
    if kind == "cables":
        measured = of_cables(excerpt, sources[0], motion)
    else:
        measured = of_sensor(excerpt, sources[0], sources[1])
    if measured is None:
        return None
    settings = excerpt.settings.balance
    commanded = any(is_command(excerpt, source) for source in sources)
    part = settings.commanded if commanded else settings.measured
    size = _sizes(excerpt, measured)
    Y = platform_regressor(motion.force, motion.omega, motion.alpha)
    allowed = _allowed(measured, size, motion.noise, part, settings)
    return _fitted(excerpt, measured, Y, allowed, size)


@dataclass(frozen=True)
class _Sizes:
    """Of what the forces move: force [N], radius of the platform [m], mass [kg]."""

    force: float
    radius: float
    mass: float


def _sizes(excerpt: Excerpt, measured: MeasuredWrench) -> _Sizes:
    """Plausible sizes, by the robot and the size of the forces."""
    w, robot = measured.wrench, excerpt.robot
    if measured.structure is not None:
        force = float(np.sqrt(np.mean(np.sum(w[:, :3] ** 2, axis=1))))
        return _Sizes(force, robot.size, force / 9.81)
    # Offsets are free: the force itself is not known, and its changes are those of half of gravity.
    spread = w.std(axis=0)
    force = float(np.sqrt(np.sum(spread[:3] ** 2)))
    lever = float(np.linalg.norm(spread[3:])) / max(float(np.linalg.norm(spread[:3])), 1e-12)
    return _Sizes(force, robot.size if robot.m else max(lever, 1e-3), max(force / 5.0, 1e-6))


def _allowed(
    measured: MeasuredWrench,
    size: _Sizes,
    noise: tuple[float, float],
    part: float,
    settings: BalanceSettings,
) -> Array:
    """What noise and imperfect models would leave of a wrench, shape (6,)."""
    spread = measured.wrench.std(axis=0)
    common = np.repeat(np.mean(spread.reshape(2, 3) ** 2, axis=1), 3)
    whole = np.repeat([settings.weight * size.force, settings.weight * size.force * size.radius], 3)
    by_lever = np.hypot(settings.off_center * size.radius * noise[0], size.radius**2 * noise[1])
    by_motion = (size.mass * noise[0], size.mass * float(by_lever))
    noisy = np.repeat(np.hypot(measured.noise, by_motion), 3)
    crossed = (settings.cross * part) ** 2 * common
    return np.asarray(np.sqrt(noisy**2 + (part * spread) ** 2 + crossed + whole**2 + 1e-24))


def _fitted(
    excerpt: Excerpt, measured: MeasuredWrench, Y: Array, allowed: Array, size: _Sizes
) -> BodyBalance:
    """The body within a wide prior, and what it leaves of the wrench."""
    w = measured.wrench
    n = len(w)
    reach = excerpt.robot.size if excerpt.robot.m else max(size.radius, 0.3)
    body = size.mass * np.concatenate([[10.0], np.full(3, 2 * reach), np.full(6, 2 * reach**2)])
    columns = np.concatenate([Y, -measured.columns], axis=2)
    sigma = np.concatenate([body, measured.sigma])
    white, target = columns / allowed[:, None] * sigma, w / allowed
    if excerpt.unread and measured.structure is not None:
        # What such a cable pulls is whatever it must.
        out = _across(measured.structure[:, :, sorted(excerpt.unread)] / allowed[:, None])
        white, target = out @ white, np.einsum("nij,nj->ni", out, target)
    prior = np.ones(len(sigma))
    fitted = unknown_body(white, target, prior, weight=excerpt.settings.balance.effective / n)
    return BodyBalance(
        left=fitted.residual * allowed,
        explained=(columns @ (fitted.value * sigma)).reshape(n, 6),
        allowed=allowed,
        parameters=(fitted.value * sigma)[BODY],
        sigma=(fitted.standard_deviation * sigma)[BODY],
        constants=fitted.value[BODY.stop :],
        measured=measured,
        white=white,
        target=target,
        scale=sigma,
    )


def _across(directions: Array) -> Array:
    """Projections that take some directions out, shape (n, 6, 6)."""
    Q, _ = np.linalg.qr(directions)
    return np.asarray(np.eye(6) - Q @ Q.swapaxes(1, 2))


def _agreement(excerpt: Excerpt, relation: Relation, found: BodyBalance) -> InstrumentAgreement:
    """What is left of the wrench, and how plausible the body is that was chosen."""
    left = np.sqrt(np.mean(found.left**2, axis=0))
    axes = ("fx", "fy", "fz", "tx", "ty", "tz")
    rows = list(zip(axes, left.tolist(), found.allowed.tolist(), strict=True))
    rows += _plausibility(excerpt, found)
    if found.measured.structure is not None:
        offsets, pose = np.split(found.constants, [-found.measured.of_pose])
        for name, constants in (("offsets", offsets), ("mounting", pose)):
            size = float(np.sqrt(np.mean(constants**2)))
            rows.append((name, size, excerpt.settings.balance.offsets))
    channels, off, allowed = zip(*rows, strict=True)
    return InstrumentAgreement(
        title(*relation[1]),
        relation[1],
        channels,
        np.array(off),
        np.array(allowed),
        "N",
        found.measured.wrench,
        found.explained,
        True,
        excerpt.settings.bad,
    )


def _plausibility(excerpt: Excerpt, found: BodyBalance) -> list[tuple[str, float, float]]:
    """Mass, centre of gravity and moments of a body: by how much each is off, and what is allowed;
    nothing where the mass is not known.
    """
    settings, robot, p = excerpt.settings.balance, excerpt.robot, found.parameters
    mass, sigma = float(p[0]), float(found.sigma[0])
    if abs(mass) <= 3 * sigma:
        return []
    if mass <= 0:
        return [("mass", settings.negative, settings.mass)]
    known = excerpt.experiment.known.get("mass")
    expected, nominal, free = np.zeros(3), None, settings.center_unknown
    if robot.platform is not None:
        expected, nominal = robot.platform.center_of_gravity, robot.platform.mass
        free = settings.center
    if known is not None:
        nominal = known[0]
    off = abs(float(np.log(mass / nominal))) if nominal else 0.0
    reach = robot.size if robot.m else 1.0
    beyond = np.abs(p[1:4] / mass - expected) - 2 * found.sigma[1:4] / mass
    return [
        ("mass", off, settings.mass),
        ("centre of gravity", float(np.linalg.norm(np.maximum(beyond, 0.0))), free * reach),
        ("moments", _impossible(p, found.sigma), settings.moments),
    ]


def _impossible(p: Array, sigma: Array) -> float:
    """By how many 1-sigmas the moments about the origin are below what the first moment alone asks
    for.
    """
    m, h = p[0], p[1:4]
    square = float(h @ h) / m
    least = square - h**2 / m
    short = (least - p[4:7]) / (sigma[4:7] + 1e-12)
    return float(max(0.0, short.max()))
