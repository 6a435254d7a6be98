"""What sensors read of a course: each stream with its own errors, all drawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.signal import lfilter

from .kinds import Kind
from .motion import Course
from .robots import RoughRobot
from .shared import Array, public

RATE = 100.0
"""Of force cells, IMU, lengths and motion capture [Hz]."""
TRACKER_RATE = 238.0
"""[Hz]"""
GYRO, ACCELEROMETER, ORIENTATION, TRACKER = 0.00175, 0.03, 0.0035, 0.0005
"""Noise of a sample [rad/s], [m/s^2], [rad], [m]."""
DELAY = 0.05
"""1-sigma of a clock against that of the forces [s]."""
LATE = 0.02
"""Motion capture of pushed platforms [s]."""
_FINE = 1e-3
"""Between instants at which filters of sensors are followed [s]."""


@dataclass(frozen=True, eq=False)
class Stream:
    """A table and what the experiment file says of its instrument."""

    header: str
    values: Array
    """Time on its own clock first."""
    stated: Mapping[str, Any]
    sync: float
    """The beginning on its own clock [s]."""


@dataclass(frozen=True, eq=False)
class Scene:
    """What all sensors of a recording share."""

    robot: RoughRobot
    kind: Kind
    course: Course
    anchors: Array
    attachments: Array
    duration: float
    recorder: float
    """The beginning on the clock of the forces [s]."""

    def times(self, rate: float, rng: np.random.Generator) -> Array:
        """Of samples [s]."""
        return np.arange(rng.uniform(0, 1 / rate), self.duration, 1 / rate)


def _walk(count: int, step: float, level: float, rng: np.random.Generator, axes: int) -> Array:
    """Random walks that begin at zero, shape (count, axes)."""
    steps = level * np.sqrt(step) * rng.standard_normal((count, axes))
    return np.cumsum(steps, axis=0) - steps[0]


def _colored(shape: tuple[int, ...], step: float, time: float, rng: np.random.Generator) -> Array:
    """First-order noise of unit size."""
    kept = np.exp(-step / time)
    white = rng.standard_normal(shape)
    white[1:] *= np.sqrt(1 - kept**2)
    return lfilter([1.0], [1.0, -kept], white, axis=0)


def _low_pass(values: Array, step: float, time: float) -> Array:
    """First order, settled at the first value; between the samples along lines, so that it is as late as
    its time constant says."""
    kept = np.exp(-step / time)
    share = (1 - kept) * time / step
    numerator = [1 - share, share - kept]
    begin = (1 - numerator[0]) * values[:1]
    return lfilter(numerator, [1.0, -kept], values, axis=0, zi=begin)[0]


def cells(scene: Scene, rng: np.random.Generator) -> Stream:
    """Force cells."""
    kind, robot = scene.kind, scene.robot
    m, pull = len(scene.anchors), robot.pull
    fine = np.arange(0.0, scene.duration, _FINE)
    motion = scene.course.at(fine)
    tension = np.maximum(motion.tension, 0.0)
    if kind.friction or kind.viscous:
        ends = motion.position[:, None] + np.einsum(
            "nij,mj->nmi", motion.rotation, scene.attachments
        )
        length = np.linalg.norm(scene.anchors - ends, axis=2)
        friction = kind.friction * np.clip(1 + 0.3 * rng.standard_normal(m), 0.2, None)
        # What runs in is pulled over the roller: the cell at the winch sees more.
        taken = friction * tension * public.rolled(length, kind.presliding)
        taken += kind.viscous * pull * np.gradient(length, _FINE, axis=0)
        tension = tension - taken
    if kind.crosstalk:
        mixed = kind.crosstalk * rng.standard_normal((m, m))
        np.fill_diagonal(mixed, 0.0)
        tension = tension + tension @ mixed.T
    if kind.force_filter:
        tension = _low_pass(tension, _FINE, kind.force_filter)
    t = scene.times(RATE, rng)
    read = np.column_stack([np.interp(t, fine, each) for each in tension.T])
    gain = 1 + kind.gains * (0.01 * rng.standard_normal(m) + 0.005 * rng.normal())
    sigma = (0.001 if kind.pushed else 0.008) * pull
    # The contract's default: of the median tension.
    zero = 0.2 * pull if kind.pushed else 0.01 * float(np.median(read))
    offset = zero * rng.standard_normal(m)
    noise = (
        _colored(read.shape, 1 / RATE, kind.coloured, rng)
        if kind.coloured
        else rng.standard_normal(read.shape)
    )
    slope = kind.drift * pull * rng.standard_normal(m)
    read = gain * read + offset + sigma * noise + slope * (t[:, None] / 60)
    stated: dict[str, Any] = {"kind": "tension", "clock": "recorder"}
    if kind.cells == "winch":
        stated["end"] = "winch"
    if kind.pushed:
        stated["calibration"] = {
            "gain": 0.15, "common_gain": 0.1, "offset": round(0.25 * pull, 3), "friction": 0.03,
        }  # fmt: skip
    else:
        stated["noise"] = round(sigma, 6)
    header = ",".join(["t", *(f"f{i + 1}" for i in range(m))])
    return Stream(header, np.column_stack([t + scene.recorder, read]), stated, scene.recorder)


def _leaning(course: Course, duration: float, time: float) -> tuple[Array, Array]:
    """Instants, and the rotation in the world by which an attitude is off that follows the
    accelerometer, as rotation vectors."""
    fine = np.arange(0.0, duration, _FINE)
    motion = course.at(fine)
    up = np.einsum("nij,nj->ni", motion.rotation, motion.specific_force)
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    kept = np.exp(-_FINE / time)
    return fine, lfilter([1 - kept], [1.0, -kept], np.cross(up, [0.0, 0.0, 1.0]), axis=0)


def _orientation(scene: Scene, t: Array, mounted: Array, rng: np.random.Generator) -> Array:
    """What an attitude reads, (w, x, y, z)."""
    kind = scene.kind
    attitude = scene.course.at(t).rotation
    if kind.attitude_filter:
        fine, lean = _leaning(scene.course, scene.duration, kind.attitude_filter)
        lean = np.column_stack([np.interp(t, fine, each) for each in lean.T])
        attitude = public.rotation_of(lean) @ attitude
    if kind.heading_walk:
        heading = _walk(len(t), float(np.diff(t).mean()), kind.heading_walk, rng, 1)
        attitude = public.rotation_of(heading * [0.0, 0.0, 1.0]) @ attitude
    reference = public.rotation_of(0.02 * rng.standard_normal(3))
    shake = public.rotation_of(ORIENTATION * rng.standard_normal((len(t), 3)))
    return public.quaternions(reference.T @ attitude @ mounted @ shake)


def imu(scene: Scene, rng: np.random.Generator) -> Stream:
    """Gyro, accelerometer and, where there is one, orientation."""
    kind, plain = scene.kind, scene.robot.plain
    t = scene.times(RATE, rng)
    motion = scene.course.at(t)
    mounted = public.rotation_of(0.05 * rng.standard_normal(3))
    place = plain.imu + 0.005 * rng.standard_normal(3)
    force = (
        motion.specific_force
        + np.cross(motion.alpha, place)
        + np.cross(motion.omega, np.cross(motion.omega, place))
    )
    scales = 1 + kind.imu_scale * rng.standard_normal((2, 3))
    gyro = motion.omega @ mounted * scales[0] + 0.02 * rng.standard_normal(3)
    gyro = gyro + GYRO * rng.standard_normal(gyro.shape)
    gyro = gyro + _walk(len(t), 1 / RATE, kind.gyro_walk, rng, 3)
    if kind.clipped:
        bound = kind.clipped * np.abs(gyro).max()
        gyro = np.clip(gyro, -bound, bound)
    accelerometer = force @ mounted * scales[1] + 0.5 * rng.standard_normal(3)
    accelerometer = accelerometer + ACCELEROMETER * rng.standard_normal(accelerometer.shape)
    header, parts = "t,wx,wy,wz,ax,ay,az", [t + scene.recorder, gyro, accelerometer]
    noise = {"angular_velocity": GYRO, "specific_force": ACCELEROMETER}
    if "orientation" in kind.instruments:
        header += ",qw,qx,qy,qz"
        noise["orientation"] = ORIENTATION
        parts.append(_orientation(scene, t, mounted, rng))
    stated = {"kind": "imu", "clock": "recorder", "position": plain.imu.tolist(), "noise": noise}
    return Stream(header, np.column_stack(parts), stated, scene.recorder)


def attitude(scene: Scene, rng: np.random.Generator) -> Stream:
    """An orientation of its own, 33 Hz."""
    t = scene.times(33.0, rng)
    mounted = public.rotation_of(0.05 * rng.standard_normal(3))
    q = _orientation(scene, t, mounted, rng)
    return _on_its_clock("t,qw,qx,qy,qz", t, q, {"kind": "attitude"}, 0.0, rng)


def _on_its_clock(
    header: str, t: Array, values: Array, stated: Mapping[str, Any], late: Array | float,
    rng: np.random.Generator,
) -> Stream:  # fmt: skip
    begin = float(rng.uniform(0.0, 5.0))
    stamps = t + begin + late + DELAY * rng.normal()
    return Stream(header, np.column_stack([stamps, values]), stated, begin)


def tracker(scene: Scene, rng: np.random.Generator) -> Stream:
    """A tracker of one target."""
    kind, plain = scene.kind, scene.robot.plain
    t = scene.times(TRACKER_RATE, rng)
    motion = scene.course.at(t)
    point = motion.position + motion.rotation @ (plain.target + 0.005 * rng.standard_normal(3))
    if kind.reacquired:
        point[t > scene.duration / 2] += kind.reacquired * rng.standard_normal(3)
    if kind.jumps:
        for _ in range(6):
            start, width = rng.uniform(0.05, 0.9) * scene.duration, rng.uniform(0.05, 0.5)
            point[(t > start) & (t < start + width)] += kind.jumps * rng.standard_normal(3)
    frame = public.rotation_of(0.0005 * rng.standard_normal(3))
    point = (point - 0.002 * rng.standard_normal(3)) @ frame
    point = point + TRACKER * rng.standard_normal(point.shape)
    stated = {"kind": "position", "target": plain.target.tolist(), "noise": TRACKER}
    late = kind.jitter * np.abs(rng.standard_normal(len(t))) if kind.jitter else 0.0
    stream = _on_its_clock("t,x,y,z", t, point, stated, late, rng)
    order = np.argsort(stream.values[:, 0], kind="stable")
    return Stream(stream.header, stream.values[order], stated, stream.sync)


def pose(scene: Scene, rng: np.random.Generator) -> Stream:
    """Motion capture, late, with a slow error."""
    t = scene.times(RATE, rng)
    motion = scene.course.at(t)
    place = np.array([0.0, 0.0, 0.1]) + 0.003 * rng.standard_normal(3)
    slow = _colored((len(t), 6), 1 / RATE, 0.7, rng) * ([0.0003] * 3 + [0.001] * 3)
    frame = public.rotation_of(0.01 * rng.standard_normal(3))
    point = motion.position + motion.rotation @ place
    point = (point - 0.03 * rng.standard_normal(3)) @ frame + slow[:, :3]
    point = point + 0.0001 * rng.standard_normal(point.shape)
    mounted = public.rotation_of(0.01 * rng.standard_normal(3))
    error = slow[:, 3:] + 0.0003 * rng.standard_normal((len(t), 3))
    q = public.quaternions(frame.T @ motion.rotation @ mounted @ public.rotation_of(error))
    calibration = {
        "frame": {"position": 0.03, "rotation": 0.01}, "target": 0.003, "misalignment": 0.01,
    }  # fmt: skip
    stated = {"kind": "pose", "position": [0.0, 0.0, 0.1], "calibration": calibration}
    header = "t,x,y,z,qw,qx,qy,qz"
    return _on_its_clock(header, t, np.column_stack([point, q]), stated, LATE, rng)


def length(scene: Scene, rng: np.random.Generator) -> Stream:
    """Unstrained lengths that winches have fed."""
    t = scene.times(RATE, rng)
    fed = scene.course.fed(t)
    sigma = scene.robot.encoder
    fed = fed + 0.5 * rng.standard_normal(fed.shape[1])
    stated: dict[str, Any] = {"kind": "length"}
    if scene.kind.pushed:
        # Encoders of winches that stand still count in steps.
        fed = np.round(fed / 1e-4) * 1e-4
    else:
        stated["noise"] = sigma
        fed = fed + sigma * rng.standard_normal(fed.shape)
    header = ",".join(["t", *(f"l{i + 1}" for i in range(fed.shape[1]))])
    return _on_its_clock(header, t, fed, stated, 0.0, rng)


READS = {"imu": imu, "tracker": tracker, "attitude": attitude, "pose": pose, "length": length}
"""Of a name in `Kind.instruments`."""
