"""The platform on elastic cables whose winches follow the command open loop.

Eq. (1) of [Tempel2017]_ solved for the acceleration. Every cable pulls with the tension that its
unstrained length fed out and the pose give (straight or as a catenary, over its roller), plus a
little damping of its stretch.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import BSpline, make_interp_spline
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from steelyard import rotations
from steelyard.arrays import Array
from steelyard.batch import Batched, Symbol
from steelyard.dynamics import newton_euler, point_velocity
from steelyard.errors import InfeasibleError, InputError
from steelyard.inertia import Inertia
from steelyard.motion.limits import winch_tensions
from steelyard.motion.state import State, motion_of_poses
from steelyard.motion.trajectory import RestToRest, Trajectory
from steelyard.robot import cable
from steelyard.robot.kinematics import cables_at, structure_columns
from steelyard.robot.model import Robot
from steelyard.simulation.response import Progress


@dataclass(frozen=True)
class ForwardDynamicsSettings:
    """How the equations of motion are solved."""

    tolerance: float = 1e-7
    """Of the integrator, relative and in metres, radians and their rates; the pose is then right to
    about 1e-8 m."""
    feed_samples_per_second: float = 100.0
    """Poses at which the winches know the lengths to feed [Hz], with a quintic spline between: far
    above the half hertz of commands."""
    moves: float = 1e-3
    """Speed at which a motion begins that does not begin at rest [m/s], [rad/s]: what is left of a
    fit to one that does is less."""
    displacement: float = 1e-6
    """Of a pose, for its stiffness by central differences [m], [rad]: far above rounding
    and far below what changes the stiffness."""
    equilibrium_step: float = 1e-12
    """Relative step at which the search for a pose at rest ends: rounding."""
    equilibrium_acceleration: float = 1e-6
    """Acceleration of a pose that counts as at rest [m/s^2], [rad/s^2]: below what any sensor
    resolves."""
    mass_share: float = 0.25
    """Part of the platform's mass that each cable damps as a spring of its own; the damping ratio
    of robot files belongs to it."""


DEFAULT = ForwardDynamicsSettings()
"""What is used where nothing is given."""


@dataclass(frozen=True, eq=False)
class ElasticMotion:
    """A platform on elastic cables: the solution of the equations of motion."""

    model: CablePlatform
    feed: BSpline
    """Unstrained lengths fed out over time [m]."""
    solution: Any
    """Position, quaternion, velocity, angular velocity over time (continuous solution of the
    integrator)."""
    duration: float

    def at(self, times: Array) -> State:
        """See :class:`.Response`.

        Raises:
            InfeasibleError: A cable goes slack.
        """
        x = self.solution(times).T
        values = self.model.forces(x=x, feed=self.feed(times), feed_rate=self.feed(times, nu=1))
        slack = ~(
            (values["tension"] > 0).all(axis=1)
            & (values["residual"] < cable.RESIDUAL_TOLERANCE).all(axis=1)
        )
        if slack.any():
            first = int(np.argmax(slack))
            which = int(np.nanargmin(values["tension"][first])) + 1
            raise InfeasibleError(
                f"at {times[first]:.2f} s: expected taut cables, found cable {which} slack; move"
                " more slowly or tilt less",
                first,
            )
        return State(
            position=x[:, :3],
            rotation=Rotation.from_quat(x[:, 3:7], scalar_first=True).as_matrix(),
            velocity=x[:, 7:10],
            omega=x[:, 10:13],
            specific_force=values["specific_force"],
            alpha=values["alpha"],
            tension=values["tension"],
            wrench=values["wrench"],
            gravity=self.model.robot.gravity,
            stretching=values["stretching"],
        )


@dataclass(frozen=True, eq=False)
class CablePlatform:
    """Equations of motion of a body on elastic cables.

    The state x is position [m], quaternion (w, x, y, z), velocity in the world frame [m/s] and
    angular velocity in the platform frame [rad/s], shape (13,).
    """

    robot: Robot
    body: Inertia
    settings: ForwardDynamicsSettings = DEFAULT

    def __post_init__(self) -> None:
        if not self.robot.cable.axial_stiffness:
            raise InputError(
                f"robot '{self.robot.name}': expected 'cable.axial_stiffness' for a simulation,"
                " found none; add EA in newtons"
            )
        if not self.body.is_physical:
            raise InputError(
                f"robot '{self.robot.name}': expected a platform that can exist, found one whose"
                " inertia no body has (triangle inequality missed by"
                f" {-self.body.triangle_margin:.3g} kg m^2); correct 'platform.inertia'"
            )

    @cached_property
    def _symbolic(self) -> tuple[dict[str, Symbol], dict[str, Symbol]]:
        """Inputs and outputs: the accelerations of a state, with the tensions that cause them."""
        m = self.robot.m
        x, feed, feed_rate = ca.SX.sym("x", 13), ca.SX.sym("feed", m), ca.SX.sym("feed_rate", m)
        q = x[3:7] / ca.norm_2(x[3:7])
        R = rotations.from_quaternion(q)
        velocity, omega = x[7:10], x[10:13]
        tensions, stretching, residuals, wrench = [], [], [], ca.SX.zeros(6)
        for i, b in enumerate(self.robot.attachments):
            b = ca.DM(b)
            shape = cable.by_length(cable.spec(self.robot, i), x[:3] + R @ b, feed[i])
            moving = point_velocity(R, velocity, omega, b)
            stretch_rate = -ca.dot(shape.direction, moving) - feed_rate[i]
            tension = shape.tension + self._damping(feed[i]) * stretch_rate
            tensions.append(tension)
            stretching.append(shape.tension)
            residuals.append(shape.residual)
            wrench += structure_columns(R, b, shape.direction) * ca.fmax(tension, 0)
        # Eq. (1) is linear in the accelerations: its matrix is the derivative of the one statement
        # of the equations.
        accelerations = ca.SX.sym("accelerations", 6)
        inertial = newton_euler(
            ca.DM(self.body.parameters), accelerations[:3], omega, accelerations[3:]
        )
        matrix = ca.jacobian(inertial, accelerations)
        rest = ca.substitute(inertial, accelerations, ca.DM.zeros(6))
        solved = ca.solve(matrix, wrench - rest)
        specific_force, alpha = solved[:3], solved[3:]
        outputs = {
            "rate": ca.vertcat(
                velocity,
                rotations.quaternion_rate(q, omega),
                R @ specific_force + ca.DM(self.robot.gravity),
                alpha,
            ),
            "specific_force": specific_force,
            "alpha": alpha,
            "tension": ca.vertcat(*tensions),
            "stretching": ca.vertcat(*stretching),
            "wrench": wrench,
            "residual": ca.vertcat(*residuals),
        }
        return {"x": x, "feed": feed, "feed_rate": feed_rate}, outputs

    def _damping(self, length: Symbol) -> Symbol:
        """Of a cable as a spring with a part of the platform's mass [N s/m]."""
        stiffness = self.robot.cable.axial_stiffness / length
        mass = self.body.mass * self.settings.mass_share
        return 2 * self.robot.cable.damping_ratio * ca.sqrt(stiffness * mass)

    @cached_property
    def forces(self) -> Batched:
        """Accelerations, tensions and their wrench over samples of x, feed and feed_rate."""
        inputs, outputs = self._symbolic
        return Batched("forces", inputs, {k: v for k, v in outputs.items() if k != "rate"})

    @cached_property
    def _rate(self) -> Callable[[Array, Array, Array], Array]:
        """Derivative of one state, through CasADi's buffers: called tens of thousands of times."""
        inputs, outputs = self._symbolic
        function = ca.Function("rate", list(inputs.values()), [ca.densify(outputs["rate"])])
        buffer: Any
        buffer, evaluate = function.buffer()
        memory = [np.empty(13), np.empty(self.robot.m), np.empty(self.robot.m)]
        result = np.empty(13)
        for i, array in enumerate(memory):
            buffer.set_arg(i, array.data)
        buffer.set_res(0, result.data)

        # Neither the trigger owns the buffer nor the buffer the function: the closure has to.
        def rate(*values: Array, _owned: Any = (function, buffer)) -> Array:
            for array, value in zip(memory, values, strict=True):
                array[:] = value
            evaluate()
            return result.copy()

        return rate

    def equilibrium(self, pose: Array, feed: Array) -> Array:
        """State at rest near a pose for given lengths, shape (13,).

        Args:
            pose: x, y, z [m], roll, pitch, yaw [rad], shape (6,).
            feed: Unstrained lengths [m], shape (m,).

        Raises:
            InfeasibleError: There is none near.
        """
        start, still = Rotation.from_euler("ZYX", pose[:2:-1]), np.zeros(self.robot.m)

        def acceleration(offset: Array) -> Array:
            return self._rate(_at_rest(pose[:3], start, offset), feed, still)[7:]

        found = root(acceleration, np.zeros(6), tol=self.settings.equilibrium_step)
        if not np.abs(found.fun).max() < self.settings.equilibrium_acceleration:
            raise InfeasibleError(
                "expected a pose at rest near the start of the trajectory, found none; start"
                " elsewhere"
            )
        return _at_rest(pose[:3], start, found.x)

    def _start(self, trajectory: Trajectory, feed: Array) -> Array:
        """State in which a motion begins, shape (13,).

        Args:
            trajectory: The command.
            feed: Unstrained lengths at its beginning [m], shape (m,).

        Raises:
            InfeasibleError: There is no pose at rest near.
        """
        pose, rate, acceleration = (trajectory.derivative(np.zeros(1), order) for order in range(3))
        if self.robot.holds_any_pose or np.abs(rate).max() < self.settings.moves:
            return self.equilibrium(pose[0], feed)
        motion = motion_of_poses(pose, rate, acceleration, self.robot.gravity)
        start = Rotation.from_matrix(motion["rotation"][0]).as_quat(scalar_first=True)
        return np.concatenate([pose[0, :3], start, motion["velocity"][0], motion["omega"][0]])

    def natural_frequencies(self, pose: Array, level: float | None = None) -> Array:
        """Of small swings about a pose at rest, ascending [Hz], shape (6,); a direction that does
        not swing back has 0.

        Args:
            pose: x, y, z [m], roll, pitch, yaw [rad], shape (6,).
            level: See :func:`feed_lengths`.

        Raises:
            InfeasibleError: The platform cannot rest there.
        """
        feed = feed_lengths(self.robot, RestToRest(pose, pose, 1.0), np.zeros(1), level)[0]
        rest, still = self.equilibrium(pose, feed), np.zeros(self.robot.m)
        turned = Rotation.from_quat(rest[3:7], scalar_first=True)

        def acceleration(offset: Array) -> Array:
            return self._rate(_at_rest(rest[:3], turned, offset), feed, still)[7:]

        moved = self.settings.displacement
        columns = [acceleration(step) - acceleration(-step) for step in moved * np.eye(6)]
        squares = np.linalg.eigvals(-np.column_stack(columns) / (2 * moved)).real
        return np.sort(np.sqrt(np.maximum(squares, 0.0))) / (2 * np.pi)

    def move(
        self,
        trajectory: Trajectory,
        progress: Progress | None = None,
        *,
        tolerance: float | None = None,
        level: float | None = None,
    ) -> ElasticMotion:
        """Integrate while the winches feed what the commanded poses need: from rest, or from what
        the command begins with where fewer than six cables let the platform swing.

        Args:
            trajectory: The command.
            progress: Is given the fraction done.
            tolerance: Of the integrator; None: that of the settings.
            level: See :func:`feed_lengths`.

        Raises:
            InfeasibleError: A pose has no tensions within the limits, or a cable goes slack.
        """
        chosen, duration = self.settings, trajectory.duration
        tolerance = chosen.tolerance if tolerance is None else tolerance
        count = int(np.ceil(duration * chosen.feed_samples_per_second)) + 1
        times = np.linspace(0.0, duration, count)
        feed = make_interp_spline(times, feed_lengths(self.robot, trajectory, times, level), k=5)
        feed_rate = feed.derivative()
        start = self._start(trajectory, feed(0.0))
        rate = self._rate

        def derivative(t: float, x: Array) -> Array:
            if progress:
                progress(t / duration)
            return rate(x, feed(t), feed_rate(t))

        result = solve_ivp(
            derivative,
            (0.0, duration),
            start,
            method="DOP853",
            rtol=tolerance,
            atol=tolerance,
            dense_output=True,
        )
        if not result.success:
            raise InfeasibleError(
                f"at {result.t[-1]:.2f} s: expected taut cables, found equations that cannot be"
                f" integrated ({result.message}); move more slowly or tilt less"
            )
        return ElasticMotion(self, feed, result.sol, duration)


