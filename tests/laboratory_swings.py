"""Swings as a laboratory records them, simulated in MuJoCo: motion capture with slow errors, lost
targets and jumps, markers off the platform's frame, air and rollers that damp, hands that still touch,
cables that stretch and go slack.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import mujoco
import numpy as np
from mujoco_swings import ANCHORS, ATTACHMENTS, BODY, locked_model
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run, Stream
from steelyard.experiment.unread import with_unread_cables
from steelyard.inertia import Inertia
from steelyard.instruments.pose import Pose
from steelyard.robot.model import CableProperties, Robot

STEP = 1e-3  # [s]
RUB = 0.01  # [m/s]
HANDS_OFF = 2.5  # [s] after the first push
DRAWS = 100
"""Of one swing, with pushes as large as asked for; then each is softer than the one before."""
SOFTER = 0.97
SOFTEST = 0.1
"""Of what was asked for."""


@dataclass(frozen=True)
class Laboratory:
    """What is real of a recording."""

    cables: int = 4
    runs: int = 6
    duration: float = 10.0
    """[s]"""
    rate: float = 100.0
    """[Hz]"""
    white: tuple[float, float] = (2e-4, 3e-4)
    """1-sigma of position [m] and orientation [rad]."""
    slow: tuple[float, float] = (0.0, 0.0)
    """1-sigma of errors that go on for a while [m], [rad]."""
    slow_time: float = 3.0
    """Their correlation time [s]."""
    lost: float = 0.0
    """Times in a run that the target is lost for a while."""
    jumps: float = 0.0
    """Single samples in a run that are centimetres off."""
    marker: tuple[float, float] = (0.0, 0.0)
    """1-sigma by which the marker frame is off the stated one [m], [rad]."""
    frame: tuple[float, float] = (0.0, 0.0)
    """The same of the tracker's frame in the world."""
    geometry: float = 0.002
    """Errors of anchors and attachments [m]."""
    linear_drag: float = 0.0
    """Of the air, force over velocity over mass [1/s]."""
    air: float = 0.0
    """Drag coefficient times area [m^2]."""
    swivel: float = 0.0
    """Torque of dry friction at each anchor against the turning of its cable [N m]."""
    hand: float = 0.0
    """How long a hand still touches after recording begins [s]."""
    push: float = 1.0
    """Size of the pushes; where hardly one of that size leaves all cables taut, as on four, softer ones
    are drawn."""
    slack: bool = False
    """Whether cables may go slack."""
    stiffness: float = 3e5
    """EA [N]."""
    jitter: float = 0.0
    """1-sigma of time stamps [s]."""
    noise_stated: bool = True
    stated: tuple[float, float] | None = None
    """Noise that is stated, where it is not that which was drawn."""
    stretch_stated: bool = True
    """Whether the robot file tells how cables stretch."""


@dataclass(frozen=True)
class Recorded:
    """An experiment and its truth."""

    experiment: Experiment
    body: Inertia
    true: Robot
    amplitudes: Array
    """Largest turn of each run [rad]."""
    slack: Array
    """Share of the time in which a cable is slack, of each run."""


def record(laboratory: Laboratory, seed, body: Inertia = BODY) -> Recorded:
    """Recordings of one laboratory."""
    lab, rng = laboratory, np.random.default_rng(seed)
    m = lab.cables
    drawn = Robot(
        f"swing {m}",
        np.array(ANCHORS[m], dtype=float),
        np.array(ATTACHMENTS[m], dtype=float),
        cable=CableProperties(axial_stiffness=lab.stiffness),
    )
    true = replace(
        drawn,
        anchors=drawn.anchors + lab.geometry * rng.normal(size=(m, 3)),
        attachments=drawn.attachments + lab.geometry * rng.normal(size=(m, 3)),
    )
    target = lab.marker[0] * rng.normal(size=3)
    turned = Rotation.from_rotvec(lab.marker[1] * rng.normal(size=3))
    origin = lab.frame[0] * rng.normal(size=3)
    world = Rotation.from_rotvec(lab.frame[1] * rng.normal(size=3))
    noise = lab.stated or lab.white
    stated: dict = {"position": noise[0], "rotation": noise[1]} if lab.noise_stated else {}
    pose = Pose.model_validate(
        {
            "kind": "pose",
            "noise": stated,
            "calibration": {
                "frame": {
                    "position": max(0.002, lab.frame[0]),
                    "rotation": max(0.0005, lab.frame[1]),
                },
                "misalignment": max(0.003, lab.marker[1]),
                "target": max(0.002, lab.marker[0]),
            },
        }
    )
    runs, amplitudes, slack = [], [], []
    for i in range(lab.runs):
        seen, loose = _swing(true, body, lab, rng)
        n = len(seen)
        own = Rotation.from_quat(seen[:, 3:7], scalar_first=True)
        amplitudes.append(float((own[0].inv() * own).magnitude().max()))
        slack.append(loose)
        position = seen[:, :3] + own.apply(target) - origin
        position = world.inv().apply(position) + lab.white[0] * rng.normal(size=(n, 3))
        position += lab.slow[0] * _slow(rng, n, lab)
        errors = lab.white[1] * rng.normal(size=(n, 3)) + lab.slow[1] * _slow(rng, n, lab)
        rotation = (world.inv() * own * turned * Rotation.from_rotvec(errors)).as_matrix()
        time = 5.0 + np.arange(n) / lab.rate
        keep = np.ones(n, dtype=bool)
        for _ in range(rng.poisson(lab.lost)):
            begun = rng.integers(n)
            keep[begun : begun + rng.integers(3, round(0.4 * lab.rate))] = False
        for _ in range(rng.poisson(lab.jumps)):
            at = rng.integers(n)
            position[at] += 0.03 * rng.normal(size=3)
        time = time + lab.jitter * np.abs(rng.normal(size=n))
        keep[1:] &= np.diff(time) > 0
        values = {"position": position[keep], "orientation": rotation[keep]}
        runs.append(Run(f"swing {i}", {"pose": Stream(time[keep], values, "lab")}, locked=True))
    uncertainty = {"anchor": lab.geometry, "attachment": lab.geometry, "gravity": 0.005}
    told = drawn if lab.stretch_stated else replace(drawn, cable=CableProperties())
    experiment = Experiment("lab", told, {"pose": pose}, tuple(runs), uncertainty=uncertainty)
    return Recorded(
        with_unread_cables(experiment), body, true, np.array(amplitudes), np.array(slack)
    )


