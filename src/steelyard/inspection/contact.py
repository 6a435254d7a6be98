"""Stretches in which something else than the body pulled or pushed: forces that no body explains,
while one explains the rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array, joined_stretches
from steelyard.identification.model.unknown_body import BODY, unknown_body
from steelyard.inspection.agreements.excerpt import Excerpt
from steelyard.inspection.agreements.motion import Relation
from steelyard.inspection.agreements.wrench_balance import (
    BodyBalance,
    body_balance,
    force_relations,
    has_body,
)
from steelyard.inspection.settings import CONTACTS, ContactSettings
from steelyard.instruments.equations import predict
from steelyard.motion.state import State


@dataclass(frozen=True)
class Contact:
    """One stretch."""

    run: str
    start: float
    """Common time [s]."""
    end: float
    instrument: str
    channels: tuple[str, ...]
    """Columns in which it shows most; of cables the axes of the platform."""
    force: float
    """Largest in the stretch [N]."""
    torque: float
    """[N m]"""


@dataclass(frozen=True, eq=False)
class Residual:
    """What no body explains of the forces of one run."""

    run: str
    instrument: str
    time: Array
    """Common time [s], shape (n,)."""
    left: Array
    """Force [N] over torque [N m] in the axes of the sensor, of cables in those of the platform,
    shape (n, 6)."""
    size: Array
    """As a part of what is allowed, shape (n,)."""
    names: tuple[str, ...]


def unexplained(
    excerpts: Sequence[Excerpt], worst: Mapping[str, float], *, settings: ContactSettings = CONTACTS
) -> tuple[list[Residual], list[Contact]]:
    """Forces that a body leaves over which explains most of all runs.

    Args:
        excerpts: Of the runs.
        worst: Run -> ratio of the worst agreement of its forces.
        settings: What is taken for a contact.
    """
    fits = {}
    for excerpt in excerpts:
        relation = None if excerpt.static else _relation(excerpt)
        balance = None if relation is None else body_balance(excerpt, relation)
        if relation is not None and balance is not None:
            fits[excerpt.run.name] = (excerpt, relation, balance)
    sound = []
    for run, (excerpt, _, found) in fits.items():
        if worst.get(run, 0.0) < excerpt.settings.bad:
            sound.append(found)
    residuals, contacts = [], []
    for excerpt, relation, found in fits.values():
        others = [each for each in sound if each is not found]
        residual = _residual(excerpt, relation, found, others, settings)
        residuals.append(residual)
        far = residual.size > settings.far
        if far.mean() < 1 - settings.least_clean:
            contacts += _contacts(residual, far, settings)
    return residuals, contacts


def _relation(excerpt: Excerpt) -> Relation | None:
    """The account of the motion to go by: an accelerometer reads what accelerates the platform,
    others only where it is.
    """
    relations = [r for r in force_relations(excerpt) if has_body(r)]
    by_accelerometer = [r for r in relations if any(q == "specific_force" for _, q in r[1])]
    return next(iter(by_accelerometer or relations), None)


def _residual(
    excerpt: Excerpt,
    relation: Relation,
    found: BodyBalance,
    others: Sequence[BodyBalance],
    settings: ContactSettings,
) -> Residual:
    """What a body leaves that is chosen so as to explain as many instants as possible, near that of
    sound runs.
    """
    A, b = found.white, found.target
    precision, expected = np.ones(A.shape[2]), np.zeros(A.shape[2])
    if others:
        scale = found.scale[BODY]
        sigma = settings.known * np.mean([each.sigma for each in others], axis=0) / scale
        precision[BODY] = 1 / np.maximum(sigma, 1e-9) ** 2
        expected[BODY] = np.mean([each.parameters for each in others], axis=0) / scale
    weight = np.ones(len(b))
    left = b
    for _ in range(settings.iterations):
        left = unknown_body(A, b, precision, expected=expected, weight=weight).residual
        # What is far counts less and less: a contact is no noise.
        weight = 1 / (1 + np.mean(left**2, axis=1)) ** 2
    size = np.sqrt(np.mean(left**2, axis=1))
    name = relation[1][0][0]
    whole, names = _shown(excerpt, name, left * found.allowed)
    return Residual(excerpt.run.name, name, excerpt.time, whole, size, names)


def _shown(excerpt: Excerpt, name: str, wrench: Array) -> tuple[Array, tuple[str, ...]]:
    """A wrench on the platform as people look for it, shape (n, 6): in the axes of a six-axis
    sensor, of cables in those of the platform; and the names of its numbers.
    """
    instrument = excerpt.instruments[name]
    if instrument.measured_force == "tension":
        parts = ("force", "torque")
        return wrench, tuple(f"{what} {axis} of the platform" for what in parts for axis in "xyz")
    robot = excerpt.experiment.robot
    errors = {term.key: np.full(term.size, term.nominal) for term in instrument.terms(robot.m)}
    unknown = dict.fromkeys(field.name for field in fields(State))
    readings = predict(instrument, robot, State(**{**unknown, "wrench": wrench}), errors)
    return np.hstack(list(readings.values())), ("fx", "fy", "fz", "tx", "ty", "tz")


def _contacts(
    residual: Residual, far: NDArray[np.bool_], settings: ContactSettings
) -> list[Contact]:
    """Stretches far from what a body explains, without pauses."""
    time = residual.time
    step = float(np.median(np.diff(time)))
    found = []
    for first, last in joined_stretches(time, far, settings.pause):
        start, end = float(time[first]), float(time[last - 1])
        if end - start + step >= settings.shortest:
            found.append(_contact(residual, start, end, settings.share))
    return found


def contacts_of_fit(
    stretches: Mapping[str, Sequence[tuple[float, float]]],
    residuals: Sequence[Residual],
    known: Sequence[Contact],
) -> list[Contact]:
    """Contacts that only the fit of everything at once has found.

    Args:
        stretches: Run -> beginning and end of each, common time [s].
        residuals: Of the runs.
        known: Contacts that need not be found again.
    """
    of_run = {residual.run: residual for residual in residuals}
    found = []
    for run, own in stretches.items():
        for start, end in own:
            again = any(c.run == run and c.start < end and c.end > start for c in known)
            if run in of_run and not again:
                found.append(_contact(of_run[run], float(start), float(end), most=1))
    return found


def _contact(
    residual: Residual, start: float, end: float, share: float = 0.0, most: int = 3
) -> Contact:
    """A stretch with the channels of force and torque in which it shows: those above a share of the
    largest, so many at most.
    """
    inside = residual.left[(residual.time >= start) & (residual.time <= end)]
    left = inside if len(inside) else np.zeros((1, 6))
    names: list[str] = []
    largest = []
    for part in (slice(0, 3), slice(3, 6)):
        size = np.sqrt(np.mean(left[:, part] ** 2, axis=0))
        order = np.argsort(-size, kind="stable")[:most]
        names += [residual.names[part.start + i] for i in order if size[i] >= share * size.max()]
        largest.append(float(np.linalg.norm(left[:, part], axis=1).max()))
    return Contact(residual.run, start, end, residual.instrument, tuple(names), *largest)
