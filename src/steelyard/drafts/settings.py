"""Levels of the guesses of a first experiment file, with unit, reason and source each."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ScaleSettings:
    """When values of columns show their unit: what a platform on cables can do."""

    shortest_step: float = 1e-5
    """Median time between samples that a reader takes, at least [s]."""
    longest_step: float = 10.0
    """The same, at most [s]."""
    gravity: tuple[tuple[str, float, float], ...] = (
        ("g", 0.75, 1.35),
        ("m/s^2", 7.5, 12.6),
        ("mg", 750.0, 1260.0),
    )
    """Unit, and between which readings of an accelerometer hold gravity in it: a quarter below to a
    third above, as bias, gain and motion may make them."""
    steady: float = 0.25
    """Scatter of the length of readings, as a part of it, below which they are mostly gravity."""
    one_way: float = 0.8
    """Length of the mean reading, as a part of the mean length, above which they are as well."""
    no_gravity_steady: float = 0.3
    """Median of steady readings below which gravity is not among them, in any unit but g."""
    no_gravity: float = 3.0
    """Median of any readings below which it is not: a third of it in m/s^2."""
    fast: float = 5.0
    """Angular speed that a platform hardly exceeds, where its robot file states no limit
    [rad/s]."""
    too_fast: float = 3.0
    """Times the limit beyond which rates are no rad/s: degrees are 57 times as many."""
    tilt: float = 3.0
    """Times the largest angle of the robot file beyond which angles are degrees."""
    largest_position: float = 100.0
    """Beyond which a position is in millimetres [m]: no frame is so large."""
    kilonewtons: float = 0.05
    """Sum of tensions as a part of the platform's weight, below which they are kN: it is at least
    the weight."""
    kilograms: float = 0.8
    """The same, below which they are kgf: a tenth of the weight in N."""
    millinewtons: float = 300.0
    """The same, above which they are mN: no cable pulls as much."""
    kilonewtons_of_limit: float = 0.005
    """Sum of tensions as a part of what all cables may bear, below which they are kN."""
    millimetres: float = 100.0
    """Times the size of the frame, beyond which lengths are in millimetres."""
    lever: float = 20.0
    """Torque over force beyond which torques are in N mm [m]: no platform has such a lever."""


@dataclass(frozen=True)
class CompareSettings:
    """When streams of one run show units, signs and mountings of each other."""

    near: float = 2.0
    """Factor within which the ratio of two angular speeds is 1, or that of degrees to radians
    (57): filters and noise change it by less."""
    step: float = 0.1
    """Over which an orientation is differenced [s]: noise of its samples hardly counts."""
    least_speed: float = 0.02
    """Angular speed that is compared at all [rad/s]: below it noise decides."""
    most: int = 4000
    """Samples that are compared: more show no more."""
    least_tilt: float = 0.05
    """Mean square deviation of the direction of gravity, from which on forces can follow it."""
    spread: float = 0.02
    """Second singular value of directions of gravity from which on they determine a rotation."""
    turned: float = 20.0
    """Angle of a mounting from which on it is stated [deg]: below, it is an error of the
    mounting."""
    square: float = 10.0
    """Angle within which a mounting is rounded to right angles [deg]."""
    fits: float = 10.0
    """Angle by which gravity may be off after the best rotation [deg]."""
    upright: float = 0.9
    """Part of the force's variance that has to follow gravity before its sign is believed."""


@dataclass(frozen=True)
class ArrangeSettings:
    """When streams belong to one run, and when their clocks agree."""

    since_1970: float = 1e8
    """A clock that reads more counts from a time that all computers share [s]: 1973."""
    agree: float = 0.1
    """Within so much clocks that begin and end together are one [s]; or within two samples."""
    long_running: float = 20.0
    """Times the length of the recording, from which on clocks that overlap do so by no chance."""
    overlap: float = 0.5
    """Part of the shorter stream that has to overlap."""
    fewest: int = 10
    """Samples that a stream in motion has."""


SCALES = ScaleSettings()
COMPARE = CompareSettings()
ARRANGE = ArrangeSettings()