def _slow(rng, n: int, lab: Laboratory) -> Array:
    """Gauss-Markov errors of unit size, shape (n, 3)."""
    kept = np.exp(-1 / (lab.rate * lab.slow_time))
    drawn = rng.normal(size=(n, 3)) * np.sqrt(1 - kept**2)
    drawn[0] /= np.sqrt(1 - kept**2)
    return np.asarray(lfilter([1.0], [1.0, -kept], drawn, axis=0))


def _swing(robot: Robot, body: Inertia, lab: Laboratory, rng) -> tuple[Array, float]:
    """Poses after some pushes, shape (n, 7), and how long a cable was slack."""
    drawn, harder = 0, 1.0
    while harder > SOFTEST:
        drawn += 1
        harder *= SOFTER if drawn > DRAWS else 1.0
        push = harder * lab.push
        place = np.array([rng.uniform(-0.6, 0.6), rng.uniform(-0.4, 0.4), rng.uniform(0.8, 1.6)])
        lengths = np.linalg.norm(robot.anchors - place - robot.attachments, axis=1)
        model = locked_model(robot, body, lengths, damping_ratio=0.02, step=STEP)
        data = mujoco.MjData(model)
        data.qpos[:3], data.qpos[3:] = place, [1, 0, 0, 0]
        model.dof_damping[:] = 6 * body.mass * np.array([1, 1, 1, 0.1, 0.1, 0.1])
        mujoco.mj_step(model, data, 15_000)
        model.dof_damping[:] = body.mass * lab.linear_drag * np.array([1, 1, 1, 0.05, 0.05, 0.05])
        if (data.ten_length < lengths).any():
            continue
        size = [1, 1, 0.3, 0.15, 0.15, 0.15]
        pushes = [
            (rng.uniform(0, 1.5), push * body.mass * rng.normal(size=6) * size) for _ in range(2)
        ]
        if lab.hand:
            # A hand that still guides, and lets go within the recording.
            pushes.append(
                (HANDS_OFF + lab.hand - 0.6, push * 0.5 * body.mass * rng.normal(size=6) * size)
            )
        begun, seen, loose = data.time, [], 0
        count = round(lab.duration * lab.rate)
        taut = True
        while len(seen) < count and taut:
            now = data.time - begun
            if now >= HANDS_OFF + len(seen) / lab.rate - 1e-9:
                seen.append(data.qpos.copy())
                slack = bool((data.ten_length < lengths).any())
                loose += slack
                taut = lab.slack or not slack
            force = sum(
                (w * np.sin(np.pi * (now - s) / 0.6) ** 2 for s, w in pushes if s < now < s + 0.6),
                start=np.zeros(6),
            )
            if lab.air:
                force[:3] -= 0.6 * lab.air * np.linalg.norm(data.qvel[:3]) * data.qvel[:3]
            data.xfrc_applied[1] = force
            data.qfrc_applied[:] = 0.0
            if lab.swivel:
                _rub(model, data, robot, lab.swivel)
            mujoco.mj_step(model, data)
        if taut:
            return np.array(seen), loose / count
    raise RuntimeError("no swing with taut cables")


def _rub(model, data, robot: Robot, torque: float) -> None:
    """Dry friction of rollers that swivel: against the turning of each cable about its anchor."""
    R = data.xmat[1].reshape(3, 3)
    omega = R @ data.qvel[3:]
    for anchor, attachment in zip(robot.anchors, robot.attachments, strict=True):
        arm = R @ attachment
        along = anchor - data.qpos[:3] - arm
        length = np.linalg.norm(along)
        moving = data.qvel[:3] + np.cross(omega, arm)
        moving -= along * (moving @ along) / length**2
        speed = np.linalg.norm(moving)
        force = -torque / length * moving / np.sqrt(speed**2 + RUB**2)
        mujoco.mj_applyFT(
            model, data, force, np.zeros(3), data.qpos[:3] + arm, 1, data.qfrc_applied
        )
