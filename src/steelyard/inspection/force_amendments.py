"""Simple mistakes of force instruments: columns, signs, units, and on whom they act."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from steelyard.arrays import Array
from steelyard.identification.model.sources import Source
from steelyard.inspection.amendment import (
    SIMPLE,
    USUAL,
    Amendment,
    columns_of,
    mapped,
    other_units,
    turns,
    units_key,
)
from steelyard.inspection.excerpt import Excerpt
from steelyard.inspection.motion_amendments import of_mounting
from steelyard.units import FACTORS

_FORCES = ("N", "kN", "daN", "kgf", "lbf", "mN")
_TORQUES = ("N m", "N mm", "N cm", "kgf m", "kN m")
_LENGTHS = ("m", "mm", "cm", "in", "ft")


def of_cables(excerpt: Excerpt, source: Source, letter: str) -> Iterator[Amendment]:
    """Columns of one cable each.

    Args:
        excerpt: What is looked at.
        source: Tensions or lengths.
        letter: Of the columns: ``f`` or ``l``.
    """
    name, quantity = source
    m = excerpt.observations[source].value.shape[1]
    touches = frozenset({name})
    names = [f"{letter}{i + 1}" for i in range(m)]

    def ordered(order: Sequence[int], kind: str, what: str, cost: float) -> Amendment:
        key = (
            "columns: {"
            + ", ".join(f"{names[i]}: {names[k]}" for i, k in enumerate(order) if i != k)
            + "}"
        )
        return Amendment(
            kind, name, quantity, what, key, mapped(source, np.eye(m)[list(order)]), cost, touches
        )

    for i, k in combinations(range(m), 2):
        order = list(range(m))
        order[i], order[k] = k, i
        yield ordered(order, "swapped cables", f"cables {i + 1} and {k + 1} are exchanged", SIMPLE)
    if m > 2:
        yield ordered(
            range(m)[::-1], "order of the cables", "cables are numbered in reverse", SIMPLE
        )
        for shift in range(1, m):
            forward = [(i + shift) % m for i in range(m)]
            yield ordered(
                forward,
                "order of the cables",
                f"cables are numbered from another one (by {shift})",
                SIMPLE + 0.1,
            )
            if shift < m - 1:
                backward = [(shift - i) % m for i in range(m)]
                yield ordered(
                    backward,
                    "order of the cables",
                    "cables are numbered the other way round, from another one",
                    USUAL,
                )
    known = FACTORS["N" if letter == "f" else "m"]
    table = {u: known[u] for u in (_FORCES if letter == "f" else _LENGTHS)}
    units = list(other_units(table))
    yield Amendment(
        "sign",
        name,
        quantity,
        f"all {quantity}s have the wrong sign",
        f"turn the sign of {names[0]} to {names[-1]} in the log",
        mapped(source, -np.eye(m)),
        SIMPLE,
        touches,
    )
    for unit, what, factor in units:
        yield Amendment(
            "unit",
            name,
            quantity,
            what,
            units_key(names, unit),
            mapped(source, factor * np.eye(m)),
            SIMPLE,
            touches,
        )
    for i in range(m):
        yield Amendment(
            "sign",
            name,
            quantity,
            f"{names[i]} has the wrong sign",
            f"turn the sign of {names[i]} in the log",
            mapped(source, _one(m, i, -1.0)),
            SIMPLE + 0.1,
            touches,
        )
        for unit, what, factor in units:
            yield Amendment(
                "unit of one sensor",
                name,
                quantity,
                f"{names[i]} {what}",
                units_key([names[i]], unit),
                mapped(source, _one(m, i, factor)),
                SIMPLE + 0.1,
                touches,
            )
        if letter == "f":
            yield Amendment(
                "dead sensor",
                name,
                quantity,
                f"{names[i]} does not read what cable {i + 1} pulls: a dead, wrong or badly scaled"
                " sensor",
                f"look at the sensor of cable {i + 1}; leave its cells empty until it is right",
                _without(i),
                2.5,
                touches,
            )


def _one(m: int, i: int, factor: float) -> Array:
    matrix = np.eye(m)
    matrix[i, i] = factor
    return matrix


def _without(i: int) -> Callable[[Excerpt], Excerpt]:
    return lambda excerpt: replace(excerpt, unread=excerpt.unread | {i})


def of_wrench(excerpt: Excerpt, name: str) -> Iterator[Amendment]:
    """A six-axis sensor."""
    instrument = excerpt.instruments[name]
    touches = frozenset({name})
    other = "body" if instrument.acts_on == "sensor" else "sensor"  # type: ignore[attr-defined]
    yield Amendment(
        "sign of the wrench",
        name,
        "force, torque",
        f"is the load on the {other}",
        f"acts_on: {other}",
        lambda p: p.with_instrument(name, acts_on=other),
        SIMPLE,
        touches,
    )
    force, torque = (name, "force"), (name, "torque")
    for turn in turns():
        words, key = columns_of(("fx", "fy", "fz"), turn)
        both, keys = columns_of(("tx", "ty", "tz"), turn)

        def change(p: Excerpt, M: Array = turn.matrix) -> Excerpt:
            # A torque is no arrow: mirrored axes turn it round.
            return p.with_observations(
                {force: p.observations[force].mapped(M), torque: p.observations[torque].mapped(M)}
            )

        kind = "order of axes" if turn.order != (0, 1, 2) else "sign of an axis"
        yield Amendment(
            kind, name, "force", words, key, mapped(force, turn.matrix), turn.cost, touches
        )
        yield Amendment(
            kind, name, "torque", both, keys, mapped(torque, turn.matrix), turn.cost, touches
        )
        if not turn.proper:
            yield Amendment(
                kind,
                name,
                "force, torque",
                f"{words}; {both}",
                f"{key}; {keys}",
                change,
                turn.cost + 0.2,
                touches,
            )
    for source, units in ((force, _FORCES), (torque, _TORQUES)):
        names = [source[1][0] + axis for axis in "xyz"]
        for unit, what, factor in other_units({u: FACTORS[units[0]][u] for u in units}):
            yield Amendment(
                "unit",
                name,
                source[1],
                what,
                units_key(names, unit),
                mapped(source, factor * np.eye(3)),
                SIMPLE,
                touches,
            )
    yield Amendment(
        "order of force and torque",
        name,
        "force, torque",
        "has its torque first",
        "columns: {fx: tx, fy: ty, fz: tz, tx: fx, ty: fy, tz: fz}",
        lambda p: p.with_observations(
            {force: p.observations[torque], torque: p.observations[force]}
        ),
        SIMPLE,
        touches,
    )
    yield from of_mounting(excerpt, name)


def of_forces(excerpt: Excerpt, name: str) -> Iterator[Amendment]:
    """Whatever an instrument of forces may have wrong."""
    if (name, "tension") in excerpt.observations:
        yield from of_cables(excerpt, (name, "tension"), "f")
    elif (name, "force") in excerpt.observations:
        yield from of_wrench(excerpt, name)
