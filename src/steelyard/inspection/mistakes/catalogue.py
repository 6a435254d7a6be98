"""The table of simple mistakes: what may be wrong, and which readings and instruments may have
it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence, Set
from dataclasses import dataclass
from functools import partial

from steelyard.identification.model.sources import Source
from steelyard.inspection.agreements.excerpt import Excerpt
from steelyard.inspection.agreements.judgement import Judged
from steelyard.inspection.mistakes.amendment import Amendment
from steelyard.inspection.mistakes.clocks import of_clocks
from steelyard.inspection.mistakes.columns import of_cables, of_vector, of_wrench
from steelyard.inspection.mistakes.mounting import (
    of_accelerometer,
    of_choices,
    of_frame,
    of_gravity,
    of_gyro,
    of_mounting,
    of_point,
)
from steelyard.inspection.mistakes.orientation import of_orientation
from steelyard.inspection.mistakes.settings import MISTAKES, MistakeSettings, PlaceSettings
from steelyard.instruments import Instrument, Quantity


@dataclass(frozen=True)
class OfReading:
    """Mistakes of a reading."""

    name: str
    may_have: Callable[[Instrument, Quantity], bool]
    amendments: Callable[[Excerpt, Source], Iterator[Amendment]]


@dataclass(frozen=True)
class OfInstrument:
    """Mistakes of a whole instrument, whatever of its readings contradicts others."""

    name: str
    may_have: Callable[[Instrument, tuple[Quantity, ...]], bool]
    """Of the instrument and of what it has recorded."""
    amendments: Callable[[Excerpt, str], Iterator[Amendment]]


def _has_recorded(name: str) -> Callable[[Instrument, tuple[Quantity, ...]], bool]:
    return lambda instrument, recorded: any(quantity.name == name for quantity in recorded)


def _is_vector(instrument: Instrument, quantity: Quantity) -> bool:
    return not quantity.rotation and not instrument.per_cable and not instrument.is_force


def _has_frame(instrument: Instrument, quantity: Quantity) -> bool:
    return instrument.mounting.frame is not None and quantity.name == "position"


def _shows_mounting(instrument: Instrument, recorded: tuple[Quantity, ...]) -> bool:
    """Whether a wrong mounting shows otherwise than as wrong axes of one reading."""
    if instrument.mounting.rpy_deg is None or instrument.is_force:
        return False
    (first, *others) = recorded
    return bool(others) or first.required or first.determines == ("position",)


OF_INSTRUMENTS = (
    OfInstrument(
        "keys of two values", lambda i, recorded: bool(i.choices) and not i.is_force, of_choices
    ),
    OfInstrument("gravity upside down", _has_recorded("specific_force"), of_accelerometer),
    OfInstrument("rates in world axes", _has_recorded("angular_velocity"), of_gyro),
    OfInstrument("mounting", _shows_mounting, of_mounting),
)


def of_readings(places: PlaceSettings) -> tuple[OfReading, ...]:
    """The table of mistakes of a reading."""
    return (
        OfReading("order, signs and units of cables", lambda i, q: i.per_cable, of_cables),
        OfReading(
            "axes, signs and units of a wrench",
            lambda i, q: i.measured_force == "wrench" and q.name == "force",
            of_wrench,
        ),
        OfReading("how an orientation is written", lambda i, q: q.rotation, of_orientation),
        OfReading("axes, signs and units of a vector", _is_vector, of_vector),
        OfReading("tracker frame", _has_frame, of_frame),
        OfReading(
            "place on the platform",
            lambda i, q: q.name in {"position", "specific_force"},
            partial(of_point, settings=places),
        ),
    )


def clock_amendments(
    now: Judged,
    suspects: Sequence[Source],
    settings: MistakeSettings = MISTAKES,
    *,
    before: Set[str] = frozenset(),
) -> Iterator[Amendment]:
    """What could be wrong with the clocks of instruments that contradict others: a search of its
    own for each, which takes longer than all the rest.

    Args:
        now: What contradicts what.
        suspects: Readings that contradict others.
        settings: Which delays are tried.
        before: Instruments whose clocks have been looked at.
    """
    if not now.excerpt.static:
        yield from of_clocks(now, {name for name, _ in suspects}, settings.clocks, before)


def amendments(
    now: Judged, suspects: Sequence[Source], settings: MistakeSettings = MISTAKES
) -> Iterator[Amendment]:
    """What could be wrong with instruments that contradict others, but for their clocks.

    Args:
        now: What contradicts what.
        suspects: Readings that contradict others, the worst first.
        settings: Which places are tried.
    """
    excerpt, m = now.excerpt, now.excerpt.robot.m
    names = list(dict.fromkeys(name for name, _ in suspects))
    if any(agreement.robot for agreement in now.bad):
        yield from of_gravity(excerpt)
    readings = of_readings(settings.places)
    for source in suspects:
        instrument = excerpt.instruments[source[0]]
        quantity = instrument.quantity(source[1], m)
        for each in readings:
            if each.may_have(instrument, quantity):
                yield from each.amendments(excerpt, source)
    for name in names:
        instrument = excerpt.instruments[name]
        own = (quantity for owner, quantity in excerpt.observations if owner == name)
        recorded = tuple(instrument.quantity(quantity, m) for quantity in own)
        for whole in OF_INSTRUMENTS:
            if whole.may_have(instrument, recorded):
                yield from whole.amendments(excerpt, name)
