"""Simulated experiments of known truth: one motion recorded as often as one likes, and studies of
them that several tests share."""

from dataclasses import dataclass, field, replace
from functools import cache, cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.dynamics import platform_regressor, platform_wrench
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run, Stream
from steelyard.identification.solve.held_motion import fit_with_held_motion
from steelyard.inertia import Inertia
from steelyard.instruments.equations import means, predict
from steelyard.motion.state import State, motion_of_poses
from steelyard.motion.trajectory import multisine
from steelyard.robot.file import read_robot
from steelyard.robot.kinematics import cables_at
from steelyard.simulation.forward_dynamics import CablePlatform
from steelyard.simulation.recording import draw_errors, record
from steelyard.simulation.response import ExactMotion
from steelyard.simulation.sensors import ideal_sensors, paper_sensors
from steelyard.simulation.trajectories import feasible_multisine

DURATION = 12.0  # [s]
EXACT = {"anchor": 0.0, "attachment": 0.0, "gravity": 0.0}
ROBOT = read_robot("cogiro").with_straight_cables()
BODY = ROBOT.platform
TRUTH = BODY.body_parameters
_PAPER = paper_sensors(ROBOT).instruments
# A third of the tracker's samples: as much is known of the acceleration by the IMU, and quicker.
PAPER = {**_PAPER, "tracker": _PAPER["tracker"].model_copy(update={"rate": 80.0})}
IDEAL = ideal_sensors(ROBOT).instruments
CENTER, REACH = np.array([0, 0, 2, 0, 0, 0.0]), np.array([0.5, 0.5, 0.4, 0.35, 0.3, 0.5])
PRETENSION = 600.0  # [N]


def changed(instrument, **keys):
    """The same instrument with other keys; those of ``calibration`` replace single ones."""
    old = instrument.model_dump(exclude_unset=True)
    calibration = {**old.get("calibration", {}), **keys.pop("calibration", {})}
    return type(instrument).model_validate({**old, **keys, "calibration": calibration})


def with_tension(state, wrench):
    """The same state with the tensions nearest to the pretension that exert a wrench."""
    even = np.full((len(wrench), ROBOT.m), PRETENSION)
    W = cables_at(ROBOT, state.position, state.rotation, even).structure
    missing = wrench - W @ even[0]
    return replace(state, tension=even + np.einsum("nmk,nk->nm", np.linalg.pinv(W), missing))


@dataclass(frozen=True)
class Following:
    """A platform that follows its command exactly, on cables of no weight that pull as they
    must."""

    trajectory: object
    body: Inertia = BODY

    @property
    def duration(self):
        return self.trajectory.duration

    def at(self, times):
        state = ExactMotion(ROBOT, self.body, self.trajectory).at(times)
        return with_tension(state, state.wrench)


@dataclass(frozen=True)
class Touched:
    """The same motion with a hand on the platform, which the cables feel: a push with 40 N for two
    seconds, .5 m beside the origin."""

    response: object

    @property
    def duration(self):
        return self.response.duration

    def at(self, times):
        state = self.response.at(times)
        push = np.where((times > 5) & (times < 7), 40.0, 0.0)
        wrench = np.zeros((len(times), 6))
        wrench[:, 1], wrench[:, 5] = push, 0.5 * push
        W = cables_at(ROBOT, state.position, state.rotation, state.tension).structure
        return replace(
            state, tension=state.tension - np.einsum("nmk,nk->nm", np.linalg.pinv(W), wrench)
        )


PAYLOAD = np.array([0.3, -0.2, -0.1])
"""Where the payload is [m]."""


def payload(mass):
    """The ten linear parameters of a mass at a point."""
    cross = np.array(
        [[0, -PAYLOAD[2], PAYLOAD[1]], [PAYLOAD[2], 0, -PAYLOAD[0]], [-PAYLOAD[1], PAYLOAD[0], 0]]
    )
    moments = -mass * cross @ cross
    six = moments[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]]
    return np.concatenate([[mass], mass * PAYLOAD, six])


@dataclass(frozen=True)
class Loaded:
    """The same motion with a payload since an instant, put down within some time."""

    response: object
    parameters: np.ndarray
    since: float
    within: float = 0.0

    @property
    def duration(self):
        return self.response.duration

    def at(self, times):
        state = self.response.at(times)
        Y = platform_regressor(state.specific_force, state.omega, state.alpha)
        share = np.clip((times - self.since) / max(self.within, 1e-9), 0.0, 1.0)
        wrench = (Y @ self.parameters) * share[:, None]
        loaded = with_tension(state, wrench)
        empty = with_tension(state, 0 * wrench)
        return replace(state, tension=state.tension + loaded.tension - empty.tension)


