"""What a run says at instants at which the platform is taken to be nearly in balance, and what a
pose, a first body and the offsets of lengths would have it say.
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
from steelyard.experiment.recording import Run
from steelyard.inertia import TEN
from steelyard.instruments import Instrument
from steelyard.instruments.equations import means
from steelyard.motion.state import State
from steelyard.robot.kinematics import cable_wrench
from steelyard.robot.model import Robot

BODY = 4
"""Mass and first moments."""
SPACING = 0.1
"""Of the instants [s]: motions of platforms have hardly more than 1 Hz."""
_MOST = 3000
"""Instants at most."""
_IN_BALANCE, _ACCELERATED = 0.02, 0.08
"""1-sigma of what the tensions do not balance, as a part of the weight: with an accelerometer, and
without."""
_LENGTH = 0.01
"""1-sigma of lengths and places, stretch and sag left out [m]."""
_ANGLE = 0.05
"""The same of an orientation [rad]."""
_VERTICAL = 0.7
"""Part of the tensions that carries weight, roughly."""


@dataclass(frozen=True, eq=False)
class Instants:
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

    def at(self, some: Array) -> Instants:
        """At some of the instants."""
        readings = {key: values[some] for key, values in self.readings.items()}
        return replace(self, time=self.time[some], readings=readings)


def instants_of(experiment: Experiment, run: Run) -> Instants | None:
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
    return Instants(
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
    body = ca.SX.sym("body", BODY)
    turned = rotation @ (ca.SX.eye(3) + ca.skew(turn))
    still = ca.SX.zeros(3)
    gravity = ca.DM(robot.gravity)
    specific_force = felt if accelerometer else -turned.T @ gravity
    state = State(position, turned, still, still, specific_force, still, tension, None, gravity)
    parameters = ca.vertcat(body, ca.SX.zeros(TEN - BODY))
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
