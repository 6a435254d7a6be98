"""What is known of the body beforehand, against what the readings alone say of it: a weighed body
checks the force sensors.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from steelyard.estimates.estimate import plausible_sizes
from steelyard.identification.known_body import EXACT
from steelyard.identification.solve.posterior import Posterior
from steelyard.identification.verdict.settings import VERDICT, VerdictSettings
from steelyard.inertia import BODY_PARAMETERS, BODY_UNITS, Inertia

_TOLD = 1e-6
"""Part of the variance of a known value that the readings have to take off it, to say anything."""


@dataclass(frozen=True)
class KnownValue:
    """A body parameter that is known beforehand."""

    name: str
    """One of :data:`steelyard.inertia.BODY_PARAMETERS`."""
    unit: str
    stated: float
    sigma: float
    found: float
    """By the readings alone."""
    deviation: float
    """Its 1-sigma."""

    @property
    def z(self) -> float:
        """Difference in its 1-sigma."""
        return float((self.found - self.stated) / np.hypot(self.sigma, self.deviation))

    def __str__(self) -> str:
        unit = self.unit
        return (
            f"{self.name} is stated as {self.stated:.6g} ± {self.sigma:.2g} {unit}, the readings"
            f" alone say {self.found:.6g} ± {self.deviation:.2g} {unit} (z = {self.z:+.1f})"
        )


def known_values(posterior: Posterior) -> Iterator[KnownValue]:
    """Each against the readings with all else that is known; none that only its statement tells.

    Args:
        posterior: Of the load that they are of.
    """
    size = plausible_sizes(float(posterior.parameters[0]), posterior.size)
    value = Inertia.from_parameters(posterior.parameters).body_parameters
    variance = np.diag(posterior.body_covariance)
    for name, (stated, given) in posterior.experiment.known.items():
        i = BODY_PARAMETERS.index(name)
        square = max(given, EXACT * size[i]) ** 2
        told = 1 - variance[i] / square
        if told < _TOLD or (name == "mass" and posterior.experiment.mass_assumed):
            continue
        # Two readings of one number: taken apart again.
        alone = variance[i] / told
        found = alone * (value[i] / variance[i] - stated / square)
        yield KnownValue(
            name,
            BODY_UNITS[i],
            float(stated),
            float(np.sqrt(square)),
            float(found),
            float(np.sqrt(alone)),
        )


def against_readings(posterior: Posterior, settings: VerdictSettings = VERDICT) -> Iterator[str]:
    """What is known and the readings contradict."""
    for each in known_values(posterior):
        if chi2.sf(each.z**2, 1) < settings.family / 10:
            yield (
                f"what is known beforehand does not go with the readings: {each}; weigh again, or"
                " check the unit and the gains of the force sensors"
            )
