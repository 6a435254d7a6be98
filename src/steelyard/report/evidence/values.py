"""What a report shows beside the ten parameters, as plain values: thinned readings, motion,
calibration, how it was made.

All numbers are SI; None stands where there is none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field
from pydantic import FiniteFloat as Real

from steelyard.arrays import Array

Number = Real | None
_TEN = Field(min_length=10, max_length=10)
Ten = Annotated[tuple[Number, ...], _TEN]
"""Of the ten body parameters."""
Vector = tuple[Real, Real, Real]


def numbers(values: Array | Sequence[float], digits: int = 17) -> tuple[Number, ...]:
    """Values as plain numbers of so many digits, None where there is none."""
    return tuple(float(f"{v:.{digits}g}") if np.isfinite(v) else None for v in values)


@dataclass(frozen=True)
class EstimatedBody:
    """An estimate."""

    name: str
    """Heading of its column."""
    method: str
    value: Ten
    """The ten of :data:`steelyard.inertia.BODY_PARAMETERS`."""
    covariance: Annotated[tuple[Ten, ...], _TEN]
    labels: Annotated[tuple[str, ...], _TEN]
    """What determined each of the ten: ``data``, ``prior`` or ``unidentifiable``."""
    accepted: bool | None
    """None: a baseline, not assessed."""
    reasons: tuple[str, ...]
    disagreement: str = ""
    """That other methods that were assessed say the opposite; empty: none does."""
    moves_within: bool = False
    """Whether something moves in it, so that no motion tells more than its mass."""


@dataclass(frozen=True)
class Shape:
    """The robot as it is drawn, m cables."""

    name: str
    anchors: tuple[Vector, ...]
    """World frame [m]."""
    attachments: tuple[Vector, ...]
    """Platform frame [m]."""


@dataclass(frozen=True)
class MotionTrack:
    """Of a run, thinned, n instants."""

    run: str
    static: bool
    time: tuple[Real, ...]
    """[s], or the number of the pose."""
    position: tuple[Vector, ...]
    """Of the platform origin in the world [m]."""
    rotation: tuple[tuple[Real, Real, Real, Real], ...]
    """Quaternion (w, x, y, z) of R_world_platform."""


@dataclass(frozen=True)
class Spectrum:
    """Power of the residuals, per frequency, over that of white noise of the same size; the
    mean over the channels.
    """

    frequency: tuple[Real, ...]
    """[Hz]"""
    power: tuple[Real, ...]


@dataclass(frozen=True)
class Trace:
    """One quantity that one instrument read in one run, k channels, thinned so that what stands out
    stays.
    """

    run: str
    instrument: str
    quantity: str
    unit: str
    channels: tuple[str, ...]
    static: bool
    samples: int
    """Before thinning."""
    time: tuple[Real, ...]
    """Common time [s], or the number of the pose."""
    measured: tuple[tuple[Number, ...], ...]
    """By channel."""
    residual: tuple[tuple[Number, ...], ...]
    """Measured less predicted, by channel."""
    sigma: tuple[Real, ...] | None
    """1-sigma by channel as the fit takes it; None: not known."""
    rms: tuple[Number, ...]
    """Of the residual by channel, of all samples that the fit looks at."""
    worst: Number
    """Largest residual of a sample that the fit looks at, in its 1-sigma."""
    outliers: int
    """Readings beyond five 1-sigma, or left out."""
    left_out: tuple[tuple[int, int], ...]
    """Those of the thinned samples that the fit does not look at: channel, sample."""
    spectrum: Spectrum | None


@dataclass(frozen=True)
class Noise:
    """1-sigma of single readings of a quantity."""

    instrument: str
    quantity: str
    unit: str
    stated: Number
    used: Number
    found: Number


@dataclass(frozen=True)
class DisturbanceTrack:
    """An error of a quantity, or a wrench on the platform, that goes on for a while, k components,
    thinned.
    """

    run: str
    owner: str
    """Instrument; of an unmodelled wrench the robot."""
    quantity: str
    cause: str
    """``colored``, ``drift``, ``reacquired`` or ``filter``."""
    stated: bool
    unit: str
    deviation: tuple[Real, ...]
    """1-sigma by component."""
    correlation_time: Real
    """[s]"""
    rms: tuple[Real, ...]
    """By component."""
    time: tuple[Real, ...]
    """Common time [s]."""
    values: tuple[tuple[Real, ...], ...]
    """By component."""


@dataclass(frozen=True)
class CalibrationEstimate:
    """One component of a systematic error of an instrument."""

    instrument: str
    name: str
    """Term, run where it is of one, axis or cable."""
    unit: str
    value: Number
    deviation: Number
    expected: Number
    """Prior value."""
    prior: Number
    """Its 1-sigma."""


@dataclass(frozen=True)
class DirectedTest:
    """A directed test of the residuals: by how much one value of the description would have to be
    wrong to explain them.
    """

    name: str
    sigmas: Real
    size: Real
    unit: str


@dataclass(frozen=True)
class ClockDelay:
    """Delay of a clock relative to that of the forces."""

    run: str
    instruments: str
    delay: Number
    """[s]"""
    deviation: Number
    """[s]"""
    prior: Number
    """Prior 1-sigma [s]."""
    found: str
    """Where it was found from the data before the fit, in words; empty: not."""


@dataclass(frozen=True)
class UncertaintySource:
    """What brings a part of the variance of the ten."""

    name: str
    shares: Ten
    """Of the variance of each of the ten body parameters, of 1."""


@dataclass(frozen=True)
class KnownCheck:
    """A body parameter that is known beforehand, and what the readings alone say of it."""

    load: str
    """Of which load; empty: there is one body."""
    name: str
    unit: str
    stated: Real
    sigma: Real
    found: Real
    deviation: Real
    z: Real


@dataclass(frozen=True)
class UsedInstrument:
    """An instrument that has recorded something."""

    name: str
    kind: str
    samples: int
    """In all runs."""
    rate: Number
    """[Hz]; None: poses at rest."""


@dataclass(frozen=True)
class RecordedRun:
    """A run."""

    name: str
    load: str
    """What it carried; empty: there is one body."""
    static: bool
    duration: Number
    """[s]; None: poses at rest."""


@dataclass(frozen=True)
class SwingTrack:
    """How the platform swings in a run with locked winches."""

    run: str
    frequency: tuple[Real, ...]
    """Of the spectrum [Hz]."""
    amplitude: tuple[Real, ...]
    """Of all components of the pose together, at the platform's radius [m]."""
    seen: tuple[tuple[Real, Real], ...]
    """Natural frequencies in the recording and their 1-sigma [Hz]."""
    predicted: tuple[tuple[Real, Number], ...]
    """Those of the estimated body about the middle of the swing, and their 1-sigma [Hz]; empty: not
    known."""


