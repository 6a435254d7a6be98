"""Levels of what an inspection finds, with unit, reason and source each."""

from __future__ import annotations

from dataclasses import dataclass

from steelyard.identification.settings import SYNCHRONISATION, SynchronisationSettings
from steelyard.identification.solve.settings import FIT, FitSettings
from steelyard.inspection.agreements.settings import AGREEMENT, AgreementSettings
from steelyard.inspection.mistakes.settings import MISTAKES, SIZES, MistakeSettings, SizeSettings


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
