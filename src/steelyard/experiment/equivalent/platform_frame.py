"""The platform frame with its origin elsewhere: what is estimated is to be the same wherever the
user's drawing has it.

A smooth motion of one point of the platform is none of a point far away, a torque that nothing
explains is another about each, and a body as large as its robot is so about the middle of it. All
of that is meant about the platform, wherever it is held.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment, Load
from steelyard.experiment.observations import SeenFrequencies
from steelyard.experiment.recording import Run, Stream
from steelyard.experiment.surroundings import AttachedForm
from steelyard.instruments import Instrument
from steelyard.robot.model import Robot

_COORDINATES = ("cx", "cy", "cz")
"""Of a centre of gravity, among what is known of a body."""


def centred(experiment: Experiment) -> Experiment:
    """The same experiment, told in a platform frame whose origin is where the platform is held: in
    the middle of its attachments, or in the wrench sensor.

    Args:
        experiment: As it was stated.
    """
    return about(experiment, _middle(experiment))


def near(experiment: Experiment) -> Experiment:
    """The same experiment, told in a platform frame whose origin is on the platform: as it was
    stated where it is no further from the middle than the attachments are, else the nearest place
    to that.

    What looks at single samples of a motion pays for the distance of the centre of gravity, which
    who describes a platform knows better than its attachments do.

    Args:
        experiment: As it was stated.
    """
    middle = _middle(experiment)
    beyond = max(0.0, 1.0 - experiment.robot.size / max(float(np.linalg.norm(middle)), 1e-12))
    return about(experiment, beyond * middle)


def _middle(experiment: Experiment) -> Array:
    """Where the platform is held, in its frame [m], shape (3,)."""
    if experiment.robot.m:
        return np.asarray(experiment.robot.attachments.mean(axis=0))
    carrying = (each for each in experiment.instruments.values() if each.is_force)
    return np.array(next((each.mounting.point for each in carrying), None) or (0.0, 0.0, 0.0))


def about(experiment: Experiment, point: Array) -> Experiment:
    """The same experiment, told in a platform frame whose origin is at a point of the present one.

    Args:
        experiment: To be told otherwise.
        point: In its platform frame [m], shape (3,).
    """
    if not point.any():
        return experiment
    robot = experiment.robot
    return replace(
        experiment,
        robot=_robot(robot, point),
        instruments={k: _instrument(each, point) for k, each in experiment.instruments.items()},
        runs=tuple(run_about(run, experiment.instruments, point) for run in experiment.runs),
        known=_known(experiment.known, point),
        surroundings=experiment.surroundings.model_copy(
            update={"attached": tuple(_hose(e, point) for e in experiment.surroundings.attached)}
        ),
        frequencies=tuple(_seen(each, point) for each in experiment.frequencies),
        loads=tuple(_load(each, robot, point) for each in experiment.loads),
        origin=experiment.origin - point,
    )


def _robot(robot: Robot, point: Array) -> Robot:
    """The robot in such a frame."""
    platform = None if robot.platform is None else robot.platform.about(point)
    return replace(robot, attachments=robot.attachments - point, platform=platform)


def run_about(run: Run, instruments: Mapping[str, Instrument], point: Array) -> Run:
    """A run in such a frame: what tells the place of its origin, and not that of a point that is
    stated for it, is told of the other.

    Args:
        run: Of an experiment.
        instruments: As they are stated there.
        point: See :func:`about`.
    """
    streams = {
        name: _stream(each, point) if instruments[name].commanded else each
        for name, each in run.streams.items()
    }
    return replace(run, streams=streams)


def _stream(stream: Stream, point: Array) -> Stream:
    """Commanded poses."""
    if not {"position", "orientation"} <= stream.values.keys():
        return stream
    position = stream.values["position"] + stream.values["orientation"] @ point
    return replace(stream, values={**stream.values, "position": position})


def _instrument(instrument: Instrument, point: Array) -> Instrument:
    """One that sits elsewhere in such a frame."""
    mounting = instrument.mounting
    if mounting.point is None:
        return instrument
    moved = tuple((np.array(mounting.point) - point).tolist())
    return instrument.model_copy(update={mounting.point_key: moved})


def _known(
    known: Mapping[str, tuple[float, float]], point: Array
) -> Mapping[str, tuple[float, float]]:
    """What is known of the place of a body."""
    shift = dict(zip(_COORDINATES, point.tolist(), strict=True))
    return {name: (value - shift.get(name, 0.0), s) for name, (value, s) in known.items()}


def _load(load: Load, robot: Robot, point: Array) -> Load:
    return replace(
        load,
        known=_known(load.known, point),
        added=_known(load.added, point),
        nominal=None if load.nominal is None else load.nominal.about(point),
    )


def _hose(hose: AttachedForm, point: Array) -> AttachedForm:
    """Something attached to a point of the platform."""
    at = tuple(
        each.model_copy(update={"value": each.value - float(own)})
        for each, own in zip(hose.at, point, strict=True)
    )
    return hose.model_copy(update={"at": at})


def _seen(seen: SeenFrequencies, point: Array) -> SeenFrequencies:
    """Frequencies seen at a pose."""
    if seen.pose is None:
        return seen
    lever = Rotation.from_euler("ZYX", seen.pose[:2:-1]).as_matrix() @ point
    return replace(seen, pose=np.concatenate([seen.pose[:3] + lever, seen.pose[3:]]))
