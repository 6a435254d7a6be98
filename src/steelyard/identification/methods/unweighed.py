"""Estimates of bodies that no force sensor has weighed: told up to their mass."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from steelyard.estimates.estimate import Estimate, Label
from steelyard.estimates.per_mass import PerMass
from steelyard.experiment.model import Experiment
from steelyard.experiment.unread import is_unread
from steelyard.inertia import BODY_PARAMETERS

_NAMES = np.array(BODY_PARAMETERS)
_OF_MASS = np.array([name == "mass" or name.startswith("J") for name in BODY_PARAMETERS])
"""Those of the ten that are multiples of the mass, shape (10,)."""


def up_to_mass(experiment: Experiment, estimate: Estimate) -> Estimate:
    """An estimate with the inertia over mass beside it, where no force is read; where the mass is an
    assumption, it and its multiples are struck out.

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
