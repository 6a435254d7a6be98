"""Mistakes in the columns of vectors, of cables and of six-axis sensors: order, signs, units."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from steelyard.identification.model.sources import Source
from steelyard.inspection.agreements.excerpt import Excerpt
from steelyard.inspection.mistakes.amendment import (
    SIMPLE,
    USUAL,
    Amendment,
    Change,
    Subject,
    columns_key,
    mapped,
    other_units,
    scale_key,
    single,
    units_key,
    without_cable,
)
from steelyard.inspection.mistakes.axes import AxisChange, axis_changes
from steelyard.inspection.mistakes.mounting import of_choices, of_mounting
from steelyard.units import FACTORS

LIKELY_UNITS = {
    "rad/s": ("deg/s", "rpm", "mrad/s"),
    "m/s^2": ("g", "mg", "mm/s^2", "cm/s^2"),
    "m": ("mm", "cm", "in", "ft"),
    "N": ("kN", "kgf", "daN", "lbf", "mN"),
    "N m": ("N mm", "N cm", "kgf m", "kN m"),
}
"""Unit of a quantity -> units that logs have instead."""
_DEAD = 2.5
"""Cost of a dead sensor: whatever is wrong with one reading would be explained by it."""

_NEAR = (0.7, 1.4)
"""Of a factor: readings of another unit agree with it alone, those of a motion that disturbs with
any that makes it smaller."""


def _units(unit: str) -> Iterator[tuple[str, str, float]]:
    known = FACTORS[unit]
    return other_units({each: known[each] for each in (unit, *LIKELY_UNITS[unit])})


def of_vector(excerpt: Excerpt, source: Source) -> Iterator[Amendment]:
    """Signs, axes and units of a vector."""
    stated = excerpt.instruments[source[0]].quantity(source[1], excerpt.robot.m)
    names = stated.forms[0]
    for change in axis_changes(len(names)):
        what, keys = change.of_columns(names)
        yield Subject(*source).amendment(
            change.kind,
            what,
            "; ".join(keys),
            mapped(source, change.matrix),
            change.cost,
            keys=keys,
        )
    yield from _of_units(source, names, stated.unit, near=_NEAR)


def _of_units(
    source: Source, names: Sequence[str], unit: str, near: Sequence[float] = ()
) -> Iterator[Amendment]:
    """All columns of a quantity in another unit.

    Args:
        source: Instrument and quantity.
        names: Of its columns.
        unit: That is stated.
        near: Of a factor those that must not do as well. Of forces any may: their scale is that of
            the body.
    """
    for other, what, factor in _units(unit):
        one = np.eye(len(names))
        keys = [scale_key(dict.fromkeys(names, factor))]
        yield Subject(*source).amendment(
            "unit",
            what,
            units_key(names, other),
            mapped(source, factor * one),
            SIMPLE,
            keys=keys,
            neighbours=[mapped(source, factor * each * one) for each in near],
        )


def of_cables(excerpt: Excerpt, source: Source) -> Iterator[Amendment]:
    """Columns of one cable each: their order, all signs and units, then those of single ones."""
    name, quantity = source
    subject = Subject(name, quantity)
    stated = excerpt.instruments[name].quantity(quantity, excerpt.robot.m)
    names, m = stated.forms[0], excerpt.robot.m
    for order, kind, what, cost in _orders(m):
        key = columns_key({names[i]: names[k] for i, k in enumerate(order) if i != k})
        yield subject.amendment(kind, what, key, mapped(source, np.eye(m)[list(order)]), cost)
    yield subject.amendment(
        "sign",
        f"all {quantity}s have the wrong sign",
        scale_key(-1.0),
        mapped(source, -np.eye(m)),
        SIMPLE,
    )
    yield from _of_units(source, names, stated.unit)
    for i in range(m):
        yield from _of_one_cable(source, names, i, stated.unit)
        if excerpt.instruments[name].is_force:
            yield subject.amendment(
                "dead sensor",
                f"{names[i]} does not read what cable {i + 1} pulls: a dead, wrong or badly scaled"
                " sensor",
                f"look at the sensor of cable {i + 1}; until it is right: without: [{i + 1}]",
                without_cable(i),
                _DEAD,
                keys=[f"without: [{i + 1}]"] if quantity == "tension" else [],
            )


def _orders(m: int) -> Iterator[tuple[tuple[int, ...], str, str, float]]:
    """Other orders of m cables: the order, what sort of mistake, the mistake in words, its cost."""
    for i, k in combinations(range(m), 2):
        order = list(range(m))
        order[i], order[k] = k, i
        yield tuple(order), "swapped cables", f"cables {i + 1} and {k + 1} are exchanged", SIMPLE
    if m < 3:
        return
    kind = "order of the cables"
    yield tuple(range(m))[::-1], kind, "cables are numbered in reverse", SIMPLE
    for shift in range(1, m):
        forward = tuple((i + shift) % m for i in range(m))
        what = f"cables are numbered from another one (by {shift})"
        yield forward, kind, what, SIMPLE + 0.1
        if shift < m - 1:
            backward = tuple((shift - i) % m for i in range(m))
            what = "cables are numbered the other way round, from another one"
            yield backward, kind, what, USUAL


def _of_one_cable(source: Source, names: Sequence[str], i: int, unit: str) -> Iterator[Amendment]:
    """Sign and unit of one column."""
    subject = Subject(*source)
    m, cost = len(names), SIMPLE + 0.1
    flipped = mapped(source, single(m, i, -1.0))
    what, key = f"{names[i]} has the wrong sign", scale_key({names[i]: -1.0})
    yield subject.amendment("sign", what, key, flipped, cost)
    for other, words, factor in _units(unit):
        what, key = f"{names[i]} {words}", units_key([names[i]], other)
        change = mapped(source, single(m, i, factor))
        keys = [scale_key({names[i]: factor})]
        yield subject.amendment("unit of one sensor", what, key, change, cost, keys=keys)


def of_wrench(excerpt: Excerpt, source: Source) -> Iterator[Amendment]:
    """A six-axis sensor: on whom it acts, axes and units, what comes first, how it is mounted.

    Args:
        excerpt: What is looked at.
        source: Its force; its torque goes with it.
    """
    name = source[0]
    both = Subject(name, "force, torque")
    force, torque = (name, "force"), (name, "torque")
    yield from of_choices(excerpt, name)
    for change in axis_changes():
        yield from _of_wrench_axes(name, change)
    for own in (force, torque):
        stated = excerpt.instruments[name].quantity(own[1], excerpt.robot.m)
        yield from _of_units(own, stated.forms[0], stated.unit)
    yield both.amendment(
        "order of force and torque",
        "has its torque first",
        "columns: {fx: tx, fy: ty, fz: tz, tx: fx, ty: fy, tz: fz}",
        lambda e: e.with_observations(
            {force: e.observations[torque], torque: e.observations[force]}
        ),
        SIMPLE,
    )
    yield from of_mounting(excerpt, name)


def _joined(first: Sequence[str], second: Sequence[str]) -> list[str]:
    """Keys of two groups of columns, each key once."""
    found: dict[str, list[str]] = {}
    for text in (*first, *second):
        key, _, mapping = text.partition(": ")
        found.setdefault(key, []).append(mapping.strip("{}"))
    return [f"{key}: {{{', '.join(each)}}}" for key, each in found.items()]


def _of_wrench_axes(name: str, change: AxisChange) -> Iterator[Amendment]:
    """Axes of the force, of the torque and, where they are mirrored, of both."""
    force, torque = (name, "force"), (name, "torque")
    of_force, force_keys = change.of_columns(("fx", "fy", "fz"))
    of_torque, torque_keys = change.of_columns(("tx", "ty", "tz"))
    force_key, torque_key = "; ".join(force_keys), "; ".join(torque_keys)
    force_change, torque_change = mapped(force, change.matrix), mapped(torque, change.matrix)
    yield Subject(*force).amendment(
        change.kind, of_force, force_key, force_change, change.cost, keys=force_keys
    )
    yield Subject(*torque).amendment(
        change.kind, of_torque, torque_key, torque_change, change.cost, keys=torque_keys
    )
    if not change.proper:
        both: Change = lambda e: torque_change(force_change(e))  # noqa: E731
        yield Subject(name, "force, torque").amendment(
            change.kind,
            f"{of_force}; {of_torque}",
            f"{force_key}; {torque_key}",
            both,
            change.cost + 0.2,
            keys=_joined(force_keys, torque_keys),
        )
