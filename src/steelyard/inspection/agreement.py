"""What two instruments say of the same thing, and how far apart they are.

Each agreement allows for what the description allows for (a bias, a small misalignment, a clock
that is a little off), within its prior, and holds what is then left against what noise and
imperfect models would leave. All that is judged is the ratio of the two: near one in a sound
recording, ten or a hundred where a sign, an axis or a unit is wrong.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.identification.model.sources import Source
from steelyard.inspection.excerpt import Excerpt
from steelyard.inspection.frames import (
    AttitudeMotion,
    OriginMotion,
    accelerometer,
    gyro,
    lever_of,
    moved,
    place,
    turning,
)
from steelyard.instruments.equations import means, predict, term_columns
from steelyard.motion.state import State

BAD = 1.8
"""Ratio beyond which an agreement is none."""
_MEASURED, _COMMANDED = 0.05, 0.1
"""What may be left of a motion that two instruments see, and of one that was commanded, as a part
of it."""
_CROSS = 0.3
"""Part of that, of the other axes: what misalignment takes from them."""
_EFFECTIVE = 10.0
"""Samples that count as independent when a calibration error is held against its prior."""
_FAR_FROM_PRIOR = 3.0
"""1-sigmas that a calibration error may be off."""
_LATE = 1.33
"""The same of clocks, which are as good as they are said to be."""
_LEAST = {"rad/s": 2e-3, "rad": 5e-3, "m/s^2": 0.05, "m": 5e-3}
"""What is never asked for, whatever the noise."""
_LEAST_SIGMA = {"rad/s": 0.005, "rad": 0.02, "m/s^2": 0.1, "m": 0.02}
"""1-sigma of a calibration error that any description may have, whatever it states."""
_OWN_AGREEMENTS = frozenset({"orientation", "position", "angular_velocity", "specific_force"})
"""Quantities that are compared by themselves and not by way of a whole motion."""
_CLOCK = 0.05
_COMMAND_CLOCK = 0.3
"""1-sigma of how late a platform follows its command [s]."""
_COMMAND_PLACE = 0.03
"""1-sigma of how far the world of a controller is from that of the robot file [m]."""
_SCATTER = 0.05
"""Of an orientation about a smooth motion [rad]."""
_VIBRATION = 0.3
"""What a platform feels beyond its commanded motion [m/s^2]."""


@dataclass(frozen=True, eq=False)
class InstrumentAgreement:
    """Two accounts of one thing."""

    name: str
    between: tuple[Source, ...]
    """Whose readings it depends on."""
    channels: tuple[str, ...]
    left: Array
    """What is left between them, root mean square, shape (k,)."""
    allowed: Array
    """What noise and imperfect models would leave, shape (k,)."""
    unit: str
    measured: Array
    """Shape (n, 3) or (n, m), for pictures."""
    predicted: Array
    """The same, with what was allowed for added."""
    robot: bool = False
    """Whether it depends on the robot file."""

    @property
    def ratio(self) -> Array:
        """Shape (k,)."""
        return np.asarray(self.left / self.allowed)

    @property
    def worst(self) -> float:
        """Largest ratio."""
        return float(self.ratio.max(initial=0.0))

    @property
    def cost(self) -> float:
        """How bad it is: grows with the logarithm, since ten times too bad is bad enough."""
        return float(np.sum(np.log1p(self.ratio**2)))


@dataclass(frozen=True, eq=False)
class Freedom:
    """Constants that a description leaves open."""

    columns: Array
    """Derivative of what is left by them, shape (n, k, c)."""
    sigma: Array
    """1-sigma beforehand, shape (c,)."""
    names: tuple[str, ...]


def compare(
    name: str,
    between: tuple[Source, ...],
    unit: str,
    measured: Array,
    predicted: Array,
    freedoms: Sequence[Freedom],
    *,
    noise: float,
    tolerance: float,
    robot: bool = False,
    axes: Sequence[str] | None = None,
) -> InstrumentAgreement:
    """Hold two accounts against each other.

    Args:
        name: What is compared.
        between: Whose readings these are.
        unit: Of both.
        measured: Shape (n, k).
        predicted: Shape (n, k).
        freedoms: Constants that may be chosen within their priors.
        noise: 1-sigma left in one number of the difference.
        tolerance: Part of the motion that may be left.
        robot: Whether the robot file matters.
        axes: Names of the k numbers; None: x, y, z of three, else their places.
    """
    spread = np.minimum(measured.std(axis=0), predicted.std(axis=0))
    allowed = np.sqrt(
        noise**2
        + (tolerance * spread) ** 2
        + (_CROSS * tolerance) ** 2 * float(np.mean(spread**2))
        + _LEAST.get(unit, 0.0) ** 2
    )
    left, taken, far = settled(measured - predicted, allowed, freedoms)
    if axes is None:
        k = measured.shape[1]
        axes = "xyz" if k == 3 else [str(i + 1) for i in range(k)]
    return InstrumentAgreement(
        name,
        between,
        (*axes, *(f.names[0] for f in freedoms)),
        np.concatenate([np.sqrt(np.mean(left**2, axis=0)), far]),
        np.concatenate(
            [allowed, [_LATE if f.names[0] == "delay" else _FAR_FROM_PRIOR for f in freedoms]]
        ),
        unit,
        measured,
        predicted + taken,
        robot,
    )


def settled(
    residual: Array, allowed: Array, freedoms: Sequence[Freedom]
) -> tuple[Array, Array, Array]:
    """What is left once constants are chosen, what they took, and how many 1-sigmas each group of
    them is off, (n, k), (n, k), (groups,).
    """
    if not freedoms:
        return residual, np.zeros_like(residual), np.zeros(0)
    columns = np.concatenate([f.columns for f in freedoms], axis=2)
    sigma = np.concatenate([f.sigma for f in freedoms])
    n = len(residual)
    A = (columns / allowed[:, None]).reshape(n * residual.shape[1], -1) * sigma
    b = (residual / allowed).ravel()
    weight = _EFFECTIVE / n
    value = np.linalg.solve(weight * A.T @ A + np.eye(len(sigma)), weight * A.T @ b)
    taken = (columns @ (value * sigma)).reshape(residual.shape)
    groups = np.split(np.abs(value), np.cumsum([len(f.sigma) for f in freedoms])[:-1])
    return residual - taken, taken, np.array([float(np.sqrt(np.mean(g**2))) for g in groups])


def _sigma(excerpt: Excerpt, name: str, key: str, least: float) -> Array:
    """1-sigma of three components of a calibration error, at least as stated; shape (3,)."""
    terms = {term.key: term for term in excerpt.instruments[name].terms(excerpt.robot.m)}
    term = terms.get(key)
    stated = None if term is None else term.deviation
    return np.full(3, least) if stated is None else np.maximum(stated, least)


def _constant(n: int, sigma: Array, name: str) -> Freedom:
    return Freedom(np.broadcast_to(np.eye(len(sigma)), (n, len(sigma), len(sigma))), sigma, (name,))


def _tilt(vectors: Array, sigma: Array, name: str = "misalignment") -> Freedom:
    """A small rotation: theta x v."""
    return Freedom(-_skew(vectors), sigma, (name,))


def _skew(v: Array) -> Array:
    zero = np.zeros(len(v))
    x, y, z = v.T
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)


def _late(rate: Array, sigma: float) -> Freedom:
    return Freedom(-rate[:, :, None], np.array([sigma]), ("delay",))


def _clock_sigma(excerpt: Excerpt, *names: str) -> float:
    """How far clocks may be apart [s]."""
    total = 0.0
    for name in names:
        if excerpt.instruments[name].kind == "command":
            total += _COMMAND_CLOCK**2
            continue
        stated = excerpt.experiment.delay(excerpt.run, name).sigma
        total += max(0.02, float(np.mean(stated)) if stated is not None else _CLOCK) ** 2
    return float(np.sqrt(total))


def is_command(excerpt: Excerpt, name: str) -> bool:
    """Whether an instrument says what was asked for rather than what was."""
    return excerpt.instruments[name].kind == "command"


def tolerance(excerpt: Excerpt, *sources: Source) -> float:
    """What may be left of a motion."""
    return _COMMANDED if any(is_command(excerpt, name) for name, _ in sources) else _MEASURED


def attitudes(excerpt: Excerpt) -> list[Source]:
    """Orientations, measured ones first."""
    return sorted(excerpt.quantity("orientation"), key=lambda s: is_command(excerpt, s[0]))


def positions(excerpt: Excerpt) -> list[Source]:
    """Positions, measured ones first."""
    return sorted(excerpt.quantity("position"), key=lambda s: is_command(excerpt, s[0]))


def title(*sources: Source) -> str:
    """Sources for people."""
    return " against ".join(f"{quantity.replace('_', ' ')} of {name}" for name, quantity in sources)


def gyro_and_attitude(
    excerpt: Excerpt, of_gyro: Source, of_attitude: Source
) -> InstrumentAgreement:
    """Angular velocity against the derivative of an attitude."""
    seen, turned = gyro(excerpt, of_gyro), turning(excerpt, of_attitude)
    n = len(seen.value)
    return compare(
        title(of_gyro, of_attitude),
        (of_gyro, of_attitude),
        "rad/s",
        seen.value,
        turned.omega,
        [
            _constant(n, _sigma(excerpt, of_gyro[0], "gyro_bias", 0.005), "bias"),
            _tilt(turned.omega, np.hypot(_sigma(excerpt, of_gyro[0], "misalignment", 0.02), 0.02)),
            _late(seen.rate, _clock_sigma(excerpt, of_gyro[0], of_attitude[0])),
        ],
        noise=float(np.hypot(seen.noise[0], turned.noise[1])),
        tolerance=tolerance(excerpt, of_gyro, of_attitude),
    )


def attitude_and_attitude(excerpt: Excerpt, first: Source, second: Source) -> InstrumentAgreement:
    """Two orientations."""
    one, other = turning(excerpt, first), turning(excerpt, second)
    apart = vector_of_rotations(other.rotation.swapaxes(1, 2) @ one.rotation)
    n = len(apart)
    # About the first instant, so that an excerpt of both shows the motion.
    begin = vector_of_rotations(other.rotation[0].T @ other.rotation)
    small = np.hypot(
        _sigma(excerpt, first[0], "misalignment", 0.02),
        _sigma(excerpt, first[0], "reference", 0.03),
    )
    return compare(
        title(first, second),
        (first, second),
        "rad",
        begin + apart,
        begin,
        [
            _constant(n, small, "misalignment"),
            Freedom(other.rotation.swapaxes(1, 2), small, ("reference",)),
            _late(other.omega, _clock_sigma(excerpt, first[0], second[0])),
        ],
        noise=float(np.hypot(one.noise[0], other.noise[0])),
        tolerance=tolerance(excerpt, first, second),
    )


def vector_of_rotations(matrices: Array) -> Array:
    """Rotation vectors [rad], shape (n, 3)."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(matrices).as_rotvec())


