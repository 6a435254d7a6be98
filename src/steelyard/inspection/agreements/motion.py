"""Which motion instruments can be compared with which, and what is left between them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.dynamics import specific_force_at
from steelyard.identification.model.sources import Source
from steelyard.inspection.agreements.agreement import (
    SETTINGS,
    Freedom,
    InstrumentAgreement,
    compare,
)
from steelyard.inspection.agreements.excerpt import Excerpt, Observation
from steelyard.inspection.agreements.frames import (
    AttitudeMotion,
    OriginMotion,
    angular_velocity,
    attitude_motion,
    origin_motion,
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


def _sigma(excerpt: Excerpt, name: str, key: str, least: float) -> Array:
    """1-sigma of three components of a calibration error, at least as stated; shape (3,)."""
    terms = {term.key: term for term in excerpt.instruments[name].terms(excerpt.robot.m)}
    stated = terms[key].deviation if key in terms else None
    return np.full(3, least) if stated is None else np.maximum(stated, least)


def _constant(n: int, sigma: Array, name: str) -> Freedom:
    k = len(sigma)
    return Freedom(np.broadcast_to(np.eye(k), (n, k, k)), sigma, name)


def _tilt(vectors: Array, sigma: Array) -> Freedom:
    """A small rotation of vectors: theta x v."""
    return Freedom(-cross_matrices(vectors), sigma, "misalignment")


def _late(rate: Array, sigma: float) -> Freedom:
    return Freedom(-rate[:, :, None], np.array([sigma]), "delay")


def _clock_sigma(excerpt: Excerpt, *names: str) -> float:
    """How far clocks may be apart [s]."""
    total = 0.0
    for name in names:
        if excerpt.instruments[name].commanded:
            total += SETTINGS.command_clock**2
            continue
        stated = excerpt.experiment.delay(excerpt.run, name).sigma
        own = float(np.mean(stated)) if stated is not None else SETTINGS.clock
        total += max(SETTINGS.least_clock, own) ** 2
    return float(np.sqrt(total))


def is_command(excerpt: Excerpt, name: str) -> bool:
    """Whether an instrument says what was asked for rather than what was."""
    return excerpt.instruments[name].commanded


def tolerance(excerpt: Excerpt, *sources: Source) -> float:
    """What may be left of a motion, as a part of it."""
    commanded = any(is_command(excerpt, name) for name, _ in sources)
    return SETTINGS.commanded if commanded else SETTINGS.measured


def attitudes(excerpt: Excerpt) -> list[Source]:
    """Orientations, measured ones first."""
    return sorted(excerpt.quantity("orientation"), key=lambda s: is_command(excerpt, s[0]))


def positions(excerpt: Excerpt) -> list[Source]:
    """Positions, measured ones first."""
    return sorted(excerpt.quantity("position"), key=lambda s: is_command(excerpt, s[0]))


def title(*sources: Source) -> str:
    """Sources for people."""
    return " against ".join(f"{quantity.replace('_', ' ')} of {name}" for name, quantity in sources)


def _gyro(excerpt: Excerpt, of_gyro: Source, of_attitude: Source) -> InstrumentAgreement:
    """Angular velocity against the derivative of an attitude."""
    least = SETTINGS.least_sigma
    read, turned = angular_velocity(excerpt, of_gyro), attitude_motion(excerpt, of_attitude)
    misalignment = _sigma(excerpt, of_gyro[0], "misalignment", least["rad"])
    bias = _sigma(excerpt, of_gyro[0], "gyro_bias", least["rad/s"])
    return compare(
        title(of_gyro, of_attitude),
        (of_gyro, of_attitude),
        "rad/s",
        read.value,
        turned.omega,
        [
            _constant(len(read.value), bias, "bias"),
            _tilt(turned.omega, np.hypot(misalignment, least["rad"])),
            _late(read.rate, _clock_sigma(excerpt, of_gyro[0], of_attitude[0])),
        ],
        noise=float(np.hypot(read.noise[0], turned.noise[1])),
        tolerance=tolerance(excerpt, of_gyro, of_attitude),
    )


def _attitudes(excerpt: Excerpt, first: Source, second: Source) -> InstrumentAgreement:
    """Two orientations."""
    one, other = attitude_motion(excerpt, first), attitude_motion(excerpt, second)
    difference = _rotation_vectors(other.rotation.swapaxes(1, 2) @ one.rotation)
    # About the first instant, so that a figure of both shows the motion.
    begin = _rotation_vectors(other.rotation[0].T @ other.rotation)
    small = np.hypot(
        _sigma(excerpt, first[0], "misalignment", SETTINGS.least_sigma["rad"]),
        _sigma(excerpt, first[0], "reference", SETTINGS.least_reference),
    )
    return compare(
        title(first, second),
        (first, second),
        "rad",
        begin + difference,
        begin,
        [
            _constant(len(difference), small, "misalignment"),
            Freedom(other.rotation.swapaxes(1, 2), small, "reference"),
            _late(other.omega, _clock_sigma(excerpt, first[0], second[0])),
        ],
        noise=float(np.hypot(one.noise[0], other.noise[0])),
        tolerance=tolerance(excerpt, first, second),
    )


def _rotation_vectors(matrices: Array) -> Array:
    """Rotation vectors [rad], shape (n, 3)."""
    return np.asarray(Rotation.from_matrix(matrices).as_rotvec())


def _places(
    excerpt: Excerpt, first: Source, second: Source, of_attitude: Source
) -> InstrumentAgreement:
    """Two places, both turned into that of the platform origin."""
    turned = attitude_motion(excerpt, of_attitude)
    one, other = (origin_motion(excerpt, source, turned) for source in (first, second))
    target = _sigma(excerpt, first[0], "target", SETTINGS.least_sigma["m"])
    frame = np.full(3, np.hypot(SETTINGS.command_place, 0.01))
    return compare(
        title(first, second),
        tuple(dict.fromkeys((first, second, of_attitude))),
        "m",
        one.position,
        other.position,
        [
            _constant(len(turned.omega), frame, "frame"),
            Freedom(turned.rotation, target, "target"),
            _late(other.velocity, _clock_sigma(excerpt, first[0], second[0])),
        ],
        noise=float(np.hypot(one.noise[0], other.noise[0])),
        tolerance=tolerance(excerpt, first, second),
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
    least = SETTINGS.least_sigma
    turned = attitude_motion(excerpt, of_attitude)
    where = None if of_position is None else origin_motion(excerpt, of_position, turned)
    read = specific_force_there(excerpt, of_force, turned)
    point = point_of(excerpt, of_force[0])
    predicted, by_point = specific_force_at(
        specific_force(excerpt, turned, where), turned.omega, turned.alpha, point
    )
    between = tuple(dict.fromkeys(s for s in (of_force, of_attitude, of_position) if s))
    of_gravity = 9.81 * turned.noise[0]
    noise = np.sqrt(
        read.noise[0] ** 2
        + of_gravity**2
        + (SETTINGS.vibration**2 if where is None else where.noise[2] ** 2)
        + (float(np.linalg.norm(point)) * turned.noise[2]) ** 2
    )
    if where is None:
        # What accelerates it is not known: whatever moves it back and forth.
        noise = np.hypot(noise, SETTINGS.unknown_motion * read.value.std(axis=0).mean())
    bias = _sigma(excerpt, of_force[0], "accelerometer_bias", least["m/s^2"])
    misalignment = _sigma(excerpt, of_force[0], "misalignment", least["rad"])
    position = _sigma(excerpt, of_force[0], "position", SETTINGS.least_lever)
    return compare(
        title(*between),
        between,
        "m/s^2",
        read.value,
        predicted,
        [
            _constant(len(predicted), bias, "bias"),
            _tilt(predicted, np.hypot(misalignment, least["rad"])),
            Freedom(by_point, position, "position"),
            _late(read.rate, _clock_sigma(excerpt, *(s[0] for s in between))),
        ],
        noise=float(noise),
        tolerance=tolerance(excerpt, *between),
        robot=True,
    )


def _gravity(excerpt: Excerpt, of_force: Source) -> InstrumentAgreement:
    """Mean length of an accelerometer's reading against gravity, where nothing tells the
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
        np.array([SETTINGS.gravity]),
        "1",
        length,
        gravity,
        True,
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
        np.array([SETTINGS.scatter, SETTINGS.scatter]),
        "rad",
        flat,
        flat,
    )


