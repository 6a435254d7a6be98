"""What is known of a body before any reading: that it is no larger than its robot, what natural
frequencies tell, and what the user says.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.estimates.estimate import plausible_sizes
from steelyard.experiment.model import Experiment
from steelyard.identification.model.calibration_parameters import CalibrationValues, load_place
from steelyard.inertia import BODY_PARAMETERS, TEN, Inertia, body_jacobian
from steelyard.natural_frequencies.information import frequency_information

EXACT = 1e-6
"""1-sigma of what is known exactly, as a part of its plausible size."""
_LARGEST = 3.0
"""1-sigma of the body before any reading, in parts of its plausible size: it moves what the data
tell to half of that size by less than .06 of a sigma."""


def plausible(parameters: Array, size: float) -> Array:
    """Plausible size of the ten linear parameters, shape (10,)."""
    mass = max(abs(float(parameters[0])), 1e-9)
    return np.array([mass, *[mass * size] * 3, *[mass * size**2] * 6])


class KnownBody(NamedTuple):
    """What is known beforehand of one of the loads."""

    place: slice | None
    """Where what it is more than the first load stands among the calibration parameters; None: it
    is the first."""
    precision: Array
    """Of its ten linear parameters, shape (10, 10)."""
    gradient: Array
    """Of what is known, about where they are now, shape (10,)."""

    def columns(self, column_of: NDArray[np.intp]) -> list[NDArray[np.intp]]:
        """Columns of the border that its ten are the sum of, each of shape (10,).

        Args:
            column_of: Column of each calibration parameter; -1: not there; shape (u,).
        """
        first = np.arange(TEN)
        if self.place is None or (column_of[self.place] < 0).any():
            return [first]
        return [first, column_of[self.place]]


def known_bodies(
    experiment: Experiment, calibration: CalibrationValues, parameters: Array, size: float
) -> list[KnownBody]:
    """What is known beforehand of all loads, see :func:`known_body`.

    Args:
        experiment: With what is known.
        calibration: With what further loads are more than the first.
        parameters: The ten of the first load, shape (10,).
        size: Plausible radius of a body [m].
    """
    parts: list[tuple[slice | None, Array]] = [(None, parameters)]
    for further in experiment.loads[1:]:
        own_place = load_place(calibration.calibration_parameters, further)
        parts.append((own_place, parameters + calibration.values[own_place]))
    # Where no reading tells a load yet, its own mass is no measure of what it may be.
    mass = max(abs(float(own[0])) for _, own in parts)
    found = []
    for (place, own), load in zip(parts, experiment.loads or (None,), strict=True):
        known = experiment if load is None else experiment.of_load(load)
        precision, pull = known_body(known, own, size, mass)
        found.append(KnownBody(place, precision, pull - precision @ own))
    return found


def known_body(
    experiment: Experiment, parameters: Array, size: float, mass: float | None = None
) -> tuple[Array, Array]:
    """Precision of what is known about the body beforehand, and its pull, shapes (10, 10) and
    (10,).

    That it is not much larger than its robot, what natural frequencies tell that somebody has seen,
    and what the user knows. Without the former an
    inertia that the data do not tell may grow until unseen vibrations explain all torques with it.

    Args:
        experiment: With what is known.
        parameters: Its ten linear parameters, about which all is linearised, shape (10,).
        size: Plausible radius of a body [m].
        mass: Of a body that is plausible [kg]; None: its own.
    """
    sizes = plausible(parameters if mass is None else np.array([mass]), size)
    precision, pull = np.diag((_LARGEST * sizes) ** -2), np.zeros(TEN)
    seen = frequency_information(experiment, parameters, sizes)
    if seen is not None:
        of_seen, toward = seen.about()
        precision, pull = precision + of_seen, pull + toward
    if not experiment.known:
        return precision, pull
    body = Inertia.from_parameters(parameters).body_parameters
    J = body_jacobian(parameters)
    own = plausible_sizes(float(parameters[0]), size)
    for name, (value, sigma) in experiment.known.items():
        i = BODY_PARAMETERS.index(name)
        deviation = max(sigma, EXACT * own[i])
        row = J[i] / deviation
        precision += np.outer(row, row)
        pull += row * ((value - body[i]) / deviation + row @ parameters)
    return precision, pull