def position_and_position(
    excerpt: Excerpt, first: Source, second: Source, of_attitude: Source
) -> InstrumentAgreement:
    """Two places, both turned into that of the platform origin."""
    turned = turning(excerpt, of_attitude)
    one, other = (place(excerpt, source, turned) for source in (first, second))
    n = len(turned.omega)
    target = _sigma(excerpt, first[0], "target", 0.02)
    return compare(
        title(first, second),
        tuple(dict.fromkeys((first, second, of_attitude))),
        "m",
        one.position,
        other.position,
        [
            _constant(n, np.full(3, np.hypot(_COMMAND_PLACE, 0.01)), "frame"),
            Freedom(turned.rotation, target, ("target",)),
            _late(other.velocity, _clock_sigma(excerpt, first[0], second[0])),
        ],
        noise=float(np.hypot(one.noise[0], other.noise[0])),
        tolerance=tolerance(excerpt, first, second),
    )


def specific_force(excerpt: Excerpt, turned: AttitudeMotion, where: OriginMotion | None) -> Array:
    """Specific force of the platform origin that a motion makes, platform frame [m/s^2], shape (n,
    3).
    """
    acceleration = np.zeros_like(turned.omega) if where is None else where.acceleration
    return np.asarray(
        np.einsum("nji,nj->ni", turned.rotation, acceleration - excerpt.robot.gravity)
    )