@dataclass(frozen=True)
class Swinging:
    """The same motion with a mass that hangs on a string below a point of the platform, and swings a
    little; it hangs at rest when the motion begins."""

    response: object
    mass: float
    at_point: np.ndarray
    """Where the string is tied [m]."""
    frequency: float
    """Of its swings below a platform at rest [Hz]."""

    @property
    def duration(self):
        return self.response.duration

    def at(self, times):
        state = self.response.at(times)
        point, spin = self.at_point, state.omega
        turned = np.cross(state.alpha, point) + np.cross(spin, np.cross(spin, point))
        fine = np.arange(0.0, times[-1] + 1e-3, 1e-3)
        rotation = state.rotation
        felt = np.einsum("nij,nj->ni", rotation, state.specific_force + turned)
        level = np.stack([np.interp(fine, times, felt[:, i]) for i in (0, 1)], axis=1)
        # A pendulum whose support moves, by small steps of velocity and place in turn.
        square, rate, place = (2 * np.pi * self.frequency) ** 2, np.zeros(2), np.zeros(2)
        along = np.zeros_like(level)
        for i, support in enumerate(level):
            along[i] = place
            rate = rate - 1e-3 * (square * place + support)
            place = place + 1e-3 * rate
        force = felt.copy()
        for i in (0, 1):
            force[:, i] = -square * np.interp(times, fine, along[:, i])
        force = self.mass * np.einsum("nji,nj->ni", rotation, force)
        wrench = np.hstack([force, np.cross(point, force)])
        more, none = with_tension(state, wrench), with_tension(state, 0 * wrench)
        return replace(state, tension=state.tension + more.tension - none.tension)


@dataclass(frozen=True)
class Leaking:
    """The same motion with a mass at the centre of gravity that comes and goes."""

    response: object
    times: np.ndarray
    masses: np.ndarray
    """What the body weighs more at these times [kg]."""

    @property
    def duration(self):
        return self.response.duration

    def at(self, times):
        state = self.response.at(times)
        c = BODY.center_of_gravity
        # Newton's law of a point that moves with the platform.
        turned = np.cross(state.alpha, c) + np.cross(state.omega, np.cross(state.omega, c))
        mass = np.interp(times, self.times, self.masses)
        force = mass[:, None] * (state.specific_force + turned)
        wrench = np.hstack([force, np.cross(c, force)])
        more, none = with_tension(state, wrench), with_tension(state, 0 * wrench)
        return replace(state, tension=state.tension + more.tension - none.tension)


def walking(seed, walk, duration):
    """Times [s] and a mass that walks at random along them [kg]."""
    rng = np.random.default_rng(seed)
    step = 0.01
    times = np.arange(0.0, duration + 1.0, step)
    steps = walk * np.sqrt(step) * rng.standard_normal(len(times) - 1)
    return times, np.concatenate([[0.0], np.cumsum(steps)])


@dataclass
class Recorder:
    """One motion; by default that of CoGiRo's own platform on elastic cables without weight."""

    trajectory: object = None
    body: Inertia = BODY
    following: bool = False
    drawn: dict = field(default_factory=dict)
    """The errors of the last recording: run -> instrument -> errors."""

    @cached_property
    def command(self):
        return ExactMotion(ROBOT, BODY, self.trajectory or feasible_multisine(ROBOT, DURATION))

    @cached_property
    def response(self):
        if self.following:
            return Following(self.command.trajectory, self.body)
        return CablePlatform(ROBOT, self.body).move(self.command.trajectory)

    def __call__(
        self, seed, *, instruments=None, stated=None, runs=("run",), touched=False, **keys
    ):
        """An experiment with errors drawn from ``instruments``; ``stated`` is what the file says of
        them, if not what they are."""
        instruments = instruments or PAPER
        rng = np.random.default_rng(seed)
        self.drawn = draw_errors(instruments, ROBOT.m, list(runs), rng)
        response = Touched(self.response) if touched else self.response
        recorded = []
        for name in runs:
            streams, sync = record(
                response, instruments, self.drawn[name], ROBOT, self.command, rng
            )
            recorded.append(Run(name, streams, sync))
        keys = {"uncertainty": EXACT, **keys}
        return Experiment("draw", ROBOT, stated or instruments, tuple(recorded), **keys)


RECORDER = Recorder()


@dataclass(frozen=True)
class AfterRest:
    """A trajectory before which the platform stands still."""

    trajectory: object
    rest: float  # [s]

    @property
    def duration(self):
        return self.rest + self.trajectory.duration

    def derivative(self, t, order):
        found = self.trajectory.derivative(np.maximum(t - self.rest, 0.0), order)
        return np.where((t < self.rest)[:, None] & (order > 0), 0.0, found)


def rested(rest, duration=DURATION):
    """A recorder of a platform that stands still for some seconds first."""
    return Recorder(AfterRest(feasible_multisine(ROBOT, duration), rest))


