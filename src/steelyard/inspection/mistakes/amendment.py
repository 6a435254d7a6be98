"""One simple mistake as an amendment of an experiment: what is changed, and what to say."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import Array
from steelyard.identification.model.sources import Source
from steelyard.inspection.agreements.excerpt import Excerpt, Observation

ROBOT = "robot"
"""Subject of mistakes in the robot file."""
SIMPLE, USUAL, RARE = 0.3, 0.6, 1.2
"""What a mistake costs: of two that explain the same the likelier one is named."""
AXES = "xyz"

_KEYS = frozenset(
    {"columns", "scale", "without", "rpy_deg", "position", "target", "point", "frame", "gravity"}
    | {"acts_on", "end", "calibration"}
)
"""Of an instrument, that amendments speak of."""

Change = Callable[[Excerpt], Excerpt]
"""How an excerpt looks without a mistake."""


@dataclass(frozen=True, eq=False)
class Amendment:
    """A change of the description, or of a log, that a mistake asks for."""

    kind: str
    """What sort of mistake it takes back, in two or three words."""
    subject: str
    """Instrument, or :data:`ROBOT`."""
    channel: str
    """Columns that it concerns."""
    what: str
    """The mistake in words."""
    proposal: str
    """What to change, with the key of the experiment file."""
    change: Change
    cost: float
    touches: frozenset[str]
    """Instruments whose readings look different then, and :data:`ROBOT`."""
    keys: tuple[str, ...] = ()
    """What to write under the instrument, key by key, in all runs; empty: no key says it."""
    neighbours: tuple[Change, ...] = ()
    """Changes by somewhat more and less, of a factor: where they explain as much, it is none."""

    @property
    def key(self) -> tuple[str, ...]:
        """In words, which are others of any other amendment."""
        return (self.kind, self.subject, self.channel, self.what, self.proposal)


@dataclass(frozen=True)
class Subject:
    """One instrument and the columns that its amendments concern."""

    name: str
    channel: str

    def amendment(
        self,
        kind: str,
        what: str,
        proposal: str,
        change: Change,
        cost: float,
        *,
        beside: Iterable[str] = (),
        keys: Iterable[str] | None = None,
        neighbours: Iterable[Change] = (),
    ) -> Amendment:
        """One amendment of it.

        Args:
            kind: See :class:`Amendment`.
            what: The same.
            proposal: The same.
            change: The same.
            cost: The same.
            beside: Other instruments whose readings the change takes.
            keys: See :class:`Amendment`; None: the proposal, where it is one.
            neighbours: See :class:`Amendment`.
        """
        touches = frozenset({self.name, *beside})
        if keys is None:
            keys = [proposal] if proposal.partition(":")[0] in _KEYS else []
        return Amendment(
            kind,
            self.name,
            self.channel,
            what,
            proposal,
            change,
            cost,
            touches,
            tuple(keys),
            tuple(neighbours),
        )


def with_keys(name: str, **keys: object) -> Change:
    """Other keys of an instrument."""
    return lambda excerpt: excerpt.with_instrument(name, **keys)


def with_gravity(gravity: Array) -> Change:
    """Another gravity in the robot file."""
    return lambda excerpt: replace(excerpt, robot=replace(excerpt.robot, gravity=gravity))


def edited(source: Source, edit: Callable[[Observation], Observation]) -> Change:
    """Other readings of one quantity."""
    return lambda excerpt: excerpt.with_observations({source: edit(excerpt.observations[source])})


def mapped(source: Source, matrix: Array) -> Change:
    """A matrix times the readings of a vector."""
    return edited(source, lambda read: read.mapped(matrix))


def rotated(source: Source, left: Array, right: Array) -> Change:
    """An orientation between two matrices, shape (3, 3) each."""
    return edited(source, lambda read: read.through(lambda R: left @ R @ right))


def shifted(delays: Mapping[str, float]) -> Change:
    """Instruments at times that are later [s]."""
    return lambda excerpt: excerpt.delayed(delays)


def without_cable(i: int) -> Change:
    """One cable whose sensor is not believed."""
    return lambda excerpt: replace(excerpt, unread=excerpt.unread | {i})


def single(k: int, i: int, factor: float) -> Array:
    """Matrix that multiplies one of k numbers, shape (k, k)."""
    matrix = np.eye(k)
    matrix[i, i] = factor
    return matrix


def columns_key(columns: Mapping[str, str]) -> str:
    """Names of columns as the experiment file has them."""
    return "columns: {" + ", ".join(f"{a}: {b}" for a, b in columns.items()) + "}"


def scale_key(factors: Mapping[str, float] | float) -> str:
    """Factors of columns as the experiment file has them, or one for all."""
    if isinstance(factors, float):
        return f"scale: {factors:.10g}"
    return "scale: {" + ", ".join(f"{c}: {factor:.10g}" for c, factor in factors.items()) + "}"


def units_key(columns: Iterable[str], unit: str) -> str:
    """Units as the experiment file has them."""
    return "units: {" + ", ".join(f"{c}: {unit}" for c in columns) + "}"


_STATED = frozenset({"deg", "deg/s", "g", "mm", "kN", "kgf", "daN", "cm", "N mm"})
"""Units that people state for readings that are in SI."""


def other_units(table: Mapping[str, float]) -> Iterator[tuple[str, str, float]]:
    """Units that a log may have been taken for, and in: the unit, how to say it, and the factor on
    what was read.

    Args:
        table: Unit -> its size; the first one is that of SI.
    """
    si = next(iter(table))
    distinct = [1.0]
    for unit, factor in table.items():
        if any(abs(factor / other - 1) < 1e-3 for other in distinct):
            continue
        distinct.append(factor)
        yield unit, f"reads in {unit}, not in {si}", factor
    for factor in distinct[1:]:
        unit = next(u for u, f in table.items() if f == factor)
        if unit in _STATED:
            yield si, f"is stated in {unit} but reads in {si}", 1 / factor
