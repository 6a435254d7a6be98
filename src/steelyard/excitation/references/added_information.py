"""How well a body is known from an experiment and a recording that is added to it: the information
of both about the same body, the same systematic errors and what was weighed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.estimates.estimate import plausible_radius
from steelyard.experiment.model import Experiment, Load
from steelyard.identification.known_body import plausible
from steelyard.identification.model.calibration_parameters import (
    CalibrationParameters,
    CalibrationValues,
    gather,
    load_place,
)
from steelyard.identification.solve.border.normal_equations import (
    BorderEquations,
    FurtherLoad,
    solve,
)
from steelyard.identification.solve.bound import Bound, bound_of
from steelyard.identification.solve.posterior import Posterior, prior_of
from steelyard.inertia import TEN

_FIRST = "first"
"""Name of the only load of an experiment, beside which another is carried."""


def bound_with(base: Posterior, further: Posterior, load: Load | None) -> Bound:
    """The Cramer-Rao bound of the first load of an experiment with one recording more.

    Args:
        base: Of the experiment.
        further: Of the recording alone, free of noise, with what it carries as its only body.
        load: What that is, with its nominal body; None: the first load of the experiment.
    """
    joint = _JointBorder.of(base, further, load)
    own, other = joint.change_from(base), joint.change_from(further, load)
    normal = np.zeros((joint.size, joint.size))
    for posterior, change in ((base, own), (further, other)):
        normal += change.T @ posterior.total.normal @ change
    # What noise alone tells of a body, by the runs that carried it.
    of_further = np.sum([each.noise for each in further.equations.values()], axis=0)
    first = _noise_of(base, base.experiment.loads[0] if base.experiment.loads else None)
    if load is None:
        first = first + of_further
    nothing = np.zeros(joint.size)
    loads = [
        each._replace(columns=own[each.columns].argmax(axis=1).astype(np.intp))
        for each in base.further_loads
    ]
    if load is not None:
        loads.append(joint.further_load(load, of_further))
    solution = solve(
        BorderEquations(normal, nothing, first, 0.0),
        prior_of(joint.experiment, joint.calibration, base.parameters, base.size),
        joint.estimated,
        plausible(base.parameters, base.size),
        loads=loads,
    )
    return bound_of(solution, base.parameters)


def _noise_of(posterior: Posterior, load: Load | None) -> Array:
    """What a motion of nothing but noise would tell of a load in its runs, shape (10, 10)."""
    experiment = posterior.experiment
    own = [
        each.noise for run, each in posterior.equations.items() if experiment.load_of(run) is load
    ]
    return np.sum(own, axis=0) if own else np.zeros((TEN, TEN))


@dataclass(frozen=True, eq=False)
class _JointBorder:
    """The border of an experiment with one recording more: the first load, and every systematic
    error of both.
    """

    experiment: Experiment
    calibration: CalibrationValues
    """Of the experiment as they were found, of the rest as known beforehand."""
    estimated: NDArray[np.bool_]
    """Columns that are not known exactly, shape (k,)."""

    @classmethod
    def of(cls, base: Posterior, further: Posterior, load: Load | None) -> _JointBorder:
        """With the errors of the experiment as uncertain as its fit had them."""
        experiment = _with_run(base.experiment, further.experiment, load)
        parameters = gather(experiment)
        before = base.calibration.calibration_parameters
        values, deviation = parameters.mean.copy(), parameters.deviation.copy()
        estimated = np.concatenate([np.ones(TEN, dtype=bool), deviation > 0])
        for own, there in _shared(before, parameters):
            values[there] = base.calibration.values[own]
            deviation[there] = before.deviation[own]
            estimated[_column(there)] = base.solution.estimated[_column(own)]
        if load is not None:
            assert load.nominal is not None
            values[load_place(parameters, load)] = load.nominal.parameters - base.parameters
        known = parameters.widened(deviation)
        return cls(experiment, CalibrationValues(known, values), estimated)

    @property
    def size(self) -> int:
        """Columns k."""
        return len(self.estimated)

    def change_from(self, posterior: Posterior, load: Load | None = None) -> Array:
        """How the border of one of the two follows this one, shape (own columns, k).

        Args:
            posterior: Of one of them.
            load: What its only body is; None: the first load.
        """
        own = posterior.calibration.calibration_parameters
        parameters = self.calibration.calibration_parameters
        found = np.zeros((TEN + len(own), self.size))
        found[:TEN, :TEN] = np.eye(TEN)
        for here, there in _shared(own, parameters):
            found[_column(here), _column(there)] = np.eye(here.stop - here.start)
        if load is not None:
            found[:TEN, _column(load_place(parameters, load))] = np.eye(TEN)
        return found

    def further_load(self, load: Load, noise: Array) -> FurtherLoad:
        """The load that was added, with what noise alone would tell of it, shape (10, 10)."""
        assert load.nominal is not None
        place = load_place(self.calibration.calibration_parameters, load)
        return FurtherLoad(
            TEN + np.arange(place.start, place.stop, dtype=np.intp),
            self.calibration.values[place],
            noise,
            plausible(load.nominal.parameters, plausible_radius(self.experiment.robot)),
        )


def _with_run(experiment: Experiment, further: Experiment, load: Load | None) -> Experiment:
    """The experiment with the runs of another, and with the load that they carried."""
    runs = tuple(replace(run, load=None if load is None else load.name) for run in further.runs)
    loads = experiment.loads
    if load is not None:
        only = Load(_FIRST, known=experiment.known, nominal=experiment.robot.platform)
        loads = (*(loads or (only,)), load)
    return replace(experiment, runs=(*experiment.runs, *runs), loads=loads)


def _shared(
    own: CalibrationParameters, other: CalibrationParameters
) -> Iterator[tuple[slice, slice]]:
    """Places of the same errors in both."""
    there: Mapping[tuple[str, str, str | None], slice] = other.places
    for key, place in own.places.items():
        if key in there:
            yield place, there[key]


def _column(place: slice) -> slice:
    """Columns of the border of calibration parameters."""
    return slice(TEN + place.start, TEN + place.stop)
