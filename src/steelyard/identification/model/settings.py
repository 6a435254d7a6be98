"""Numbers that decide how readings become a motion in continuous time, with the reason of each."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class MotionSettings:
    """Of segments, their knots and their smoothness."""

    # Segments

    gap: float = 0.5
    """Longest stretch without a reading of the rotation, or of the translation, that a motion is
    carried over [s]: half a period of the slow motions that platforms make."""
    shortest: float = 1.0
    """Least length of a segment [s]: below it the ends, which one side tells, are most of it."""
    margin: float = 0.1
    """Of the knots beyond the first and the last reading [s]: clocks may still be moved."""
    least_noise: float = 1e-4
    """Of a quantity that scatters by nothing but rounding, as a part of how much it varies: no
    sensor resolves more."""
    least_jerk: float = 1e-2
    """Mean square of a third derivative to begin with, at least [m^2/s^6], [1/s^6]: where nothing
    tells the place, it begins as if at rest."""
    commanded_position: float = 0.02
    """1-sigma of how far a platform is from its commanded place, where that stands in for a
    measurement [m]: what winches and elastic cables leave."""
    commanded_orientation: float = 0.02
    """The same of its orientation [rad]."""
    commanded_rate: float = 0.1
    """Readings of a command a second that count as independent [Hz]: it is wrong for a while where
    it is wrong."""

    # Spacing of the knots

    finest: float = 0.02
    """On cables [s]: platforms on cables move below 25 Hz."""
    finest_on_sensor: float = 0.005
    """On a wrench sensor [s]: arms vibrate up to 100 Hz."""
    widest: float = 0.45
    """[s]: about a second of motion between knots tells nothing about accelerations."""
    judged: float = 20.0
    """Length of the stretch on which the spacing is chosen [s]."""
    per_knot: float = 2.0
    """Samples between two knots, at least: a motion that its instruments do not resolve cannot be
    told from their readings, and the forces, which would tell it instead, could then say nothing
    about the body."""
    per_vibration: float = 3.0
    """The same of the accelerometer where it is to follow a vibration."""

    # Poses at rest

    place_at_rest: float = 1e-3
    """First guess of the noise of a place where none is stated [m]."""
    angle_at_rest: float = 3e-3
    """The same of an orientation [rad]."""
    specific_force_at_rest: float = 0.03
    """The same of a specific force [m/s^2]."""
    rate_at_rest: float = 3e-3
    """The same of an angular velocity [rad/s]."""
    best_at_rest: float = 10.0
    """By how much it may be better than that: two instruments at rest cannot tell which of them is
    the better one."""

    # Smoothness

    looser: float = 30.0
    """By how much more a motion that its instruments resolve is let do than it does on average:
    where it rings, its roughness sits in narrow bands, far above the mean, and a prior that is too
    stiff there takes from the acceleration what the forces measure. It widens what passes by
    30^(1/6), less than twofold."""

    def at_rest(self, unit: str) -> float:
        """First guess of the noise of a quantity at rest, by its unit."""
        return {
            "m": self.place_at_rest,
            "rad": self.angle_at_rest,
            "m/s^2": self.specific_force_at_rest,
            "rad/s": self.rate_at_rest,
        }[unit]


MOTION = MotionSettings()
"""What is used where nothing is given."""
