"""A platform on elastic cables in MuJoCo: an oracle that shares no equation of motion with the
package."""

from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.motion.limits import commanded_tensions, extremes_of
from steelyard.motion.state import State
from steelyard.robot.file import read_robot
from steelyard.simulation.recording import draw_errors, record
from steelyard.simulation.response import ExactMotion
from steelyard.simulation.sensors import paper_sensors

STEP = 5e-4  # [s]: half of it changes no tension by more than .1 N
SEEN = 2e-3  # [s] between recorded states: the stiffest platform of the benchmark swings at 15 Hz
FED = 0.01  # [s] between lengths that the winches are told
LAWS = ("cables", "springs")
EXACT = {"anchor": 0.0, "attachment": 0.0, "gravity": 0.0}


def point_robot(damping_ratio=0.02, stiffer=1.0):
    """CoGiRo with straight cables from points, as MuJoCo's tendons are."""
    robot = read_robot("cogiro").with_straight_cables()
    cable = replace(
        robot.cable,
        damping_ratio=damping_ratio,
        axial_stiffness=stiffer * robot.cable.axial_stiffness,
    )
    return replace(robot, pulley_radius=np.zeros(robot.m), cable=cable)


def mujoco_model(robot, step):
    """The nominal platform on a tendon for each cable, whose spring is set while it moves."""
    body = robot.platform
    inertial = body.to_mujoco()
    numbers = lambda values: " ".join(f"{v:.17g}" for v in values)  # noqa: E731
    anchors = "".join(
        f'<site name="a{i}" pos="{numbers(a)}"/>' for i, a in enumerate(robot.anchors)
    )
    attachments = "".join(
        f'<site name="b{i}" pos="{numbers(b)}"/>' for i, b in enumerate(robot.attachments)
    )
    tendons = "".join(
        f'<spatial stiffness="1"><site site="a{i}"/><site site="b{i}"/></spatial>'
        for i in range(robot.m)
    )
    return mujoco.MjModel.from_xml_string(f"""
        <mujoco><option timestep="{step}" integrator="RK4" gravity="{numbers(robot.gravity)}"/>
        <compiler balanceinertia="false"/>
        <worldbody>{anchors}<body name="platform"><freejoint/>
        <inertial mass="{inertial.mass}" pos="{numbers(inertial.pos)}" fullinertia="{numbers(inertial.fullinertia)}"/>
        {attachments}</body></worldbody><tendon>{tendons}</tendon></mujoco>""")


@dataclass(frozen=True)
class Winding:
    """What winches have fed at instants; each cable pulls with k (length - fed) + c (rate of the
    length - rate fed)."""

    fed: np.ndarray  # [m], shape (n, m)
    rate: np.ndarray  # [m/s], shape (n, m)
    stiffness: np.ndarray  # k [N/m], shape (n, m) or (1, m)
    damping: np.ndarray  # c [N s/m], likewise

    def __post_init__(self):
        for name in ("stiffness", "damping"):
            object.__setattr__(self, name, np.broadcast_to(getattr(self, name), self.fed.shape))

    @cached_property
    def spring(self):
        """Length at which MuJoCo's spring is slack: its damper sees the whole rate of the tendon,
        and what is fed is taken off here."""
        return self.fed + self.damping / self.stiffness * self.rate

    def put(self, model, i):
        m = self.fed.shape[1]
        model.tendon_stiffness.reshape(m, -1)[:, 0] = self.stiffness[i]
        model.tendon_damping.reshape(m, -1)[:, 0] = self.damping[i]
        # No force between these lengths: a spring that is slack does not push.
        model.tendon_lengthspring[:, 0] = 0.0
        model.tendon_lengthspring[:, 1] = self.spring[i]


def wound(robot, feed, times, stiffness=None):
    """Lengths of a spline over time at instants, fed to cables of EA / fed, or to springs of a
    stiffness of their own [N/m]."""
    fed, rate = feed(times), feed(times, nu=1)
    k = robot.cable.axial_stiffness / fed if stiffness is None else stiffness[None]
    return Winding(
        fed, rate, k, 2 * robot.cable.damping_ratio * np.sqrt(k * robot.platform.mass / 4)
    )


