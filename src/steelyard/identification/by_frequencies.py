"""A body from natural frequencies alone: a stop-watch is an instrument."""

from __future__ import annotations

import numpy as np

from steelyard.arrays import Array
from steelyard.estimates.estimate import (
    Estimate,
    identifiable_parameters,
    judge,
    plausible_radius,
)
from steelyard.experiment.model import Experiment
from steelyard.identification.methods.unweighed import up_to_mass
from steelyard.identification.solve.posterior import cost_of_known, known_body, plausible
from steelyard.identification.verdict.assessment import of_frequencies
from steelyard.identification.verdict.settings import VERDICT, VerdictSettings
from steelyard.inertia import Inertia, body_jacobian
from steelyard.natural_frequencies.information import check_predictable, frequency_information

_TURNS = 60
_ARRIVED = 1e-3
"""Largest step of one of the ten in its 1-sigma."""
_SHORTEST = 1e-6
"""Part of a step below which nothing descends any more."""
_PLAUSIBLE = 0.5
"""Radii of gyration of a body of which nothing is known, in radii of the platform."""


def by_frequencies(
    experiment: Experiment, method: str, settings: VerdictSettings = VERDICT
) -> Estimate:
    """Estimate a body of which only natural frequencies have been seen.

    Args:
        experiment: Without runs in motion.
        method: Name under which the estimate is kept.
        settings: Levels of the verdict.

    Raises:
        InputError: The platform, as it is known beforehand, cannot hang as the rows say.
    """
    start = _first_body(experiment)
    check_predictable(experiment, Inertia.from_parameters(start))
    size = plausible_radius(experiment.robot)
    found, spread = _fitted(experiment, start, size)
    J = body_jacobian(found)
    covariance = J @ spread @ J.T
    covariance = (covariance + covariance.T) / 2
    value = Inertia.from_parameters(found).body_parameters
    known = identifiable_parameters(float(value[0]), covariance, size)
    value = np.where(known, value, np.nan)
    reasons = list(of_frequencies(experiment, found, size, settings))
    estimate = Estimate(
        method=method,
        value=value,
        covariance=np.where(np.outer(known, known), covariance, np.nan),
        verdict=judge(value, reasons=reasons),
        notes=("from natural frequencies alone",),
    )
    return up_to_mass(experiment, estimate)


def _first_body(experiment: Experiment) -> Array:
    """The nominal platform with the mass that is known or assumed, else a body of the size of its
    platform; ten linear parameters.
    """
    mass, nominal = experiment.known["mass"][0], experiment.robot.platform
    if nominal is not None:
        return np.asarray(nominal.parameters * (mass / nominal.mass))
    attachments = experiment.robot.attachments
    radius = _PLAUSIBLE * plausible_radius(experiment.robot)
    centre = attachments.mean(axis=0) + 0.2 * radius * _down(experiment)
    return Inertia(mass, centre, mass * radius**2 * np.eye(3)).parameters


def _down(experiment: Experiment) -> Array:
    gravity = experiment.robot.gravity
    return np.asarray(gravity / np.linalg.norm(gravity))


def _fitted(experiment: Experiment, start: Array, size: float) -> tuple[Array, Array]:
    """The ten linear parameters and their covariance, by Gauss-Newton with shorter steps where one
    does not descend.
    """
    scale = plausible(start, size)
    found, cost = start, _cost(experiment, start, size)
    for _ in range(_TURNS):
        precision, pull = known_body(experiment, found, size)
        inverse = np.linalg.inv(precision * np.outer(scale, scale))
        covariance = inverse * np.outer(scale, scale)
        step = scale * (inverse @ (scale * (pull - precision @ found)))
        share = 1.0
        while share > _SHORTEST and not _cost(experiment, found + share * step, size) <= cost:
            share /= 2
        if share <= _SHORTEST:
            break
        found = found + share * step
        cost = _cost(experiment, found, size)
        if np.max(np.abs(share * step) / np.sqrt(np.diag(covariance))) < _ARRIVED:
            break
    return found, covariance


def _cost(experiment: Experiment, parameters: Array, size: float) -> float:
    """Square of what does not fit, of frequencies and of what is known; infinite for bodies that
    cannot hang so.
    """
    seen = frequency_information(experiment, parameters, plausible(parameters, size))
    if seen is None:
        return np.inf
    residual = seen.residual(parameters)
    misfit = residual @ np.linalg.solve(seen.covariance, residual)
    return float(misfit) + cost_of_known(experiment, parameters, size)
