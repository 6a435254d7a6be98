"""A motion to begin with where no instrument tells the pose by itself: winch encoders with or without
an orientation, a tracked point and cables, a gyro that knows no north.

At some instants of a run the platform is taken to be nearly in balance. Its poses there, a first
body and the offsets of the lengths are those that fit the tensions, the lengths, the tracked points
and the orientations at once: Gauss-Newton with damping [Marquardt1963]_ on poses that only share
the body and the offsets. It is rough, since accelerations count as noise where no accelerometer
reads them, but it is the place where a fit of all readings begins.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.batch import Batched, Symbol
from steelyard.dynamics import newton_euler
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run, Stream
from steelyard.identification.model.calibration_parameters import clock_of
from steelyard.inertia import TEN
from steelyard.instruments import Instrument
from steelyard.instruments.command import Command
from steelyard.instruments.equations import means
from steelyard.motion.state import State
from steelyard.robot.kinematics import cable_wrench
from steelyard.robot.model import Robot

FIRST_MOTION = "first motion"
"""Name of the stream that stands in for what nothing measures."""
_BODY = 4
"""Mass and first moments."""
SPACING = 0.1
"""Of the instants [s]: motions of platforms have hardly more than 1 Hz."""
_MOST = 3000
"""Instants at most."""
_FEW = 10
"""Instants with which it is found out how deep the platform hangs."""
_DEPTHS = (0.1, 0.25, 0.4, 0.6, 0.9)
"""Where it may hang below the highest anchor, in parts of their span: there is another answer above
the anchors."""
_IN_BALANCE, _ACCELERATED = 0.02, 0.08
"""1-sigma of what the tensions do not balance, as a part of the weight: with an accelerometer, and
without."""
_LENGTH = 0.01
"""1-sigma of lengths and places, stretch and sag left out [m]."""
_ANGLE = 0.05
"""The same of an orientation [rad]."""
_REACH, _TURN = 5.0, 0.5
"""1-sigma of the poses beforehand about the first guess [m], [rad]."""
_VERTICAL = 0.7
"""Part of the tensions that carries weight, roughly."""
_HEADINGS = 8
"""That a platform is looked for with."""
_FITS = 0.2
"""Mean square of the residuals below which poses are not looked for any further: of right ones it is
0.08 to 0.17 in recordings at hand, of wrong ones 0.3 and more, since all 1-sigma are generous."""
_CLEARLY = 0.7
"""Part of the cost below which a platform that is turned otherwise fits better: noise makes less."""
_ITERATIONS = 80
"""After which a search that goes astray ends."""
_SETTLED = 1e-4
"""Relative decrease of the cost at which it has arrived."""
_DAMPING = (1e-2, 1e-9, 1e8)
"""First, least and largest."""


@dataclass(frozen=True, eq=False)
class FirstMotion:
    """Poses of a run at some instants."""

    time: Array
    """Common time [s], shape (k,)."""
    position: Array
    """Of the platform origin, world frame [m], shape (k, 3)."""
    rotation: Array
    """R_world_platform, shape (k, 3, 3)."""
    offsets: Mapping[str, Array]
    """Instrument of lengths -> offset of each cable [m], shape (m,)."""


def lacks_pose(experiment: Experiment, run: Run) -> bool:
    """Whether a run of a robot on cables has no orientation, measured or commanded, or no place: lengths
    tell one only once their offsets are known.
    """
    force = experiment.force_instrument(run)
    if force is None or experiment.instruments[force].measured_force != "tension" or run.static:
        return False
    there = {quantity for stream in run.streams.values() for quantity in stream.values}
    return "orientation" not in there or "position" not in there


def turns_are_told(experiment: Experiment, run: Run) -> bool:
    """Whether an instrument beside the forces says how the platform turns: a rate, lengths, or
    several targets. Forces that have to tell it as well leave too little for the body.
    """
    told = [
        quantity.determines
        for name in run.streams
        for quantity in experiment.instruments[name].quantities(experiment.robot.m)
        if quantity.name in run.streams[name].values
    ]
    return any("rotation" in each for each in told) or told.count(("position",)) > 1


def with_first_motion(
    experiment: Experiment, run: Run, found: FirstMotion
) -> tuple[Experiment, Run]:
    """The experiment and its run with poses that stand in for what nothing measures."""
    force = experiment.force_instrument(run)
    assert force is not None
    own = experiment.common_time(run, force)
    shift = float(run.streams[force].time[0] - own[0])
    stream = Stream(
        found.time + shift,
        {"position": found.position, "orientation": found.rotation},
        FIRST_MOTION,
    )
    instrument = Command.model_validate({"kind": "command", "clock": clock_of(experiment, force)})
    sync = {**run.sync, FIRST_MOTION: run.sync[force]} if run.sync else run.sync
    run = replace(run, streams={**run.streams, FIRST_MOTION: stream}, sync=sync)
    return (
        replace(experiment, instruments={**experiment.instruments, FIRST_MOTION: instrument}),
        run,
    )


def first_motion(experiment: Experiment, run: Run) -> FirstMotion | None:
    """Poses of a run in motion; None where its streams have no instant in common.

    Args:
        experiment: With a robot on cables.
        run: One of its runs, with tensions.
    """
    problem = _problem(experiment, run)
    if problem is None:
        return None
    few = np.unique(np.linspace(0, len(problem.time) - 1, _FEW).astype(int))
    robot, some = experiment.robot, problem.at(few)
    best, cost = None, np.inf
    for turned in _turned(some, robot.up):
        if cost < _FITS * some.numbers:
            break
        begun = [
            _Poses.at_rest(robot.below_anchors(depth), turned, len(few), problem.mean)
            for depth in _DEPTHS
        ]
        found, there = min((_solved(some, each) for each in begun), key=lambda each: each[1])
        if there < _CLEARLY * cost:
            best, cost = found, there
    assert best is not None
    poses, _ = _solved(problem, best.spread(problem.time[few], problem.time))
    columns = {
        name: poses.shared[_BODY + i * experiment.robot.m :][: experiment.robot.m]
        for i, name in enumerate(problem.lengths)
    }
    return FirstMotion(problem.time, poses.position, poses.rotation, columns)


@dataclass(frozen=True, eq=False)
class _Poses:
    """What is sought."""

    position: Array
    """Shape (k, 3)."""
    rotation: Array
    """Shape (k, 3, 3)."""
    shared: Array
    """Body and offsets, shape (g,)."""

    @classmethod
    def at_rest(cls, place: Array, turned: Array, count: int, shared: Array) -> _Poses:
        """All the same."""
        return cls(np.tile(place, (count, 1)), np.tile(turned, (count, 1, 1)), shared)

    def spread(self, from_time: Array, to_time: Array) -> _Poses:
        """At other instants: places between, the mean of the orientations."""
        between = np.column_stack([np.interp(to_time, from_time, c) for c in self.position.T])
        turned = Rotation.from_matrix(self.rotation).mean().as_matrix()
        return replace(self, position=between, rotation=np.tile(turned, (len(to_time), 1, 1)))

    def moved(self, poses: Array, shared: Array) -> _Poses:
        """A step further, shapes (k, 6) and (g,)."""
        turn = Rotation.from_rotvec(poses[:, 3:]).as_matrix()
        return _Poses(self.position + poses[:, :3], self.rotation @ turn, self.shared + shared)


def _turned(problem: _Problem, up: Array) -> Iterator[Array]:
    """How the platform may be turned, R_world_platform, shape (3, 3): as somebody has read it; else with
    its axes along those of the world first, then with any heading where an accelerometer says what is
    up, or any way that brings the axes of a cube onto themselves.
    """
    if problem.turned is not None:
        yield problem.turned
        return
    yield np.eye(3)
    felt = problem.readings["felt"].mean(axis=0)
    if not felt.any():
        yield from Rotation.create_group("O").as_matrix()
        return
    upright, _ = Rotation.align_vectors(up, felt)
    for heading in np.arange(_HEADINGS) * 2 * np.pi / _HEADINGS:
        yield (Rotation.from_rotvec(heading * up) * upright).as_matrix()


@dataclass(frozen=True, eq=False)
class _Problem:
    """Readings at instants, and what they should be."""

    time: Array
    readings: Mapping[str, Array]
    """Inputs of the residuals."""
    residuals: Batched
    mean: Array
    """Of body and offsets beforehand, shape (g,)."""
    sigma: Array
    lengths: tuple[str, ...]
    """Instruments of lengths."""
    turned: Array | None
    """Mean of R_world_platform as it was read, shape (3, 3); None: it was not."""

    @property
    def numbers(self) -> int:
        """Of the residuals at all instants."""
        return len(self.time) * self.residuals.shape_of("residual")[0]

    def at(self, some: Array) -> _Problem:
        """At some of the instants."""
        readings = {key: values[some] for key, values in self.readings.items()}
        return replace(self, time=self.time[some], readings=readings)


def _solved(problem: _Problem, poses: _Poses) -> tuple[_Poses, float]:
    """Poses, body and offsets that fit best, and their cost."""
    middle, back = poses.position.mean(axis=0), poses.rotation.transpose(0, 2, 1)
    deviation = np.array([_REACH] * 3 + [_TURN] * 3)

    def evaluated(at: _Poses) -> tuple[dict[str, Array], Array, float]:
        found = problem.residuals(
            position=at.position,
            rotation=at.rotation,
            shared=np.tile(at.shared, (len(at.position), 1)),
            **problem.readings,
        )
        turned = Rotation.from_matrix(back @ at.rotation).as_rotvec()
        prior = np.hstack([at.position - middle, turned]) / deviation
        off = (at.shared - problem.mean) / problem.sigma
        cost = np.sum(found["residual"] ** 2) + np.sum(prior**2) + np.sum(off**2)
        return found, prior, float(cost)

    damping, least, most = _DAMPING
    found, prior, cost = evaluated(poses)
    for _ in range(_ITERATIONS):
        J, G, r = found["by_pose"], found["by_shared"], found["residual"]
        own = J.transpose(0, 2, 1) @ J + np.diag(deviation**-2)
        across = J.transpose(0, 2, 1) @ G
        shared = np.einsum("nki,nkj->ij", G, G) + np.diag(problem.sigma**-2)
        pull = np.einsum("nki,nk->ni", J, r) + prior / deviation
        common = np.einsum("nki,nk->i", G, r) + (poses.shared - problem.mean) / problem.sigma**2
        before = cost
        while True:
            inverse = np.linalg.inv(own * (1 + damping * np.eye(6)))
            system = shared * (1 + damping * np.eye(len(shared))) - np.einsum(
                "nia,nij,njb->ab", across, inverse, across
            )
            right = common - np.einsum("nia,nij,nj->a", across, inverse, pull)
            by_shared = -np.linalg.solve(system, right)
            by_pose = -np.einsum("nij,nj->ni", inverse, pull + across @ by_shared)
            there = poses.moved(by_pose, by_shared)
            found, prior, cost = evaluated(there)
            if cost < before:
                break
            damping *= 4
            if damping > most:
                return poses, before
        poses, damping = there, max(damping / 5, least)
        if before - cost < _SETTLED * before:
            break
    return poses, cost


def _problem(experiment: Experiment, run: Run) -> _Problem | None:
    """What the streams of a run say at instants; None where they have none in common."""
    robot = experiment.robot.with_straight_cables()
    force = experiment.force_instrument(run)
    assert force is not None
    times = {name: experiment.common_time(run, name) for name in run.streams}
    start = max(float(each[0]) for each in times.values())
    end = min(float(each[-1]) for each in times.values())
    if run.window is not None:
        start, end = max(start, run.window[0]), min(end, run.window[1])
    if end - start < 2 * SPACING:
        return None
    count = min(_MOST, int((end - start) / SPACING))
    edges = np.linspace(start, end, count + 1)
    said = [(force, "tension"), *_read(experiment, run)]
    readings = {
        "_".join(source): _means(times[source[0]], run.streams[source[0]].values[source[1]], edges)
        for source in said
    }
    whole = np.all(
        [np.isfinite(each.reshape(count, -1)).all(axis=1) for each in readings.values()], axis=0
    )
    if whole.sum() < 2:
        return None
    accelerometer = next((s for s in said if s[1] == "specific_force"), None)
    felt = np.zeros((count, 3))
    if accelerometer is not None:
        instrument = experiment.instruments[accelerometer[0]]
        felt = readings.pop("_".join(accelerometer)) @ instrument.mounting.rotation.T
    tension = readings.pop(f"{force}_tension")
    weight = _VERTICAL * float(np.median(tension[whole].sum(axis=1)))
    lengths = tuple(name for name, quantity in said if quantity == "length")
    quantities = tuple(s for s in said[1:] if s != accelerometer)
    instruments = tuple(experiment.instruments[name] for name, _ in quantities)
    residuals = _residuals(robot, quantities, instruments, accelerometer is not None)
    offsets = [_offset(experiment.instruments[name], robot.m) for name in lengths]
    moment = weight / float(np.linalg.norm(robot.gravity))
    return _Problem(
        ((edges[:-1] + edges[1:]) / 2)[whole],
        {
            "tension": tension[whole],
            "felt": felt[whole],
            "weight": np.full(whole.sum(), weight)[:, None],
            **{key: values[whole] for key, values in readings.items()},
        },
        residuals,
        np.concatenate([[moment], np.zeros(3), *(mean for mean, _ in offsets)]),
        np.concatenate(
            [[moment], np.full(3, moment * robot.size), *(sigma for _, sigma in offsets)]
        ),
        lengths,
        _read_rotation(experiment, readings),
    )


def _read_rotation(experiment: Experiment, readings: Mapping[str, Array]) -> Array | None:
    """Mean of how the platform was turned, as the first instrument that reads it has it; None: none
    does.
    """
    for name, instrument in experiment.instruments.items():
        read = readings.get(f"{name}_orientation")
        if read is None:
            continue
        mounting = instrument.mounting
        whole = read[np.isfinite(read).all(axis=(1, 2))]
        mean = Rotation.from_matrix(whole).mean().as_matrix()
        frame = np.eye(3) if mounting.frame is None else mounting.frame.rotation
        return np.asarray(frame @ mean @ mounting.rotation.T)
    return None


def _read(experiment: Experiment, run: Run) -> Iterator[tuple[str, str]]:
    """Instruments and quantities that say something of a pose."""
    for name, stream in run.streams.items():
        if experiment.instruments[name].is_measurement:
            for quantity in ("position", "orientation", "length", "specific_force"):
                if quantity in stream.values:
                    yield name, quantity


def _means(time: Array, values: Array, edges: Array) -> Array:
    """Means of readings between instants, shape (k, ...); NaN where there is none."""
    flat = values.reshape(len(values), -1)
    sound = np.isfinite(flat).all(axis=1)
    place = np.searchsorted(edges, time[sound], side="right") - 1
    inside = (place >= 0) & (place < len(edges) - 1)
    count = np.bincount(place[inside], minlength=len(edges) - 1)
    sums = [
        np.bincount(place[inside], weights=column[sound][inside], minlength=len(edges) - 1)
        for column in flat.T
    ]
    found = np.array(sums).T / np.where(count, count, np.nan)[:, None]
    return np.asarray(found.reshape(-1, *values.shape[1:]))


def _offset(instrument: Instrument, m: int) -> tuple[Array, Array]:
    """Mean and 1-sigma of the offsets of lengths beforehand [m]."""
    (term,) = (each for each in instrument.terms(m) if each.key == "offset")
    assert term.deviation is not None  # lengths have one
    return term.mean, np.maximum(term.deviation, 1e-6)


@lru_cache(maxsize=16)
def _residuals(
    robot: Robot,
    sources: tuple[tuple[str, str], ...],
    instruments: tuple[Instrument, ...],
    accelerometer: bool,
) -> Batched:
    """Residuals of one pose, and how they follow it and what all poses share."""
    position, rotation = ca.SX.sym("position", 3), ca.SX.sym("rotation", 3, 3)
    turn, tension = ca.SX.sym("turn", 3), ca.SX.sym("tension", robot.m)
    felt, weight = ca.SX.sym("felt", 3), ca.SX.sym("weight")
    body = ca.SX.sym("body", _BODY)
    turned = rotation @ (ca.SX.eye(3) + ca.skew(turn))
    still = ca.SX.zeros(3)
    gravity = ca.DM(robot.gravity)
    specific_force = felt if accelerometer else -turned.T @ gravity
    state = State(position, turned, still, still, specific_force, still, tension, None, gravity)
    parameters = ca.vertcat(body, ca.SX.zeros(TEN - _BODY))
    pulled = cable_wrench(
        robot, position, turned, tension, ca.DM(robot.anchors.T), ca.DM(robot.attachments.T)
    )
    share = _IN_BALANCE if accelerometer else _ACCELERATED
    unit = ca.vertcat(*[1.0] * 3, *[robot.size] * 3) * share * weight
    residual = [(pulled - newton_euler(parameters, specific_force, still, still)) / unit]
    readings: dict[str, Symbol] = {}
    offsets = []
    for (name, quantity), instrument in zip(sources, instruments, strict=True):
        errors: dict[str, Symbol] = {
            key: ca.DM(value) for key, value in means(instrument, robot.m).items()
        }
        if quantity == "length":
            errors["offset"] = ca.SX.sym(f"offset_{name}", robot.m)
            offsets.append(errors["offset"])
        expected = instrument.predict(state, errors, robot)[quantity]
        read = ca.SX.sym(f"{name}_{quantity}", *expected.shape)
        readings[f"{name}_{quantity}"] = read
        if quantity == "orientation":
            residual.append(ca.inv_skew(expected.T @ read) / _ANGLE)
        else:
            residual.append((read - expected) / _LENGTH)
    own = ca.vertcat(body, *offsets)
    shared = ca.SX.sym("shared", own.numel())
    whole = ca.vertcat(*residual)
    by_pose = ca.jacobian(whole, ca.vertcat(position, turn))
    outputs = ca.substitute(
        [whole, by_pose, ca.jacobian(whole, own)], [own, turn], [shared, ca.SX.zeros(3)]
    )
    return Batched(
        "first_motion",
        {
            "position": position,
            "rotation": rotation,
            "tension": tension,
            "felt": felt,
            "weight": weight,
            "shared": shared,
            **readings,
        },
        dict(zip(("residual", "by_pose", "by_shared"), map(ca.densify, outputs), strict=True)),
    )
