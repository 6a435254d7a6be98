"""Recordings of the public benchmark: `python benchmarks/public/generate.py [--seeds N] [--out DIR]`.

What MuJoCo moves (`simulator.py`) as sensors of its own see it: nothing of steelyard is in it. A seed
gives the same recording.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from robots import CONDITIONS, GRAVITY, ROBOTS, Array, Condition, PublicRobot, Sensing, sensing_of
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation
from simulator import SEEN, Cables, Motion, structure_of, taut

FORMAT = "cable-robot-benchmark/1"
HERE = Path(__file__).parent
DURATION = 20.0
"""[s]"""
TRACKER_RATE = 200.0
"""[Hz]"""
PARAMETERS = ("mass", "cx", "cy", "cz", "Jxx", "Jyy", "Jzz", "Jyz", "Jxz", "Jxy")


def rolled(length: Array, presliding: float) -> Array:
    """How far the friction of rollers has built up, -1 to 1 (Dahl), positive where cable runs
    out; shape (n, m)."""
    state = np.zeros(length.shape[1])
    found = [state]
    for change in np.diff(length, axis=0):
        sign = np.sign(change)
        state = sign + (state - sign) * np.exp(-np.abs(change) / presliding)
        found.append(state)
    return np.array(found)


@dataclass(frozen=True, eq=False)
class Drawn:
    """Errors of one recording that are constant."""

    offset: Array
    gain: Array
    gyro_bias: Array
    accelerometer_bias: Array
    misalignment: Array
    reference: Array
    imu_position: Array
    target: Array
    frame_position: Array
    frame_rotation: Array
    delay: float
    anchor: Array
    attachment: Array


def drawn(robot: PublicRobot, sensing: Sensing, rng: np.random.Generator) -> Drawn:
    """Every error with its stated 1-sigma."""
    m = len(robot.anchors)
    three = lambda sigma: sigma * rng.standard_normal(3)  # noqa: E731
    return Drawn(
        offset=sensing.offset * rng.standard_normal(m),
        gain=1 + sensing.gain * rng.standard_normal(m) + sensing.common_gain * rng.normal(),
        gyro_bias=three(sensing.gyro_bias),
        accelerometer_bias=three(sensing.accelerometer_bias),
        misalignment=three(sensing.misalignment),
        reference=three(sensing.reference),
        imu_position=three(sensing.imu_position),
        target=three(sensing.target),
        frame_position=three(sensing.frame_position),
        frame_rotation=three(sensing.frame_rotation),
        delay=sensing.delay * float(rng.normal()),
        anchor=sensing.geometry * rng.standard_normal((m, 3)),
        attachment=sensing.geometry * rng.standard_normal((m, 3)),
    )


def _exp(vector: Array) -> Array:
    return Rotation.from_rotvec(vector).as_matrix()


def _quaternions(rotation: Array) -> Array:
    """(w, x, y, z) without jumps of sign, shape (n, 4)."""
    q = Rotation.from_matrix(rotation).as_quat(scalar_first=True)
    flips = np.sign(np.sum(q[1:] * q[:-1], axis=1))
    return q * np.concatenate([[np.sign(q[0, 0])], np.sign(q[0, 0]) * np.cumprod(flips)])[:, None]


def _leaning(motion: Motion, constant: float, step: float) -> Array:
    """Rotation in the world by which an attitude is wrong that follows the accelerometer."""
    up = np.einsum("nij,nj->ni", motion.rotation, motion.specific_force)
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    kept = np.exp(-step / constant)
    return _exp(lfilter([1 - kept], [1.0, -kept], np.cross(up, [0.0, 0.0, 1.0]), axis=0))


@dataclass(frozen=True, eq=False)
class Recording:
    """What is written: tables of numbers and plain descriptions."""

    tables: Mapping[str, tuple[str, Array]]
    """File -> header and values."""
    description: dict[str, Any]
    truth: dict[str, Any]


def recorded(
    robot: PublicRobot, condition: Condition, name: str, seed: int, duration: float = DURATION
) -> Recording:
    """Simulate a recording."""
    sensing = sensing_of(robot, condition)
    path, draw, noise = np.random.default_rng(seed).spawn(3)
    errors = drawn(robot, sensing, draw)
    anchors, attachments = robot.anchors + errors.anchor, robot.attachments + errors.attachment
    cables = Cables.of(robot, condition, anchors, attachments)
    response = taut(robot, cables, duration, path)
    step = 1 / sensing.rate
    t = np.arange(noise.uniform(0, step), duration, step)
    motion = response.at(t)
    tension = motion.tension
    if condition.friction:
        fine = np.arange(0.0, duration, SEEN)
        points = response.at(fine)
        ends = points.position[:, None] + np.einsum("nij,mj->nmi", points.rotation, attachments)
        state = rolled(np.linalg.norm(points.leave - ends, axis=2), condition.presliding)
        built_up = np.column_stack([np.interp(t, fine, each) for each in state.T])
        # What runs in is pulled over the roller: the cell at the winch sees more.
        tension = tension * (1 - condition.friction * built_up)
    cell_noise = noise.normal(0, sensing.tension, tension.shape)
    read = errors.gain * tension + errors.offset + cell_noise
    gyro_noise = noise.normal(0, sensing.angular_velocity, (len(t), 3)) + errors.gyro_bias
    accelerometer_noise = (
        noise.normal(0, sensing.specific_force, (len(t), 3)) + errors.accelerometer_bias
    )
    attitude = motion.rotation
    if condition.attitude_filter:
        attitude = _leaning(motion, condition.attitude_filter, step) @ attitude
    shake = _exp(noise.normal(0, sensing.orientation, (len(t), 3)))
    R_platform_imu = _exp(errors.misalignment)
    place = robot.imu + errors.imu_position
    at_imu = (
        motion.specific_force
        + np.cross(motion.alpha, place)
        + np.cross(motion.omega, np.cross(motion.omega, place))
    )
    q = _quaternions(_exp(errors.reference).T @ attitude @ R_platform_imu @ shake)
    imu = [
        motion.omega @ R_platform_imu + gyro_noise,
        at_imu @ R_platform_imu + accelerometer_noise,
        q,
    ]
    tracker_step = 1 / TRACKER_RATE
    t_tracker = np.arange(noise.uniform(0, tracker_step), duration, tracker_step)
    seen = response.at(t_tracker)
    point = seen.position + seen.rotation @ (robot.target + errors.target)
    point = (point - errors.frame_position) @ _exp(errors.frame_rotation)
    point = point + noise.normal(0, sensing.tracker, point.shape)
    origin, tracker_origin = noise.uniform(0, 5, 2)
    # A constant offset and a gain of every cell are no constant wrench on a platform that moves:
    # here the offsets are what they make where the motion begins, and the gains are exact.
    structure = structure_of(motion.leave, attachments, motion.position, motion.rotation)
    in_platform = np.einsum(
        "nji,nkjm->nkim", motion.rotation, structure.reshape(len(t), 2, 3, -1)
    ).reshape(structure.shape)
    wrench = np.einsum("nkm,nm->nk", in_platform, tension + cell_noise)
    wrench = wrench + in_platform[0] @ errors.offset
    position = motion.position + noise.normal(0, sensing.tracker, (len(t), 3))
    platform = [
        position,
        _quaternions(attitude @ shake),
        motion.omega + gyro_noise,
        motion.specific_force + accelerometer_noise,
        wrench,
    ]
    late = errors.delay + condition.late
    labels = ",".join(f"f{i + 1}" for i in range(tension.shape[1]))
    tables = {
        "cables.csv": (f"t,{labels}", np.column_stack([t + origin, read])),
        "imu.csv": ("t,wx,wy,wz,ax,ay,az,qw,qx,qy,qz", np.column_stack([t + origin, *imu])),
        "tracker.csv": ("t,x,y,z", np.column_stack([t_tracker + tracker_origin + late, point])),
        "platform.csv": (
            "t,x,y,z,qw,qx,qy,qz,wx,wy,wz,ax,ay,az,fx,fy,fz,tx,ty,tz",
            np.column_stack([t, *platform]),
        ),
    }
    sync = {"cables": origin, "imu": origin, "tracker": tracker_origin}
    description = _description(robot, condition, sensing, name, sync, seed)
    return Recording(tables, description, _truth(robot, errors, late))


def _description(
    robot: PublicRobot,
    condition: Condition,
    sensing: Sensing,
    name: str,
    sync: dict[str, float],
    seed: int,
) -> dict[str, Any]:
    """All that a method may know."""
    return {
        "format": FORMAT,
        "recording": name,
        "robot": robot.name,
        "condition": condition.words,
        "seed": seed,
        "gravity": GRAVITY,
        "anchors": robot.anchors.tolist(),
        "attachments": robot.attachments.tolist(),
        "axial_stiffness": robot.axial_stiffness,
        **{
            key: value
            for key in ("roller_radius", "linear_density")
            if (value := getattr(condition, key))
        },
        "force_cells": "winch" if condition.friction else "platform",
        "imu_position": robot.imu.tolist(),
        "target": robot.target.tolist(),
        "tracker_rate": TRACKER_RATE,
        "sync": {key: round(value, 9) for key, value in sync.items()},
        "sigma": asdict(sensing),
    }


def _truth(robot: PublicRobot, errors: Drawn, late: float) -> dict[str, Any]:
    J = robot.inertia
    inertia = [J[0, 0], J[1, 1], J[2, 2], J[1, 2], J[0, 2], J[0, 1]]
    value = [robot.mass, *robot.center_of_gravity.tolist(), *inertia]
    constant = {
        key: np.asarray(each).round(9).tolist()
        for key, each in vars(errors).items()
        if key != "delay"
    }
    return {
        "format": FORMAT,
        "parameters": list(PARAMETERS),
        "value": [float(each) for each in value],
        "errors": {**constant, "tracker_delay": round(late, 9)},
    }


def write(recording: Recording, folder: Path, truth: Path) -> None:
    """Write the tables and the description into a folder, the truth beside."""
    folder.mkdir(parents=True, exist_ok=True)
    truth.parent.mkdir(parents=True, exist_ok=True)
    for file, (header, values) in recording.tables.items():
        lines = [",".join([f"{row[0]:.7f}", *(f"{v:.8g}" for v in row[1:])]) for row in values]
        (folder / file).write_text("\n".join([header, *lines, ""]), encoding="utf-8")
    for path, content in (
        (folder / "description.json", recording.description),
        (truth, recording.truth),
    ):
        path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


_README = """# {name}

