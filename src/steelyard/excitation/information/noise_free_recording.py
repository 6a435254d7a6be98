"""The recording that a motion would give without noise and errors, if it is followed exactly, and
what maximum likelihood makes of it.

What an estimator says of its uncertainty from this recording is the prediction: the very code that
will read the recording has read it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.excitation.settings import DEFAULT, DesignSettings
from steelyard.experiment.model import Experiment, Load
from steelyard.experiment.recording import Run, Stream
from steelyard.identification.model.settings import MOTION
from steelyard.identification.solve.beginning.begin import NoBalanceError
from steelyard.identification.solve.joint_motion import fit_jointly
from steelyard.identification.solve.posterior import Posterior, Progress
from steelyard.identification.solve.settings import FIT
from steelyard.instruments import Instrument
from steelyard.instruments.equations import means, predict
from steelyard.motion.state import State
from steelyard.motion.trajectory import Trajectory
from steelyard.robot.kinematics import cables_at
from steelyard.robot.model import Robot
from steelyard.simulation.response import ExactMotion

_LEAST_TENSION = 1.0
"""At which the sag of a cable is evaluated [N]: a slack one would have none that is finite."""
_AS_DESCRIBED = replace(
    FIT,
    suspicions=0,
    most_processes=0,
    jittering=float("inf"),
    motion=replace(MOTION, looser_jointly=MOTION.looser),
)
"""A recording without noise shows nothing that is not described, but rounding that looks so; nor is
anything left over with which a firmer motion could go, and its matrices are better conditioned."""


def tensions_near_level(
    robot: Robot, state: State, level: float, settings: DesignSettings = DEFAULT
) -> Array:
    """Tensions that exert the wrench of a state, whatever the robot's limits [N], shape (n, m).

    Those of straight cables nearest to a level, then with the smallest changes that the sag asks
    for: nearest anew, a slack cable would go on sagging.
    """
    tension = np.full((len(state.wrench), robot.m), level)
    sagging = [robot] * settings.sag_iterations if robot.cable.linear_density else []
    for cables in [robot.with_straight_cables(), *sagging]:
        taut = np.maximum(tension, _LEAST_TENSION)
        W = cables_at(cables, state.position, state.rotation, taut).structure
        missing = state.wrench - np.einsum("nkm,nm->nk", W, tension)
        tension = tension + np.einsum("nmk,nk->nm", np.linalg.pinv(W), missing)
    return tension


def with_noise_free_runs(
    experiment: Experiment,
    trajectories: Mapping[str, Trajectory],
    level: float,
    settings: DesignSettings = DEFAULT,
) -> Experiment:
    """The experiment with a noise-free recording of every motion.

    Args:
        experiment: Robot, with its nominal platform, and instruments.
        trajectories: Run -> motion.
        level: Tension near which the cables are held [N].
        settings: Of the design.

    Raises:
        InputError: An instrument states no rate or no noise.
    """
    instruments = {
        name: _with_rate(name, each, experiment, settings)
        for name, each in experiment.instruments.items()
    }
    planned, body = replace(experiment, instruments=instruments), experiment.robot.platform
    assert body is not None
    runs = []
    for run, trajectory in trajectories.items():
        streams = {
            name: _noise_free_stream(
                planned,
                name,
                ExactMotion(planned.robot, body, trajectory),
                _instants(name, each, trajectory.duration),
                level,
                settings,
            )
            for name, each in instruments.items()
        }
        runs.append(Run(run, streams, dict.fromkeys(streams, 0.0)))
    return replace(planned, runs=tuple(runs))


def noise_free_poses(
    experiment: Experiment,
    name: str,
    poses: Array,
    level: float,
    *,
    load: Load | None = None,
    settings: DesignSettings = DEFAULT,
) -> Run:
    """A noise-free recording of poses at rest, one row each.

    Args:
        experiment: Robot, with its nominal platform, and instruments.
        name: Of the run.
        poses: x, y, z [m], roll, pitch, yaw [rad], shape (n, 6).
        level: Tension near which the cables are held [N].
        load: What the platform carries, with its nominal body; None: the nominal platform.
        settings: Of the design.

    Raises:
        InputError: An instrument states no noise.
    """
    robot = experiment.robot
    body = robot.platform if load is None else load.nominal
    assert body is not None
    motion = ExactMotion(robot, body, _AtRest(poses))
    times = np.arange(len(poses), dtype=np.float64)
    streams = {}
    for each, instrument in experiment.instruments.items():
        if instrument.is_measurement and not instrument.tabular:
            _check_noise(each, instrument, experiment)
            streams[each] = _noise_free_stream(experiment, each, motion, times, level, settings)
    return Run(name, streams, static=True, load=None if load is None else load.name)


@dataclass(frozen=True, eq=False)
class _AtRest:
    """Poses one after the other, each at rest; the time is the number of the pose."""

    poses: Array
    """Shape (n, 6)."""

    @property
    def duration(self) -> float:
        """Number of the last pose."""
        return float(len(self.poses) - 1)

    def derivative(self, t: Array, order: int) -> Array:
        """See :class:`.Trajectory`."""
        at = self.poses[np.asarray(t).astype(np.intp)]
        return np.zeros_like(at) if order else at


def fit_noise_free(
    experiment: Experiment,
    trajectories: Mapping[str, Trajectory],
    level: float,
    progress: Progress = None,
    *,
    settings: DesignSettings = DEFAULT,
) -> Posterior:
    """The joint fit of maximum likelihood to noise-free recordings of motions.

    Raises:
        InputError: The instruments cannot identify anything, or lack a rate or a noise.
    """
    return fit_recorded(with_noise_free_runs(experiment, trajectories, level, settings), progress)


def fit_recorded(recorded: Experiment, progress: Progress = None) -> Posterior:
    """The joint fit of maximum likelihood to recordings that have no noise.

    Raises:
        InputError: They identify nothing.
    """
    try:
        return fit_jointly(recorded, progress, settings=_AS_DESCRIBED)
    except NoBalanceError as error:
        raise InputError(
            f"{recorded.source or recorded.name}: expected instruments and a motion that"
            f" identify something of the body, found that {error}"
        ) from None


def _instants(name: str, instrument: Instrument, duration: float) -> Array:
    """When an instrument reads a motion [s], shape (n,).

    Raises:
        InputError: It reads less than twice.
    """
    assert instrument.rate is not None
    times = np.arange(0.5 / instrument.rate, duration, 1 / instrument.rate)
    if len(times) < 2:
        raise InputError(
            f"instrument '{name}': expected at least two samples in {duration:g}"
            f" s, found a rate of {instrument.rate:g} Hz; choose a longer motion"
        )
    return times


def _noise_free_stream(
    experiment: Experiment,
    name: str,
    motion: ExactMotion,
    times: Array,
    level: float,
    settings: DesignSettings,
) -> Stream:
    """Readings of one instrument without noise and errors."""
    robot, instrument = experiment.robot, experiment.instruments[name]
    state = motion.at(times)
    if instrument.per_cable:
        state = replace(state, tension=tensions_near_level(robot, state, level, settings))
    readings = predict(instrument, robot, state, means(instrument, robot.m))
    recorded = _recorded_quantities(name, instrument, experiment)
    return Stream(times, {key: value for key, value in readings.items() if key in recorded}, name)


def _with_rate(
    name: str, instrument: Instrument, experiment: Experiment, settings: DesignSettings
) -> Instrument:
    """An instrument whose rate and noise are known; the rate may be that of earlier recordings.

    Raises:
        InputError: It states no rate or no noise.
    """
    rate = instrument.rate
    if rate is None:
        rate = _recorded_rate(name, experiment)
    if rate is None and instrument.commanded:
        rate = settings.command_rate
    if rate is None:
        raise InputError(
            f"instrument '{name}': expected the key 'rate', found none, and no recording to"
            " take it from; add the samples per second"
        )
    _check_noise(name, instrument, experiment)
    return instrument.model_copy(update={"rate": rate})


def check_noise(experiment: Experiment) -> None:
    """Refuse an experiment of which an instrument states no noise.

    Raises:
        InputError: One does not.
    """
    for name, instrument in experiment.instruments.items():
        _check_noise(name, instrument, experiment)


def _check_noise(name: str, instrument: Instrument, experiment: Experiment) -> None:
    """Refuse an instrument that states no noise.

    Raises:
        InputError: It does not.
    """
    recorded = _recorded_quantities(name, instrument, experiment)
    for quantity in instrument.quantities(experiment.robot.m):
        if quantity.name in recorded and not quantity.noise and instrument.is_measurement:
            raise InputError(
                f"instrument '{name}': expected the noise of its {quantity.name.replace('_', ' ')},"
                f" found none; add 'noise', the 1-sigma of a sample in {quantity.unit}: what can be"
                " known depends on it"
            )


def _recorded_rate(name: str, experiment: Experiment) -> float | None:
    """Samples a second of earlier recordings [Hz]; None: there are none."""
    steps = []
    for run in experiment.runs:
        if name in run.streams and not run.static and len(run.streams[name]) > 1:
            steps.append(float(np.median(np.diff(run.streams[name].time))))
    steps = [step for step in steps if step > 0]
    return float(1 / np.median(steps)) if steps else None


def _recorded_quantities(
    name: str, instrument: Instrument, experiment: Experiment
) -> frozenset[str]:
    """Quantities that will be recorded: as in earlier runs; without these, all but those that may
    be absent and state no noise.
    """
    earlier = [run.streams[name].values for run in experiment.runs if name in run.streams]
    if earlier:
        return frozenset(quantity for values in earlier for quantity in values)
    return frozenset(
        q.name for q in instrument.quantities(experiment.robot.m) if q.required or q.noise
    )
