"""A platform that swings on locked cables in MuJoCo: an oracle that shares no equation of motion
with the package.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run, Stream
from steelyard.experiment.unread import with_unread_cables
from steelyard.inertia import Inertia
from steelyard.instruments.pose import Pose
from steelyard.instruments.tension import Tension
from steelyard.robot.model import CableProperties, Robot

STEP = 5e-4  # [s]
RATE = 100  # [Hz]
PUSHED = 2.5  # [s] after which nobody touches the platform
STIFFNESS = 3e5  # EA [N]
ANCHORS = {
    1: [[0, 0, 3]],
    2: [[-2, 0, 3], [2, 0.2, 3]],
    3: [[-2, -1.5, 3], [2, -1.5, 3], [0, 2, 3]],
    4: [[-2, -1.5, 3], [2, -1.5, 3], [2, 1.5, 3], [-2, 1.5, 3]],
}
ATTACHMENTS = {
    1: [[0.05, 0, 0.2]],
    2: [[-0.3, 0, 0.15], [0.3, 0, 0.15]],
    3: [[-0.3, -0.2, 0.1], [0.3, -0.2, 0.1], [0, 0.3, 0.1]],
    4: [[-0.3, -0.25, 0.1], [0.3, -0.25, 0.1], [0.3, 0.25, 0.1], [-0.3, 0.25, 0.1]],
}
BODY = Inertia(
    9.0,
    np.array([0.03, 0.01, -0.03]),
    np.array([[0.3, -0.02, 0.02], [-0.02, 0.6, 0.003], [0.02, 0.003, 0.65]]),
)


def swinging_robot(m, stiffness=STIFFNESS):
    """A robot of m cables with this EA [N]."""
    cable = CableProperties(axial_stiffness=stiffness)
    return Robot(f"swing {m}", np.array(ANCHORS[m]), np.array(ATTACHMENTS[m]), cable=cable)


def locked_model(robot, body, lengths, damping_ratio=0.0, step=STEP):
    """The body on tendons of constant unstrained lengths [m]."""
    numbers = lambda values: " ".join(f"{v:.17g}" for v in np.ravel(values))  # noqa: E731
    stiffness = robot.cable.axial_stiffness / np.asarray(lengths)
    damping = 2 * damping_ratio * np.sqrt(stiffness * body.mass / 4)
    J = body.inertia
    full = [J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]]
    anchors = "".join(
        f'<site name="a{i}" pos="{numbers(a)}"/>' for i, a in enumerate(robot.anchors)
    )
    attachments = "".join(
        f'<site name="b{i}" pos="{numbers(b)}"/>' for i, b in enumerate(robot.attachments)
    )
    tendons = "".join(
        f'<spatial stiffness="{stiffness[i]:.17g}" damping="{damping[i]:.17g}"'
        f' springlength="0 {lengths[i]:.17g}"><site site="a{i}"/><site site="b{i}"/></spatial>'
        for i in range(robot.m)
    )
    return mujoco.MjModel.from_xml_string(f"""
        <mujoco><option timestep="{step}" integrator="RK4" gravity="{numbers(robot.gravity)}"/>
        <compiler balanceinertia="false"/>
        <worldbody>{anchors}<body name="platform"><freejoint/>
        <inertial mass="{body.mass}" pos="{numbers(body.center_of_gravity)}" fullinertia="{numbers(full)}"/>
        {attachments}</body></worldbody><tendon>{tendons}</tendon></mujoco>""")


def linear_frequencies(robot, body, lengths, start):
    """Of MuJoCo's accelerations about the equilibrium near a pose [Hz], ascending, by
    differences.
    """
    model = locked_model(robot, body, lengths)
    data = mujoco.MjData(model)
    place = np.array(start)

    def acceleration(change):
        data.qpos[:], data.qvel[:] = place, 0.0
        mujoco.mj_integratePos(model, data.qpos, np.asarray(change, dtype=float), 1.0)
        mujoco.mj_forward(model, data)
        return data.qacc.copy()

    for _ in range(8):
        ways = 1e-6 * np.eye(6)
        slope = np.array([(acceleration(d) - acceleration(-d)) / 2e-6 for d in ways]).T
        step, *_ = np.linalg.lstsq(slope, -acceleration(np.zeros(6)), rcond=1e-12)
        data.qpos[:] = place
        mujoco.mj_integratePos(model, data.qpos, step, 1.0)
        place = data.qpos.copy()
    squares = np.sort(np.linalg.eigvals(-slope).real)
    return np.sqrt(np.maximum(squares, 0.0)) / (2 * np.pi)


@dataclass(frozen=True)
class Swings:
    """Recordings of a platform that hands have pushed, and the truth."""

    experiment: Experiment
    body: Inertia
    true: Robot
    """With the errors of its geometry."""


SEEN = {"frame": {"position": 0.005, "rotation": 0.003}, "misalignment": 0.003, "target": 0.002}
"""1-sigma of where motion capture stands and what it sees of the platform [m], [rad]."""


CELLS = {
    "kind": "tension",
    "noise": 0.1,
    "calibration": {"gain": 0.01, "common_gain": 0.005, "offset": 1.0},
}
"""Force sensors in the cables [N]."""


def swings(
    m,
    runs,
    seed,
    duration=10.0,
    noise=(3e-4, 5e-4),
    geometry=0.002,
    body=BODY,
    misplaced=False,
    weighed=0,
    air=0.0,
):
    """Pushed by hand on locked cables, seen by motion capture once the hands are off.

    Args:
        m: Number of cables.
        runs: Number of recordings.
        seed: Of everything that is drawn.
        duration: Of each [s].
        noise: Of position [m] and orientation [rad].
        geometry: Errors of anchors and attachments, 1-sigma [m].
        body: That swings.
        misplaced: Whether motion capture is off by what is stated of it; else it is exact.
        weighed: Recordings, of the first ones, in which force sensors are read too, which are off
            by what is stated of them; of the winches nothing is said there.
        air: Rate at which air slows the platform [1/s].
    """
    rng = np.random.default_rng(seed)
    drawn = swinging_robot(m)
    true = Robot(
        drawn.name,
        drawn.anchors + geometry * rng.normal(size=drawn.anchors.shape),
        drawn.attachments + geometry * rng.normal(size=drawn.attachments.shape),
        cable=drawn.cable,
    )
    pose = Pose.model_validate(
        {
            "kind": "pose",
            "noise": {"position": noise[0], "rotation": noise[1]},
            "calibration": SEEN,
        }
    )
    # Drawn apart, so that the swings are the same ones.
    off = np.random.default_rng([*np.atleast_1d(seed), 9]).normal(size=(4, 3)) * misplaced
    origin, target = SEEN["frame"]["position"] * off[0], SEEN["target"] * off[1]
    frame, mounting = (
        Rotation.from_rotvec(sigma * each)
        for sigma, each in ((SEEN["frame"]["rotation"], off[2]), (SEEN["misalignment"], off[3]))
    )
    apart = np.random.default_rng([*np.atleast_1d(seed), 10])
    stated = CELLS["calibration"]
    gain = 1 + stated["gain"] * apart.normal(size=m) + stated["common_gain"] * apart.normal()
    offset = stated["offset"] * apart.normal(size=m)
    found = []
    for i in range(runs):
        seen, pulls = _swing(true, body, rng, duration, air)
        time = 5.0 + np.arange(len(seen)) / RATE
        turned = Rotation.from_quat(seen[:, 3:7], scalar_first=True)
        place = frame.inv().apply(seen[:, :3] + turned.apply(target) - origin)
        turned = frame.inv() * turned * mounting
        turned = turned * Rotation.from_rotvec(noise[1] * rng.normal(size=(len(seen), 3)))
        values = {
            "position": place + noise[0] * rng.normal(size=(len(seen), 3)),
            "orientation": turned.as_matrix(),
        }
        streams = {"pose": Stream(time, values, "MuJoCo")}
        if i < weighed:
            read = gain * pulls + offset + CELLS["noise"] * apart.normal(size=pulls.shape)
            streams["cables"] = Stream(time, {"tension": read}, "MuJoCo")
        found.append(Run(f"swing {i}", streams, locked=i >= weighed))
    uncertainty = {"anchor": geometry, "attachment": geometry, "gravity": 0.005}
    instruments = {"pose": pose}
    if weighed:
        instruments["cables"] = Tension.model_validate({**CELLS, "clock": "pose"})
    experiment = Experiment("swings", drawn, instruments, tuple(found), uncertainty=uncertainty)
    return Swings(with_unread_cables(experiment), body, true)


def _swing(robot, body, rng, duration, air):
    """Poses after some pushes, of a swing in which every cable stays taut, shape (n, 7), and how
    hard the cables pull [N], shape (n, m).
    """
    every = round(1 / RATE / STEP)
    while True:
        place = np.array([rng.uniform(-0.6, 0.6), rng.uniform(-0.4, 0.4), rng.uniform(0.8, 1.6)])
        lengths = np.linalg.norm(robot.anchors - place - robot.attachments, axis=1)
        model = locked_model(robot, body, lengths, damping_ratio=0.02)
        data = mujoco.MjData(model)
        data.qpos[:3], data.qpos[3:] = place, [1, 0, 0, 0]
        # In honey until it hangs still.
        model.dof_damping[:] = 6 * body.mass * np.array([1, 1, 1, 0.1, 0.1, 0.1])
        mujoco.mj_step(model, data, 30_000)
        model.dof_damping[:] = air * body.mass * np.array([1, 1, 1, 0.1, 0.1, 0.1])
        pushes = [
            (rng.uniform(0, 1.5), body.mass * rng.normal(size=6) * [1, 1, 0.3, 0.15, 0.15, 0.15])
            for _ in range(2)
        ]
        begun = data.time
        while (now := data.time - begun) < PUSHED:
            data.xfrc_applied[1] = sum(
                w * np.sin(np.pi * (now - s) / 0.6) ** 2 for s, w in pushes if s < now < s + 0.6
            )
            mujoco.mj_step(model, data)
        seen, pulls = [], []
        for _ in range(round(duration * RATE)):
            seen.append(data.qpos.copy())
            # Anew: MuJoCo keeps what it computed before the last step.
            mujoco.mj_forward(model, data)
            stretch = data.ten_length - lengths
            taut = bool((stretch > 0).all())
            pulls.append(
                model.tendon_stiffness * stretch + model.tendon_damping * data.ten_velocity
            )
            if not taut:
                break
            mujoco.mj_step(model, data, every)
        if taut:
            return np.array(seen), np.array(pulls)
