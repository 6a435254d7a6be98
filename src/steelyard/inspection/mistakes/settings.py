"""Numbers that decide which mistake of a description is named, with the reason of each."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ClockSettings:
    """Which delays are tried."""

    coarse: float = 0.2
    """First step [s]: a fifth of the slowest motion that determines a clock."""
    fine: float = 0.04
    """Second step [s]: the delay itself is named to .01 s and found exactly by `identify`."""
    largest: float = 10.0
    """[s]; more is a wrong event, which shows in times that do not overlap."""
    least: float = 0.15
    """Of a clock that is named [s]: three 1-sigmas of the contract's default."""
    relations: int = 2
    """Agreements by which a delay is sought."""


CLOCKS = ClockSettings()


@dataclass(frozen=True)
class PlaceSettings:
    """Which places on the platform are tried."""

    farthest: float = 4.0
    """Radii of the platform beyond which nothing sits on it."""
    least_radius: float = 0.5
    """Of a platform, for that [m]."""
    least: float = 0.05
    """By which a place on the platform must be wrong to be named [m]: less is an error that its
    prior allows for."""
    clear: float = 5.0
    """Standard normal value from which a place that a fit finds is named."""
    closer: float = 0.4
    """Part of the distance to where it should be that a place with other signs may leave."""
    free: float = 1e-3
    """Weight of what is not known about a constant that is solved for: it only keeps the equations
    solvable."""


PLACES = PlaceSettings()


@dataclass(frozen=True)
class MistakeSettings:
    """When a mistake is named; chosen so that no sound recording of ``make bench`` has one."""

    clocks: ClockSettings = CLOCKS
    """Of clocks."""
    places: PlaceSettings = PLACES
    """Of instruments on the platform."""

    most: int = 6
    """Mistakes that are looked for in one run."""
    least_gain: float = 2.5
    """By how much the whole must get better: of one channel, that it is left with less than a third
    of what was too much."""
    share: float = 0.25
    """Of what is bad altogether, that a mistake must explain."""
    enough: float = 30.0
    """Cost of all that is bad from which that share grows no more."""
    plain: float = 0.8
    """Share of what is bad altogether that is explained well enough not to try clocks, too."""
    much_better: float = 0.4
    """Ratio to the present one that is left where it is worst, at most."""
    spoils: float = 2.0
    """By how much a good agreement that becomes bad must be worse than before to be spoilt."""
    good: float = 1.25
    """Ratio of an agreement that nothing but noise is left of."""
    wider: float = 2.0
    """By how much more may be allowed to the amended description, as a part of what is compared."""
    equal: float = 0.5
    """Gain by which the next best explanation is about as good."""
    suspect: float = 0.5
    """Share of bad agreements, as a part of the largest, from which a source is suspected."""
    considered: int = 5
    """Amendments of the largest gain among which one must do much better somewhere."""
    others: int = 3
    """Other explanations that are named."""


MISTAKES = MistakeSettings()


@dataclass(frozen=True)
class SizeSettings:
    """What size alone tells of units."""

    smallest_hall: float = 0.1
    """Mean distance of anchors from their middle that is usual at least [m]."""
    largest_hall: float = 300.0
    """The same, at most [m]: most of the largest cable robots span stadiums."""
    smallest_platform: float = 0.01
    """Mean distance of attachments from their middle that is usual at least [m]."""
    largest_platform: float = 30.0
    """The same, at most [m]."""
    hall_to_platform: tuple[float, float] = (0.3, 2000.0)
    """Lowest and highest ratio of both that is usual: cameras above stadiums have several
    hundred."""
    densest: float = 1e5
    """What cables pull at most over gravity and the cube of the radius of the platform [kg/m^3]:
    lead in a sphere, with tensions twice its weight."""
    clear: float = 1.0
    """Decades by which sizes must be likelier in millimetres than in metres; with readings that
    agree no better, a frame of 3 km is still believed."""
    decade: float = 2.5
    """Gain in the agreements of readings that counts as much as a decade of size: that from which a
    mistake is named."""
    impossible: float = 30.0
    """Cost of an agreement that cannot be had with a geometry: of six channels, each a tenfold too
    far."""
    beyond: float = 10.0
    """Factor between the median tension and the limits of the robot file: a cable that is not even
    a tenth as tight as asked for is in another unit."""
    air: float = 1.2
    """Density of air [kg/m^3]: no platform is lighter."""
    usual: float = 12.0
    """What most platforms have at least over the cube of their radius [kg/m^3]; of several units
    that are possible those are likelier with which they do."""
    noise_factor: float = 4.0
    """Ratio of the noise that is stated to that which is seen, from which it may be a unit."""
    noise_near: float = 0.08
    """Logarithm within which that ratio is one of a unit: of noise that was stated too large by
    chance, few are."""
    noise_runs: int = 3
    """Runs in which the noise is looked at."""


SIZES = SizeSettings()
