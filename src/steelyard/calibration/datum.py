r"""A datum: the world frame as some of the anchors, or one pose, define it.

Readings tell where anchors are against each other; where the world frame lies is a definition. A
change of it moves all that is told in the world by one rigid motion, and takes the uncertainty of
what defines it to the rest (an S-transformation [Baarda1973]_). Distances and angles between points
stay as they are.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from steelyard import rotations
from steelyard.arrays import Array
from steelyard.batch import Batched
from steelyard.calibration.first_poses import UPRIGHT
from steelyard.calibration.fit import GeometryFit
from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.identification.banded import banded_window
from steelyard.identification.model.calibration_parameters import ROBOT
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.segment import POSE
from steelyard.instruments.base import FrameForm
from steelyard.instruments.equations import solve_for

_PLACE, _TURNED, _REFERENCE = "frame.position", "frame.rotation", "reference"
"""Keys of errors that are told in the world frame."""
_MOTIONS = 6
"""Of a frame: along x, y, z and about these."""


@dataclass(frozen=True, eq=False)
class Placed:
    """All calibration parameters in the world frame that is meant."""

    values: Array
    """Shape (u,)."""
    covariance: Array
    """Shape (u, u)."""
    words: str | None = None
    """What the world frame is; None: as the readings and what was known beforehand have it."""
    rotation: Array | None = None
    """From the world frame as it was described to this one, shape (3, 3); None: it is that."""
    translation: Array | None = None
    """Its origin in this one [m], shape (3,)."""
    spread: Array | None = None
    """Covariance of that motion: translation of the datum's centre [m], rotation vector [rad] in
    this frame, shape (6, 6)."""


@dataclass(frozen=True, eq=False)
class _Definition:
    """A rigid motion of the world frame, and what it depends on."""

    rotation: Array
    """Shape (3, 3)."""
    translation: Array
    """[m], shape (3,)."""
    centre: Array
    """Point about which small rotations turn, in the new frame [m], shape (3,)."""
    by_values: Array
    """How translation and small rotation of the new frame follow the calibration parameters, shape
    (6, u)."""
    by_pose: Array
    """And a pose, shape (6, 7); zero where none defines it."""


def check_datum(experiment: Experiment) -> None:
    """See that the datum of an experiment, where it has one, can define its world.

    Args:
        experiment: With poses at rest.

    Raises:
        InputError: Nothing tells the pose of the datum, or an instrument stands in the world in a
            way that cannot be told in another frame.
    """
    if experiment.datum is None:
        return
    for run in experiment.runs:
        for name in run.streams if run.static else ():
            instrument = experiment.instruments[name]
            keys = {term.key for term in instrument.terms(experiment.robot.m)}
            if (
                instrument.is_motion
                and not instrument.commanded
                and not keys & {_PLACE, _REFERENCE}
            ):
                raise InputError(
                    f"datum: expected no instrument of kind '{instrument.kind}' in poses at rest,"
                    f" whose place in the world is stated, found '{name}'; leave out 'datum', or"
                    " the instrument"
                )
    if experiment.datum.pose is not None:
        _stated_pose(experiment, experiment.run(experiment.datum.pose))


def placed(found: GeometryFit) -> Placed:
    """Values and covariance of all calibration parameters on the datum of an experiment.

    Args:
        found: The fit, of an experiment that :func:`check_datum` lets pass. One that has not
            converged defines nothing.
    """
    datum = found.experiment.datum
    if datum is None or not found.fit.converged:
        return Placed(found.calibration.values, found.covariance)
    if datum.pose is None:
        definition = _by_anchors(found, datum.anchors)
        numbers = ", ".join(map(str, datum.anchors[:-1])) + f" and {datum.anchors[-1]}"
        words = f"that in which anchors {numbers} are nearest to those of the robot file (datum)"
        covariance = np.zeros((POSE, POSE))
        across = np.zeros((len(found.parameters), POSE))
    else:
        run = found.experiment.run(datum.pose)
        place, turned, by = _stated_pose(found.experiment, run)
        definition = _by_pose(found, run, place, turned)
        words = f"that in which the first pose of run '{run.name}' is as {by} says (datum)"
        covariance, across = _pose_covariance(found, run)
    values, change, follows = _moved(found, definition)
    whole = change + follows @ definition.by_values
    by_pose = follows @ definition.by_pose
    mixed = whole @ across @ by_pose.T
    spread = whole @ found.covariance @ whole.T + mixed + mixed.T + by_pose @ covariance @ by_pose.T
    A, B = definition.by_values, definition.by_pose
    both = A @ across @ B.T
    own = A @ found.covariance @ A.T + both + both.T + B @ covariance @ B.T
    return Placed(
        values,
        (spread + spread.T) / 2,
        words,
        definition.rotation,
        definition.translation,
        (own + own.T) / 2,
    )


def _by_anchors(found: GeometryFit, numbers: tuple[int, ...]) -> _Definition:
    """The frame in which some anchors are nearest to those drawn, in the sum of squares
    [Kabsch1976]_.
    """
    place = found.parameters.places[ROBOT, "anchor", None]
    own = np.array(numbers) - 1
    drawn = found.experiment.robot.anchors[own]
    points = found.calibration.values[place].reshape(-1, 3)[own]
    centre, middle = drawn.mean(axis=0), points.mean(axis=0)
    turn, _ = Rotation.align_vectors(drawn - centre, points - middle)
    R = np.asarray(turn.as_matrix())
    arms, meant = (points - middle) @ R.T, drawn - centre
    # What is nearest has no moment about the centre, however the points move.
    S, M = rotations.cross_matrices(meant), rotations.cross_matrices(arms)
    turned = np.linalg.solve(np.einsum("nij,njk->ik", S, M), np.concatenate(S, axis=1))
    by_values = np.zeros((_MOTIONS, len(found.parameters)))
    columns = place.start + (3 * own[:, None] + np.arange(3)).ravel()
    by_values[:3, columns] = -np.tile(R, len(own)) / len(own)
    by_values[3:, columns] = turned @ np.kron(np.eye(len(own)), R)
    none = np.zeros((_MOTIONS, POSE))
    return _Definition(R, centre - R @ middle, centre, by_values, none)


def _stated_pose(experiment: Experiment, run: Run) -> tuple[Array, Array, str]:
    """First position [m], shape (3,), and rotation, shape (3, 3), of a run, and the instrument that
    says so: the command, or what reads both in the world.

    Raises:
        InputError: There is none.
    """
    both = ("position", "orientation")
    able = [
        name
        for name, stream in run.streams.items()
        if all(part in stream.values and np.isfinite(stream.values[part][0]).all() for part in both)
        and name != UPRIGHT
    ]
    for name in sorted(able, key=lambda each: not experiment.instruments[each].commanded):
        instrument, values = experiment.instruments[name], run.streams[name].values
        seen = {part: values[part][:1] for part in both}
        robot, orientation = experiment.robot, {"orientation": seen["orientation"]}
        turned = solve_for("rotation", instrument, robot, orientation, {})
        position = {"position": seen["position"]}
        place = solve_for("position", instrument, robot, position, {"rotation": turned})
        return place[0], turned[0], name
    raise InputError(
        f"datum: expected a command or an instrument of kind 'pose' in the first row of run"
        f" '{run.name}', found none; add one, or name anchors (datum: {{anchors: [1, 2, 3]}})"
    )


def _by_pose(found: GeometryFit, run: Run, place: Array, turned: Array) -> _Definition:
    """The frame in which the first pose of a run is a given one.

    Args:
        found: The fit.
        run: Static.
        place: Position that it is to have [m], shape (3,).
        turned: Rotation, shape (3, 3).
    """
    pose = _segment(found, run)[1].coefficients[0][:POSE]
    was = Rotation.from_quat(pose[3:], scalar_first=True).as_matrix()
    R = turned @ was.T
    by_pose = np.zeros((_MOTIONS, POSE))
    by_pose[:3, :3] = -R
    by_pose[3:, 3:] = -R @ was @ _turning()(quaternion=pose[3:])["slope"]
    none = np.zeros((_MOTIONS, len(found.parameters)))
    return _Definition(R, place - R @ pose[:3], place, none, by_pose)


def _segment(found: GeometryFit, run: Run) -> tuple[int, Segment]:
    """Number and poses of a run."""
    segments = found.fit.state.segments
    return next((i, each) for i, each in enumerate(segments) if each.run == run.name)


def _pose_covariance(found: GeometryFit, run: Run) -> tuple[Array, Array]:
    """Covariance of the first pose of a run, shape (7, 7), and of all calibration parameters with
    it, shape (u, 7).
    """
    number, _ = _segment(found, run)
    equations, border = found.fit.equations[number], found.fit.covariance
    followed = equations.followed[:POSE]
    whole = banded_window(equations.inverse, 0, POSE) + followed @ border @ followed.T
    across = np.zeros((len(found.parameters), POSE))
    active = np.flatnonzero(found.task.active)
    across[active] = -(border @ followed.T)[len(border) - len(active) :]
    return whole, across


def _moved(found: GeometryFit, definition: _Definition) -> tuple[Array, Array, Array]:
    """Values of all calibration parameters in the frame of a definition, shape (u,), and how they
    follow those in the frame before, shape (u, u), and small motions of the new one, shape (u, 6).
    """
    R = definition.rotation
    values, count = found.calibration.values.copy(), len(found.parameters)
    change, follows = np.eye(count), np.zeros((count, _MOTIONS))

    def point(own: slice, offset: Array) -> None:
        # A point of the world, told from another.
        was = offset + values[own]
        moved = R @ was + definition.translation
        values[own] = moved - offset
        change[own, own] = R
        follows[own, :3] = np.eye(3)
        follows[own, 3:] = -rotations.cross_matrices((moved - definition.centre)[None])[0]

    for (owner, key, _), place in found.parameters.places.items():
        if owner == UPRIGHT:
            continue
        if (owner, key) == (ROBOT, "anchor"):
            for start in range(place.start, place.stop, 3):
                point(slice(start, start + 3), np.zeros(3))
        elif (owner, key) == (ROBOT, "gravity") and found.body is not None:
            values[place] = R @ values[place]
            change[place, place] = R
            follows[place, 3:] = -rotations.cross_matrices(values[place][None])[0]
        elif key in {_PLACE, _TURNED, _REFERENCE} and owner != ROBOT:
            frame = found.experiment.instruments[owner].mounting.frame or FrameForm()
            if key == _PLACE:
                point(place, np.array(frame.position))
                continue
            stated = frame.rotation if key == _TURNED else np.eye(3)
            turn = _turn()(theta=values[place], moved=R, stated=stated)
            values[place] = turn["theta"]
            change[place, place], follows[place, 3:] = turn["by_theta"], turn["by_motion"]
    return values, change, follows


@cache
def _turning() -> Batched:
    """How a platform turns in its own axes with its quaternion."""
    q, dq = ca.SX.sym("q", 4), ca.SX.sym("dq", 4)
    slope = ca.jacobian(rotations.quaternion_omega(q, dq), dq)
    return Batched("turning", {"quaternion": q}, {"slope": slope})


@cache
def _turn() -> Batched:
    """Rotation vector of an error of a stated rotation, in a world frame that has been turned."""
    theta, motion = ca.SX.sym("theta", 3), ca.SX.sym("motion", 3)
    moved, stated = ca.SX.sym("moved", 3, 3), ca.SX.sym("stated", 3, 3)
    whole = rotations.exp(motion) @ moved @ stated @ rotations.exp(theta)
    found = rotations.log(stated.T @ whole)
    slopes = (ca.jacobian(found, each) for each in (theta, motion))
    here, by_theta, by_motion = (ca.substitute(e, motion, ca.DM.zeros(3)) for e in (found, *slopes))
    return Batched(
        "turn",
        {"theta": theta, "moved": moved, "stated": stated},
        {"theta": here, "by_theta": by_theta, "by_motion": by_motion},
    )