{words}. Simulated; nothing was measured. Free to use for any purpose, without conditions.

Recordings here: {conditions}; two digits number the draws. The motion differs between recordings.

| file | columns | rate | clock |
|---|---|---|---|
| `cables.csv` | `t` [s], `f1` ... `f{m}`: tension of cable i [N] | {rate:g} Hz | recorder |
| `imu.csv` | `t`, angular velocity `wx wy wz` [rad/s], specific force (a - g) `ax ay az` [m/s^2], both in IMU axes; orientation IMU -> world `qw qx qy qz` | {rate:g} Hz | recorder |
| `tracker.csv` | `t`, target `x y z` in the tracker frame [m] | {tracker:g} Hz | its own |
| `platform.csv` | the friendlier version of the same recording, see below | {rate:g} Hz | exact |
| `description.json` | what a method may know | | |

World axes: z up, gravity {gravity} m/s^2. Platform axes: those in which `attachments` are given. Nominally, IMU axes are
platform axes and the tracker frame is the world frame. `sync` is the time of one common event on each clock; a stamp of
the tracker is late by an error of the 1-sigma `delay` beside that. A reading of a force cell is gain x tension + offset +
noise. `sigma` in `description.json` has the 1-sigma of every error; noise is white, other errors are constant. Cables are
straight, massless and elastic (EA = {stiffness:g} N), from `anchors` (world) to `attachments` (platform) [m]. With
`linear_density` [kg/m] in `description.json` they have weight, and sag. With `roller_radius` [m] a cable comes up at its anchor,
enters there a roller that swivels about this vertical line, goes over its top and leaves it along a tangent.

