"""A body from natural frequencies alone: a stop-watch is an instrument."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from steelyard.arrays import Array
from steelyard.estimates.estimate import (
    Estimate,
    identifiable_parameters,
    judge,
    plausible_radius,
)
from steelyard.estimates.quantiles import chi2_exceeded
from steelyard.experiment.model import Experiment
from steelyard.identification.known_body import known_body, plausible
from steelyard.identification.methods.from_posterior.unweighed import up_to_mass
from steelyard.identification.verdict.seen_frequencies import of_frequencies
from steelyard.identification.verdict.settings import VERDICT, VerdictSettings
from steelyard.inertia import Inertia, body_jacobian
from steelyard.natural_frequencies.information import (
    check_predictable,
    frequency_information,
    noise_of,
)

_TURNS = 40
"""Evaluations after which a search from one beginning that goes astray ends."""
_BELOW = (0.2, -0.1)
_GYRATION = (0.5, 0.25)
"""Depths of centres of gravity and radii of gyration to begin with, in radii of the platform."""
_WIDE = 10.0
"""1-sigma of the nine numbers of a body: anything that is no point."""
_REWEIGHTED = 4
"""Searches with what errors of the geometry add to the noise, at most."""
_SAME = 1e-4
"""Change of the nine numbers that moves that noise no more."""
_CANNOT_HANG = 1e6
"""Residual of a body that cannot hang as the rows say."""
_SMALL = 1e-6
"""Steps of the derivatives of frequencies by the nine numbers, which are of order one."""


class _Found(NamedTuple):
    """The end of a search."""

    parameters: Array
    """The ten linear ones, shape (10,)."""
    cost: float


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
    starts = _first_bodies(experiment)
    modes = check_predictable(experiment, starts[0])
    size = plausible_radius(experiment.robot)
    count = sum(len(each.frequency) for each in experiment.frequencies)
    # Modes that were not seen may be these or those: then all beginnings are looked at.
    partial = any(len(each.frequency) < modes for each in experiment.frequencies)
    enough = -np.inf if partial else float(chi2_exceeded(settings.family, count))
    fits: list[_Found] = []
    for start in starts:
        fits.append(_fitted(experiment, start, size))
        if fits[-1].cost <= enough:
            break
    best = min(fits, key=lambda each: each.cost)
    found = best.parameters
    precision, _ = known_body(experiment, found, size)
    scale = plausible(found, size)
    spread = np.linalg.inv(precision * np.outer(scale, scale)) * np.outer(scale, scale)
    J = body_jacobian(found)
    covariance = J @ spread @ J.T
    covariance = (covariance + covariance.T) / 2
    value = Inertia.from_parameters(found).body_parameters
    known = identifiable_parameters(float(value[0]), covariance, size)
    value = np.where(known, value, np.nan)
    reasons = [
        *of_frequencies(experiment, found, size, settings),
        *_of_others(fits, best, spread, settings),
    ]
    estimate = Estimate(
        method=method,
        value=value,
        covariance=np.where(np.outer(known, known), covariance, np.nan),
        verdict=judge(value, reasons=reasons),
        notes=("from natural frequencies alone",),
    )
    return up_to_mass(experiment, estimate)


def _of_others(
    fits: Sequence[_Found], best: _Found, covariance: Array, settings: VerdictSettings
) -> Iterator[str]:
    """Another body that has what was seen nearly as well."""
    limit = float(chi2_exceeded(settings.family / 10, len(covariance)))
    use = slice(1, None)
    for other in fits:
        off = (other.parameters - best.parameters)[use]
        apart = float(off @ np.linalg.solve(covariance[use, use], off))
        if other.cost < best.cost + limit and apart > limit:
            yield (
                "another body has these natural frequencies nearly as well, with modes that were"
                " not seen in other places; add rows, or all frequencies of a row"
            )
            return


def _first_bodies(experiment: Experiment) -> list[Inertia]:
    """Where to begin: the nominal platform with the mass that is known or assumed, and bodies of
    the size of the platform about the middle of its attachments and below.
    """
    mass, robot = experiment.known["mass"][0], experiment.robot
    radius = plausible_radius(robot)
    down = robot.gravity / np.linalg.norm(robot.gravity)
    found = [
        Inertia(
            mass,
            robot.attachments.mean(axis=0) + below * radius * down,
            mass * (part * radius) ** 2 * np.diag([0.8, 1.0, 1.2]),
        )
        for below in _BELOW
        for part in _GYRATION
    ]
    nominal = robot.platform
    if nominal is None:
        return found
    inertia = nominal.inertia * (mass / nominal.mass)
    return [Inertia(mass, nominal.center_of_gravity, inertia), *found]


def _fitted(experiment: Experiment, start: Inertia, size: float) -> _Found:
    """The body nearest to what was seen; over bodies that can exist, by their log-Cholesky
    parameters [Rucker2022]_ without the first, which is the mass.

    What errors of the geometry add to the noise changes slowly with the body: it is held in a
    search, taken anew at its end, and searched on from there.
    """
    first, sizes = start.log_cholesky, plausible(start.parameters, size)
    count = sum(len(each.frequency) for each in experiment.frequencies)
    uncertainty = {**experiment.uncertainty, "anchor": 0.0, "attachment": 0.0}
    exact = replace(experiment, uncertainty=uncertainty)

    def at(x: Array) -> Array:
        return Inertia.from_log_cholesky(np.concatenate([first[:1], first[1:] + x])).parameters

    def searched(x: Array, covariance: Array) -> OptimizeResult:
        root = np.linalg.cholesky(covariance)

        def residual(x: Array) -> Array:
            seen = frequency_information(exact, at(x), sizes)
            if seen is None:
                return np.full(count + 9, _CANNOT_HANG)
            return np.concatenate([np.linalg.solve(root, seen.residual(at(x))), x / _WIDE])

        def jacobian(x: Array) -> Array:
            seen = frequency_information(exact, at(x), sizes)
            if seen is None:
                return np.zeros((count + 9, 9))
            ways = _SMALL * np.eye(9)
            by_x = np.column_stack([(at(x + d) - at(x - d)) / (2 * _SMALL) for d in ways])
            slopes = -np.linalg.solve(root, seen.by_parameters @ by_x)
            return np.vstack([slopes, np.eye(9) / _WIDE])

        return least_squares(residual, x, jacobian, x_scale=0.1, max_nfev=_TURNS)

    found = searched(np.zeros(9), noise_of(experiment))
    for _ in range(_REWEIGHTED if uncertainty != experiment.uncertainty else 0):
        whole = frequency_information(experiment, at(found.x), sizes)
        if whole is None:
            break
        before, found = found, searched(found.x, whole.covariance)
        if np.abs(found.x - before.x).max() < _SAME:
            break
    return _Found(at(found.x), float(2 * found.cost))