def _lengths(
    excerpt: Excerpt, of_length: Source, of_attitude: Source, of_position: Source
) -> InstrumentAgreement:
    """Cable lengths against anchors, attachments and pose, up to a constant of each cable."""
    turned = attitude_motion(excerpt, of_attitude)
    where = origin_motion(excerpt, of_position, turned)
    read = excerpt.observations[of_length]
    centred = read.value - read.value.mean(axis=0)
    lengths = _predicted(excerpt, of_length, turned, where)
    return compare(
        title(of_length, of_position),
        tuple(dict.fromkeys((of_length, of_attitude, of_position))),
        "m",
        centred,
        lengths - lengths.mean(axis=0),
        [_late(read.rate, _clock_sigma(excerpt, of_length[0], of_position[0]))],
        noise=_noise_of_pose(read, turned, where, excerpt.robot.size),
        tolerance=tolerance(excerpt, of_attitude, of_position),
        robot=True,
    )


def _reading(
    excerpt: Excerpt, of_reading: Source, of_attitude: Source, of_position: Source
) -> InstrumentAgreement:
    """Any reading against what its instrument would read in a motion."""
    name, quantity = of_reading
    instrument, robot = excerpt.instruments[name], excerpt.experiment.robot
    turned = attitude_motion(excerpt, of_attitude)
    where = origin_motion(excerpt, of_position, turned)
    read = excerpt.observations[of_reading]
    stated = instrument.quantity(quantity, robot.m)
    least = SETTINGS.least_sigma[stated.unit]
    columns = term_columns(instrument, quantity, robot, _state(excerpt, turned, where))
    freedoms = []
    for term in instrument.terms(robot.m):
        sigma = np.full(term.size, least) if term.deviation is None else term.deviation
        freedoms.append(Freedom(columns[term.key], np.maximum(sigma, least), term.key))
    freedoms.append(_late(read.rate, _clock_sigma(excerpt, name, of_position[0])))
    return compare(
        title(of_reading, of_position),
        tuple(dict.fromkeys((of_reading, of_attitude, of_position))),
        stated.unit,
        read.value,
        _predicted(excerpt, of_reading, turned, where),
        freedoms,
        noise=_noise_of_pose(read, turned, where, float(np.linalg.norm(point_of(excerpt, name)))),
        tolerance=tolerance(excerpt, of_attitude, of_position),
        robot=True,
        axes=stated.forms[0],
    )


