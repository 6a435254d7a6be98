"""What measured lengths tell of the cables and their rollers, by the instrument that knows it
best.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.calibration.fit import GeometryFit
from steelyard.calibration.settings import CalibrationSettings
from steelyard.instruments.length import ROLLER, ROLLER_AXIS, STRETCH
from steelyard.robot.pulley import leaned


def stiffness_of(found: GeometryFit, settings: CalibrationSettings) -> tuple[float, float] | None:
    """Axial stiffness of the cables and its 1-sigma [N]; None: the readings do not tell it."""
    told = _of_lengths(found, settings, STRETCH)
    stated = found.experiment.robot.cable.axial_stiffness
    if told is None or not stated or not told[0][0] > 0:
        return None
    stretch, sigma = float(told[0][0]), float(told[1][0])
    return stated / stretch, stated * sigma / stretch**2


def rollers_of(found: GeometryFit, settings: CalibrationSettings) -> tuple[Array, Array] | None:
    """Radii of the rollers and their 1-sigma [m], NaN where the readings do not tell them, shape
    (m,) each; None: they tell none.
    """
    told = _of_lengths(found, settings, ROLLER)
    if told is None:
        return None
    drawn = found.experiment.robot.pulley_radius
    there = drawn > 0
    return np.where(there, drawn + told[0], np.nan), np.where(there, told[1], np.nan)


def axes_of(found: GeometryFit, settings: CalibrationSettings) -> tuple[Array, Array] | None:
    """Axes about which the rollers swivel, unit vectors in the world frame of the description,
    shape (m, 3), and the 1-sigma of how they lean along two directions square to them [rad], shape
    (m, 2); NaN where the readings do not tell both; None: they tell none.
    """
    told = _of_lengths(found, settings, ROLLER_AXIS)
    if told is None:
        return None
    robot = found.experiment.robot
    lean, sigma = (each.reshape(-1, 2) for each in told)
    known = np.isfinite(lean).all(axis=1) & (robot.pulley_radius > 0)
    if not known.any():
        return None
    axes = np.array(
        [leaned(axis, *own).full()[:, 0] for axis, own in zip(robot.pulley_axis, lean, strict=True)]
    )
    return np.where(known[:, None], axes, np.nan), np.where(known[:, None], sigma, np.nan)


def told_errors(found: GeometryFit, settings: CalibrationSettings) -> NDArray[np.bool_]:
    """Which errors the readings tell rather than what was known beforehand, shape (u,)."""
    before = found.parameters.deviation
    return np.asarray((before > 0) & (found.deviations < settings.told * before))


def _of_lengths(
    found: GeometryFit, settings: CalibrationSettings, key: str
) -> tuple[Array, Array] | None:
    """Values and 1-sigma of an error of the lengths, NaN where they are not told, by the instrument
    that knows them best; None: none does.
    """
    known, best = told_errors(found, settings), None
    for owner, own, run in found.parameters.places:
        if own != key or run is not None:
            continue
        place = found.parameters.places[owner, own, run]
        told = known[place]
        sigma = np.where(told, found.deviations[place], np.nan)
        if told.any() and (best is None or np.nanmean(sigma) < np.nanmean(best[1])):
            best = np.where(told, found.calibration.values[place], np.nan), sigma
    return best
