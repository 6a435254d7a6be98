"""Estimates of bodies that no force sensor has weighed: told up to their mass."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from steelyard.estimates.estimate import Estimate, Label
from steelyard.estimates.geometry import FoundGeometry
from steelyard.estimates.per_mass import PerMass
from steelyard.experiment.model import Experiment
from steelyard.experiment.unread import is_unread
from steelyard.identification.model.calibration_parameters import ROBOT
from steelyard.identification.solve.posterior import Posterior
from steelyard.inertia import BODY_PARAMETERS, TEN, Inertia, body_jacobian

_NAMES = np.array(BODY_PARAMETERS)
_OF_MASS = np.array([name == "mass" or name.startswith("J") for name in BODY_PARAMETERS])
"""Those of the ten that are multiples of the mass, shape (10,)."""


def found_geometry(found: Posterior) -> FoundGeometry | None:
    """Anchors and attachments that a body without forces has been found with; None: forces were
    read, or the geometry is exact, or not all of the body is told.
    """
    experiment, places = found.experiment, found.calibration.calibration_parameters.places
    if not is_unread(experiment) or not found.identifiable.all() or not found.fit.converged:
        return None
    own = [places[ROBOT, name, None] for name in ("anchor", "attachment")]
    robot = experiment.robot
    values = np.array([found.calibration.values[place].reshape(-1, 3) for place in own])
    # Of the ten, then of anchors and attachments.
    geometry = found.calibration.calibration_parameters.of_geometry
    use = np.concatenate([np.arange(TEN), TEN + geometry])
    joint = found.solution.covariance[np.ix_(use, use)]
    jacobian = np.zeros((len(use) - 1, len(use)))
    body = Inertia.from_parameters(found.parameters).body_parameters
    jacobian[:9, :TEN] = PerMass.jacobian(body) @ body_jacobian(found.parameters)
    jacobian[9:, TEN:] = np.eye(len(use) - TEN)
    covariance = jacobian @ joint @ jacobian.T
    nominal = np.array([robot.anchors, robot.attachments])
    return FoundGeometry(nominal, values, (covariance + covariance.T) / 2)


def up_to_mass(experiment: Experiment, estimate: Estimate) -> Estimate:
    """An estimate with the inertia over mass beside it, where no force is read; where the mass is
    an assumption, it and its multiples are struck out.

    Args:
        experiment: That it was made from.
        estimate: With the mass as known or assumed.
    """
    if not is_unread(experiment):
        return estimate
    per_mass = PerMass.of(estimate.value, estimate.covariance)
    if not experiment.mass_assumed:
        return replace(estimate, per_mass=per_mass)
    labels: dict[str, Label] = dict(estimate.verdict.parameters)
    labels |= dict.fromkeys(_NAMES[_OF_MASS].tolist(), "unidentifiable")
    told = ~_OF_MASS
    return replace(
        estimate,
        value=np.where(told, estimate.value, np.nan),
        covariance=np.where(np.outer(told, told), estimate.covariance, np.nan),
        verdict=replace(estimate.verdict, parameters=labels),
        per_mass=per_mass,
        notes=(
            *estimate.notes,
            "no force was read, so that mass and inertia are not told, only the inertia per mass;"
            " weigh the platform once and state 'known: {mass: {value: …, sigma: …}}'",
        ),
    )
