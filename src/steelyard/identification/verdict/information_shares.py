"""What the estimate owes to the data, and what to priors and to what was known about the body."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.identification.known_body import plausible
from steelyard.identification.model.calibration_parameters import ROBOT, CalibrationParameter
from steelyard.identification.solve.posterior import Posterior
from steelyard.inertia import TEN, body_jacobian
from steelyard.instruments.base import LATENCY, TIME_CONSTANT
from steelyard.natural_frequencies.information import frequency_information
from steelyard.robot.covariance import POINTS


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


def variance_shares(posterior: Posterior) -> dict[str, Array]:
    """What is uncertain, in words -> part of the variance of each of the ten body parameters that
    comes from it, shape (10,); together they are 1.

    Readings bring their noise, calibration parameters what their priors leave open: an estimate is
    a linear function of both, so that its variance is the sum of theirs.
    """
    solution = posterior.solution
    J = body_jacobian(posterior.parameters)
    gain = J @ solution.gain[:TEN]

    def of(matrix: Array) -> Array:
        return np.asarray(np.einsum("ik,kl,il->i", gain, matrix, gain))

    whole = np.maximum(np.diag(posterior.body_covariance), 1e-300)
    noise = np.einsum("ij,jk,ik->i", J, solution.noise_part[:TEN, :TEN], J)
    shares: dict[str, Array] = {}
    for (owner, _), matrix in posterior.by_source.items():
        name = owner if owner == ROBOT else f"noise of {owner}"
        shares[name] = shares.get(name, 0.0) + of(matrix)
    shares = {
        ("unmodelled wrench" if name == ROBOT else name): each for name, each in shares.items()
    }
    rest = np.maximum(noise - np.sum(list(shares.values()), axis=0), 0.0) if shares else noise
    shares[_MOTION if shares else "noise of the readings"] = rest
    shares = {name: posterior.noise_factor * each for name, each in shares.items()}
    prior = posterior.prior.precision
    calibration = posterior.calibration.calibration_parameters
    together = {_WEIGHED: calibration.of_weighed}
    if calibration.geometry is not None:
        together["geometry of the cables"] = calibration.of_geometry
    for name, places in together.items():
        use = TEN + places
        block = np.zeros_like(prior)
        block[np.ix_(use, use)] = prior[np.ix_(use, use)]
        shares[name] = of(block)
    joint = np.concatenate(list(together.values()))
    for entry in calibration.entries:
        place = calibration.places[entry.full_key]
        if place.start in joint:
            continue
        own = TEN + np.arange(place.start, place.stop)
        name = _group(posterior, entry)
        shares[name] = shares.get(name, 0.0) + gain[:, own] ** 2 @ np.diag(prior)[own]
    # What is known of bodies is all that is left of the priors, and so is what is plausible.
    shares[_BODY] = np.maximum(whole - np.sum(list(shares.values()), axis=0), 0.0)
    total = np.sum(list(shares.values()), axis=0)
    return {name: each / total for name, each in shares.items() if (each > 0).any()}


_MOTION = "smoothness of the motion"
_BODY = "the body beforehand"
_WEIGHED = "gains, offsets and gravity after dead weights"
_GEOMETRY = frozenset(POINTS)
_OF_ROLLERS = frozenset({"friction", "presliding", "presliding_start", "viscous"})
_OF_GAINS = frozenset({"gain", "common_gain", "crosstalk"})
_OF_CLOCKS = frozenset({"delay", LATENCY, TIME_CONSTANT})


def _group(posterior: Posterior, entry: CalibrationParameter) -> str:
    """What a calibration parameter belongs to, in words."""
    if entry.owner == ROBOT:
        if entry.key in _GEOMETRY:
            return "geometry of the cables"
        if entry.is_load:
            return "what was added to the first load"
        return "gravity" if entry.key == "gravity" else "hoses, air and cable inertia"
    if entry.key in _OF_CLOCKS:
        return "clocks and filters"
    if not posterior.experiment.is_force(entry.owner):
        biased = "bias" in entry.key or "scale" in entry.key
        return f"{'biases and scales' if biased else 'mounting'} of {entry.owner}"
    if entry.key in _OF_ROLLERS:
        return f"rollers before {entry.owner}"
    part = entry.key.partition(".")[0]
    if part in _OF_GAINS:
        return f"gains of {entry.owner}"
    return f"{'offsets' if part == 'offset' else 'mounting'} of {entry.owner}"
