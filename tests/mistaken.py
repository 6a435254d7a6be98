"""Mistakes of sign, unit, axis, order and place, made in a sound experiment: what people do to
their recordings."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.experiment.model import Experiment
from steelyard.simulation.edits import (
    exchanged,
    instrument,
    late,
    quaternions,
    readings,
    robot,
    vector,
    with_streams,
    with_values,
    without_sync,
    z_down,
)

G = 9.80665


@dataclass(frozen=True)
class Mistake:
    """One mistake, and the words of which one at least must stand in what is said of it."""

    make: Callable[[Experiment], Experiment]
    subject: str
    words: tuple[str, ...]
    needs: tuple[tuple[str, str], ...]
    """Instruments and quantities without which it cannot be made."""


def rotation(name, change):
    """Orientations changed one by one."""
    return readings(name, "orientation", change)


def columns(name, quantity, order):
    """Columns in another order; ``order`` of the number of columns gives it."""
    return readings(name, quantity, lambda v: v[:, order(v.shape[1])])


def one(i, factor):
    """A factor on one column."""
    return readings(
        "cables", "tension", lambda f: f * np.where(np.arange(f.shape[1]) == i, factor, 1.0)
    )


def removed(experiment):
    """An accelerometer whose device has taken gravity out."""

    def change(values):
        g = np.einsum("nji,j->ni", values["orientation"], experiment.robot.gravity)
        return {"specific_force": values["specific_force"] + g}

    return with_values(experiment, "imu", change)


def angles(name, change):
    """Roll, pitch and yaw that were written otherwise."""

    def changed(stream):
        rpy = change(Rotation.from_matrix(stream.values["orientation"]).as_euler("ZYX")[:, ::-1])
        R = Rotation.from_euler("ZYX", rpy[:, ::-1]).as_matrix()
        values = {**stream.values, "orientation": R}
        return replace(stream, values=values, angles={"orientation": rpy})

    return lambda e: with_streams(e, name, changed)


def as_xyz(rpy):
    """The same rotation, written as R = Rx Ry Rz."""
    return Rotation.from_euler("ZYX", rpy[:, ::-1]).as_euler("XYZ")


def exchanged_events(first, second):
    """Entries of ``sync`` exchanged."""

    def make(experiment):
        runs = []
        for run in experiment.runs:
            sync = {**run.sync, first: run.sync[second], second: run.sync[first]}
            runs.append(replace(run, sync=sync))
        return replace(experiment, runs=tuple(runs))

    return make


def moved_target(experiment):
    """A target that sits elsewhere."""
    old = np.array(experiment.instruments["tracker"].target)
    return instrument("tracker", target=tuple(old + np.array([0.3, -0.2, -0.4])))(experiment)


_ACC, _GYRO, _ATT = ("imu", "specific_force"), ("imu", "angular_velocity"), ("imu", "orientation")
_TRACKER, _FORCE, _TURN = ("tracker", "position"), ("cables", "tension"), ("command", "orientation")

MISTAKES: Mapping[str, Mistake] = {
    "accelerometer in g": Mistake(
        vector("imu", "specific_force", 1 / G), "imu", ("in g,", "ax: g"), (_ACC,)
    ),
    "accelerometer in mm/s^2": Mistake(
        vector("imu", "specific_force", 1000.0), "imu", ("mm/s",), (_ACC,)
    ),
    "gravity removed": Mistake(removed, "imu", ("gravity: removed",), (_ACC, _ATT)),
    "accelerometer upside down": Mistake(
        vector("imu", "specific_force", -1.0), "imu", ("wrong sign", "upside"), (_ACC,)
    ),
    "ax with the wrong sign": Mistake(
        vector("imu", "specific_force", [-1, 1, 1]), "imu", ("ax has the wrong sign",), (_ACC,)
    ),
    "ay and az exchanged": Mistake(
        exchanged("imu", "specific_force", 1, 2), "imu", ("ay: az",), (_ACC,)
    ),
    "gyro in deg/s": Mistake(
        vector("imu", "angular_velocity", 180 / np.pi), "imu", ("deg/s",), (_GYRO,)
    ),
    "gyro y with the wrong sign": Mistake(
        vector("imu", "angular_velocity", [1, -1, 1]), "imu", ("wy has the wrong sign",), (_GYRO,)
    ),
    "gyro with the wrong sign": Mistake(
        vector("imu", "angular_velocity", -1.0),
        "imu",
        ("wx, wy, wz have the wrong sign",),
        (_GYRO,),
    ),
    "wx and wz exchanged": Mistake(
        exchanged("imu", "angular_velocity", 0, 2), "imu", ("wx: wz",), (_GYRO,)
    ),
    "orientation transposed": Mistake(
        rotation("imu", lambda R: R.transpose(0, 2, 1)), "imu", ("transposed", "conjugate"), (_ATT,)
    ),
    "quaternion x y z w": Mistake(
        rotation("imu", quaternions([1, 2, 3, 0])), "imu", ("quaternion",), (_ATT,)
    ),
    "angles of the orientation in degrees": Mistake(
        angles("imu", np.degrees), "imu", ("degrees", "deg"), (_ATT,)
    ),
    "angles of the orientation in another order": Mistake(
        angles("imu", as_xyz), "imu", ("another order",), (_ATT,)
    ),
    "roll and yaw exchanged": Mistake(
        angles("imu", lambda a: a[:, ::-1]), "imu", ("exchanged",), (_ATT,)
    ),
    "IMU turned by 90 degrees": Mistake(
        instrument("imu", rpy_deg=(0.0, 0.0, 90.0)), "imu", ("rpy_deg: [0.0, 0.0, 0.0]",), (_ACC,)
    ),
    "IMU turned by 180 degrees": Mistake(
        instrument("imu", rpy_deg=(180.0, 0.0, 0.0)), "imu", ("rpy_deg: [0.0, 0.0, 0.0]",), (_ACC,)
    ),
    "orientation with z down": Mistake(
        rotation("imu", z_down), "imu", ("z down", "both turned"), (_ATT,)
    ),
    "left-handed tracker": Mistake(
        vector("tracker", "position", [1, -1, 1]), "tracker", ("y has the wrong sign",), (_TRACKER,)
    ),
    "tracker x and y exchanged": Mistake(
        exchanged("tracker", "position", 0, 1), "tracker", ("x: y",), (_TRACKER,)
    ),
    "tracker in mm": Mistake(
        vector("tracker", "position", 1000.0), "tracker", ("mm",), (_TRACKER,)
    ),
    "target elsewhere": Mistake(moved_target, "tracker", ("elsewhere", "target"), (_TRACKER,)),
    "cables 2 and 5 exchanged": Mistake(
        exchanged("cables", "tension", 1, 4), "cables", ("cables 2 and 5",), (_FORCE,)
    ),
    "cables 3 and 4 exchanged": Mistake(
        exchanged("cables", "tension", 2, 3), "cables", ("cables 3 and 4",), (_FORCE,)
    ),
    "cables in reverse": Mistake(
        columns("cables", "tension", lambda m: list(range(m))[::-1]),
        "cables",
        ("reverse",),
        (_FORCE,),
    ),
    "negative tensions": Mistake(
        vector("cables", "tension", -1.0), "cables", ("wrong sign",), (_FORCE,)
    ),
    "tensions in daN": Mistake(
        vector("cables", "tension", 0.1), "cables", ("daN", "kgf"), (_FORCE,)
    ),
    "tensions in kgf": Mistake(
        vector("cables", "tension", 1 / G), "cables", ("daN", "kgf"), (_FORCE,)
    ),
    "tensions in kN": Mistake(vector("cables", "tension", 1e-3), "cables", ("kN",), (_FORCE,)),
    "one sensor in kgf": Mistake(one(3, 1 / G), "cables", ("f4",), (_FORCE,)),
    "one sensor with the wrong sign": Mistake(one(6, -1.0), "cables", ("f7",), (_FORCE,)),
    "one sensor dead": Mistake(one(2, 0.0), "cables", ("f3", "cable 3", "tension 3"), (_FORCE,)),
    "gravity with the wrong sign": Mistake(
        robot(gravity=lambda r: -r.gravity), "robot", ("gravity",), ()
    ),
    "IMU late by half a second": Mistake(late("imu", 0.5), "imu", ("late",), (_ACC,)),
    "tracker late by 0.3 s": Mistake(late("tracker", 0.3), "tracker", ("late",), (_TRACKER,)),
    "events of IMU and tracker exchanged": Mistake(
        exchanged_events("imu", "tracker"), "", ("exchanged", "late", "early"), (_ACC, _TRACKER)
    ),
    "command in degrees": Mistake(
        angles("command", np.degrees), "command", ("degrees", "deg"), (_TURN,)
    ),
    "command in mm": Mistake(vector("command", "position", 1000.0), "command", ("mm",), (_TURN,)),
}


def possible(mistake, experiment):
    """Whether all that a mistake needs is there."""
    return all(
        name in run.streams and quantity in run.streams[name].values
        for run in experiment.runs[:1]
        for name, quantity in mistake.needs
    )


LB = 4.4482216152605
MISPLACED = 0.31  # [m]


def geometry_in_millimetres(experiment):
    """A robot file whose points were typed in millimetres."""
    r = experiment.robot
    changed = replace(r, anchors=1000 * r.anchors, attachments=1000 * r.attachments)
    return replace(experiment, robot=changed)


def misplaced_imu(experiment):
    """An IMU that is said to sit elsewhere."""
    old = np.array(experiment.instruments["imu"].position)
    return instrument("imu", position=tuple(old + np.array([MISPLACED, 0, 0])))(experiment)


def scaled(columns, factor):
    """What an instrument's key must be for columns in another unit."""
    return "scale: {" + ", ".join(f"{c}: {factor:.10g}" for c in columns) + "}"


