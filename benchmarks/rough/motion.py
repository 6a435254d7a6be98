"""What the platform does: a body on cables that only pull, with what hangs on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from scipy.interpolate import BSpline, make_interp_spline
from scipy.optimize import least_squares

from .kinds import Kind
from .robots import RoughRobot
from .shared import Array, public

_BENDING = 2 * np.pi * 7.0
"""Of what bends [rad/s]."""
_PUSHES = 0.5, 6.5, 12.5
"""When a hand begins to push [s]."""
_PUSHED = 0.5
"""For how long [s]."""

Wrench = Callable[[float, mujoco.MjData], tuple[Array, Array]]
"""Force and torque on the platform about its origin, world axes, at an instant."""


@dataclass(frozen=True, eq=False)
class Course:
    """A recording before any sensor has seen it."""

    between: BSpline
    fed: BSpline
    """Unstrained lengths [m]."""
    body: Array
    """Mass, centre of gravity, inertia about it (xx, yy, zz, yz, xz, xy), all as one rigid body."""
    slack: float
    """Part of the time in which a cable is slack."""
    cables: public.Cables

    def at(self, times: Array) -> public.Motion:
        """At instants [s]."""
        return public.Moved(self.between, self.cables).at(times)


def _numbers(values: Array) -> str:
    return " ".join(f"{v:.17g}" for v in np.ravel(values))


def _carried(robot: RoughRobot, kind: Kind) -> tuple[str, float, Array]:
    """What hangs on the platform or stands on it: its XML, its mass [kg] and its place [m]."""
    plain = robot.plain
    low, high = plain.attachments[:, 2].min(), plain.attachments[:, 2].max()
    if kind.swinging:
        mass, string = kind.swinging * plain.mass, 0.6 * max(robot.size, 0.3)
        place = np.array([0.0, 0.0, low - string])
        tiny = 1e-4 * mass * string**2
        xml = (
            f'<body pos="0 0 {low}"><joint type="ball" damping="{0.01 * mass * string**2}"/>'
            f'<inertial mass="{mass}" pos="0 0 {-string}" diaginertia="{tiny} {tiny} {tiny}"/></body>'
        )
        return xml, mass, place
    if kind.bending:
        mass = kind.bending * plain.mass
        place = np.array([0.0, 0.0, high])
        joints = "".join(
            f'<joint type="slide" axis="{axis}" stiffness="{mass * _BENDING**2}"'
            f' damping="{0.04 * mass * _BENDING}"/>'
            for axis in ("1 0 0", "0 1 0")
        )
        tiny = 1e-3 * mass * robot.size**2
        xml = (
            f'<body pos="{_numbers(place)}">{joints}'
            f'<inertial mass="{mass}" pos="0 0 0" diaginertia="{tiny} {tiny} {tiny}"/></body>'
        )
        return xml, mass, place
    return "", 0.0, np.zeros(3)


def _model(robot: RoughRobot, kind: Kind, anchors: Array, attachments: Array) -> mujoco.MjModel:
    """The platform on one tendon for each cable, each with an actuator that can only pull."""
    plain = robot.plain
    J = plain.inertia
    full = [J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]]
    sites = lambda letter, points: "".join(  # noqa: E731
        f'<site name="{letter}{i}" pos="{_numbers(p)}"/>' for i, p in enumerate(points)
    )
    count = range(len(anchors))
    tendons = "".join(
        f'<spatial name="c{i}"><site site="a{i}"/><site site="b{i}"/></spatial>' for i in count
    )
    pulls = "".join(
        f'<general tendon="c{i}" biastype="affine" biasprm="0 -1 -1" gainprm="0"'
        ' forcelimited="true" forcerange="-1e9 0"/>'
        for i in count
    )
    return mujoco.MjModel.from_xml_string(f"""
        <mujoco><option timestep="{plain.step}" integrator="RK4" gravity="0 0 {-public.GRAVITY}"/>
        <worldbody>{sites("a", anchors)}<body name="platform"><freejoint/>
        <inertial mass="{plain.mass}" pos="{_numbers(plain.center_of_gravity)}"
         fullinertia="{_numbers(full)}"/>{sites("b", attachments)}
        {_carried(robot, kind)[0]}</body></worldbody>
        <tendon>{tendons}</tendon><actuator>{pulls}</actuator></mujoco>""")


def _whole(robot: RoughRobot, kind: Kind) -> Array:
    """Platform and what it carries as one rigid body at rest."""
    plain = robot.plain
    _, mass, place = _carried(robot, kind)
    total = plain.mass + mass
    center = (plain.mass * plain.center_of_gravity + mass * place) / total
    arm = place - plain.center_of_gravity
    reduced = plain.mass * mass / total
    size = robot.size if kind.bending else 0.6 * max(robot.size, 0.3)
    own = (1e-3 if kind.bending else 1e-4) * mass * size**2 * np.eye(3)
    J = plain.inertia + reduced * (arm @ arm * np.eye(3) - np.outer(arm, arm)) + own
    return np.array([total, *center, J[0, 0], J[1, 1], J[2, 2], J[1, 2], J[0, 2], J[0, 1]])


def _outside(robot: RoughRobot, kind: Kind, rng: np.random.Generator) -> Wrench | None:
    """What acts from outside: a hose, air, a hand."""
    size, weight = robot.size, robot.weight
    side = rng.uniform(0, 2 * np.pi)
    if kind.hose:
        at = np.array([0.3 * np.cos(side), 0.3 * np.sin(side), 0.5]) * size
        top = robot.plain.anchors[:, 2].max()
        to = 1.2 * np.array([*(robot.plain.anchors[:, :2].max(axis=0)), top]) * [0.3, 0.8, 0.8]
        free = 0.5 * float(np.linalg.norm(to - robot.plain.center))

        def hose(_: float, data: mujoco.MjData) -> tuple[Array, Array]:
            arm = data.xmat[1].reshape(3, 3) @ at
            line = to - data.xpos[1] - arm
            length = np.linalg.norm(line)
            pull = kind.hose * weight * max(length - free, 0.0) * line / length
            force = pull - np.array([0.0, 0.0, kind.hose * weight])
            return force, np.cross(arm, force)

        return hose
    if kind.air:
        density, area = 1.2, kind.air * size**2

        def air(_: float, data: mujoco.MjData) -> tuple[Array, Array]:
            velocity, turning = data.qvel[:3], data.xmat[1].reshape(3, 3) @ data.qvel[3:6]
            force = -0.5 * density * area * np.linalg.norm(velocity) * velocity
            torque = -0.5 * density * area * size**3 / 3 * np.linalg.norm(turning) * turning
            return force, torque

        return air
    if kind.pushed:
        pushes = 0.1 * weight * rng.normal(0, 1, (len(_PUSHES), 3)) * [1, 1, 0.2]
        arms = rng.uniform(-0.5, 0.5, (len(_PUSHES), 3)) * size

        def hand(t: float, _: mujoco.MjData) -> tuple[Array, Array]:
            for start, force, arm in zip(_PUSHES, pushes, arms, strict=True):
                if start < t < start + _PUSHED:
                    now = np.sin(np.pi * (t - start) / _PUSHED) ** 2 * force
                    return now, np.cross(arm, now)
            return np.zeros(3), np.zeros(3)

        return hand
    return None


def _hanging(plain: public.PublicRobot, anchors: Array, attachments: Array, pose: Array) -> Array:
    """Lengths of fewer than six cables, which cannot turn the body: those of the attitude in which
    it hangs at commanded places with even tension, shape (n, m)."""
    m, weight = len(anchors), public.GRAVITY * plain.mass
    scale = np.array([weight] * 3 + [weight * np.ptp(attachments, axis=0).max()] * 3)

    def missing(x: Array, place: Array) -> Array:
        rotation = public.rotation_of(x[m:])
        structure = public.structure_of(anchors, attachments, place[None], rotation[None])[0]
        load = np.array([0.0, 0.0, -weight])
        wrench = structure @ (x[:m] * plain.tension)
        wrench = wrench + np.concatenate([load, np.cross(rotation @ plain.center_of_gravity, load)])
        return np.concatenate([1e3 * wrench / scale, x[:m] - 1, x[m:]])

    x, found = np.concatenate([np.ones(m), np.zeros(3)]), []
    for place in pose[:, :3]:
        x = least_squares(missing, x, args=(place,)).x
        ends = place + attachments @ public.rotation_of(x[m:]).T
        tension = np.maximum(x[:m], 0.0) * plain.tension
        found.append(np.linalg.norm(anchors - ends, axis=1) / (1 + tension / plain.axial_stiffness))
    return np.array(found)


def _command(robot: RoughRobot, kind: Kind, duration: float, rng: np.random.Generator) -> BSpline:
    """Poses over time: x, y, z [m] and a rotation vector."""
    plain = robot.plain
    if not kind.pushed and kind.motion in {"multisine", "slow"}:
        pace = 1 / 3 if kind.motion == "slow" else 1.0
        return public.commanded(replace(plain, frequency=pace * plain.frequency), duration, rng)
    t = np.linspace(0.0, duration, round(duration * 100) + 1)
    drawn = _held if kind.pushed else {"moves": _moves, "circles": _circles}[kind.motion]
    pose = drawn(robot, t, rng) + np.concatenate([plain.center, np.zeros(3)])
    return make_interp_spline(t, pose, k=5)


def _held(_: RoughRobot, t: Array, __: np.random.Generator) -> Array:
    """No motion of its own, shape (n, 6)."""
    return np.zeros((len(t), 6))


def _smooth(share: Array) -> Array:
    """From 0 to 1 with the least jerk, as a share of the time goes from 0 to 1."""
    s = np.clip(share, 0.0, 1.0)
    return s**3 * (10 - 15 * s + 6 * s**2)


def _moves(robot: RoughRobot, t: Array, rng: np.random.Generator) -> Array:
    """From rest to rest, as a robot that works: poses drawn, each held for a while, shape (n, 6)."""
    wave, here, at = np.zeros((len(t), 6)), np.zeros(6), 0.0
    while at < t[-1] - 1.0:
        at += rng.uniform(0.2, 1.5)
        takes = rng.uniform(0.7, 1.5) / robot.plain.frequency
        there = 1.8 * robot.plain.reach * rng.uniform(-1, 1, 6)
        wave += (there - here) * _smooth((t - at) / takes)[:, None]
        here, at = there, at + takes
    return wave


def _circles(robot: RoughRobot, t: Array, rng: np.random.Generator) -> Array:
    """Level circles, as of a camera or a printer, the attitude constant, shape (n, 6)."""
    angle = np.pi * robot.plain.frequency * t + rng.uniform(0, 2 * np.pi)
    ramp = _smooth(np.minimum(t, t[-1] - t) / 2.0)[:, None]
    wave = np.zeros((len(t), 6))
    wave[:, :2] = np.column_stack([np.cos(angle), np.sin(angle)])
    return 1.5 * ramp * wave * robot.plain.reach


def course(
    robot: RoughRobot,
    kind: Kind,
    anchors: Array,
    attachments: Array,
    duration: float,
    rng: np.random.Generator,
) -> Course:
    """Integrate the platform while the winches feed open loop."""
    plain = robot.plain
    body = _whole(robot, kind)
    carrying = replace(plain, mass=float(body[0]), center_of_gravity=body[1:4])
    command = _command(robot, kind, duration, rng)
    few = len(anchors) < 6
    known = np.linspace(0.0, duration, round(duration * (10 if few else 100)) + 1)
    cables = public.Cables(anchors, attachments, plain.axial_stiffness)
    if few:
        lengths = _hanging(carrying, anchors, attachments, command(known))
    else:
        lengths = public.fed_lengths(carrying, cables, command(known))
    feed = make_interp_spline(known, lengths, k=5)
    model = _model(robot, kind, anchors, attachments)
    data = mujoco.MjData(model)
    data.qpos[:3], data.qpos[3] = command(0.0)[:3], 1.0
    outside = _outside(robot, kind, rng)

    def springs(fed: Array, rate: Array) -> None:
        k = plain.axial_stiffness / fed
        c = 2 * public.DAMPING_RATIO * np.sqrt(k * plain.mass / 4)
        model.actuator_biasprm[:, :3] = np.column_stack([k * fed + c * rate, -k, -c])

    def push(t: float) -> None:
        if outside is None:
            return
        force, torque = outside(t, data)
        # MuJoCo takes it at the centre of gravity.
        arm = data.xipos[1] - data.xpos[1]
        data.xfrc_applied[1, :3], data.xfrc_applied[1, 3:] = force, torque - np.cross(arm, force)

    springs(feed(0.0), np.zeros(len(anchors)))
    model.dof_damping[:6] = [8.0 * plain.mass] * 3 + [8.0 * np.trace(plain.inertia) / 3] * 3
    mujoco.mj_forward(model, data)
    push(-1.0)
    mujoco.mj_step(model, data, nstep=round(public.SETTLING / plain.step))
    model.dof_damping[:6] = 0.0
    data.qvel[:] = 0.0
    every, count = round(public.SEEN / plain.step), round(duration / plain.step)
    middle = (np.arange(count) + 0.5) * plain.step
    fed, rates = feed(middle), feed(middle, nu=1)
    seen = []
    for i in range(count + 1):
        if i % every == 0:
            springs(feed(i * plain.step), feed(i * plain.step, nu=1))
            mujoco.mj_forward(model, data)
            state = data.qpos[:7], data.qvel[:6], data.qacc[:6], -data.actuator_force
            seen.append(np.concatenate(state))
        if i < count:
            springs(fed[i], rates[i])
            push((i + 0.5) * plain.step)
            mujoco.mj_step(model, data)
    states = np.array(seen)
    times = np.arange(0, count + 1, every) * plain.step
    slack = float(np.mean(states[:, 19:].min(axis=1) <= 0))
    return Course(make_interp_spline(times, states, k=5), feed, body, slack, cables)
