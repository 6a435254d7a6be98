"""By how much further loads differ from the first, and what moves in a load."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from steelyard.arrays import Array
from steelyard.estimates.estimate import plausible_radius
from steelyard.experiment.model import Experiment, Load
from steelyard.identification.model.calibration_parameters.keys import (
    APPARENT,
    LOAD,
    ROBOT,
)
from steelyard.identification.model.calibration_parameters.usual_forces import usual_forces
from steelyard.identification.model.calibration_parameters.vector import (
    CalibrationParameter,
    CalibrationParameters,
)
from steelyard.inertia import TEN

_ANY_LOAD = 10.0
"""1-sigma of that, in plausible sizes of a body: none that the data tell is hardly moved by it."""
_EXACT_PART = 1e-6
"""Part of its size to which what was added is known at best."""
_AXES = "xyz"


def load_place(parameters: CalibrationParameters, load: Load) -> slice:
    """Where it stands by how much a further load differs from the first."""
    return parameters.places[ROBOT, _load_key(load), None]


def _load_key(load: Load) -> str:
    """Under which it stands by how much a further load differs from the first."""
    return f"{LOAD}.{load.name}"


def further_loads(experiment: Experiment) -> Iterator[CalibrationParameter]:
    """By how much they differ from the first, and what is known of that."""
    if len(experiment.loads) < 2:
        return
    wide = _any_load(experiment)
    for load in experiment.loads[1:]:
        mean, deviation = _of_added(load, wide)
        yield CalibrationParameter(ROBOT, _load_key(load), None, "", mean, deviation)


def apparent_loads(experiment: Experiment) -> Iterator[CalibrationParameter]:
    """How loads in which something moves answer accelerations beside what they weigh: anyhow.

    What swings or flows follows the platform late, ahead or not at all: to the platform it is
    another body at every pace. Only what it weighs is the same, whatever it does.
    """
    keys = dict.fromkeys(apparent(experiment).values())
    wide = _any_load(experiment) if keys else np.zeros(TEN)
    for key in keys:
        yield CalibrationParameter(ROBOT, key, None, "", np.zeros(TEN), wide)


def apparent(experiment: Experiment) -> dict[str, str]:
    """Run in motion -> key of how a load in which something moves answers accelerations there."""
    return {
        run.name: f"{APPARENT}.{load.name}"
        for run in experiment.runs
        if experiment.moves_within(run.name) and (load := experiment.load_of(run.name))
    }


def _any_load(experiment: Experiment) -> Array:
    """1-sigma of ten linear parameters of which nothing is known, shape (10,)."""
    known = [load.known["mass"][0] for load in experiment.loads if "mass" in load.known]
    known += [load.added["mass"][0] for load in experiment.loads if "mass" in load.added]
    drawn = [load.nominal.mass for load in experiment.loads if load.nominal is not None]
    weighs = usual_forces(experiment) / float(np.linalg.norm(experiment.robot.gravity))
    mass, size = max([*known, *drawn, weighs, 1e-9]), plausible_radius(experiment.robot)
    return _ANY_LOAD * np.array([mass, *[mass * size] * 3, *[mass * size**2] * 6])


def _of_added(load: Load, wide: Array) -> tuple[Array, Array]:
    """What is known of the ten linear parameters of what was added to the first load, and 1-sigma,
    shape (10,) each.

    Args:
        load: With it.
        wide: 1-sigma of those of which nothing is known, shape (10,).
    """
    mean, deviation = np.zeros(TEN), wide.copy()
    if "mass" in load.added:
        # As exact as a body of which all is known may be.
        mean[0], sigma = load.added["mass"]
        deviation[0] = max(sigma, _EXACT_PART * mean[0])
        for i, axis in enumerate(_AXES, start=1):
            if f"c{axis}" in load.added:
                place, off = load.added[f"c{axis}"]
                mean[i] = mean[0] * place
                # The first moment of a mass at a place: both may be off.
                by_mass, by_place = deviation[0] * place, mean[0] * off
                deviation[i] = max(float(np.hypot(by_mass, by_place)), _EXACT_PART * wide[i])
    return mean, deviation


def carried(experiment: Experiment) -> dict[str, str]:
    """Run -> key of what it carried more than the first load; runs of the first are not there."""
    keys = {load.name: _load_key(load) for load in experiment.loads[1:]}
    return {
        run.name: keys[load.name]
        for run in experiment.runs
        if (load := experiment.load_of(run.name)) is not None and load.name in keys
    }


def with_last_load(
    parameters: CalibrationParameters, experiment: Experiment
) -> CalibrationParameters:
    """The same with what the last load of an experiment is more than the first, at the end, and for
    the last run, which goes on with that load.

    Args:
        parameters: Of the experiment without that run.
        experiment: With a further load and a run that continues another one.
    """
    *_, entry = further_loads(experiment)
    last = experiment.runs[-1]
    assert last.continues is not None
    return replace(
        parameters,
        entries=(*parameters.entries, entry),
        carried={**parameters.carried, last.name: entry.key},
        continued={**parameters.continued, last.name: last.continues},
    )