def _at_rest(position: Array, rotation: Rotation, offset: Array) -> Array:
    """State at rest, displaced from a pose by an offset [m], [rad] of shape (6,); shape (13,)."""
    turned = (rotation * Rotation.from_rotvec(offset[3:])).as_quat(scalar_first=True)
    return np.concatenate([position + offset[:3], turned, np.zeros(6)])


def feed_lengths(
    robot: Robot, trajectory: Trajectory, times: Array, level: float | None = None
) -> Array:
    """Unstrained lengths that hold the nominal platform at rest in the commanded poses [m], shape
    (n, m).

    What a winch controller knows: elasticity and sag under the platform's weight, but no dynamics.
    Fewer than six cables cannot hold it in any pose: then they are those that come nearest to
    moving it as commanded, dynamics included, so that a motion that such a robot has made comes out
    again.

    Args:
        robot: With a nominal platform.
        trajectory: The command.
        times: [s], shape (n,).
        level: Tension that it stays near to [N]; None: the smallest tensions that do.
    """
    still = robot.holds_any_pose
    tension = winch_tensions(robot, trajectory, times, still=still, level=level)
    pose = trajectory.derivative(times, 0)
    rotation = Rotation.from_euler("ZYX", pose[:, :2:-1]).as_matrix()
    try:
        return cables_at(robot, pose[:, :3], rotation, tension).length
    except InfeasibleError as error:
        raise InfeasibleError(
            f"at {times[error.sample]:.2f} s of the trajectory: {error}", error.sample
        ) from None
