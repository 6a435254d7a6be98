"""An experiment made in thought: readings without errors of a motion that is followed exactly, and
what an estimator makes of them.

What it says of its own uncertainty is the prediction: the very code that will look at the recording
has looked at it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.experiment.model import Experiment, Run, Stream
from steelyard.instruments import Instrument
from steelyard.instruments.equations import means, predict
from steelyard.motion.state import State
from steelyard.motion.trajectory import Trajectory
from steelyard.robot.kinematics import cables_at
from steelyard.robot.model import Robot
from steelyard.simulation.forward_dynamics import ExactMotion

_TURNS = 3
"""Of tensions and sag, which follow each other."""


def held_tensions(robot: Robot, state: State, level: float) -> Array:
    """Tensions that exert the wrench of a state, whatever the robot's limits [N], shape (n, m).

    Those of straight cables nearest to a level, then with the smallest changes that the sag asks
    for: nearest anew, a slack cable would go on sagging.
    """
    tension = np.full((len(state.wrench), robot.m), level)
    for which in [robot.with_straight_cables()] + [robot] * (
        _TURNS if robot.cable.linear_density else 0
    ):
        W = cables_at(which, state.position, state.rotation, np.maximum(tension, 1.0)).structure
        missing = state.wrench - np.einsum("nkm,nm->nk", W, tension)
        tension = tension + np.einsum("nmk,nk->nm", np.linalg.pinv(W), missing)
    return tension


def rehearsed(
    experiment: Experiment, trajectories: Mapping[str, Trajectory], level: float
) -> Experiment:
    """The experiment with runs that have been recorded in thought.

    Args:
        experiment: Robot, with its nominal platform, and instruments.
        trajectories: Run -> motion.
        level: Tension that the cables are held near to [N].

    Raises:
        InputError: An instrument states no rate or no noise.
    """
    robot = experiment.robot
    assert robot.platform is not None
    instruments = {
        name: _stated(name, each, experiment) for name, each in experiment.instruments.items()
    }
    runs = []
    for run, trajectory in trajectories.items():
        response = ExactMotion(robot, robot.platform, trajectory)
        streams = {}
        for name, instrument in instruments.items():
            assert instrument.rate is not None
            times = np.arange(0.5 / instrument.rate, trajectory.duration, 1 / instrument.rate)
            if len(times) < 2:
                raise InputError(
                    f"instrument '{name}': expected at least two samples in {trajectory.duration:g}"
                    f" s, found a rate of {instrument.rate:g} Hz; choose a longer motion"
                )
            state = response.at(times)
            if instrument.per_cable:
                state = replace(state, tension=held_tensions(robot, state, level))
            readings = predict(instrument, robot, state, means(instrument, robot.m))
            there = _read(name, instrument, experiment)
            streams[name] = Stream(
                times, {key: value for key, value in readings.items() if key in there}, name
            )
        runs.append(Run(run, streams, dict.fromkeys(streams, 0.0)))
    return replace(experiment, instruments=instruments, runs=tuple(runs))


_COMMANDED = 100.0
"""Rate of a command that states none [Hz]."""


def _stated(name: str, instrument: Instrument, experiment: Experiment) -> Instrument:
    """An instrument whose rate and noise are known; the rate may be that of earlier recordings."""
    rate = instrument.rate
    if rate is None:
        steps = [
            float(np.median(np.diff(run.streams[name].time)))
            for run in experiment.runs
            if name in run.streams and not run.static and len(run.streams[name]) > 1
        ]
        steps = [step for step in steps if step > 0]
        if steps:
            rate = float(1 / np.median(steps))
        elif instrument.commanded:
            rate = _COMMANDED
        else:
            raise InputError(
                f"instrument '{name}': expected the key 'rate', found none, and no recording to"
                " take it from; add the samples per second"
            )
    for quantity in instrument.quantities(experiment.robot.m):
        silent = not instrument.is_measurement
        if (
            quantity.name in _read(name, instrument, experiment)
            and not quantity.noise
            and not silent
        ):
            raise InputError(
                f"instrument '{name}': expected the noise of its {quantity.name.replace('_', ' ')},"
                f" found none; add 'noise', the 1-sigma of a sample in {quantity.unit}: what can be"
                " known depends on it"
            )
    return instrument.model_copy(update={"rate": rate})


def _read(name: str, instrument: Instrument, experiment: Experiment) -> frozenset[str]:
    """Quantities that will be recorded: as in earlier runs; without these, all but those that may
    be absent and state no noise.
    """
    earlier = [run.streams[name].values for run in experiment.runs if name in run.streams]
    if earlier:
        return frozenset(quantity for values in earlier for quantity in values)
    return frozenset(
        q.name for q in instrument.quantities(experiment.robot.m) if q.required or q.noise
    )