def accelerometer_and_motion(
    excerpt: Excerpt, of_force: Source, of_attitude: Source, of_position: Source | None
) -> InstrumentAgreement:
    """Specific force where an accelerometer sits against what gravity and the motion make of it."""
    turned = turning(excerpt, of_attitude)
    where = None if of_position is None else place(excerpt, of_position, turned)
    force_samples = accelerometer(excerpt, of_force, turned.rotation)
    lever = lever_of(excerpt, of_force[0])
    predicted = moved(specific_force(excerpt, turned, where), turned.omega, turned.alpha, lever)
    n = len(predicted)
    by_lever = _skew(turned.alpha) + _skew(turned.omega) @ _skew(turned.omega)
    between = tuple(dict.fromkeys(s for s in (of_force, of_attitude, of_position) if s))
    follows = 9.81 * turned.noise[0]
    noise = np.sqrt(
        force_samples.noise[0] ** 2
        + follows**2
        + (_VIBRATION**2 if where is None else where.noise[2] ** 2)
        + (float(np.linalg.norm(lever)) * turned.noise[2]) ** 2
    )
    if where is None:
        # What accelerates it is not known: whatever moves it back and forth.
        noise = float(np.hypot(noise, 0.5 * force_samples.value.std(axis=0).mean()))
    return compare(
        title(*between),
        between,
        "m/s^2",
        force_samples.value,
        predicted,
        [
            _constant(n, _sigma(excerpt, of_force[0], "accelerometer_bias", 0.1), "bias"),
            _tilt(predicted, np.hypot(_sigma(excerpt, of_force[0], "misalignment", 0.02), 0.02)),
            Freedom(by_lever, _sigma(excerpt, of_force[0], "position", 0.03), ("position",)),
            _late(force_samples.rate, _clock_sigma(excerpt, *(s[0] for s in between))),
        ],
        noise=float(noise),
        tolerance=tolerance(excerpt, *between),
        robot=True,
    )