def _noise_of_pose(
    read: Observation, turned: AttitudeMotion, where: OriginMotion, lever: float
) -> float:
    """1-sigma left between a reading of the pose and a motion, for a point at a lever [m]."""
    return float(np.hypot(read.noise[0], where.noise[0] + lever * turned.noise[0]))


def _predicted(
    excerpt: Excerpt, source: Source, turned: AttitudeMotion, where: OriginMotion
) -> Array:
    """What an instrument would read in a motion, its cables taut, shape (n, k)."""
    instrument, robot = excerpt.instruments[source[0]], excerpt.robot.with_straight_cables()
    state = _state(excerpt, turned, where)
    return predict(instrument, robot, state, means(instrument, robot.m))[source[1]]


def _state(excerpt: Excerpt, turned: AttitudeMotion, where: OriginMotion) -> State:
    """State of the platform in a motion, without forces."""
    return State(
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


def motion_relations(excerpt: Excerpt) -> Iterator[Relation]:
    """Which motion instruments can be compared with which."""
    turned, placed = attitudes(excerpt), positions(excerpt)
    measured = [s for s in turned if not is_command(excerpt, s[0])]
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
        kind = "lengths" if instrument.is_cable_motion else "reading"
        if kind == "lengths" or (instrument.is_motion and source[1] not in _COMPARED_ALONE):
            yield from ((kind, (source, a, p)) for a in turned[:1] for p in placed)


_AGREEMENTS: Mapping[str, Callable[..., InstrumentAgreement]] = {
    "gyro": _gyro,
    "attitudes": _attitudes,
    "places": _places,
    "accelerometer": _accelerometer,
    "scatter": _scatter,
    "lengths": _lengths,
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
