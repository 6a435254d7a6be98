"""A rigid body on elastic cables in MuJoCo, which may run over rollers or have weight.

A cable is a spring between two places: where it leaves its anchor or its roller, and its attachment.
Cables with weight are chains of masses on such springs.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from robots import GRAVITY, Array, Condition, PublicRobot
from scipy.interpolate import BSpline, make_interp_spline
from scipy.spatial.transform import Rotation

DAMPING_RATIO = 0.05
"""Of each cable with a quarter of the platform's mass."""
SETTLING = 4.0
"""For which the platform comes to rest, heavily damped, before the recording begins [s]."""
SEEN = 2e-3
"""Between kept states [s]."""
MASSES = 6
"""Of a cable with weight, in the middle of as many parts of it."""
_FINER = 2
"""By how much steps are shorter where cables have masses: these vibrate at 500 Hz."""
_RELAXED = 5e-4
"""Damping over stiffness of such cables, at most [s]: more would not be stable."""
_LIVELY, _DAMPED = 30.0, 0.02
"""Frequency at which masses are damped by the air [rad/s], and how much; they settle at once."""
_ATTEMPTS = 8
"""Motions that are drawn until no cable goes slack."""


def commanded(robot: PublicRobot, duration: float, rng: np.random.Generator) -> BSpline:
    """A multisine in six axes that begins and ends at rest: x, y, z [m] and a rotation vector."""
    t = np.linspace(0.0, duration, round(duration * 100) + 1)
    lowest = 1.0 / duration
    count = max(2, int(robot.frequency / lowest))
    frequencies = lowest * np.arange(2, count + 1)
    phases = rng.uniform(0, 2 * np.pi, (6, len(frequencies)))
    wave = np.sin(2 * np.pi * frequencies * t[:, None, None] + phases).sum(axis=2)
    wave /= wave.std(axis=0)
    ramp = np.clip(np.minimum(t, duration - t) / min(2.0, duration / 4), 0.0, 1.0)
    smooth = ramp**4 * (35 - 84 * ramp + 70 * ramp**2 - 20 * ramp**3)
    # Peaks are held within 2.2 sigma, so that no cable goes slack.
    wave = 2.2 * np.tanh(wave / 2.2) * smooth[:, None] * robot.reach
    return make_interp_spline(t, wave + np.concatenate([robot.center, np.zeros(3)]), k=5)


@dataclass(frozen=True, eq=False)
class Cables:
    """The cables as they are."""

    anchors: Array
    """In the world [m], shape (m, 3)."""
    attachments: Array
    """In the platform [m], shape (m, 3)."""
    axial_stiffness: float
    """EA [N]."""
    roller_radius: float = 0.0
    """[m]; 0: they leave from their anchors."""
    linear_density: float = 0.0
    """[kg/m]; 0: they are straight. Cables over rollers are."""

    @classmethod
    def of(
        cls, robot: PublicRobot, condition: Condition, anchors: Array, attachments: Array
    ) -> Cables:
        """Of a robot whose anchors and attachments are here."""
        radius, density = condition.roller_radius, condition.linear_density
        return cls(anchors, attachments, robot.axial_stiffness, radius, density)

    @property
    def masses(self) -> int:
        """Of each cable; 0: none."""
        return MASSES if self.linear_density else 0

    def weighed(self, lengths: Array) -> Array:
        """Masses along cables [kg], each three times, shape (3 m masses,).

        Args:
            lengths: Of the cables [m], shape (m,).
        """
        each = self.linear_density * lengths / max(self.masses, 1)
        return np.repeat(each, 3 * self.masses)

    def leaving(self, ends: Array) -> tuple[Array, Array]:
        """Where straight cables leave towards their ends, shape (n, m, 3), and how much of them lies on
        their rollers [m], shape (n, m).

        A cable comes up at its anchor and enters there a roller that swivels about this line, goes
        over the top and leaves along a tangent.

        Args:
            ends: On the platform, world [m], shape (n, m, 3).
        """
        anchors, r = np.broadcast_to(self.anchors, ends.shape), self.roller_radius
        if not r:
            return anchors, np.zeros(ends.shape[:2])
        away = ends - anchors
        outwards = np.linalg.norm(away[..., :2], axis=2)
        flat = away[..., :2] / outwards[..., None]
        # In the plane of the roller, from its middle, which is one radius outwards.
        x, z = outwards - r, away[..., 2]
        angle = np.arctan2(z, x) + np.arccos(r / np.hypot(x, z))
        radial, upward = r + r * np.cos(angle), r * np.sin(angle)
        leave = anchors + np.concatenate([radial[..., None] * flat, upward[..., None]], axis=2)
        return leave, r * (np.pi - angle)