DESCRIPTIONS: Mapping[str, tuple[Callable[[Experiment], Experiment], str]] = {
    "forces in kN": (vector("cables", "tension", 1e-3), "  cables:\n    scale: 1000"),
    "forces in kgf": (vector("cables", "tension", 1 / G), "  cables:\n    scale: 9.80665"),
    "forces in lb": (vector("cables", "tension", 1 / LB), "  cables:\n    scale: 4.448221615"),
    "lengths in mm": (
        vector("tracker", "position", 1000.0),
        "  tracker:\n    " + scaled("xyz", 1e-3),
    ),
    "geometry in mm": (geometry_in_millimetres, "anchors and attachments in metres"),
    "gyro in deg/s": (
        vector("imu", "angular_velocity", 180 / np.pi),
        "  imu:\n    " + scaled(("wx", "wy", "wz"), np.pi / 180),
    ),
    "accelerometer in g": (
        vector("imu", "specific_force", 1 / G),
        "  imu:\n    " + scaled(("ax", "ay", "az"), G),
    ),
    "z down": (
        rotation("imu", z_down),
        "  imu:\n    scale: {qy: -1, qz: -1}",
    ),
    "gravity with z down": (robot(gravity=lambda r: -r.gravity), "gravity: [0.0, 0.0, -9.81]"),
    "swapped cables": (
        exchanged("cables", "tension", 1, 2),
        "  cables:\n    columns: {f2: f3, f3: f2}",
    ),
    "quaternion order": (
        rotation("imu", quaternions([1, 2, 3, 0])),
        "  imu:\n    columns: {qw: qz, qx: qw, qy: qx, qz: qy}",
    ),
    "conjugate": (
        rotation("imu", lambda R: R.transpose(0, 2, 1)),
        "  imu:\n    scale: {qx: -1, qy: -1, qz: -1}",
    ),
    "missing sync": (without_sync, "    sync: auto"),
    "wrong IMU place": (misplaced_imu, "  imu:\n    position: ["),
}
"""What is wrong -> how it is made, and what `identify` must say to change."""