@dataclass(frozen=True, eq=False)
class Hanging:
    """What a platform did in MuJoCo; a response for the virtual sensors."""

    robot: object
    duration: float
    time: np.ndarray  # [s], shape (n,)
    seen: np.ndarray  # position, quaternion (w, x, y, z), velocity, omega, their derivatives, the tensions and what of them stretches the cables, shape (n, 19 + 2 m)

    @cached_property
    def _between(self):
        return make_interp_spline(self.time, self.seen, k=5)

    def at(self, times):
        """State between the recorded ones, which follow each other much faster than the platform
        swings."""
        x = self._between(times)
        rotation = Rotation.from_quat(x[:, 3:7], scalar_first=True).as_matrix()
        force_samples = np.einsum("nji,nj->ni", rotation, x[:, 13:16] - self.robot.gravity)
        # The wrench of the cables, from MuJoCo's own tensions and geometry.
        point = np.einsum("nij,mj->nmi", rotation, self.robot.attachments)
        pull = self.robot.anchors - x[:, None, :3] - point
        tension, spring = np.split(x[:, 19:], 2, axis=1)
        pull *= (tension / np.linalg.norm(pull, axis=2))[:, :, None]
        total = np.stack([pull.sum(axis=1), np.cross(point, pull).sum(axis=1)], axis=1)
        return State(
            position=x[:, :3],
            rotation=rotation,
            velocity=x[:, 7:10],
            omega=x[:, 10:13],
            specific_force=force_samples,
            alpha=x[:, 16:19],
            tension=tension,
            wrench=np.einsum("nji,nkj->nki", rotation, total).reshape(-1, 6),
            gravity=self.robot.gravity,
            stretching=spring,
        )

    @property
    def tension(self):
        """At the recorded times [N], shape (n, m)."""
        return self.seen[:, 19 : 19 + self.robot.m]

    @property
    def pose(self):
        """x, y, z [m], roll, pitch, yaw [rad] at the recorded times, shape (n, 6)."""
        rpy = Rotation.from_quat(self.seen[:, 3:7], scalar_first=True).as_euler("ZYX")[:, ::-1]
        return np.hstack([self.seen[:, :3], np.unwrap(rpy, axis=0)])

    def uses(self):
        """Name -> largest use of each limit on pose, speed and acceleration, 1 being all that is
        allowed."""
        x = self.seen
        found = extremes_of(
            self.robot.limits, self.pose, x[:, 7:10], x[:, 13:16], x[:, 10:13], x[:, 16:19]
        )
        return {use.name: use.fraction for use in found.uses}


def hung(robot, trajectory, level, law="cables", step=STEP):
    """Move the nominal platform of a robot by winches that feed what holds it at rest in the
    commanded poses.

    Args:
        robot: With straight cables from points.
        trajectory: The command.
        level: Mean tension that the winches would hold [N].
        law: ``cables``: a metre of cable stretches like every other; ``springs``: each pulls as in
            the first pose however much is fed.
        step: Of the integration [s].
    """
    times = np.linspace(0.0, trajectory.duration, round(trajectory.duration / FED) + 1)
    tension = commanded_tensions(robot, trajectory, times, still=True, level=level)
    pose = trajectory.derivative(times, 0)
    rotation = Rotation.from_euler("ZYX", pose[:, :2:-1])
    point = pose[:, None, :3] + np.einsum("nij,mj->nmi", rotation.as_matrix(), robot.attachments)
    length = np.linalg.norm(point - robot.anchors, axis=2)
    fed = length / (1 + tension / robot.cable.axial_stiffness)
    stiffness = None
    if law == "springs":
        stiffness = robot.cable.axial_stiffness / fed[0]
        fed = length - tension / stiffness
    feed = make_interp_spline(times, fed, k=5)
    start = np.concatenate([pose[0, :3], rotation[0].as_quat(scalar_first=True)])
    return moved(robot, feed, start, trajectory.duration, stiffness=stiffness, step=step)


def moved(robot, feed, start, duration, *, stiffness=None, step=STEP):
    """Integrate from rest in a pose.

    Args:
        robot: With a nominal platform.
        feed: Unstrained lengths over time, a spline [m].
        start: Position and quaternion (w, x, y, z).
        duration: [s]
        stiffness: See :func:`wound`.
        step: Of the integration [s].
    """
    model = mujoco_model(robot, step)
    data = mujoco.MjData(model)
    data.qpos[:] = start
    every = round(SEEN / step)
    count = round(duration / step)
    time = np.arange(0, count + 1, every) * step
    # MuJoCo holds the springs during a step: their values in its middle keep that second-order
    # accurate.
    during = wound(robot, feed, (np.arange(count) + 0.5) * step, stiffness)
    now = wound(robot, feed, time, stiffness)
    seen = []
    for k in range(count + 1):
        if k % every == 0:
            i = k // every
            now.put(model, i)
            mujoco.mj_forward(model, data)
            stretch, stretching = data.ten_length - now.fed[i], data.ten_velocity - now.rate[i]
            spring = now.stiffness[i] * stretch
            tension = spring + now.damping[i] * stretching
            seen.append(np.concatenate([data.qpos, data.qvel, data.qacc, tension, spring]))
        if k < count:
            during.put(model, k)
            mujoco.mj_step(model, data)
    return Hanging(robot, duration, time, np.array(seen))


def recorded(hanging, trajectory, seed):
    """What the sensors of the paper record of it, with every error drawn anew."""
    robot = hanging.robot
    rng = np.random.default_rng(seed)
    instruments = paper_sensors(robot).instruments
    drawn = draw_errors(instruments, robot.m, ["run"], rng)["run"]
    command = ExactMotion(robot, robot.platform, trajectory)
    streams, sync = record(hanging, instruments, drawn, robot, command, rng)
    return Experiment("MuJoCo", robot, instruments, (Run("run", streams, sync),), uncertainty=EXACT)


def chi_square(estimate, body):
    """Of the ten parameters."""
    error = estimate.value - body.body_parameters
    return float(error @ np.linalg.solve(estimate.covariance, error))
