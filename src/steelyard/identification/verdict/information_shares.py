"""What the estimate owes to the data, and what to priors and to what was known about the body."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.identification.known_body import plausible
from steelyard.identification.solve.posterior import Posterior
from steelyard.inertia import TEN, body_jacobian
from steelyard.natural_frequencies.information import frequency_information


def priors_share(posterior: Posterior) -> Array:
    """Part of the variance of each of the ten body parameters that came from priors and not from
    the data, shape (10,).
    """
    J = body_jacobian(posterior.parameters)
    whole = np.diag(posterior.body_covariance)
    noise = np.diag(J @ posterior.solution.noise_part[:TEN, :TEN] @ J.T) * posterior.noise_factor
    return np.asarray(np.clip(1 - noise / np.maximum(whole, 1e-300), 0.0, 1.0))


def label_mask(posterior: Posterior) -> NDArray[np.bool_]:
    """Which of the ten body parameters were told by what was known about the body rather than by
    the data, shape (10,).
    """
    if not posterior.experiment.known:
        return np.zeros(TEN, dtype=bool)
    size = plausible(posterior.parameters, posterior.size)
    seen = frequency_information(posterior.experiment, posterior.parameters, size)
    J = body_jacobian(posterior.parameters)
    use = np.flatnonzero(posterior.solution.estimated)
    precision = posterior.prior.precision.copy()
    # Frequencies are data.
    precision[:TEN, :TEN] = 0.0 if seen is None else seen.about()[0]
    matrix = posterior.total.normal[np.ix_(use, use)] + precision[np.ix_(use, use)]
    scale = 1 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    alone = np.linalg.pinv(matrix * np.outer(scale, scale), rcond=1e-14, hermitian=True) * np.outer(
        scale, scale
    )
    without = np.diag(J @ alone[:TEN, :TEN] @ J.T)
    return np.asarray(np.diag(posterior.body_covariance) < 0.5 * without)