`platform.csv` has exact clocks, exact mounting and exact geometry: `t`; position `x y z` [m] and orientation `qw qx qy qz`
of the platform in the world; angular velocity `wx wy wz` [rad/s] and specific force `ax ay az` of the platform's origin
[m/s^2], platform axes; wrench of the cables on the platform about its origin, `fx fy fz` [N], `tx ty tz` [N m], platform
axes. Its gains are exact, and its offset is one constant wrench: what the offsets of the cells make where the motion begins.
Noise of the cells, biases of the IMU, and what the condition says of them, are as in the other files.

Truth is not in this folder but in `truth/{name}/`: mass [kg], centre of gravity [m] in platform axes, inertia about it
[kg m^2] in platform axes (elements of the matrix), in the order `{parameters}`, and the errors drawn.
"""


def plan(seeds: int) -> Iterator[tuple[str, str, int]]:
    """Robot, condition and number of every recording; disturbed conditions are recorded half as
    often."""
    for key, condition in CONDITIONS.items():
        for robot in condition.robots:
            for number in range(seeds if key == "plain" else (seeds + 1) // 2):
                yield robot, key, number


def seed_of(robot: str, condition: str, number: int) -> int:
    """Of a recording; the same whatever else is generated."""
    digest = hashlib.sha256(f"{robot}/{condition}-{number:02d}".encode()).digest()
    return int.from_bytes(digest[:4], "big")


def readme(robot: PublicRobot) -> str:
    """What stands beside the recordings of a robot."""
    kinds = "; ".join(f"`{k}`: {c.words}" for k, c in CONDITIONS.items() if robot.name in c.robots)
    return _README.format(
        name=robot.name, words=robot.words, conditions=kinds, m=len(robot.anchors),
        rate=robot.sensing.rate, tracker=TRACKER_RATE, gravity=GRAVITY,
        stiffness=robot.axial_stiffness, parameters=" ".join(PARAMETERS),
    )  # fmt: skip


def generate(out: Path, seeds: int) -> None:
    """Write all recordings that are not there."""
    for robot_name, key, number in plan(seeds):
        robot, name = ROBOTS[robot_name], f"{robot_name}/{key}-{number:02d}"
        (out / robot_name).mkdir(parents=True, exist_ok=True)
        (out / robot_name / "README.md").write_text(readme(robot), encoding="utf-8")
        if (out / "truth" / f"{name}.json").exists():
            continue
        seed = seed_of(robot_name, key, number)
        made = recorded(robot, CONDITIONS[key], name, seed)
        # The truth last: what it stands beside is complete.
        write(made, out / name, out / "truth" / f"{name}.json")
        print(name, flush=True)


def checksums(out: Path) -> dict[str, str]:
    """File -> SHA-256 of all tables and truths."""
    files = sorted(each for each in out.rglob("*") if each.suffix in (".csv", ".json"))
    return {
        each.relative_to(out).as_posix(): hashlib.sha256(each.read_bytes()).hexdigest()
        for each in files
        if "results" not in each.parts
    }


def check(out: Path, listed: Path) -> str:
    """Whether files are those that the project has used, in one sentence."""
    known = dict(reversed(line.split("  ", 1)) for line in listed.read_text("utf-8").splitlines())
    found = checksums(out)
    others = [name for name, digest in found.items() if known.get(name, digest) != digest]
    beside = f", {len(set(found) - set(known))} are not listed" if set(found) - set(known) else ""
    if others:
        return (
            f"{len(others)} of {len(found)} files differ from {listed.name} (another MuJoCo, NumPy or"
            f" processor), the first is {others[0]}{beside}: say so beside your results"
        )
    return f"{len(found)} files, all that are listed as in {listed.name}{beside}"


def main(arguments: list[str]) -> None:
    """Generate and check."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=1, help="recordings of the plain condition")
    parser.add_argument("--out", type=Path, default=HERE / "data")
    parser.add_argument("--list", action="store_true", help="write the list of checksums anew")
    given = parser.parse_args(arguments)
    generate(given.out, given.seeds)
    listed = HERE / "checksums.sha256"
    if given.list:
        lines = [f"{digest}  {name}" for name, digest in checksums(given.out).items()]
        listed.write_text("\n".join([*lines, ""]), encoding="utf-8")
    print(check(given.out, listed))


if __name__ == "__main__":
    main(sys.argv[1:])
