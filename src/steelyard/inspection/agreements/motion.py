"""Which motion instruments can be compared with which, and what is left between them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.dynamics import specific_force_at
from steelyard.identification.model.sources import Source
from steelyard.inspection.agreements.agreement import (
    Freedom,
    InstrumentAgreement,
    compare,
    is_command,
    title,
)
from steelyard.inspection.agreements.excerpt import Excerpt
from steelyard.inspection.agreements.frames import (
    AttitudeMotion,
    OriginMotion,
    angular_velocity,
    attitude_motion,
    lever_of,
    origin_motion,
    place_sigma,
    point_of,
    specific_force_there,
)
from steelyard.instruments.equations import means, predict, term_columns
from steelyard.motion.state import State
from steelyard.rotations import cross_matrices

Relation = tuple[str, tuple[Source, ...]]
"""Kind of an agreement and the readings that it takes."""
_COMPARED_ALONE = frozenset({"orientation", "position", "angular_velocity", "specific_force"})
"""Quantities that have agreements of their own and need no whole motion to be compared with."""


def sigma_of(excerpt: Excerpt, name: str, key: str, least: float) -> Array:
    """1-sigma of three components of a calibration error, at least as stated; shape (3,).

    Args:
        excerpt: With its instruments.
        name: Of an instrument.
        key: Of the error.
        least: What any description may have.
    """
    terms = {term.key: term for term in excerpt.instruments[name].terms(excerpt.robot.m)}
    stated = terms[key].deviation if key in terms else None
    return np.full(3, least) if stated is None else np.maximum(stated, least)


def _constant(sigma: Array, name: str) -> Freedom:
    """A constant in every number, shape (k,)."""
    return Freedom(np.eye(len(sigma)), sigma, name)


def _tilt(vectors: Array, sigma: Array) -> Freedom:
    """A small rotation of vectors: theta x v."""
    return Freedom(-cross_matrices(vectors), sigma, "misalignment")


def _gyro(excerpt: Excerpt, of_gyro: Source, of_attitude: Source) -> InstrumentAgreement:
    """Angular velocity against the derivative of an attitude."""
    least = excerpt.settings.least_sigma
    read, turned = angular_velocity(excerpt, of_gyro), attitude_motion(excerpt, of_attitude)
    misalignment = sigma_of(excerpt, of_gyro[0], "misalignment", least["rad"])
    return compare(
        excerpt,
        (of_gyro, of_attitude),
        "rad/s",
        read.value,
        turned.omega,
        [
            _constant(sigma_of(excerpt, of_gyro[0], "gyro_bias", least["rad/s"]), "bias"),
            _tilt(turned.omega, np.hypot(misalignment, least["rad"])),
        ],
        rate=read.rate,
        noise=float(np.hypot(read.noise[0], turned.noise[1])),
    )


def _attitudes(excerpt: Excerpt, first: Source, second: Source) -> InstrumentAgreement:
    """Two orientations."""
    one, other = attitude_motion(excerpt, first), attitude_motion(excerpt, second)
    back = other.rotation.swapaxes(1, 2)
    difference = Rotation.from_matrix(back @ one.rotation).as_rotvec()
    # About the first instant, so that a figure of both shows the motion.
    begin = Rotation.from_matrix(back[0] @ other.rotation).as_rotvec()
    small = np.hypot(
        sigma_of(excerpt, first[0], "misalignment", excerpt.settings.least_sigma["rad"]),
        sigma_of(excerpt, first[0], "reference", excerpt.settings.least_reference),
    )
    return compare(
        excerpt,
        (first, second),
        "rad",
        begin + difference,
        begin,
        [_constant(small, "misalignment"), Freedom(back, small, "reference")],
        rate=other.omega,
        noise=float(np.hypot(one.noise[0], other.noise[0])),
    )


def _places(
    excerpt: Excerpt, first: Source, second: Source, of_attitude: Source
) -> InstrumentAgreement:
    """Two places, both turned into that of the platform origin."""
    turned = attitude_motion(excerpt, of_attitude)
    one, other = (origin_motion(excerpt, source, turned) for source in (first, second))
    target = sigma_of(excerpt, first[0], "target", excerpt.settings.least_sigma["m"])
    frame = np.full(3, np.hypot(excerpt.settings.command_place, 0.01))
    return compare(
        excerpt,
        (first, second),
        "m",
        one.position,
        other.position,
        [_constant(frame, "frame"), Freedom(turned.rotation, target, "target")],
        rate=other.velocity,
        noise=float(np.hypot(one.noise[0], other.noise[0])),
        beside=(of_attitude,),
    )


def specific_force(excerpt: Excerpt, turned: AttitudeMotion, where: OriginMotion | None) -> Array:
    """Specific force of the platform origin in a motion, platform frame [m/s^2], shape (n, 3)."""
    acceleration = np.zeros_like(turned.omega) if where is None else where.acceleration
    return np.asarray(
        np.einsum("nji,nj->ni", turned.rotation, acceleration - excerpt.robot.gravity)
    )


def _accelerometer(
    excerpt: Excerpt, of_force: Source, of_attitude: Source, of_position: Source | None = None
) -> InstrumentAgreement:
    """Specific force where an accelerometer sits against that of gravity and motion."""
    least = excerpt.settings.least_sigma
    turned = attitude_motion(excerpt, of_attitude)
    where = None if of_position is None else origin_motion(excerpt, of_position, turned)
    read = specific_force_there(excerpt, of_force, turned)
    point = point_of(excerpt, of_force[0])
    predicted, by_point = specific_force_at(
        specific_force(excerpt, turned, where), turned.omega, turned.alpha, point
    )
    noise = np.sqrt(
        read.noise[0] ** 2
        + (9.81 * turned.noise[0]) ** 2
        + (excerpt.settings.vibration**2 if where is None else where.noise[2] ** 2)
        + (lever_of(excerpt.instruments[of_force[0]], excerpt.robot) * turned.noise[2]) ** 2
    )
    if where is None:
        # What accelerates it is not known: whatever moves it back and forth.
        noise = np.hypot(noise, excerpt.settings.unknown_motion * read.value.std(axis=0).mean())
    bias = sigma_of(excerpt, of_force[0], "accelerometer_bias", least["m/s^2"])
    misalignment = sigma_of(excerpt, of_force[0], "misalignment", least["rad"])
    position = sigma_of(excerpt, of_force[0], "position", excerpt.settings.least_lever)
    if of_position is not None:
        # A target that sits elsewhere shows as an accelerometer does that sits elsewhere.
        tracker = excerpt.instruments[of_position[0]]
        position = np.hypot(position, place_sigma(tracker, excerpt.robot))
    return compare(
        excerpt,
        (of_force, of_attitude) if of_position is None else (of_force, of_attitude, of_position),
        "m/s^2",
        read.value,
        predicted,
        [
            _constant(bias, "bias"),
            _tilt(predicted, np.hypot(misalignment, least["rad"])),
            Freedom(by_point, position, "position"),
        ],
        rate=read.rate,
        noise=float(noise),
        robot=True,
    )


def _gravity(excerpt: Excerpt, of_force: Source) -> InstrumentAgreement:
    """Mean length of an accelerometer's reading against gravity, where there is no
    attitude.
    """
    read = excerpt.observations[of_force]
    length = np.linalg.norm(read.value, axis=1, keepdims=True)
    gravity = np.full_like(length, np.linalg.norm(excerpt.robot.gravity))
    ratio = float(np.mean(length) / gravity[0, 0])
    return InstrumentAgreement(
        f"mean of {title(of_force)} against gravity",
        (of_force,),
        ("length",),
        np.array([abs(np.log(max(ratio, 1e-6)))]),
        np.array([excerpt.settings.gravity]),
        "1",
        length,
        gravity,
        True,
        excerpt.settings.bad,
    )


def _scatter(excerpt: Excerpt, of_attitude: Source) -> InstrumentAgreement:
    """How far an orientation is from a motion at all: what turns to and fro from sample to sample
    is none.
    """
    read = excerpt.observations[of_attitude]
    flat = read.value.reshape(len(read.value), -1)
    # The determinant of what is smooth is that of a rotation.
    lost = np.abs(1 - np.linalg.det(read.value))
    return InstrumentAgreement(
        f"{title(of_attitude)} alone",
        (of_attitude,),
        ("scatter", "length"),
        np.array([read.noise[0] * np.sqrt(1.5), float(np.median(lost))]),
        np.array([excerpt.settings.scatter, excerpt.settings.scatter]),
        "rad",
        flat,
        flat,
        bad=excerpt.settings.bad,
    )


def _reading(
    excerpt: Excerpt, of_reading: Source, of_attitude: Source, of_position: Source
) -> InstrumentAgreement:
    """Any reading against what its instrument would read in a motion; lengths of cables up to a
    constant of each cable.
    """
    name, quantity = of_reading
    instrument, read = excerpt.instruments[name], excerpt.observations[of_reading]
    turned = attitude_motion(excerpt, of_attitude)
    where = origin_motion(excerpt, of_position, turned)
    state = State(
        position=where.position,
        rotation=turned.rotation,
        velocity=where.velocity,
        omega=turned.omega,
        specific_force=specific_force(excerpt, turned, where),
        alpha=turned.alpha,
        tension=np.zeros(excerpt.robot.m) if excerpt.robot.m else None,
        wrench=None,
        gravity=excerpt.robot.gravity,
    )
    robot = excerpt.robot.with_straight_cables()
    measured = read.value
    predicted = predict(instrument, robot, state, means(instrument, robot.m))[quantity]
    stated = instrument.quantity(quantity, robot.m)
    axes: Sequence[str] | None = stated.forms[0]
    lever = float(np.linalg.norm(point_of(excerpt, name)))
    freedoms = []
    if instrument.is_cable_motion:
        measured = measured - measured.mean(axis=0)
        predicted = predicted - predicted.mean(axis=0)
        axes, lever = None, robot.size
    else:
        least = excerpt.settings.least_sigma[stated.unit]
        columns = term_columns(instrument, quantity, excerpt.experiment.robot, state)
        for term in instrument.terms(robot.m):
            sigma = np.full(term.size, least) if term.deviation is None else term.deviation
            freedoms.append(Freedom(columns[term.key], np.maximum(sigma, least), term.key))
    return compare(
        excerpt,
        (of_reading, of_position),
        stated.unit,
        measured,
        predicted,
        freedoms,
        rate=read.rate,
        noise=float(np.hypot(read.noise[0], where.noise[0] + lever * turned.noise[0])),
        beside=(of_attitude,),
        motion=(of_attitude, of_position),
        robot=True,
        axes=axes,
    )


def motion_relations(excerpt: Excerpt) -> Iterator[Relation]:
    """Which motion instruments can be compared with which."""
    turned, placed = excerpt.quantity("orientation"), excerpt.quantity("position")
    measured = [s for s in turned if not is_command(excerpt, s)]
    if not excerpt.static:
        yield from (("scatter", (a,)) for a in turned)
    for of_gyro in excerpt.quantity("angular_velocity"):
        if not excerpt.static:
            yield from (("gyro", (of_gyro, a)) for a in turned)
    for i, first in enumerate(turned):
        yield from (("attitudes", (first, second)) for second in turned[i + 1 :])
    for i, first in enumerate(placed):
        if turned:
            yield from (("places", (first, second, turned[0])) for second in placed[i + 1 :])
    for of_force in excerpt.quantity("specific_force"):
        for a in measured or turned:
            if excerpt.static or not placed:
                yield ("accelerometer", (of_force, a))
            else:
                yield from (("accelerometer", (of_force, a, p)) for p in placed)
        if not turned:
            yield ("gravity", (of_force,))
    for source in excerpt.observations:
        instrument = excerpt.instruments[source[0]]
        alone = source[1] in _COMPARED_ALONE
        if instrument.is_cable_motion or (instrument.is_motion and not alone):
            yield from (("reading", (source, a, p)) for a in turned[:1] for p in placed)


_AGREEMENTS: Mapping[str, Callable[..., InstrumentAgreement]] = {
    "gyro": _gyro,
    "attitudes": _attitudes,
    "places": _places,
    "accelerometer": _accelerometer,
    "scatter": _scatter,
    "reading": _reading,
    "gravity": _gravity,
}


def is_of_motion(relation: Relation) -> bool:
    """Whether a relation compares motion instruments alone."""
    return relation[0] in _AGREEMENTS


def motion_agreement(excerpt: Excerpt, relation: Relation) -> InstrumentAgreement:
    """Evaluate one of :func:`motion_relations`."""
    kind, sources = relation
    return _AGREEMENTS[kind](excerpt, *sources)
