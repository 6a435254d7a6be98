"""Errors of the instruments and of their clocks, with the priors of the contract."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.identification.model.calibration_parameters.vector import CalibrationParameter, Key
from steelyard.instruments import Instrument
from steelyard.instruments.base import LATE, LATENCY, TIME_CONSTANT, Term
from steelyard.instruments.length import CABLE_DAMPING, DAMPED, STRETCH
from steelyard.instruments.unread_cables import UnreadCables

_STRETCHED = 0.1
"""1-sigma of the stretch of cables over that by the axial stiffness of the robot file: ropes of one
make differ by so much, and grow stiffer in use. Taken as exact it would weigh the platform."""
_OFFSET_SHARE = 0.01
"""Default 1-sigma of the offset of a force sensor, as a part of the median tension."""


def clock_of(experiment: Experiment, name: str) -> str:
    """The clock of an instrument; one without a name has one of its own."""
    return experiment.instruments[name].clock or name


def errors_of_instruments(experiment: Experiment) -> Iterator[CalibrationParameter]:
    """Of every instrument that was read, in motion, at rest or under dead weights."""
    used = [name for run in experiment.runs for name in run.streams]
    for name in dict.fromkeys([*used, *(each.of for each in experiment.weights)]):
        for term in experiment.instruments[name].terms(experiment.robot.m):
            deviation = _beforehand(experiment, name, term)
            suspected = (
                None if _is_of_clock(experiment, name, term) else _suspected(experiment, name, term)
            )
            runs: Sequence[Run | None] = [None]
            if term.prior.per == "run":
                runs = [run for run in experiment.runs if name in run.streams]
            for run in runs:
                absent = term.of_motion and run is not None and run.static
                yield CalibrationParameter(
                    name,
                    term.key,
                    run.name if run else None,
                    term.unit,
                    term.mean,
                    np.zeros_like(deviation) if absent else deviation,
                    suspected,
                )


def before_weighing(experiment: Experiment) -> dict[Key, tuple[Array, Array]]:
    """Errors of the instruments that were read under dead weights: values beforehand and
    1-sigma.
    """
    found: dict[Key, tuple[Array, Array]] = {}
    for name in dict.fromkeys(each.of for each in experiment.weights):
        own = [each.run for each in experiment.weights if each.of == name]
        for term in experiment.instruments[name].terms(experiment.robot.m):
            for run in own if term.prior.per == "run" else [None]:
                found[name, term.key, run] = term.mean, _beforehand(experiment, name, term)
    return found


def errors_of_clocks(experiment: Experiment) -> Iterator[CalibrationParameter]:
    """Delays of the clocks in every run in motion."""
    for run in experiment.runs:
        if run.static:
            continue
        clocks: dict[str, CalibrationParameter] = {}
        for name in run.streams:
            prior, clock = experiment.delay(run, name), clock_of(experiment, name)
            mean, sigma = (
                np.atleast_1d(np.asarray(v or 0.0, dtype=np.float64))
                for v in (prior.value, prior.sigma)
            )
            # Instruments of one clock share its error: what is known of one is known of all.
            if clock not in clocks or sigma[0] < clocks[clock].deviation[0]:
                clocks[clock] = CalibrationParameter(clock, "delay", run.name, "s", mean, sigma)
        yield from clocks.values()


def errors_within_clocks(experiment: Experiment) -> Iterator[CalibrationParameter]:
    """How late instruments read what a clock says that they share with others; none of them is,
    unless the readings ask for it, or for a filter, where the delay is stated.
    """
    moving = [run for run in experiment.runs if not run.static]
    for name in dict.fromkeys(name for run in moving for name in run.streams):
        instrument = experiment.instruments[name]
        measures = instrument.is_measurement and not instrument.stands_in(experiment.robot.m)
        if measures and shares_clock(experiment, name):
            none, stated = np.zeros(1), instrument.calibration.delay is not None
            yield CalibrationParameter(name, LATENCY, None, "s", none, none, LATE, instead=stated)


def _beforehand(experiment: Experiment, name: str, term: Term) -> Array:
    """1-sigma of an error before anything is fitted, shape (k,)."""
    if term.key == STRETCH and _may_stretch(experiment, experiment.instruments[name]):
        return np.full(term.size, _STRETCHED)
    if term.key == CABLE_DAMPING and _may_damp(experiment, name):
        return np.full(term.size, DAMPED)
    return term.deviation if term.deviation is not None else _from_data(experiment, name, term)


def _is_of_clock(experiment: Experiment, name: str, term: Term) -> bool:
    """Whether it is a time constant that nothing tells from an error of the clock, since no motion
    is read by it.
    """
    return term.key == TIME_CONSTANT and not shares_clock(experiment, name)


def shares_clock(experiment: Experiment, name: str) -> bool:
    """Whether another instrument that measures reads the clock of this one."""
    clock = clock_of(experiment, name)
    return any(
        clock_of(experiment, other) == clock
        for run in experiment.runs
        for other in run.streams
        if other != name and not experiment.instruments[other].commanded
    )


def _may_stretch(experiment: Experiment, instrument: Instrument) -> bool:
    """Whether nobody has stated how well the stiffness of the cables is known, and tensions tell
    how far they stretch; without these nobody knows.
    """
    return STRETCH not in instrument.calibration.model_fields_set and _stretches(experiment)


def _may_damp(experiment: Experiment, name: str) -> bool:
    """Whether nobody has stated how far the stretch of cables lags behind their tension, and these
    are read in motion.
    """
    if CABLE_DAMPING in experiment.instruments[name].calibration.model_fields_set:
        return False
    moving = any(name in run.streams and not run.static for run in experiment.runs)
    return moving and _stretches(experiment)


def _stretches(experiment: Experiment) -> bool:
    """Whether cables stretch, and tensions tell how far."""
    forces = [experiment.force_instrument(run) for run in experiment.runs]
    read = any(
        name is not None and not isinstance(experiment.instruments[name], UnreadCables)
        for name in forces
    )
    return bool(experiment.robot.cable.axial_stiffness) and read


def _from_data(experiment: Experiment, name: str, term: Term) -> Array:
    """Default 1-sigma that the contract takes from the readings, shape (k,)."""
    quantity = {"offset.force": "force", "offset.torque": "torque"}.get(term.key, "tension")
    sizes = _sizes(experiment, name, quantity)
    scale = _OFFSET_SHARE * np.nanmedian(sizes) if quantity == "tension" else np.nanmax(sizes)
    return np.full(term.size, float(scale))


def _suspected(experiment: Experiment, name: str, term: Term) -> float | None:
    """1-sigma of an error that is taken as none until the readings ask for it, in its unit."""
    if term.suspected is None or not term.of_reading:
        return term.suspected
    sizes = _sizes(experiment, name, term.of_reading)
    # What nothing has been read of is under no suspicion.
    return term.suspected * float(np.nanmedian(sizes)) if np.isfinite(sizes).any() else None


def _sizes(experiment: Experiment, name: str, quantity: str) -> Array:
    """Of all readings of a quantity, and of those under dead weights where there are no others."""
    streams = [run.streams[name] for run in experiment.runs if name in run.streams]
    readings = [each.values[quantity] for each in streams if quantity in each.values]
    readings = readings or [each.reading for each in experiment.weights if each.of == name]
    return np.asarray(np.abs(np.concatenate([np.zeros(0), *(each.ravel() for each in readings)])))
