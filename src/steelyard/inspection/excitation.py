"""What is identifiable from a recording, by the information of all of its readings: the ten of the
body, and every systematic error.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from steelyard.estimates.estimate import plausible_radius, plausible_sizes
from steelyard.identification.model.calibration_parameters import ROBOT, CalibrationParameter
from steelyard.identification.solve.posterior import Posterior
from steelyard.inertia import BODY_PARAMETERS, BODY_UNITS, Inertia
from steelyard.inspection.settings import IDENTIFIABILITY, IdentifiabilitySettings

Told = Literal["data", "data and prior", "prior", "per mass", "not at all"]
"""``per mass``: its ratio to the mass, where nothing weighs the platform."""


@dataclass(frozen=True)
class Identifiability:
    """How well one number can be known."""

    name: str
    unit: str
    value: float
    """About which this was looked at."""
    sigma: float
    """1-sigma at best."""
    prior: float | None
    """1-sigma beforehand; None where nothing is known."""
    told: Told
    group: str = ""
    """What its neighbours share with it: the error of all axes, or of all cables."""


@dataclass(frozen=True)
class Excitation:
    """How well everything can be known from this recording."""

    body: tuple[Identifiability, ...]
    """The ten of :data:`steelyard.inertia.BODY_PARAMETERS`."""
    calibration: tuple[Identifiability, ...]
    """Every systematic error that is not known exactly."""


def excitation(joint: Posterior, settings: IdentifiabilitySettings = IDENTIFIABILITY) -> Excitation:
    """From a fit of the experiment: its bound.

    Args:
        joint: Of it.
        settings: When the data determine a number.
    """
    experiment = joint.experiment
    sizes = plausible_sizes(abs(float(joint.parameters[0])), plausible_radius(experiment.robot))
    values = Inertia.from_parameters(joint.parameters).about(experiment.origin).body_parameters
    body = []
    for i, name in enumerate(BODY_PARAMETERS):
        sigma = float(joint.bound.standard_deviation[i])
        told: Told = "data" if sigma < settings.data * sizes[i] else "not at all"
        _, known = experiment.known.get(name, (None, None))
        if known is not None:
            told = _determined_by(sigma, known, settings)
        value = float(values[i])
        if experiment.mass_assumed and BODY_UNITS[i].startswith("kg"):
            # In the multiples of a mass that is only assumed.
            told = "per mass" if name != "mass" and told == "data" else "not at all"
            value = sigma = np.nan
            known = None
        body.append(Identifiability(name, BODY_UNITS[i], value, sigma, known, told))
    return Excitation(tuple(body), tuple(_of_calibration(joint, settings)))


def _of_calibration(
    joint: Posterior, settings: IdentifiabilitySettings
) -> Iterator[Identifiability]:
    """Of every systematic error that is not known exactly."""
    parameters = joint.calibration.calibration_parameters
    left = np.sqrt(np.maximum(np.diag(joint.bound.calibration), 0.0))
    for place, unknown, component in parameters.components():
        sigma, prior = float(left[place]), float(unknown.deviation[component])
        if prior > 0 and not unknown.is_load:
            yield Identifiability(
                parameters.names[place],
                unknown.unit,
                float(joint.calibration.values[place]),
                sigma,
                prior,
                _determined_by(sigma, prior, settings),
                _group(unknown),
            )


def _group(unknown: CalibrationParameter) -> str:
    owner = "" if unknown.owner == ROBOT else f"{unknown.owner}."
    return f"{owner}{unknown.key}" + (f" of run '{unknown.run}'" if unknown.run else "")


def _determined_by(sigma: float, prior: float, settings: IdentifiabilitySettings) -> Told:
    """By what a number is known whose 1-sigma was another one beforehand."""
    if sigma < settings.data * prior:
        return "data"
    return "data and prior" if sigma < settings.mostly_prior * prior else "prior"
