"""Dead weights on force sensors: what is known of the sensors, and belongs to no motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.experiment.observations import DeadWeights
from steelyard.experiment.recording import Run, Stream
from steelyard.instruments import Instrument
from steelyard.instruments.weight import Weight, cells_under_weights
from steelyard.robot.model import Robot

_MISTAKEN = {
    1e-3: (
        "masses seem to be in grams, or readings in kilonewtons; state it under 'units' ({mass: g}"
        " or {f: kN})"
    ),
    1e3: (
        "masses seem to be in tonnes, or readings in millinewtons; state it under 'units' ({mass:"
        " t} or {f: mN})"
    ),
}
"""Readings over what they should be -> what seems to be wrong."""
_NEAR = 2.0
"""How far they may be off such a factor."""
_KILOGRAMS = 0.1
"""The same of readings in kilograms, as a part."""


def with_weights_apart(experiment: Experiment) -> Experiment:
    """The experiment with all tables of dead weights taken out of the runs, and without runs of
    which nothing else is left.

    Args:
        experiment: As it was read.

    Raises:
        InputError: A row has no cable with a sensor, or no mass; or masses are not in kilograms.
    """
    tables = {name for name, each in experiment.instruments.items() if isinstance(each, Weight)}
    if not tables:
        return experiment
    weights, runs = [], []
    for run in experiment.runs:
        weights += [
            _table(experiment, run.name, name, stream)
            for name, stream in run.streams.items()
            if name in tables
        ]
        rest = {name: each for name, each in run.streams.items() if name not in tables}
        if rest:
            sync = {name: time for name, time in run.sync.items() if name in rest}
            runs.append(replace(run, streams=rest, sync=sync))
    instruments = {k: v for k, v in experiment.instruments.items() if k not in tables}
    return replace(experiment, instruments=instruments, runs=tuple(runs), weights=tuple(weights))


def _table(experiment: Experiment, run: str, name: str, stream: Stream) -> DeadWeights:
    """One table, once all of its rows have been looked at."""
    description = experiment.instruments[name]
    assert isinstance(description, Weight)
    number, mass, reading = (stream.values[key][:, 0] for key in ("cable", "mass", "force"))
    m, without = experiment.robot.m, experiment.instruments[description.of].unread
    for i, (cable, weight) in enumerate(zip(number, mass, strict=True)):
        where = f"run '{run}': row {i + 1} of '{name}'"
        if not np.isfinite(cable) or cable != round(cable) or not 1 <= cable <= m:
            raise InputError(
                f"{where}: expected the number of a cable, 1 to {m}, in column 'cable', found"
                f" {_cell(cable)}; correct it"
            )
        if f"f{int(cable)}" in without:
            raise InputError(
                f"{where}: expected a cable that has a sensor of '{description.of}', found"
                f" {int(cable)}, which is under its 'without'; correct one of them"
            )
        if not np.isfinite(weight) or weight < 0:
            raise InputError(
                f"{where}: expected a mass of zero or more [kg] in column 'mass', found"
                f" {_cell(weight)}; correct it"
            )
    found = DeadWeights(run, name, description, number.astype(np.intp), mass, reading)
    _check_units(found, experiment.instruments[description.of], experiment.robot)
    return found


def _cell(value: float) -> str:
    return f"{value:g}" if np.isfinite(value) else "nothing"


def _check_units(weights: DeadWeights, cells: Instrument, robot: Robot) -> None:
    """Refuse masses in grams or tonnes, and readings in kilonewtons or kilograms.

    Args:
        weights: A table.
        cells: That it is about, with the gains that are stated of them.
        robot: Whose cells they are.
    """
    gravity = float(np.linalg.norm(robot.gravity))
    pull = np.zeros((len(weights), robot.m))
    own = np.arange(len(weights)), weights.cable - 1
    pull[own] = weights.mass * gravity
    means = np.concatenate([term.mean for term in cells.terms(robot.m)])
    equations = cells_under_weights(cells, robot)
    expected = (
        equations(pull=pull, errors=means)["reading"][own]
        - equations(pull=0 * pull, errors=means)["reading"][own]
    )
    use = (weights.mass > 0) & np.isfinite(weights.reading) & (expected != 0)
    if use.sum() < 2:
        return
    usual = float(np.median(np.abs(weights.reading[use] / expected[use])))
    start = (
        f"run '{weights.run}': '{weights.instrument}': expected readings of about gain times mass"
        f" times {gravity:.4g} m/s^2 [N], found {usual:.3g} times that in the median"
    )
    for factor, why in _MISTAKEN.items():
        if 1 / _NEAR < usual / factor < _NEAR:
            raise InputError(f"{start}: {why}")
    if abs(usual * gravity - 1) < _KILOGRAMS:
        raise InputError(
            f"{start}: readings seem to be in kilograms; state it under 'units' ({{f: kgf}})"
        )


def with_weights_together(experiment: Experiment) -> Experiment:
    """The experiment with its dead weights as tables of its runs, as files have them.

    Args:
        experiment: Of :func:`with_weights_apart`.
    """
    instruments, runs = dict(experiment.instruments), {run.name: run for run in experiment.runs}
    for each in experiment.weights:
        instruments[each.instrument] = each.description
        values: dict[str, Array] = {
            "cable": each.cable.astype(np.float64)[:, None],
            "mass": each.mass[:, None],
            "force": each.reading[:, None],
        }
        stream = Stream(np.arange(float(len(each))), values, each.instrument)
        run = runs.get(each.run, Run(each.run, {}))
        runs[each.run] = replace(run, streams={**run.streams, each.instrument: stream})
    return replace(experiment, instruments=instruments, runs=tuple(runs.values()), weights=())