def gravity_and_accelerometer_alone(excerpt: Excerpt, of_force: Source) -> InstrumentAgreement:
    """Length of what an accelerometer feels on average against gravity, where nothing tells the
    attitude.
    """
    force_samples = excerpt.observations[of_force]
    length = np.linalg.norm(force_samples.value, axis=1, keepdims=True)
    gravity = np.full_like(length, np.linalg.norm(excerpt.robot.gravity))
    left = float(np.mean(length) / gravity[0, 0])
    off = abs(np.log(max(left, 1e-6)))
    return InstrumentAgreement(
        f"mean of {title(of_force)} against gravity",
        (of_force,),
        ("length",),
        np.array([off]),
        np.array([0.15]),
        "1",
        length,
        gravity,
        True,
    )


def scatter_of_attitude(excerpt: Excerpt, of_attitude: Source) -> InstrumentAgreement:
    """How far an orientation is from a motion at all: what turns to and fro from sample to sample
    is none.
    """
    seen = excerpt.observations[of_attitude]
    flat = seen.value.reshape(len(seen.value), -1)
    # The determinant of what is smooth is that of a rotation.
    lost = np.abs(1 - np.linalg.det(seen.value))
    return InstrumentAgreement(
        f"{title(of_attitude)} alone",
        (of_attitude,),
        ("scatter", "length"),
        np.array([seen.noise[0] * np.sqrt(1.5), float(np.median(lost))]),
        np.array([_SCATTER, _SCATTER]),
        "rad",
        flat,
        flat,
    )


def length_and_geometry(
    excerpt: Excerpt, of_length: Source, of_attitude: Source, of_position: Source
) -> InstrumentAgreement:
    """Cable lengths against anchors, attachments and pose, up to a constant of each cable."""
    robot = excerpt.robot
    turned = turning(excerpt, of_attitude)
    where = place(excerpt, of_position, turned)
    corners = where.position[:, None, :] + np.einsum(
        "nij,mj->nmi", turned.rotation, robot.attachments
    )
    lengths = np.linalg.norm(robot.anchors - corners, axis=2)
    read = excerpt.observations[of_length]
    measured, predicted = (each - each.mean(axis=0) for each in (read.value, lengths))
    return compare(
        title(of_length, of_position),
        tuple(dict.fromkeys((of_length, of_attitude, of_position))),
        "m",
        measured,
        predicted,
        [_late(read.rate, _clock_sigma(excerpt, of_length[0], of_position[0]))],
        noise=float(np.hypot(read.noise[0], where.noise[0] + robot.size * turned.noise[0])),
        tolerance=tolerance(excerpt, of_attitude, of_position),
        robot=True,
    )


