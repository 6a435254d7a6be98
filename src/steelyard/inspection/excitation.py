"""What the recording can tell, from the information of all of its readings: the ten of the body,
and every systematic error.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from steelyard.estimates.estimate import plausible_radius, plausible_sizes
from steelyard.identification.model.calibration_parameters import ROBOT, CalibrationParameter
from steelyard.identification.solve.joint_study import Joint
from steelyard.inertia import BODY_PARAMETERS, BODY_UNITS, Inertia

Told = Literal["data", "data and prior", "prior", "not at all"]

_HALF = 0.5
"""Of its plausible size, or of its prior 1-sigma: what is known better than that is told by the
data."""
_MOSTLY = 0.9
"""Of its prior 1-sigma: what is known no better than that is told by the prior."""


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


def excitation(joint: Joint) -> Excitation:
    """From a fit of the experiment: its bound.

    Args:
        joint: Of it.
    """
    study = joint.study
    experiment, calibration_parameters = study.experiment, study.calibration.calibration_parameters
    sizes = plausible_sizes(abs(float(study.parameters[0])), plausible_radius(experiment.robot))
    values = Inertia.from_parameters(study.parameters).body_parameters
    findings = []
    for i, name in enumerate(BODY_PARAMETERS):
        sigma, prior = float(joint.bound.standard_deviation[i]), experiment.known.get(name)
        known = prior[1] if prior else None
        told = (
            _determined_by(sigma, known)
            if known is not None
            else "data"
            if sigma < _HALF * sizes[i]
            else "not at all"
        )
        findings.append(Identifiability(name, BODY_UNITS[i], float(values[i]), sigma, known, told))
    left = np.sqrt(np.maximum(np.diag(joint.bound.calibration), 0.0))
    names = calibration_parameters.names
    calibration = [
        Identifiability(
            names[place],
            unknown.unit,
            float(study.calibration.values[place]),
            float(left[place]),
            float(unknown.deviation[component]),
            _determined_by(float(left[place]), float(unknown.deviation[component])),
            _group(unknown),
        )
        for place, unknown, component in calibration_parameters.components()
        if unknown.deviation[component] > 0
    ]
    return Excitation(tuple(findings), tuple(calibration))


def _group(unknown: CalibrationParameter) -> str:
    owner = "" if unknown.owner == ROBOT else f"{unknown.owner}."
    return f"{owner}{unknown.key}" + (f" of run '{unknown.run}'" if unknown.run else "")


def _determined_by(sigma: float, prior: float) -> Told:
    if sigma < _HALF * prior:
        return "data"
    return "data and prior" if sigma < _MOSTLY * prior else "prior"