@dataclass(frozen=True)
class Vibrating:
    """A trajectory with a vibration along z and about x from an instant on, growing within a second."""

    trajectory: object
    since: float  # [s]
    frequency: float = 3.0  # [Hz]
    size: tuple = (0, 0, 0.002, 0.004, 0, 0)  # [m], [rad]

    @property
    def duration(self):
        return self.trajectory.duration

    def derivative(self, t, order):
        w, u = 2 * np.pi * self.frequency, np.clip(t - self.since, 0.0, 1.0)
        grown = [u**3 * (10 - 15 * u + 6 * u**2), 30 * u**2 * (1 - u) ** 2, 60 * u - 180 * u**2 + 120 * u**3]  # fmt: skip
        sine = [np.sin(w * t), w * np.cos(w * t), -(w**2) * np.sin(w * t)]
        terms = [[(1, 0, 0)], [(1, 0, 1), (1, 1, 0)], [(1, 0, 2), (2, 1, 1), (1, 2, 0)]][order]
        vibration = sum(n * grown[i] * sine[k] for n, i, k in terms)
        return self.trajectory.derivative(t, order) + vibration[:, None] * np.array(self.size)


def vibrating(since, duration=DURATION):
    """A recorder of a platform that begins to vibrate."""
    return Recorder(Vibrating(feasible_multisine(ROBOT, duration), since), following=True)


def loaded(seed, **keys):
    """A recording with a payload."""
    mass = keys.pop("mass", 3.2)
    recorder = replace(RECORDER)
    recorder.__dict__["response"] = Loaded(RECORDER.response, payload(mass), **keys)
    return recorder(seed)


def leaking(seed, times, masses):
    """A recording of a body that weighs more or less with time."""
    recorder = replace(RECORDER)
    recorder.__dict__["response"] = Leaking(RECORDER.response, times, masses)
    return recorder(seed)


@cache
def sound(seed):
    """A recording with the sensors of the paper."""
    return RECORDER(seed)


@cache
def studied(seed):
    """Its study."""
    return fit_with_held_motion(sound(seed))


@cache
def pair():
    """A recording of two runs, a and b."""
    return RECORDER(7, runs=("a", "b"))


@cache
def pair_studied():
    """Its study."""
    return fit_with_held_motion(pair())


def moving(axes, duration=DURATION, scale=1.0, harmonics=6):
    """A recorder of a motion along some of x, y, z, roll, pitch, yaw."""
    trajectory = multisine(list(CENTER), list(REACH * np.array(axes) * scale), duration, harmonics)
    return Recorder(trajectory, following=True)


def at_rest(poses, drawn=None, *, instruments=PAPER, seed=0, name="poses", body=BODY):
    """A static run at poses x, y, z [m], roll, pitch, yaw [rad]; with the errors drawn for a run in
    motion, or with none."""
    poses = np.asarray(poses, dtype=float)
    rng = np.random.default_rng(seed)
    state = _still(poses, body)
    streams = {}
    for key, instrument in instruments.items():
        errors = means(instrument, ROBOT.m) if drawn is None else drawn[key].calibration
        values = dict(predict(instrument, ROBOT, state, errors))
        for quantity in instrument.quantities(ROBOT.m):
            true, sigma = values[quantity.name], quantity.noise or 0.0
            noise = rng.normal(0.0, sigma, (len(poses), quantity.size))
            rotated = quantity.rotation
            values[quantity.name] = (
                true @ Rotation.from_rotvec(noise).as_matrix() if rotated else true + noise
            )
        streams[key] = Stream(np.arange(len(poses), dtype=float), values, key)
    return Run(name, streams, static=True)


def _still(poses, body):
    motion = motion_of_poses(poses, np.zeros_like(poses), np.zeros_like(poses), ROBOT.gravity)
    wrench = platform_wrench(
        body.parameters, motion["specific_force"], motion["omega"], motion["alpha"]
    )
    return with_tension(State(**motion, tension=None, wrench=wrench, gravity=ROBOT.gravity), wrench)


def with_stream(experiment, name, change):
    """The experiment with other readings of one instrument."""
    runs = []
    for run in experiment.runs:
        stream = run.streams[name]
        runs.append(
            replace(
                run,
                streams={
                    **run.streams,
                    name: replace(stream, values={**stream.values, **change(stream.values)}),
                },
            )
        )
    return replace(experiment, runs=tuple(runs))


def without(experiment, instrument, quantity=None):
    """The experiment without an instrument, or without one quantity of it."""

    def less(streams):
        if quantity is None:
            return {name: stream for name, stream in streams.items() if name != instrument}
        stream = streams[instrument]
        values = {name: value for name, value in stream.values.items() if name != quantity}
        return {**streams, instrument: replace(stream, values=values)}

    return replace(
        experiment, runs=tuple(replace(r, streams=less(r.streams)) for r in experiment.runs)
    )
