"""What natural frequencies that somebody has seen tell of the body.

They follow from body and cables by :mod:`.modes`; errors of the robot's geometry are a noise
that all of them share.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.experiment.observations import SeenFrequencies
from steelyard.inertia import Inertia, body_jacobian
from steelyard.natural_frequencies.modes import (
    NaturalModes,
    beside,
    by_points,
    natural,
    sensitivity,
)
from steelyard.robot.model import DIRECTIONS, Robot

_DIGITS = 3
"""Of the ten in plausible sizes, about which frequencies are linearised."""
_COARSE = 1
"""The same of mass and first moment, about which places are looked for."""


@dataclass(frozen=True, eq=False)
class FrequencyInformation:
    """Seen frequencies, linearised about a body."""

    seen: Array
    """All that were seen, one after the other [Hz], shape (k,)."""
    predicted: Array
    """[Hz], shape (k,)."""
    at: Array
    """The ten linear parameters, shape (10,)."""
    by_parameters: Array
    """Derivative of the predicted ones by these, shape (k, 10)."""
    covariance: Array
    """Of what was seen about what is predicted [Hz^2], shape (k, k)."""

    def about(self) -> tuple[Array, Array]:
        """Precision of the ten linear parameters, and its pull, shapes (10, 10) and (10,)."""
        weighted = np.linalg.solve(self.covariance, self.by_parameters).T
        toward = self.seen - self.predicted + self.by_parameters @ self.at
        return weighted @ self.by_parameters, weighted @ toward

    def residual(self, parameters: Array) -> Array:
        """Seen less predicted [Hz], shape (k,)."""
        return np.asarray(self.seen - self.predicted - self.by_parameters @ (parameters - self.at))


def frequency_information(
    experiment: Experiment, parameters: Array, sizes: Array
) -> FrequencyInformation | None:
    """What seen frequencies tell about a body; None: there are none, or nothing can hang so.

    Args:
        experiment: With what was seen.
        parameters: The ten linear parameters near which they are linearised, shape (10,).
        sizes: Plausible size of these, shape (10,).

    Raises:
        InputError: More frequencies were seen than there are modes.
    """
    if not experiment.frequencies or not np.isfinite(parameters).all():
        return None
    scaled, coarse = (
        tuple((np.round(parameters / sizes, digits) * sizes).tolist())
        for digits in (_DIGITS, _COARSE)
    )
    return _linearised(experiment, scaled, coarse[:4])


def noise_of(experiment: Experiment) -> Array:
    """Covariance of what was seen where nothing else is uncertain [Hz^2], shape (k, k)."""
    return np.diag(np.concatenate([each.sigma for each in experiment.frequencies]) ** 2)


def check_predictable(experiment: Experiment, body: Inertia) -> int:
    """The largest number of modes with which a body swings in a row; refuses rows at which it
    cannot hang.

    Raises:
        InputError: With the row, and why.
    """
    most = 0
    for each in experiment.frequencies:
        try:
            most = max(most, len(_modes_of(experiment.robot, body, each).frequencies))
        except InputError as error:
            raise InputError(
                f"run '{each.run}': row {each.row} of '{each.instrument}': {error}"
            ) from None
    return most


@lru_cache(maxsize=8)
def _linearised(
    experiment: Experiment, parameters: tuple[float, ...], near: tuple[float, ...]
) -> FrequencyInformation | None:
    """About a body that hangs near where one of such a mass and first moment does; None: it cannot
    hang so.
    """
    at = np.array(parameters)
    body = Inertia.from_parameters(at)
    if body.mass <= 0 or not body.is_physical:
        return None
    of_points = np.repeat(
        [experiment.uncertainty.get(name, 0.0) for name in ("anchor", "attachment")],
        3 * experiment.robot.m,
    )
    predicted, by_body, by_error = [], [], []
    starts = _about(experiment, near[0], near[1:]) or (None,) * len(experiment.frequencies)
    for each, start in zip(experiment.frequencies, starts, strict=True):
        try:
            found = (start and beside(start, body)) or _modes_of(experiment.robot, body, each)
            follows = sensitivity(found)
            strays = by_points(found) * of_points if of_points.any() else None
        except InputError:
            return None
        own = _matched(each, found.frequencies)
        predicted.append(found.frequencies[own])
        by_body.append(follows[own])
        if strays is not None:
            by_error.append(strays[own])
    covariance = noise_of(experiment)
    if by_error:
        together = np.concatenate(by_error)
        covariance = covariance + together @ together.T
    return FrequencyInformation(
        seen=np.concatenate([each.frequency for each in experiment.frequencies]),
        predicted=np.concatenate(predicted),
        at=at,
        by_parameters=np.concatenate(by_body) @ body_jacobian(at),
        covariance=covariance,
    )


@lru_cache(maxsize=8)
def _about(
    experiment: Experiment, mass: float, first_moment: tuple[float, ...]
) -> tuple[NaturalModes, ...] | None:
    """Where a body hangs in all rows: a place to look at first for those near it. Its inertia does
    not matter there.
    """
    if mass <= 0:
        return None
    body = Inertia(mass, np.array(first_moment) / mass, mass * np.eye(3))
    try:
        return tuple(_modes_of(experiment.robot, body, e) for e in experiment.frequencies)
    except InputError:
        return None


def _modes_of(robot: Robot, body: Inertia, seen: SeenFrequencies) -> NaturalModes:
    """As the body swings there; on six cables and more by their stretch alone."""
    elastic = robot.m >= DIRECTIONS
    return natural(robot, body, pose=seen.pose, lengths=seen.lengths, elastic=elastic)


def _matched(seen: SeenFrequencies, modes: Array) -> list[int]:
    """Which modes were seen: both ascend, and some may not have been."""
    if len(seen.frequency) > len(modes):
        raise InputError(
            f"run '{seen.run}': row {seen.row} of '{seen.instrument}': expected at most"
            f" {len(modes)} natural frequencies of a platform that hangs so, found"
            f" {len(seen.frequency)}; correct the row"
        )

    choices = np.array(list(combinations(range(len(modes)), len(seen.frequency))))
    off = np.sum(((seen.frequency - modes[choices]) / seen.sigma) ** 2, axis=1)
    return [int(i) for i in choices[np.argmin(off)]]
