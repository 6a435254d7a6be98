"""Whether natural frequencies that somebody has seen are those of the body."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from steelyard.arrays import Array
from steelyard.estimates.quantiles import chi2_tail
from steelyard.experiment.model import Experiment
from steelyard.identification.known_body import plausible
from steelyard.identification.verdict.settings import VerdictSettings
from steelyard.natural_frequencies.information import frequency_information


def of_frequencies(
    experiment: Experiment, parameters: Array, size: float, settings: VerdictSettings
) -> Iterator[str]:
    """Natural frequencies that somebody has seen and a body does not have.

    Args:
        experiment: With what was seen.
        parameters: The ten linear ones of the body, shape (10,).
        size: Plausible radius of the body [m].
        settings: Levels of the verdict.
    """
    if not experiment.frequencies:
        return
    seen = frequency_information(experiment, parameters, plausible(parameters, size))
    if seen is None:
        yield (
            "the body that the recordings tell cannot hang as the natural frequencies say; check"
            " their poses or lengths"
        )
        return
    residual = seen.residual(parameters)
    z = residual / np.sqrt(np.diag(seen.covariance))
    chi = float(residual @ np.linalg.solve(seen.covariance, residual))
    if chi2_tail(chi, len(z)) < settings.family / 10:
        of_each = [each for each in experiment.frequencies for _ in each.frequency]
        worst = int(np.argmax(np.abs(z)))
        own = of_each[worst]
        yield (
            f"the natural frequencies do not fit (chi-square {chi:.0f} on {len(z)}), most in run"
            f" '{own.run}', row {own.row}: seen {seen.seen[worst]:.4g} Hz, predicted"
            f" {seen.seen[worst] - residual[worst]:.4g} Hz; check its pose or lengths, or whether"
            " the load was another"
        )