def structure_of(leave: Array, attachments: Array, position: Array, rotation: Array) -> Array:
    """Wrench of unit tensions about the platform's origin, world axes, shape (n, 6, m)."""
    arm = np.einsum("nij,mj->nmi", rotation, attachments)
    direction = leave - position[:, None, :] - arm
    direction /= np.linalg.norm(direction, axis=2, keepdims=True)
    return np.concatenate([direction, np.cross(arm, direction)], axis=2).transpose(0, 2, 1)


def fed_lengths(robot: PublicRobot, cables: Cables, pose: Array) -> Array:
    """Unstrained lengths that hold the body in poses, as well as straight cables can, shape (n, m)."""
    rotation = Rotation.from_rotvec(pose[:, 3:]).as_matrix()
    arms = np.einsum("nij,mj->nmi", rotation, cables.attachments)
    leave, rolled_up = cables.leaving(pose[:, None, :3] + arms)
    structure = structure_of(leave, cables.attachments, pose[:, :3], rotation)
    weight = np.array([0.0, 0.0, -GRAVITY * robot.mass])
    arm = rotation @ robot.center_of_gravity
    load = np.concatenate([np.tile(weight, (len(pose), 1)), np.cross(arm, weight)], axis=1)
    even = np.full(len(cables.anchors), robot.tension)
    missing = -load - structure @ even
    tension = np.maximum(even + np.einsum("nmk,nk->nm", np.linalg.pinv(structure), missing), 0.0)
    length = np.linalg.norm(leave - pose[:, None, :3] - arms, axis=2) + rolled_up
    return length / (1 + tension / robot.axial_stiffness)


@dataclass(frozen=True, eq=False)
class Motion:
    """What the platform did; arrays over n instants."""

    position: Array
    """Of the platform's origin in the world [m], shape (n, 3)."""
    rotation: Array
    """R_world_platform, shape (n, 3, 3)."""
    omega: Array
    """In the platform [rad/s], shape (n, 3)."""
    alpha: Array
    """Its derivative, in the platform [rad/s^2], shape (n, 3)."""
    specific_force: Array
    """Of the origin, in the platform [m/s^2], shape (n, 3)."""
    tension: Array
    """At the platform [N], shape (n, m)."""
    leave: Array
    """From where the last straight piece of each cable comes, world [m], shape (n, m, 3)."""


@dataclass(frozen=True, eq=False)
class Moved:
    """A simulated recording, before any sensor has seen it."""

    between: BSpline
    cables: Cables

    def at(self, times: Array) -> Motion:
        """At instants [s]."""
        x, m = self.between(times), len(self.cables.anchors)
        rotation = Rotation.from_quat(x[:, 3:7], scalar_first=True).as_matrix()
        upward = x[:, 13:16] + np.array([0.0, 0.0, GRAVITY])
        force = np.einsum("nji,nj->ni", rotation, upward)
        tension, last = x[:, 19 : 19 + m], x[:, 19 + m :]
        if last.shape[1]:
            leave = last.reshape(-1, m, 3)
        else:
            arms = np.einsum("nij,mj->nmi", rotation, self.cables.attachments)
            leave, _ = self.cables.leaving(x[:, None, :3] + arms)
        return Motion(x[:, :3], rotation, x[:, 10:13], x[:, 16:19], force, tension, leave)


class SlackError(Exception):
    """A cable went slack."""


def _numbers(values: Array) -> str:
    return " ".join(f"{v:.17g}" for v in values)


