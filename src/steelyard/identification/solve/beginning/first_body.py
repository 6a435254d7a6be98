"""The body that balances forces and a given motion, and that motion in the time of the forces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from steelyard.arrays import Array
from steelyard.dynamics import platform_regressor
from steelyard.experiment.model import Experiment
from steelyard.experiment.unread import is_unread
from steelyard.identification.model.balance import Forces, balance_of, parts_of
from steelyard.identification.model.calibration_parameters import (
    CalibrationValues,
    clock_of,
)
from steelyard.identification.model.force_residuals import sample_weight
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.reading_times import reference_clocks, time_of
from steelyard.identification.solve.beginning.readings import Readings
from steelyard.identification.solve.fit_state import FitState
from steelyard.identification.solve.settings import FitSettings
from steelyard.inertia import TEN


def first_bodies(
    readings: Readings, state: FitState, force_samples: Sequence[Forces | None]
) -> tuple[Array, FitState]:
    """The ten linear parameters of the first load, and a state with what further ones are more."""
    experiment, settings = readings.experiment, readings.settings
    parameters = state.calibration.calibration_parameters
    values = state.calibration.values.copy()
    found: list[tuple[slice | None, Array | None]] = []
    for load in experiment.loads or (None,):
        own = [
            forces if experiment.load_of(segment.run) is load else None
            for segment, forces in zip(state.segments, force_samples, strict=True)
        ]
        known = experiment.known if load is None else load.known
        runs = [run.name for run in experiment.runs if experiment.load_of(run.name) is load]
        place = parameters.place_of_load(runs[0]) if runs else None
        there = any(each is not None for each in own)
        found.append(
            (place, first_body(experiment, state, own, known, settings) if there else None)
        )
    first = next(body for _, body in found if body is not None)
    first = first if found[0][1] is None else found[0][1]
    for place, body in found:
        if place is not None and body is not None:
            values[place] = body - first
    return first, replace(state, calibration=replace(state.calibration, values=values))


def first_body(
    experiment: Experiment,
    state: FitState,
    force_samples: Sequence[Forces | None],
    known: Mapping[str, tuple[float, float]],
    settings: FitSettings,
) -> Array:
    """The ten linear parameters that balance forces and a given motion, samples that stand far
    counting less.

    Args:
        experiment: With its robot.
        state: With motion and calibration.
        force_samples: Of each segment; None: not looked at.
        known: Body parameter -> value and 1-sigma beforehand.
        settings: How often to weigh the samples anew.
    """
    parameters = np.zeros(TEN)
    for _ in range(settings.first_body_iterations):
        normal, right = np.zeros((TEN, TEN)), np.zeros(TEN)
        parts = (
            (segment, part)
            for segment, forces in zip(state.segments, force_samples, strict=True)
            if forces is not None
            for part in parts_of(experiment, segment, forces, state.calibration)
        )
        for segment, forces in parts:
            at = balance_of(
                experiment, segment, forces, state.calibration, parameters, state.factors
            )
            regressor = platform_regressor(
                at.motion["specific_force"], at.motion["omega"], at.motion["alpha"]
            )
            residual = at.residual
            weight = sample_weight(residual) * ~forces.touched
            A = -at.whitener @ regressor
            normal += np.einsum("nki,n,nkj->ij", A, weight, A, optimize=True)
            right += np.einsum(
                "nki,n,nk->i",
                A,
                weight,
                np.einsum("nki,i->nk", A, parameters) - residual,
                optimize=True,
            )
        if "mass" in known:
            # Without forces it is all that tells how large the body is.
            mass, sigma = known["mass"]
            weight_of_mass = max(sigma, 1e-3 * mass) ** -2
            normal[0, 0] += weight_of_mass
            right[0] += weight_of_mass * mass
        scale = 1 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
        solution, *_ = np.linalg.lstsq(normal * np.outer(scale, scale), scale * right, rcond=1e-9)
        parameters = scale * solution
        if is_unread(experiment) and parameters[0]:
            # It is told in multiples of the mass.
            parameters = parameters * (known["mass"][0] / parameters[0])
    return np.asarray(parameters)


def on_force_clock(experiment: Experiment, state: FitState) -> FitState:
    """The same motion, told in the time of the forces."""
    segments = tuple(
        _by_force_clock(experiment, segment, state.calibration) for segment in state.segments
    )
    return replace(state, segments=segments)


def _by_force_clock(
    experiment: Experiment, segment: Segment, calibration: CalibrationValues
) -> Segment:
    """The same motion, told in the time of the forces."""
    if segment.static:
        return segment
    calibration_parameters = calibration.calibration_parameters
    name = experiment.force_instrument(
        next(run for run in experiment.runs if run.name == segment.run)
    )
    assert name is not None
    nothing = np.zeros(1)
    (there,), *_ = time_of(
        experiment,
        segment,
        calibration,
        reference_clocks(experiment, calibration_parameters, segment),
        name,
        nothing,
    )
    told = replace(segment, reference=clock_of(experiment, name))
    (here,), *_ = time_of(experiment, told, calibration, {}, name, nothing)
    return replace(told, knots=segment.knots + (here - there))
