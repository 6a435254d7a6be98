"""Numbers that decide whether instruments agree, with the reason of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class ExcerptSettings:
    """Which part of a run is looked at, and how smooth."""

    longest: float = 30.0
    """Of a run that is looked at [s]: enough for every sign and axis, and quick."""
    shortest: float = 0.5
    """Of a run that is looked at [s]."""
    margin: float = 10.0
    """Of a stream beside that part, so that clocks may be moved [s]."""
    finest: float = 0.1
    """Spacing of the knots [s]: what platforms do on purpose is slower."""
    samples_per_knot: float = 3.0
    """Of the slowest stream, so that its samples determine every spline."""
    fewest_knots: float = 6.0
    """Knots in the part."""
    most: int = 160
    """Instants that are looked at: all agreements of a description take milliseconds."""
    bin: float = 0.25
    """Length of which means are taken to see where most happens [s]."""


EXCERPT = ExcerptSettings()


@dataclass(frozen=True)
class BalanceSettings:
    """What a body may leave of measured forces, and how far it may be from the nominal one."""

    measured: float = 0.05
    """What may be left of the changes of a wrench, as a part of them: smoothing, elasticity."""
    commanded: float = 0.1
    """The same where the motion is a commanded one."""
    cross: float = 0.5
    """Part of these two, of the other axes."""
    weight: float = 0.01
    """What may be left as a part of the force itself: geometry, sag, gains."""
    mass: float = 0.45
    """How far a platform may be from its nominal mass, as a logarithm."""
    center: float = 0.35
    """How far its centre of gravity may be from the nominal one, in radii of the platform; without
    cables in metres."""
    center_unknown: float = 1.5
    """The same from the origin, where no nominal body is stated."""
    moments: float = 1.5
    """1-sigmas that moments of inertia may be below what the first moment alone asks for."""
    offsets: float = 3.0
    """1-sigmas that offsets of sensors in the cables may be off."""
    negative: float = 7.0
    """Logarithm that stands for a mass below zero: a factor of a thousand."""
    range: float = 1.0
    """Logarithm by which tensions may lie beyond the limits of the robot file."""
    slack: float = 0.02
    """How far below zero a tension may read, as a part of the median: noise and offsets."""
    off_center: float = 0.5
    """Lever at which noise in the specific force becomes torque, in radii of the platform."""
    effective: float = 30.0
    """Samples that count as independent when a body is fitted."""
    accelerometer: float = 0.1
    """1-sigma of an accelerometer beside the motion: bias, misalignment [m/s^2]."""
    sensor_offset: float = 0.02
    """1-sigma of the offset of a force sensor that is not stated, as a part of the median
    tension."""
    least_offset: float = 0.25
    """Part of that, that a stated offset is allowed at least: imperfect models look like
    offsets."""


BALANCE = BalanceSettings()


@dataclass(frozen=True)
class AgreementSettings:
    """What two accounts of one motion may differ by; chosen on simulated and real recordings
    (docs/validation.md) so that sound ones stay below a ratio of one and a half.
    """

    excerpt: ExcerptSettings = EXCERPT
    """Of the part of a run that is looked at."""
    balance: BalanceSettings = BALANCE
    """Of forces against a body."""

    bad: float = 1.8
    """Ratio of what is left to what is allowed beyond which instruments contradict each other."""
    moving_within: float = 10.0
    """The same of forces in a run whose load has something that moves in it, in these: a third of
    the mass on a string leaves four times what is allowed."""
    measured: float = 0.05
    """What may be left of a motion that two instruments measure, as a part of it: smoothing and
    imperfect models."""
    commanded: float = 0.1
    """The same of a commanded motion, which a platform on elastic cables follows less well."""
    cross: float = 0.3
    """Part of these two, of the other axes: what misalignment takes from them."""
    effective: float = 10.0
    """Samples that count as independent when a calibration error is compared with its prior:
    imperfect models change slowly."""
    far_from_prior: float = 3.0
    """1-sigmas that a calibration error may be off."""
    late: float = 1.33
    """1-sigmas that a clock may be off; clocks are as good as they are said to be."""
    least: Mapping[str, float] = field(
        default_factory=lambda: {"rad/s": 2e-3, "rad": 5e-3, "m/s^2": 0.05, "m": 5e-3}
    )
    """Unit -> difference that is always allowed, whatever the noise."""
    least_sigma: Mapping[str, float] = field(
        default_factory=lambda: {"rad/s": 0.005, "rad": 0.02, "m/s^2": 0.1, "m": 0.02}
    )
    """Unit -> 1-sigma of a calibration error that any description may have, whatever it states."""
    least_reference: float = 0.03
    """The same of the reference of an orientation [rad]."""
    least_lever: float = 0.03
    """The same of the place of an accelerometer [m]."""
    least_clock: float = 0.02
    """1-sigma that a clock is allowed at least [s]: half a knot of the fastest motion."""
    clock: float = 0.05
    """1-sigma of a clock whose error is taken from the data [s], the contract's default."""
    command_clock: float = 0.3
    """1-sigma of how late a platform follows its command [s]."""
    command_place: float = 0.03
    """1-sigma of how far the world of a controller is from that of the robot file [m]."""
    scatter: float = 0.05
    """What an orientation may scatter about a smooth motion [rad]."""
    vibration: float = 0.3
    """What a platform shakes beyond its commanded motion [m/s^2]."""
    gravity: float = 0.15
    """What the mean length of an accelerometer's reading may differ from gravity, as a
    logarithm."""
    unknown_motion: float = 0.5
    """Part of the accelerometer's changes that may be left where no instrument gives the place."""


AGREEMENT = AgreementSettings()