@dataclass(frozen=True)
class Input:
    """A file that was read."""

    name: str
    """Beside the experiment file."""
    sha256: str
    size: int
    """[bytes]"""


@dataclass(frozen=True)
class Made:
    """How the result was made."""

    versions: tuple[tuple[str, str], ...]
    """Program or library, its version."""
    options: tuple[tuple[str, str], ...]
    """What was asked for."""
    inputs: tuple[Input, ...] = ()
    facts: tuple[tuple[str, str], ...] = ()
    """What stands under the title: project, operator, day of the recording."""


@dataclass(frozen=True)
class Evidence:
    """All of it."""

    shape: Shape | None = None
    motions: tuple[MotionTrack, ...] = ()
    traces: tuple[Trace, ...] = ()
    noise: tuple[Noise, ...] = ()
    errors: tuple[CalibrationEstimate, ...] = ()
    tests: tuple[DirectedTest, ...] = ()
    clocks: tuple[ClockDelay, ...] = ()
    contacts: tuple[tuple[str, Real, Real], ...] = ()
    """Run, beginning and end of what touched the platform [s]."""
    disturbances: tuple[DisturbanceTrack, ...] = ()
    swings: tuple[SwingTrack, ...] = ()
    budget: tuple[UncertaintySource, ...] = ()
    known: tuple[KnownCheck, ...] = ()
    instruments: tuple[UsedInstrument, ...] = ()
    recorded: tuple[RecordedRun, ...] = ()
    not_drawn: int = 0
    """Runs of which no readings and motions are kept, to bound the size."""
