"""What is known of the body beforehand, against what the readings alone say of it: a weighed body
checks the force sensors.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import Array
from steelyard.estimates.estimate import plausible_sizes
from steelyard.estimates.quantiles import chi2_tail
from steelyard.experiment.unread import is_unread
from steelyard.identification.known_body import EXACT
from steelyard.identification.model.calibration_parameters import load_place
from steelyard.identification.solve.posterior import Posterior
from steelyard.identification.verdict.settings import VERDICT, VerdictSettings
from steelyard.inertia import BODY_PARAMETERS, BODY_UNITS, TEN, Inertia

_ADDED = (("added mass", "kg"), *((f"added first moment {axis}", "kg m") for axis in "xyz"))
"""Names and units of what may be known of what was added."""
_TOLD = 1e-6
"""Part of the variance of a known value that the readings have to take off it, to say anything."""


@dataclass(frozen=True)
class KnownValue:
    """A body parameter that is known beforehand, or what is known of what was added to the first
    load.
    """

    name: str
    """One of :data:`steelyard.inertia.BODY_PARAMETERS`; ``added mass``, ``added first moment x``
    …"""
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

    def less(self, off: float) -> KnownValue:
        """The same counted from elsewhere, in its unit."""
        return replace(self, stated=self.stated - off, found=self.found - off)

    def __str__(self) -> str:
        unit = self.unit
        return (
            f"{self.name} is stated as {self.stated:.6g} ± {self.sigma:.2g} {unit}, the readings"
            f" alone say {self.found:.6g} ± {self.deviation:.2g} {unit} (z = {self.z:+.1f})"
        )


def known_values(posterior: Posterior) -> Iterator[KnownValue]:
    """Each against the readings with all else that is known, in the platform frame as it was
    stated; none that only its statement tells.

    Args:
        posterior: Of the load that they are of.
    """
    size = plausible_sizes(float(posterior.parameters[0]), posterior.size)
    value = Inertia.from_parameters(posterior.parameters).body_parameters
    off = _off(posterior)
    variance = np.diag(posterior.body_covariance)
    for name, (stated, given) in posterior.experiment.known.items():
        i = BODY_PARAMETERS.index(name)
        square = max(given, EXACT * size[i]) ** 2
        told = 1 - variance[i] / square
        # Without forces all but what is known of the mass is the same for any mass.
        if told < _TOLD or (name == "mass" and is_unread(posterior.of_its_runs)):
            continue
        found = _apart(name, BODY_UNITS[i], (stated, square), (value[i], variance[i]))
        yield found.less(float(off[i]))
    yield from _added_values(posterior)


def _added_values(posterior: Posterior) -> Iterator[KnownValue]:
    """The same of what the load that it is seen from has more than the first."""
    if posterior.load is None:
        return
    calibration = posterior.calibration
    parameters = calibration.calibration_parameters
    place = load_place(parameters, posterior.load)
    prior = parameters.deviation[place] ** 2
    variance = np.diag(posterior.solution.covariance)[TEN:][place]
    off = parameters.mean[place][0] * _off(posterior)
    for i, (name, unit) in enumerate(_ADDED):
        entry = posterior.load.added.get("mass" if i == 0 else f"c{'xyz'[i - 1]}")
        if entry is None or variance[i] > (1 - _TOLD) * prior[i]:
            continue
        mean, value = parameters.mean[place][i], calibration.values[place][i]
        found = _apart(name, unit, (mean, prior[i]), (value, variance[i]))
        yield found.less(float(off[i]))


def _off(posterior: Posterior) -> Array:
    """Where the origin of the platform frame as it was stated lies, at the places of the centre of
    gravity among the ten, shape (10,).
    """
    return np.concatenate([[0.0], posterior.experiment.origin, np.zeros(TEN - 4)])


def _apart(
    name: str, unit: str, stated: tuple[float, float], both: tuple[float, float]
) -> KnownValue:
    """Two readings of one number taken apart again.

    Args:
        name: Of the number.
        unit: Of the number.
        stated: What is known beforehand, and its variance.
        both: What follows from that and the readings, and its variance.
    """
    alone = both[1] / (1 - both[1] / stated[1])
    found = alone * (both[0] / both[1] - stated[0] / stated[1])
    return KnownValue(
        name,
        unit,
        float(stated[0]),
        float(np.sqrt(stated[1])),
        float(found),
        float(np.sqrt(alone)),
    )


def against_readings(posterior: Posterior, settings: VerdictSettings = VERDICT) -> Iterator[str]:
    """What is known and the readings contradict."""
    for each in known_values(posterior):
        if chi2_tail(each.z**2, 1) < settings.family / 10:
            yield (
                f"what is known beforehand does not go with the readings: {each}; weigh again, or"
                " check the unit and the gains of the force sensors"
            )