def _sites(letter: str, points: Array) -> str:
    return "".join(f'<site name="{letter}{i}" pos="{_numbers(p)}"/>' for i, p in enumerate(points))


def _model(
    robot: PublicRobot, cables: Cables, step: float, between: str, tendons: str
) -> mujoco.MjModel:
    """The platform, on tendons that are springs."""
    J = robot.inertia
    full = np.array([J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]])
    return mujoco.MjModel.from_xml_string(f"""
        <mujoco><option timestep="{step}" integrator="RK4" gravity="0 0 {-GRAVITY}"/>
        <worldbody>{_sites("a", cables.anchors)}<body name="platform"><freejoint/>
        <inertial mass="{robot.mass}" pos="{_numbers(robot.center_of_gravity)}" fullinertia="{_numbers(full)}"/>
        {_sites("b", cables.attachments)}</body>{between}</worldbody><tendon>{tendons}</tendon></mujoco>""")


def _sliding(name: str, place: Array) -> str:
    """A mass that slides in all directions; how large it is, is set while it moves."""
    axes = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1"))
    inertial = '<inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/>'
    return f'<body pos="{_numbers(place)}">{inertial}{axes}<site name="{name}"/></body>'


def _spatial(*sites: str) -> str:
    """A spring along a straight line."""
    places = "".join(f'<site site="{each}"/>' for each in sites)
    return f'<spatial stiffness="1" damping="1">{places}</spatial>'


class Springs:
    """The platform in MuJoCo on cables of one spring each, or of masses in the middle of equal parts with
    springs between them.
    """

    def __init__(self, robot: PublicRobot, cables: Cables) -> None:
        self._robot, self._cables = robot, cables
        count, m = cables.masses, len(cables.anchors)
        starts, ends = cables.anchors, robot.center + cables.attachments
        part = (np.arange(count) + 0.5) / max(count, 1)
        between, tendons = "", ""
        for i in range(m):
            places = starts[i] + part[:, None] * (ends[i] - starts[i])
            names = [f"c{i}_{j}" for j in range(count)]
            between += "".join(map(_sliding, names, places))
            along = itertools.pairwise([f"a{i}", *names, f"b{i}"])
            tendons += "".join(_spatial(*pair) for pair in along)
        step = robot.step / _FINER if count else robot.step
        self.model = _model(robot, cables, step, between, tendons)
        self.data = mujoco.MjData(self.model)
        self._share = np.array([1.0])
        self._relaxed = np.inf
        if count:
            self._share = np.concatenate([[0.5], np.ones(count - 1), [0.5]]) / count
            self._relaxed = _RELAXED
        self._last = [
            mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_SITE, f"c{i}_{count - 1}")
            for i in range(m if count else 0)
        ]
        self._rotation = np.zeros(9)
        self._k = self._c = self._free = np.zeros((m, count + 1))
        # Masses come to rest within some tenths of a second, too.
        self._mass = cables.weighed(np.linalg.norm(ends - starts, axis=1))
        self.damped([8.0 * robot.mass] * 3 + [8.0 * np.trace(robot.inertia) / 3] * 3, 1.0)

    def damped(self, platform: Sequence[float], masses: float) -> None:
        """Set what damps platform and masses.

        Args:
            platform: Six of them [N s/m], [N m s].
            masses: In parts of that with which they settle at once.
        """
        self.model.dof_damping[:6] = platform
        self.model.dof_damping[6:] = masses * _LIVELY * self._mass

    def fed(self, lengths: Array, rates: Array) -> None:
        """Set the springs for what the winches have fed out, shape (m,), and how fast; all parts of a
        cable are fed alike.
        """
        model, cables = self.model, self._cables
        k = self._robot.axial_stiffness / lengths
        c = 2 * DAMPING_RATIO * np.sqrt(k * self._robot.mass / 4)
        c = np.minimum(c, self._relaxed * k)
        self._k, self._c = k[:, None] / self._share, c[:, None] / self._share
        self._free = lengths[:, None] * self._share
        self._rates = rates[:, None] * self._share
        if cables.roller_radius:
            # Where a cable leaves moves along with it: its length follows the attachment alone.
            mujoco.mju_quat2Mat(self._rotation, self.data.qpos[3:7])
            arms = cables.attachments @ self._rotation.reshape(3, 3).T
            leave, rolled_up = cables.leaving((self.data.qpos[:3] + arms)[None])
            model.site_pos[: len(lengths)] = leave[0]
            self._free = self._free - rolled_up[0][:, None]
        model.tendon_stiffness.reshape(self._k.size, -1)[:, 0] = self._k.ravel()
        model.tendon_damping.reshape(self._k.size, -1)[:, 0] = self._c.ravel()
        # MuJoCo's damper sees the whole rate of the tendon; what is fed is taken off here. A spring
        # within (0, length) does not push.
        model.tendon_lengthspring[:, 0] = 0.0
        set_to = self._free + self._c / self._k * self._rates
        model.tendon_lengthspring[:, 1] = set_to.ravel()
        if cables.masses:
            self._mass = cables.weighed(lengths)
            # Three joints each. Of bodies that only slide MuJoCo keeps the inertia ready made.
            model.body_mass[2:] = model.body_subtreemass[2:] = self._mass[::3]
            model.dof_M0[6:] = self._mass

    def seen(self, lengths: Array, rates: Array) -> tuple[Array, Array]:
        """Tensions at the platform, shape (m,), and where the last pieces come from, shape (3 m,); of
        straight cables, where that is known, (0,).
        """
        self.fed(lengths, rates)
        mujoco.mj_forward(self.model, self.data)
        shape = self._free.shape
        stretch = self.data.ten_length.reshape(shape) - self._free
        rate = self.data.ten_velocity.reshape(shape) - self._rates
        tension = (self._k * stretch + self._c * rate)[:, -1]
        return tension, self.data.site_xpos[self._last].ravel()


