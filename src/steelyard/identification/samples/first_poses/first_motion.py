"""A motion to begin with where no instrument tells the pose by itself: winch encoders with or
without an orientation, a tracked point and cables, a gyro that knows no north.

At some instants of a run the platform is taken to be nearly in balance. Its poses there, a first
body and the offsets of the lengths are those that fit the tensions, the lengths, the tracked points
and the orientations at once: Gauss-Newton with damping [Marquardt1963]_ on poses that only share
the body and the offsets. It is rough, since accelerations count as noise where no accelerometer
reads them, but it is the place where a fit of all readings begins.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run, Stream
from steelyard.identification.model.calibration_parameters import clock_of
from steelyard.identification.samples.instants_in_balance import BODY, Instants, instants_of
from steelyard.instruments.command import Command

FIRST_MOTION = "first motion"
"""Name of the stream that stands in for what nothing measures."""
_FEW = 10
"""Instants with which it is found out how deep the platform hangs."""
_DEPTHS = (0.1, 0.25, 0.4, 0.6, 0.9)
"""Where it may hang below the highest anchor, in parts of their span: there is another answer above
the anchors."""
_REACH, _TURN = 5.0, 0.5
"""1-sigma of the poses beforehand about the first guess [m], [rad]."""
_HEADINGS = 8
"""That a platform is looked for with."""
_FITS = 0.2
"""Cost per residual below which poses are not looked for any further: of right ones it is
0.08 to 0.17 in recordings at hand, of wrong ones 0.3 and more, since all 1-sigma are generous."""
_CLEARLY = 0.7
"""Part of the cost below which a platform that is turned otherwise fits better: noise makes
less."""
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
    """Whether a run of a robot on cables has no orientation, measured or commanded, or no place:
    lengths tell one only once their offsets are known.
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
    instants = instants_of(experiment, run)
    if instants is None:
        return None
    few = np.unique(np.linspace(0, len(instants.time) - 1, _FEW).astype(int))
    robot, some = experiment.robot, instants.at(few)
    best, cost = None, np.inf
    for turned in _turned(some, robot.up):
        if cost < _FITS:
            break
        begun = [
            _Poses.at_rest(robot.below_anchors(depth), turned, len(few), instants.mean)
            for depth in _DEPTHS
        ]
        found, there = min((_solved(some, each) for each in begun), key=lambda each: each[1])
        if there < _CLEARLY * cost:
            best, cost = found, there
    assert best is not None
    poses, _ = _solved(instants, best.spread(instants.time[few], instants.time))
    columns = {
        name: poses.shared[BODY + i * experiment.robot.m :][: experiment.robot.m]
        for i, name in enumerate(instants.lengths)
    }
    return FirstMotion(instants.time, poses.position, poses.rotation, columns)


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


def _turned(instants: Instants, up: Array) -> Iterator[Array]:
    """How the platform may be turned, R_world_platform, shape (3, 3): as somebody has read it; else
    with its axes along those of the world first, then with any heading where an accelerometer says
    what is up, or any way that brings the axes of a cube onto themselves.
    """
    if instants.turned is not None:
        yield instants.turned
        return
    yield np.eye(3)
    felt = instants.readings["felt"].mean(axis=0)
    if not felt.any():
        yield from Rotation.create_group("O").as_matrix()
        return
    upright, _ = Rotation.align_vectors(up, felt)
    for heading in np.arange(_HEADINGS) * 2 * np.pi / _HEADINGS:
        yield (Rotation.from_rotvec(heading * up) * upright).as_matrix()


def _solved(instants: Instants, poses: _Poses) -> tuple[_Poses, float]:
    """Poses, body and offsets that fit best, and their cost per residual."""
    middle, back = poses.position.mean(axis=0), poses.rotation.transpose(0, 2, 1)
    deviation = np.array([_REACH] * 3 + [_TURN] * 3)

    def evaluated(at: _Poses) -> tuple[dict[str, Array], Array, float]:
        found = instants.residuals(
            position=at.position,
            rotation=at.rotation,
            shared=np.tile(at.shared, (len(at.position), 1)),
            **instants.readings,
        )
        turned = Rotation.from_matrix(back @ at.rotation).as_rotvec()
        prior = np.hstack([at.position - middle, turned]) / deviation
        off = (at.shared - instants.mean) / instants.sigma
        cost = np.sum(found["residual"] ** 2) + np.sum(prior**2) + np.sum(off**2)
        return found, prior, float(cost)

    damping, least, most = _DAMPING
    found, prior, cost = evaluated(poses)
    for _ in range(_ITERATIONS):
        J, G, r = found["by_pose"], found["by_shared"], found["residual"]
        own = J.transpose(0, 2, 1) @ J + np.diag(deviation**-2)
        across = J.transpose(0, 2, 1) @ G
        shared = np.einsum("nki,nkj->ij", G, G) + np.diag(instants.sigma**-2)
        pull = np.einsum("nki,nk->ni", J, r) + prior / deviation
        common = np.einsum("nki,nk->i", G, r) + (poses.shared - instants.mean) / instants.sigma**2
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
                return poses, before / found["residual"].size
        poses, damping = there, max(damping / 5, least)
        if before - cost < _SETTLED * before:
            break
    return poses, cost / found["residual"].size
