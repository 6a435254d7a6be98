"""Levels of the calibration, with the reasons."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class CalibrationSettings:
    """How the geometry is looked for."""

    anchor: float = 0.3
    """1-sigma of every coordinate of an anchor that nobody has stated [m]: a hall measured with a
    tape."""
    attachment: float = 0.03
    """The same of attachments [m]: drawn, and built about so."""
    scale: float = 0.5
    """1-sigma of the length of a cable per that of its drum's reading, where something metric is
    read."""
    offset: float = 3.0
    """1-sigma of the offset of a length that nobody has stated [m]."""
    roller: float = 0.001
    """1-sigma of the radius of a roller [m]: the groove and half the cable."""
    roller_axis: float = 0.01
    """1-sigma of the axis about which a roller swivels [rad]: half a degree, as things stand that
    are put up with a level."""
    force: float = 0.02
    """1-sigma of a tension whose noise is not stated, over the usual one, to begin with."""
    upright: float = 0.7
    """1-sigma of the orientation of a platform of which nothing tells it [rad]."""
    told: float = 0.5
    """1-sigma over that before, above which the readings have not told a number."""
    coarse: tuple[float, ...] = (300.0, 20.0)
    """Factors on all noise with which a fit begins, one after the other."""
    wrong: float = 6.0
    """Size of a residual, in its 1-sigma, of a row that is wrong."""
    most_wrong: float = 0.15
    """Part of the rows of a channel that may be left out as wrong: with more it is the
    description."""
    device: float = 100.0
    """Noise that nobody has stated, over the usual one, that no device has: places to a decimetre,
    orientations to six degrees."""
    renewed: float = 0.1
    """Move of a point from which on cables in motion are fitted again about where it is found [m]:
    it turns the ends of a sagging cable by less than their forces tell."""
    renewals: int = 4
    """Times at most that they are."""
    rounds: int = 5
    """Times that wrong rows are looked for."""
    far_off: float = 5.0
    """Move of a point, in its 1-sigma beforehand, that nobody would have said so."""
    by_chance: float = 1e-3
    """Probability below which residuals are larger than their noise is."""


CALIBRATION = CalibrationSettings()
