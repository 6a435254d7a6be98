"""Runs without force sensors: the cables carry the platform though nobody reads how hard they pull.

A stream of guessed tensions, none of them read, stands where the forces would be. What the cables
cannot carry has to be in balance without them: six equations less one for every cable.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment, Run, Stream
from steelyard.instruments import Instrument
from steelyard.instruments.unread_cables import UnreadCables
from steelyard.robot.model import Robot

UNREAD = "unread cables"
"""Name of the instrument that stands in for force sensors."""
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
            sync = {**run.sync, name: run.sync[clock]} if run.sync else {}
            run = replace(run, streams={**run.streams, name: stream}, sync=sync)
        runs.append(run)
    found = replace(experiment, instruments=instruments, runs=tuple(runs))
    if "mass" in found.known or not is_unread(found):
        return found
    known = {**found.known, "mass": (usual_mass(found), 0.0)}
    loads = tuple(
        replace(load, known=known) if i == 0 else load for i, load in enumerate(found.loads)
    )
    return replace(found, known=known, loads=loads, mass_assumed=True)


def is_unread(experiment: Experiment) -> bool:
    """Whether no run reads the forces that carry the platform."""
    hangs = any(isinstance(each, UnreadCables) for each in experiment.instruments.values())
    return (hangs or bool(experiment.frequencies)) and not any(
        _weighs(experiment, run) for run in experiment.runs
    )


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
    motion = [n for n in run.streams if experiment.instruments[n].is_motion]
    motion = motion or [n for n in run.streams if every]
    whole = [n for n in motion if {"position", "orientation"} <= run.streams[n].values.keys()]
    return max(whole or motion, key=lambda name: len(run.streams[name]), default=None)


def _standing_in(
    instruments: dict[str, Instrument], clock: str, robot: Robot
) -> tuple[str, UnreadCables]:
    """Name and instrument, the same for all runs on one clock."""
    own = UnreadCables(cables=robot.m, clock=instruments[clock].clock or clock)
    names = [UNREAD, *(f"{UNREAD} {i}" for i in range(2, len(instruments) + 3))]
    return next(n for n in names if n not in instruments or instruments[n] == own), own


def _stream(time: Array, weight: float, robot: Robot) -> Stream:
    """Every cable carries its share, roughly."""
    rate = (len(time) - 1) / max(float(time[-1] - time[0]), 1e-9) if len(time) > 1 else 1.0
    own = time[:: max(1, int(rate / _RATE))]
    values = np.full((len(own), robot.m), weight / robot.m)
    return Stream(own, {"tension": values}, UNREAD)
