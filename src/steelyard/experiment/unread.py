"""Runs without force sensors: the cables carry the platform though nobody reads how hard they pull.

A stream of guessed tensions, none of them read, stands where the forces would be. What the cables
cannot carry has to be in balance without them: six equations less one for every cable. Where it is
stated how constant their lengths are, a stream of lengths that do not change stands beside it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run, Stream
from steelyard.instruments import Instrument
from steelyard.instruments.unread_cables import CHANGE, ConstantLengths, UnreadCables
from steelyard.robot.model import Robot

UNREAD = "unread cables"
"""Name of the instrument that stands in for force sensors."""
LOCKED = "locked winches"
"""Name of the instrument that says that lengths are constant."""
_CONSTANT = 20.0
"""Instants in a second at which it does [Hz]: two for each swing of the fastest that there is, and
so many errors that are independent of each other."""
_RATE = 100.0
"""Largest number of instants in a second: platforms that swing have a few Hz."""
_USUAL_MASS = 10.0
"""Of a body of which nothing is known [kg]; how hard cables sag and stretch follows from it."""


def with_unread_cables(experiment: Experiment, *, every: bool = False) -> Experiment:
    """The experiment in which cables without force sensors carry the platform in runs that have
    locked winches and no forces; where nothing weighs the platform, a mass is assumed.

    Args:
        experiment: As it was read.
        every: Whether in all runs that have no forces, poses at rest too.
    """
    instruments = dict(experiment.instruments)
    gravity = float(np.linalg.norm(experiment.robot.gravity))
    runs = []
    for run in experiment.runs:
        clock = _clock(experiment, run, every=every)
        if clock is not None:
            name, instrument = _standing_in(instruments, clock, experiment.robot)
            instruments[name] = instrument
            load = experiment.load_of(run.name)
            carried = experiment if load is None else experiment.of_load(load)
            weight = usual_mass(carried) * gravity
            stream = _stream(run.streams[clock].time, weight, experiment.robot)
            run = _with_stream(run, name, stream, clock)
        runs.append(run)
    found = with_constant_lengths(replace(experiment, instruments=instruments, runs=tuple(runs)))
    if "mass" in found.known or not is_unread(found):
        return found
    known = {**found.known, "mass": (usual_mass(found), 0.0)}
    loads = tuple(
        replace(load, known=known) if i == 0 else load for i, load in enumerate(found.loads)
    )
    return replace(found, known=known, loads=loads, mass_assumed=True)


def with_constant_lengths(experiment: Experiment) -> Experiment:
    """The experiment in which the lengths of the cables do not change in runs with locked winches,
    to the noise that is stated of them; the very same where none is.

    Args:
        experiment: As it was read.
    """
    noise, robot = experiment.length_noise, experiment.robot
    if noise is None or not robot.m:
        return experiment
    instruments = dict(experiment.instruments)
    runs = []
    for run in experiment.runs:
        # Encoders say the same by themselves.
        read = any(instruments[name].is_cable_motion for name in run.streams)
        clock = None if read or not run.locked else _whole_motion(experiment, run)
        if clock is not None:
            own = ConstantLengths(
                cables=robot.m,
                noise=noise,
                axial_stiffness=robot.cable.axial_stiffness,
                clock=instruments[clock].clock or clock,
            )
            name = _named(LOCKED, instruments, own)
            instruments[name] = own
            time = run.streams[clock].time
            count = max(2, round((time[-1] - time[0]) * _CONSTANT) + 1)
            instants = np.linspace(time[0], time[-1], count)
            stream = Stream(instants, {CHANGE: np.zeros((count, robot.m))}, name)
            run = _with_stream(run, name, stream, clock)
        runs.append(run)
    return replace(experiment, instruments=instruments, runs=tuple(runs))


def without_constant_lengths(experiment: Experiment) -> Experiment:
    """The experiment in which nothing is said of lengths that nobody reads; the very same where
    that is so.

    Args:
        experiment: Any.
    """
    said = {
        name for name, each in experiment.instruments.items() if isinstance(each, ConstantLengths)
    }
    if not said:
        return experiment
    runs = tuple(
        replace(run, streams={name: s for name, s in run.streams.items() if name not in said})
        for run in experiment.runs
    )
    instruments = {n: each for n, each in experiment.instruments.items() if n not in said}
    return replace(experiment, instruments=instruments, runs=runs, length_noise=None)


def is_unread(experiment: Experiment) -> bool:
    """Whether no run reads the forces that carry the platform."""
    hangs = any(isinstance(each, UnreadCables) for each in experiment.instruments.values())
    return (hangs or bool(experiment.frequencies)) and not any(
        _weighs(experiment, run) for run in experiment.runs
    )


def moves_unread(experiment: Experiment) -> bool:
    """Whether the platform moves in a run that reads no forces, beside others or not."""
    unread = {n for n, each in experiment.instruments.items() if isinstance(each, UnreadCables)}
    return any(unread & run.streams.keys() for run in experiment.runs if not run.static)


def unread_runs(experiment: Experiment) -> list[str]:
    """Names of runs that read no forces, beside others that do."""
    if is_unread(experiment):
        return []
    return [run.name for run in experiment.runs if not _weighs(experiment, run)]


def _weighs(experiment: Experiment, run: Run) -> bool:
    """Whether a run reads forces."""
    name = experiment.force_instrument(run)
    return name is not None and not isinstance(experiment.instruments[name], UnreadCables)


def usual_mass(experiment: Experiment) -> float:
    """What the platform may weigh, before anything has been measured [kg]: as known, else that of
    the robot file.
    """
    if "mass" in experiment.known:
        return experiment.known["mass"][0]
    return experiment.robot.platform.mass if experiment.robot.platform else _USUAL_MASS


def _clock(experiment: Experiment, run: Run, *, every: bool) -> str | None:
    """The instrument by whose clock the balance of a run without forces is looked at: the fastest
    that knows how the platform moves; None: the run has forces, or needs none.
    """
    if experiment.force_instrument(run) is not None:
        return None
    if not every and (not run.locked or run.static):
        return None
    return _whole_motion(experiment, run, every=every)


def _whole_motion(experiment: Experiment, run: Run, *, every: bool = False) -> str | None:
    """The fastest instrument that knows how the platform moves; None: there is none.

    Args:
        experiment: With the run.
        run: One of its runs.
        every: Whether any other will do where there is none.
    """
    motion = [n for n in run.streams if experiment.instruments[n].is_motion]
    motion = motion or [n for n in run.streams if every]
    whole = [n for n in motion if {"position", "orientation"} <= run.streams[n].values.keys()]
    return max(whole or motion, key=lambda name: len(run.streams[name]), default=None)


def _standing_in(
    instruments: dict[str, Instrument], clock: str, robot: Robot
) -> tuple[str, UnreadCables]:
    """Name and instrument, the same for all runs on one clock."""
    own = UnreadCables(cables=robot.m, clock=instruments[clock].clock or clock)
    return _named(UNREAD, instruments, own), own


def _named(usual: str, instruments: dict[str, Instrument], own: Instrument) -> str:
    """A name that is free, or is that of the very same instrument."""
    names = [usual, *(f"{usual} {i}" for i in range(2, len(instruments) + 3))]
    return next(n for n in names if n not in instruments or instruments[n] == own)


def _with_stream(run: Run, name: str, stream: Stream, clock: str) -> Run:
    """A run with a stream of a stand-in, on the clock of one of its instruments."""
    sync = {**run.sync, name: run.sync[clock]} if run.sync else {}
    return replace(run, streams={**run.streams, name: stream}, sync=sync)


def _stream(time: Array, weight: float, robot: Robot) -> Stream:
    """Every cable carries its share, roughly."""
    rate = (len(time) - 1) / max(float(time[-1] - time[0]), 1e-9) if len(time) > 1 else 1.0
    own = time[:: max(1, int(rate / _RATE))]
    values = np.full((len(own), robot.m), weight / robot.m)
    return Stream(own, {"tension": values}, UNREAD)