def reading_and_motion(
    excerpt: Excerpt, of_reading: Source, of_attitude: Source, of_position: Source
) -> InstrumentAgreement:
    """Any reading against what its instrument would read in a motion."""
    name, quantity = of_reading
    instrument, robot = excerpt.instruments[name], excerpt.robot.with_straight_cables()
    turned = turning(excerpt, of_attitude)
    where = place(excerpt, of_position, turned)
    state = state_of(excerpt, turned, where)
    read = excerpt.observations[of_reading]
    predicted = predict(instrument, robot, state, means(instrument, robot.m))[quantity]
    columns = term_columns(instrument, quantity, robot, state)
    stated = instrument.quantity(quantity, robot.m)
    least = _LEAST_SIGMA[stated.unit]
    freedoms = []
    for term in instrument.terms(robot.m):
        sigma = np.full(term.size, least) if term.deviation is None else term.deviation
        freedoms.append(Freedom(columns[term.key], np.maximum(sigma, least), (term.key,)))
    freedoms.append(_late(read.rate, _clock_sigma(excerpt, name, of_position[0])))
    lever = float(np.linalg.norm(lever_of(excerpt, name)))
    return compare(
        title(of_reading, of_position),
        tuple(dict.fromkeys((of_reading, of_attitude, of_position))),
        stated.unit,
        read.value,
        predicted,
        freedoms,
        noise=float(np.hypot(read.noise[0], where.noise[0] + lever * turned.noise[0])),
        tolerance=tolerance(excerpt, of_attitude, of_position),
        robot=True,
        axes=stated.forms[0],
    )


def state_of(excerpt: Excerpt, turned: AttitudeMotion, where: OriginMotion) -> State:
    """State of the platform in a motion, without forces."""
    return State(
        position=where.position,
        rotation=turned.rotation,
        velocity=where.velocity,
        omega=turned.omega,
        specific_force=specific_force(excerpt, turned, where),
        alpha=turned.alpha,
        tension=None,
        wrench=None,
        gravity=excerpt.robot.gravity,
    )


Relation = tuple[str, tuple[Source, ...]]
"""Kind of an agreement and whom it takes."""


def motion_relations(excerpt: Excerpt) -> Iterator[Relation]:
    """Which motion instruments can be held against which."""
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
    for force_samples in excerpt.quantity("specific_force"):
        for a in measured or turned:
            if excerpt.static or not placed:
                yield ("accelerometer", (force_samples, a))
            else:
                yield from (("accelerometer", (force_samples, a, p)) for p in placed)
        if not turned:
            yield ("gravity", (force_samples,))
    for of_length in excerpt.quantity("length"):
        yield from (("lengths", (of_length, a, p)) for a in turned[:1] for p in placed)
    for reading in _other_readings(excerpt):
        yield from (("reading", (reading, a, p)) for a in turned[:1] for p in placed)


def _other_readings(excerpt: Excerpt) -> list[Source]:
    """Vectors that motion instruments read and no agreement of its own is made for."""
    return [
        (name, quantity)
        for name, quantity in excerpt.observations
        if excerpt.instruments[name].is_motion and quantity not in _OWN_AGREEMENTS
    ]


def motion_agreement(excerpt: Excerpt, relation: Relation) -> InstrumentAgreement:
    """Evaluate one of :func:`motion_relations`."""
    kind, sources = relation
    match kind, len(sources):
        case "gyro", _:
            return gyro_and_attitude(excerpt, sources[0], sources[1])
        case "attitudes", _:
            return attitude_and_attitude(excerpt, sources[0], sources[1])
        case "places", _:
            return position_and_position(excerpt, sources[0], sources[1], sources[2])
        case "accelerometer", 2:
            return accelerometer_and_motion(excerpt, sources[0], sources[1], None)
        case "accelerometer", _:
            return accelerometer_and_motion(excerpt, sources[0], sources[1], sources[2])
        case "reading", _:
            return reading_and_motion(excerpt, sources[0], sources[1], sources[2])
        case "scatter", _:
            return scatter_of_attitude(excerpt, sources[0])
        case "lengths", _:
            return length_and_geometry(excerpt, sources[0], sources[1], sources[2])
        case _:
            return gravity_and_accelerometer_alone(excerpt, sources[0])