def moved(robot: PublicRobot, cables: Cables, command: BSpline) -> Moved:
    """Integrate the platform while the winches feed open loop."""
    duration = float(command.t[-1])
    known = np.linspace(0.0, duration, round(duration * 100) + 1)
    feed = make_interp_spline(known, fed_lengths(robot, cables, command(known)), k=5)
    here = Springs(robot, cables)
    model, data = here.model, here.data
    data.qpos[:3], data.qpos[3] = command(0.0)[:3], 1.0
    step, m = model.opt.timestep, len(cables.anchors)
    still = np.zeros(m)
    here.fed(feed(0.0), still)
    every = round(SEEN / step)
    for _ in range(round(SETTLING / SEEN)):
        mujoco.mj_step(model, data, nstep=every)
        here.fed(feed(0.0), still)
    here.damped([0.0] * 6, 2 * _DAMPED)
    data.qvel[:] = 0.0
    count = round(duration / step)
    middle = (np.arange(count) + 0.5) * step
    lengths, rates = feed(middle), feed(middle, nu=1)
    seen = []
    for i in range(count + 1):
        if i % every == 0:
            tension, last = here.seen(feed(i * step), feed(i * step, nu=1))
            states = (data.qpos[:7], data.qvel[:6], data.qacc[:6])
            seen.append(np.concatenate([*states, tension, last]))
        if i < count:
            here.fed(lengths[i], rates[i])
            mujoco.mj_step(model, data)
    whole = np.array(seen)
    if whole[:, 19 : 19 + m].min() <= 0:
        raise SlackError(f"{robot.name}: a cable went slack")
    between = make_interp_spline(np.arange(0, count + 1, every) * step, whole, k=5)
    return Moved(between, cables)


def taut(robot: PublicRobot, cables: Cables, duration: float, rng: np.random.Generator) -> Moved:
    """A motion in which no cable goes slack: another, smaller one is drawn until that is so."""
    for attempt in range(_ATTEMPTS):
        smaller = replace(robot, reach=robot.reach * 0.85**attempt)
        try:
            return moved(smaller, cables, commanded(smaller, duration, rng))
        except SlackError:
            continue
    raise SlackError(f"{robot.name}: a cable went slack in {_ATTEMPTS} motions; reduce its reach")
