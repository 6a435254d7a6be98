"""Imperfections that a sound description has: what real sensors and robots do though nothing is stated
wrongly.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Stream

Make = Callable[[Experiment, np.random.Generator], Experiment]


def _changed(experiment: Experiment, name: str, quantity: str, change: Callable) -> Experiment:
    runs = []
    for run in experiment.runs:
        stream: Stream = run.streams[name]
        values = {**stream.values, quantity: change(stream.time, stream.values[quantity])}
        runs.append(replace(run, streams={**run.streams, name: replace(stream, values=values)}))
    return replace(experiment, runs=tuple(runs))


def gains(experiment: Experiment, draw: np.random.Generator) -> Experiment:
    """Of the cells, 2 %."""
    factors = 1 + 0.02 * draw.standard_normal(experiment.robot.m)
    return _changed(experiment, "cables", "tension", lambda t, f: f * factors)


def friction(experiment: Experiment, draw: np.random.Generator) -> Experiment:
    """Of rollers, 3 %, by the direction in which each cable moves."""
    run = experiment.runs[0]
    where = run.streams["tracker"]
    far = np.linalg.norm(where.values["position"][:, None] - experiment.robot.anchors, axis=2)

    def change(t, f):
        shift = run.sync.get("cables", 0.0) - run.sync.get("tracker", 0.0)
        at = [np.interp(t - shift, where.time, column) for column in far.T]
        speed = np.gradient(np.stack(at, axis=1), t, axis=0)
        return f * (1 + 0.03 * np.tanh(speed / 0.01))

    return _changed(experiment, "cables", "tension", change)


def filtered(name: str, quantity: str, time: float) -> Make:
    """A first-order filter [s] in an amplifier."""

    def make(experiment, draw):
        def change(t, x):
            a = np.exp(-np.median(np.diff(t)) / time)
            flat = x.reshape(len(x), -1)
            slow, _ = lfilter([1 - a], [1, -a], flat, axis=0, zi=a * flat[:1])
            return slow.reshape(x.shape)

        return _changed(experiment, name, quantity, change)

    return make


def lagging_attitude(experiment: Experiment, draw: np.random.Generator) -> Experiment:
    """An attitude that is slow, and leans."""
    slow = filtered("imu", "orientation", 0.15)(experiment, draw)
    lean = Rotation.from_rotvec(0.02 * draw.standard_normal(3)).as_matrix()

    def change(t, R):
        U, _, V = np.linalg.svd(R)
        return U @ V @ lean

    return _changed(slow, "imu", "orientation", change)


def late(name: str, delay: float) -> Make:
    """A clock that is late [s]."""

    def make(experiment, draw):
        runs = []
        for run in experiment.runs:
            stream = run.streams[name]
            moved = replace(stream, time=stream.time + delay)
            runs.append(replace(run, streams={**run.streams, name: moved}))
        return replace(experiment, runs=tuple(runs))

    return make


def drift(experiment: Experiment, draw: np.random.Generator) -> Experiment:
    """Of all cells, 15 N within the recording."""
    slope = draw.standard_normal(experiment.robot.m)
    return _changed(
        experiment, "cables", "tension", lambda t, f: f + 15 * np.outer((t - t[0]) / 12, slope)
    )


def turned(angle: float) -> Make:
    """An IMU that sits askew [rad]."""

    def make(experiment, draw):
        R = Rotation.from_rotvec(angle * draw.standard_normal(3)).as_matrix()
        for quantity in ("angular_velocity", "specific_force"):
            experiment = _changed(experiment, "imu", quantity, lambda t, v: v @ R.T)
        return experiment

    return make


def biased(experiment: Experiment, draw: np.random.Generator) -> Experiment:
    """Biases and scales of a cheap IMU."""
    for quantity, size in (("angular_velocity", 0.02), ("specific_force", 0.3)):
        bias, scale = size * draw.standard_normal(3), 1 + 0.02 * draw.standard_normal(3)
        experiment = _changed(experiment, "imu", quantity, lambda t, v, b=bias, s=scale: v * s + b)
    return experiment


def noisy_tracker(experiment: Experiment, draw: np.random.Generator) -> Experiment:
    """5 mm of a camera, and a frame off by a degree and 3 cm."""
    R = Rotation.from_rotvec(0.015 * draw.standard_normal(3)).as_matrix()
    return _changed(
        experiment,
        "tracker",
        "position",
        lambda t, p: p @ R.T + 0.03 + 0.005 * draw.standard_normal(p.shape),
    )


def places(experiment: Experiment, draw: np.random.Generator) -> Experiment:
    """Places on the platform measured with a tape: 3 cm."""
    changed = dict(experiment.instruments)
    for name, key in (("imu", "position"), ("tracker", "target")):
        old = np.array(getattr(changed[name], key))
        new = tuple(float(each) for each in old + 0.03 * draw.standard_normal(3))
        changed[name] = changed[name].model_copy(update={key: new})
    return replace(experiment, instruments=changed)


def geometry(experiment: Experiment, draw: np.random.Generator) -> Experiment:
    """Anchors by a drawing: 2 cm."""
    robot = experiment.robot
    moved = robot.anchors + 0.02 * draw.standard_normal(robot.anchors.shape)
    return replace(experiment, robot=replace(robot, anchors=moved))


def hose(experiment: Experiment, draw: np.random.Generator) -> Experiment:
    """A hose that pulls on one side: 3 % of the tension, with the height."""
    share = 0.06 * draw.random(experiment.robot.m)
    return _changed(
        experiment, "cables", "tension", lambda t, f: f + share * (f - 0.5 * f.mean(axis=0))
    )


def together(*makes: Make) -> Make:
    """Several at once."""

    def make(experiment, draw):
        for each in makes:
            experiment = each(experiment, draw)
        return experiment

    return make


SOUND: Mapping[str, Make] = {
    "gains of 2 %": gains,
    "friction of 3 %": friction,
    "filter of the forces, .05 s": filtered("cables", "tension", 0.05),
    "attitude filter, .15 s": lagging_attitude,
    "tracker late by .05 s": late("tracker", 0.05),
    "tracker late by .12 s": late("tracker", 0.12),
    "drift of 15 N": drift,
    "IMU askew by 2 degrees": turned(0.035),
    "cheap IMU": biased,
    "camera": noisy_tracker,
    "places by tape": places,
    "anchors by drawing": geometry,
    "hose": hose,
    "friction, drift, gains": together(friction, drift, gains),
    "all of the IMU": together(lagging_attitude, biased, turned(0.035)),
    "all of the tracker": together(noisy_tracker, late("tracker", 0.05), places),
    "everything": together(
        gains, friction, drift, hose, biased, turned(0.035), noisy_tracker, places, geometry
    ),
}
