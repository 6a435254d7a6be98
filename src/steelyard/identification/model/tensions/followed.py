"""Tensions that lengths follow: as the forces carry the body, as far as the cables stretch by them,
and without the noise that the lengths themselves show.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.identification.model.calibration_parameters import (
    CalibrationValues,
)
from steelyard.identification.model.motion_segment import (
    CarriedTensions,
)
from steelyard.identification.tally import limit
from steelyard.instruments.length import CABLE_DAMPING

AT_ONCE = 16384
"""Samples whose rows are held at once."""


Carried = Callable[[Array], CarriedTensions]
"""From times within a segment [s], shape (n,)."""


def stretching(
    carried: Carried,
    calibration: CalibrationValues,
    name: str,
    run: str,
    column_of: NDArray[np.intp],
) -> Carried:
    """Tensions by which cables stretch as an instrument reads them: their damping takes a part.

    Args:
        carried: All of the tensions.
        calibration: Present values of the systematic errors.
        name: Of the instrument.
        run: In which it reads.
        column_of: Column of each systematic error in the border; -1: not there; shape (u,).
    """
    try:
        place = calibration.calibration_parameters.place(name, CABLE_DAMPING, run)
    except KeyError:
        return carried
    lags, columns = calibration.values[place], column_of[place]

    def at_times(times: Array) -> CarriedTensions:
        return carried(times).behind(lags, columns)

    return at_times


class CorrectedTensions:
    """Tensions that lengths follow: as the forces carry the body, then less the noise that the
    lengths themselves show, so that it does not meet itself in the derivatives [Helmert1872]_.
    """

    carried: CarriedTensions
    about: CarriedTensions
    """About which is linearised, once the times are known."""

    def __init__(self, at: Carried, sigma: float | Array) -> None:
        self._at, self._sigma = at, sigma
        self._off: Array | None = None

    def __call__(self, times: Array) -> CarriedTensions:
        """Tensions about which is linearised."""
        if self._off is None:
            self.carried = self.about = self._at(times)
        return self.about

    def deviation(self, slope: Array) -> Array:
        """1-sigma of the residuals by noise of the lengths and of the tensions, shape (n, k).

        Args:
            slope: Derivative of the residuals by the tensions, shape (n, k, m).
        """
        own = np.einsum("nkm,nm->nk", slope**2, self.carried.variance)
        return np.asarray(np.sqrt(np.square(self._sigma) + own))

    def correct(self, linear: Mapping[str, Array]) -> bool:
        """Take off the noise that the residuals show, no more than noise may do; whether there is
        any.
        """
        slope, noise = linear["by_tension"], self.carried.noise
        far = limit(1) * self.deviation(slope)
        residual = np.clip(np.nan_to_num(linear["residual"]), -far, far)
        shown = slope @ noise
        own = np.broadcast_to(np.square(self._sigma), residual.shape)
        covariance = shown @ shown.transpose(0, 2, 1) + own[:, :, None] * np.eye(own.shape[1])
        likeliest = np.linalg.solve(covariance, residual[:, :, None])
        off = (noise @ (shown.transpose(0, 2, 1) @ likeliest))[:, :, 0]
        # No cable is pulled slack by noise.
        most = 0.5 * np.abs(self.carried.values)
        self._off = np.clip(off, -most, most)
        self.about = self.carried.without(self._off)
        return bool(self._off.any())

    def as_carried(self, linear: Mapping[str, Array]) -> Mapping[str, Array]:
        """The linearised difference at the carried tensions, by derivatives about the others."""
        assert self._off is not None
        further = np.einsum("nkm,nm->nk", linear["by_tension"], self._off)
        return {**linear, "residual": linear["residual"] + further}
