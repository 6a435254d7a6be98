"""One simple mistake, and how the recording would look without it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import permutations, product

import numpy as np

from steelyard.arrays import Array
from steelyard.identification.model.sources import Source
from steelyard.inspection.excerpt import Excerpt

ROBOT = "robot"
"""Subject of mistakes in the robot file."""
SIMPLE, USUAL, RARE = 0.3, 0.6, 1.2
"""What a mistake costs: of two that explain the same the likelier one is named."""
AXES = "xyz"


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
    change: Callable[[Excerpt], Excerpt]
    cost: float
    touches: frozenset[str]
    """Instruments whose readings look different then, and :data:`ROBOT`."""


@dataclass(frozen=True, eq=False)
class Turn:
    """Axes exchanged and turned round."""

    matrix: Array
    """What is true is this times what was read, shape (k, k)."""
    order: tuple[int, ...]
    signs: tuple[int, ...]
    proper: bool

    @property
    def keeps_order(self) -> bool:
        """Whether only signs change."""
        return self.order == tuple(range(len(self.order)))

    @property
    def cost(self) -> float:
        """A sign or two axes are simple, the rest is not."""
        moved = sum(i != k for i, k in enumerate(self.order))
        flipped = sum(s < 0 for s in self.signs)
        return SIMPLE + 0.1 * moved + 0.1 * flipped


@cache
def turns(k: int = 3) -> tuple[Turn, ...]:
    """All ways to exchange k axes and signs, but for none; the simple ones first."""
    found = []
    for order in permutations(range(k)):
        for signs in product((1, -1), repeat=k):
            matrix = np.zeros((k, k))
            matrix[np.arange(k), list(order)] = signs
            if not np.array_equal(matrix, np.eye(k)):
                found.append(Turn(matrix, order, signs, bool(np.linalg.det(matrix) > 0)))
    return tuple(sorted(found, key=lambda turn: turn.cost))


def columns_of(names: Sequence[str], turn: Turn) -> tuple[str, str]:
    """A turn of columns in words, and what to write into the experiment file.

    Args:
        names: Of k columns.
        turn: What is to be done with them.
    """
    exchanged = {names[i]: names[k] for i, k in enumerate(turn.order) if i != k}
    flipped = [names[k] for i, k in enumerate(turn.order) if turn.signs[i] < 0]
    words, keys = [], []
    if exchanged:
        words.append(f"{', '.join(sorted(exchanged))} are exchanged (sign or order of axes)")
        keys.append("columns: {" + ", ".join(f"{a}: {b}" for a, b in exchanged.items()) + "}")
    if flipped:
        words.append(
            f"{', '.join(flipped)} {'has' if len(flipped) == 1 else 'have'} the wrong sign"
        )
        keys.append(f"turn the sign of {', '.join(flipped)} in the log")
    return " and ".join(words), ", and ".join(keys)


def mapped(source: Source, matrix: Array) -> Callable[[Excerpt], Excerpt]:
    """The change of a vector."""
    return lambda excerpt: excerpt.with_observations(
        {source: excerpt.observations[source].mapped(matrix)}
    )


def units_key(columns: Iterable[str], unit: str) -> str:
    """Units as the experiment file has them."""
    return "units: {" + ", ".join(f"{c}: {unit}" for c in columns) + "}"


def other_units(table: Mapping[str, float]) -> Iterator[tuple[str, str, float]]:
    """Units that a log may have been taken for, and in: the unit, how to say it, and the factor on
    what was read.
    """
    seen: list[float] = [1.0]
    for unit, factor in table.items():
        if any(abs(factor / other - 1) < 1e-3 for other in seen):
            continue
        seen.append(factor)
        yield unit, f"reads in {unit}, not in {next(iter(table))}", factor
    si = next(iter(table))
    for factor in seen[1:]:
        unit = next(u for u, f in table.items() if f == factor)
        if unit in {"deg", "deg/s", "g", "mm", "kN", "kgf", "daN", "cm", "N mm"}:
            yield si, f"is stated in {unit} but reads in {si}", 1 / factor
