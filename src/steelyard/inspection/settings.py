"""Levels of what an inspection finds, with unit, reason and source each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from steelyard.identification.settings import SYNCHRONISATION, SynchronisationSettings
from steelyard.identification.solve.settings import FIT, FitSettings


@dataclass(frozen=True)
class StreamSettings:
    """How noise and rest of a stream are found."""

    most: int = 400_000
    """Samples of which the noise is looked at: more do not change two digits of it."""
    bin: float = 0.25
    """Length of which means are compared to see whether the platform moves [s]."""
    still: float = 5.0
    """Change from one mean to the next that is rest, in units of what noise makes of it."""
    still_share: float = 2e-3
    """Part of all changes that is rest as well: a platform on cables never hangs quite still."""
    fewest_still: int = 3
    """Bins in a row that make a rest."""
    fewest: int = 20
    """Third differences that are enough to find the noise."""
    white: float = 0.04
    """By how much the correlation of neighbouring third differences may be off that of white noise:
    half of what it is off for a random walk."""
    segment: int = 512
    """Samples of a noise spectrum: resolves a hundredth of the rate."""


STREAMS = StreamSettings()


@dataclass(frozen=True)
class RemarkSettings:
    """What of a single stream is worth a remark."""

    like: float = 0.15
    """Logarithm within which two lengths of recording are the same: streams seldom begin and end
    together."""
    far: float = 4.0
    """Factor between stated and found noise."""
    near_unit: float = 0.35
    """Logarithm within which that factor may be one of a unit."""


REMARKS = RemarkSettings()


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
    """The same of forces in a run whose load has something that moves in it, in these: a third of the
    mass on a string leaves four times what is allowed."""
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
    """Lowest and highest ratio of both that is usual: cameras above stadiums have several hundred."""
    densest: float = 1e5
    """What cables pull at most over gravity and the cube of the radius of the platform [kg/m^3]: lead in
    a sphere, with tensions twice its weight."""
    clear: float = 1.0
    """Decades by which sizes must be likelier in millimetres than in metres; with readings that agree
    no better, a frame of 3 km is still believed."""
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
    """What most platforms have at least over the cube of their radius [kg/m^3]; of several units that
    are possible those are likelier with which they do."""
    noise_factor: float = 4.0
    """Ratio of the noise that is stated to that which is seen, from which it may be a unit."""
    noise_near: float = 0.08
    """Logarithm within which that ratio is one of a unit: of noise that was stated too large by
    chance, few are."""
    noise_runs: int = 3
    """Runs in which the noise is looked at."""


SIZES = SizeSettings()


@dataclass(frozen=True)
class ContactSettings:
    """What is taken for a contact."""

    iterations: int = 40
    """Of the weights; the body settles in ten to twenty."""
    far: float = 4.0
    """Ratio of what is left to what is allowed, of one instant, from which something has touched
    the platform: sound recordings stay below two and a half."""
    pause: float = 0.3
    """Longest pause within one contact [s]."""
    shortest: float = 0.15
    """[s]; what is shorter is a spike."""
    least_clean: float = 0.15
    """Part of the run that one body must explain: else the forces are wrong, and nothing has
    touched."""
    known: float = 5.0
    """By how much less a body of other runs is trusted than these say."""
    share: float = 0.4
    """Of the largest channel, that another one must show to be named."""


CONTACTS = ContactSettings()


@dataclass(frozen=True)
class DelaySettings:
    """How a delay is looked for, and when the data determine it."""

    finest: float = 0.03
    """Spacing of the knots [s]: fine enough for vibrations, which determine a clock best."""
    most: int = 800
    """Instants that are looked at: two a knot over thirty seconds with room to spare."""
    reach: float = 0.08
    """By how much a clock is moved [s]: what `sync` is usually good to."""
    step: float = 0.004
    """Steps in which it is moved first [s]: several within the narrowest minimum."""
    largest_sigma: float = 0.02
    """Largest 1-sigma of a delay that the data determine [s]."""
    prior_share: float = 0.5
    """Part of the prior's 1-sigma, for the same."""
    correlated: float = 0.5
    """Time after which what a body leaves of the forces is something new [s]."""
    per_knot: float = 3.0
    """Samples between two knots of a vibration."""
    shaken: float = 0.8
    """Part of the changes of the force that may be left: else the two do not shake together."""
    clear: float = 4.0
    """1-sigmas by which a clock must be off to be worth a remark."""


DELAYS = DelaySettings()


@dataclass(frozen=True)
class IdentifiabilitySettings:
    """When the data determine a number."""

    data: float = 0.5
    """Part of its plausible size, or of its prior 1-sigma, within which it is known by the data."""
    mostly_prior: float = 0.9
    """Part of its prior 1-sigma beyond which it is known by the prior."""


IDENTIFIABILITY = IdentifiabilitySettings()


@dataclass(frozen=True)
class InspectionSettings:
    """How much :func:`steelyard.inspect` looks at, and what is named."""

    runs: int = 8
    """Runs whose agreements are looked at: mistakes of a description show in each."""
    fitted: int = 3
    """Runs in motion that are fitted as a whole: enough to see what is identifiable."""
    fastest: float = 130.0
    """Rate on cables beyond which samples are averaged before that fit [Hz]: what platforms do on
    purpose is slower."""
    fastest_on_sensor: float = 30.0
    """The same on a wrench sensor [Hz]."""
    synchronisation: SynchronisationSettings = SYNCHRONISATION
    """How clocks are found."""
    fit: FitSettings = FIT
    """Of the runs that are fitted."""
    streams: StreamSettings = STREAMS
    """Of each stream by itself."""
    remarks: RemarkSettings = REMARKS
    """What of a single stream is worth a remark."""
    agreements: AgreementSettings = AGREEMENT
    """What two accounts of one motion may differ by."""
    mistakes: MistakeSettings = MISTAKES
    """When a mistake is named."""
    sizes: SizeSettings = SIZES
    """What size alone tells of units."""
    checked: int = 3
    """Runs that are looked at before an identification: mistakes of a description show in each."""
    contacts: ContactSettings = CONTACTS
    """What is taken for a contact."""
    delays: DelaySettings = DELAYS
    """When the data determine a delay."""
    identifiability: IdentifiabilitySettings = IDENTIFIABILITY
    """When the data determine a number."""


INSPECTION = InspectionSettings()
