"""What natural frequencies that somebody has seen tell of the body.

They follow from body and cables by :mod:`.frequencies`; errors of the robot's geometry are a noise
that all of them share.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.experiment.model import Experiment, SeenFrequencies
from steelyard.inertia import Inertia, body_jacobian
from steelyard.natural_frequencies.frequencies import (
    DIRECTIONS,
    NaturalModes,
    beside,
    by_points,
    natural,
    sensitivity,
)
from steelyard.robot.model import Robot

_DIGITS = 3
"""Of the ten in plausible sizes, about which frequencies are linearised."""
_COARSE = 1
"""The same for how they follow the geometry."""


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
    found = _linearised(experiment, scaled, coarse)
    if found is None:
        return None
    seen, predicted, J = found
    sigma = np.concatenate([each.sigma for each in experiment.frequencies])
    follows = _by_geometry(experiment, coarse)
    spread = np.diag(sigma**2)
    if follows is not None:
        spread = spread + follows @ follows.T
    return FrequencyInformation(seen, predicted, np.array(scaled), J, spread)


def check_predictable(experiment: Experiment, body: Inertia) -> int:
    """The largest number of modes with which a body swings in a row; refuses rows at which it cannot
    hang.

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
    experiment: Experiment, parameters: tuple[float, ...], coarse: tuple[float, ...]
) -> tuple[Array, Array, Array] | None:
    """Seen and predicted frequencies, and their derivative by the ten linear parameters, of a body
    near another one; None: it cannot hang so.
    """
    body = Inertia.from_parameters(np.array(parameters))
    if body.mass <= 0 or not body.is_physical:
        return None
    predicted, slopes = [], []
    about = _about(experiment, coarse[0], coarse[1:4]) or (None,) * len(experiment.frequencies)
    for each, near in zip(experiment.frequencies, about, strict=True):
        try:
            found = (near and beside(near, body)) or _modes_of(experiment.robot, body, each)
            J = sensitivity(found)
        except InputError:
            return None
        own = _matched(each, found.frequencies)
        predicted.append(found.frequencies[own])
        slopes.append(J[own])
    to_body = body_jacobian(np.array(parameters))
    seen = np.concatenate([each.frequency for each in experiment.frequencies])
    return seen, np.concatenate(predicted), np.concatenate(slopes) @ to_body


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


@lru_cache(maxsize=8)
def _by_geometry(experiment: Experiment, parameters: tuple[float, ...]) -> Array | None:
    """How predicted frequencies follow 1-sigma of every coordinate of anchors and attachments,
    shape (k, 6 m); None: these are exact, or the body cannot hang.
    """
    robot, body = experiment.robot, Inertia.from_parameters(np.array(parameters))
    sigmas = [experiment.uncertainty.get(name, 0.0) for name in ("anchor", "attachment")]
    if not any(sigmas) or body.mass <= 0:
        return None
    scale = np.repeat(sigmas, 3 * robot.m)
    slopes = []
    for each in experiment.frequencies:
        try:
            found = _modes_of(robot, body, each)
            slopes.append(by_points(found)[_matched(each, found.frequencies)])
        except InputError:
            return None
    return np.asarray(np.concatenate(slopes) * scale)


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
    choices = combinations(range(len(modes)), len(seen.frequency))
    off = lambda own: float(  # noqa: E731
        np.sum(((seen.frequency - modes[list(own)]) / seen.sigma) ** 2)
    )
    return list(min(choices, key=off))
