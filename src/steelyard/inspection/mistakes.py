"""Which simple mistakes a recording gives away: descriptions amended by one of them, held against
the present one.

A mistake is named where the present description fits badly and the amended one much better, in all
agreements together: who is wrong shows in how many others then agree. Then the next one is looked
for, until nothing is bad or nothing helps.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import Array
from steelyard.identification.model.calibration_parameters import clock_of
from steelyard.identification.model.sources import Source
from steelyard.inspection.agreement import (
    BAD,
    InstrumentAgreement,
    Relation,
    motion_agreement,
    motion_relations,
    positions,
    specific_force,
)
from steelyard.inspection.amendment import ROBOT, Amendment
from steelyard.inspection.excerpt import Excerpt
from steelyard.inspection.force_amendments import of_cables, of_forces
from steelyard.inspection.frames import (
    accelerometer,
    attitude_source,
    moved,
    place,
    tracker_frame,
    turning,
)
from steelyard.inspection.motion_amendments import (
    of_clock,
    of_frame,
    of_gravity,
    of_imu,
    of_mounting,
    of_orientation,
    of_target,
    of_vectors,
)
from steelyard.inspection.wrench_balance import force_agreement, force_relations

_MOST = 6
"""Mistakes that are looked for in one run."""
_LEAST_GAIN = 2.5
"""By how much the whole must get better: of one channel, that it is left with less than a third of
what was too much."""
_SHARE = 0.25
"""Of what is bad altogether, that a mistake must explain."""
_MUCH_BETTER = 0.4
"""Ratio to the present one that is left where it is worst, at most."""
_GOOD = 1.25
"""Ratio of an agreement that nothing but noise is left of."""
_WIDER = 2.0
"""By how much more may be allowed to the amended description, as a part of what is compared."""
_EQUAL = 0.5
"""Gain by which the next best explanation is about as good."""
_SUSPECT = 0.5
"""Share of bad agreements, as a part of the largest, from which a source is suspected."""
_COARSE, _FINE = 0.2, 0.04
"""Steps in which clocks are tried [s]."""
_LATEST = 10.0
"""[s]"""
_LEAST_DELAY = 0.15
"""Of a clock that is named [s]."""
_FREE = 1e-3
"""Weight of what is not known about a constant that is solved for."""


@dataclass(frozen=True, eq=False)
class Mistake:
    """One that was found."""

    amendment: Amendment
    run: str
    before: tuple[InstrumentAgreement, ...]
    """Agreements that it spoils, as they are."""
    after: tuple[InstrumentAgreement, ...]
    """The same with the amended description."""
    gain: float
    others: tuple[str, ...]
    """Other explanations that are about as good."""

    @property
    def evidence(self) -> str:
        """Where it shows most, in words."""
        pairs = [(b, a) for b, a in zip(self.before, self.after, strict=True) if b.worst > BAD]
        b, a = max(
            pairs or [(self.before[0], self.after[0])], key=lambda pair: pair[0].cost - pair[1].cost
        )
        i = int(np.argmax(b.ratio))
        channel = b.channels[i]
        left = a.ratio[a.channels.index(channel)] if channel in a.channels else a.worst
        return (
            f"{b.name}: {channel} is off by {b.ratio[i]:.2g} times what is allowed, by {left:.2g}"
            " times then"
        )


@dataclass(frozen=True, eq=False)
class Judged:
    """An excerpt and all its agreements."""

    excerpt: Excerpt
    relations: tuple[Relation, ...]
    agreements: Mapping[Relation, InstrumentAgreement]

    @property
    def bad(self) -> list[InstrumentAgreement]:
        """Agreements that are none."""
        return [a for a in self.agreements.values() if a.worst > BAD]


def judged(excerpt: Excerpt) -> Judged:
    """Evaluate everything that can be compared."""
    relations = (*motion_relations(excerpt), *force_relations(excerpt))
    found = {r: a for r in relations if (a := evaluated(excerpt, r)) is not None}
    return Judged(excerpt, tuple(found), found)


_MOTION = frozenset(
    {"gyro", "scatter", "attitudes", "places", "accelerometer", "gravity", "lengths", "reading"}
)


def evaluated(excerpt: Excerpt, relation: Relation) -> InstrumentAgreement | None:
    """One agreement; None where it cannot be had."""
    try:
        found = (
            motion_agreement(excerpt, relation)
            if relation[0] in _MOTION
            else force_agreement(excerpt, relation)
        )
    except np.linalg.LinAlgError:
        return None
    return found if found is not None and np.isfinite(found.ratio).all() else None


def held_against(after: InstrumentAgreement, before: InstrumentAgreement) -> InstrumentAgreement:
    """An agreement that may not be better for allowing more: noise that a change makes larger
    explains nothing.

    Args:
        after: With an amended description.
        before: As described.
    """
    axes = after.measured.shape[1]
    if len(before.allowed) < axes:
        # Of one account alone, which has limits of its own.
        return after
    now, then = (
        np.append(np.var(each.measured, axis=0), np.mean(np.var(each.measured, axis=0)))
        for each in (before, after)
    )
    grown = np.sqrt(then / (now + 1e-300))
    # What is compared may have another unit: an axis of it, or all.
    grown = np.maximum(grown[:-1], grown[-1])
    most = dict(zip(before.channels, _WIDER * before.allowed[:axes] * grown, strict=False))
    capped = [
        min(float(a), most.get(c, np.inf)) if i < axes else float(a)
        for i, (c, a) in enumerate(zip(after.channels, after.allowed, strict=True))
    ]
    gone = [i for i, c in enumerate(before.channels) if c not in after.channels]
    return replace(
        after,
        channels=(*after.channels, *(before.channels[i] for i in gone)),
        left=np.concatenate([after.left, before.left[gone]]),
        allowed=np.concatenate([capped, before.allowed[gone]]),
    )


def _touched(relation: Relation, agreement: InstrumentAgreement, touches: frozenset[str]) -> bool:
    return any(name in touches for name, _ in relation[1]) or (ROBOT in touches and agreement.robot)


def mistakes(
    excerpt: Excerpt, tell: Callable[[str], None] | None = None
) -> tuple[list[Mistake], Judged]:
    """Find the mistakes of one run, and how everything agrees once they are taken back.

    Args:
        excerpt: Of the run.
        tell: Is told what is being tried.
    """
    found: list[Mistake] = []
    now = judged(excerpt)
    while now.bad and len(found) < _MOST:
        if tell is not None:
            tell(f"looking for mistakes in {excerpt.run.name}")
        # Who agrees with nobody first; then everybody who contradicts anyone.
        best = _best(now, _SUSPECT) or _best(now, 0.0)
        if best is None:
            break
        mistake, now = best
        found.append(mistake)
    return found, now


def _best(now: Judged, suspected: float) -> tuple[Mistake, Judged] | None:
    """The amendment that helps most, if it helps enough."""
    total = sum(a.cost for a in now.bad)
    wanted = max(_LEAST_GAIN, _SHARE * min(total, 30.0))
    tried: list[tuple[float, Amendment, Excerpt, dict[Relation, InstrumentAgreement]]] = []
    for amendment in _amendments(now, suspected):
        relations = [r for r, a in now.agreements.items() if _touched(r, a, amendment.touches)]
        # What could be gained at best: all that is wrong with these.
        gain = sum(now.agreements[r].cost for r in relations) - amendment.cost
        least = max(wanted, max((t[0] for t in tried), default=0.0) - 2 * _EQUAL)
        if gain < least:
            continue
        try:
            amended = amendment.change(now.excerpt)
        except (ValueError, np.linalg.LinAlgError):
            continue
        after: dict[Relation, InstrumentAgreement] = {}
        for r in sorted(relations, key=lambda r: r[0] not in _MOTION):
            each = evaluated(amended, r)
            if each is None:
                break
            after[r] = each = held_against(each, now.agreements[r])
            gain -= each.cost
            if gain < least:
                break
        else:
            tried.append((gain, amendment, amended, after))
    tried.sort(key=lambda each: -each[0])
    for gain, amendment, amended, after in tried[:5]:
        spoilt = [r for r in after if now.agreements[r].worst > BAD]
        if not any(
            after[r].worst < max(_GOOD, _MUCH_BETTER * now.agreements[r].worst) for r in spoilt
        ):
            continue
        others = [
            f"{a.subject}: {a.what}"
            for g, a, *_ in tried
            if a is not amendment and g + a.cost > gain + amendment.cost - _EQUAL
        ]
        mistake = Mistake(
            amendment,
            now.excerpt.run.name,
            tuple(now.agreements[r] for r in after),
            tuple(after.values()),
            gain,
            tuple(dict.fromkeys(others))[:3],
        )
        # From here on the amended description is the one that is held against others.
        fresh = {r: each for r in after if (each := evaluated(amended, r)) is not None}
        return mistake, Judged(amended, now.relations, {**now.agreements, **fresh})
    return None


def _amendments(now: Judged, suspected: float) -> Iterator[Amendment]:
    """What could be wrong with the instruments of agreements that are none."""
    excerpt = now.excerpt
    suspects = _suspects(now, suspected)
    names = dict.fromkeys(name for name, _ in suspects)
    if not excerpt.static:
        yield from _clocks(now, set(names))
    if any(a.robot for a in now.bad):
        yield from of_gravity(excerpt)
    for name, quantity in suspects:
        kind = excerpt.instruments[name].kind
        if kind in {"tension", "wrench"}:
            if quantity != "torque":
                yield from of_forces(excerpt, name)
            continue
        if quantity == "orientation":
            yield from of_orientation(excerpt, (name, quantity))
        elif quantity == "length":
            yield from of_cables(excerpt, (name, quantity), "l")
        else:
            yield from of_vectors(excerpt, (name, quantity))
        if kind in {"position", "pose"} and quantity == "position":
            yield from of_frame(excerpt, name)
        if quantity in {"position", "specific_force"}:
            for wanted in _wanted_places(excerpt, name):
                yield from of_target(excerpt, name, wanted)
    for name in names:
        kind = excerpt.instruments[name].kind
        if kind == "imu":
            yield from of_imu(excerpt, name)
        if kind in {"attitude", "pose"}:
            yield from of_mounting(excerpt, name)


def _suspects(now: Judged, suspected: float) -> list[Source]:
    """Sources of which most agreements are none, the worst first: who is wrong agrees with
    nobody.
    """
    bad: dict[Source, int] = {}
    all_of: dict[Source, int] = {}
    for relation, agreement in now.agreements.items():
        for source in relation[1]:
            all_of[source] = all_of.get(source, 0) + 1
            bad[source] = bad.get(source, 0) + (agreement.worst > BAD)
    share = {source: bad[source] / count for source, count in all_of.items()}
    most = max(share.values())
    return sorted(
        (s for s in share if bad[s] and share[s] >= suspected * most), key=lambda s: -share[s]
    )


def _wanted_places(excerpt: Excerpt, name: str) -> Iterator[Array]:
    """Where on the platform an instrument would have to sit."""
    orientation = attitude_source(excerpt)
    if orientation is None or excerpt.static:
        return
    turned = turning(excerpt, orientation)
    source = (name, "position")
    n = len(turned.omega)
    by_lever = _cross(turned.alpha) + _cross(turned.omega) @ _cross(turned.omega)
    if source in excerpt.observations and excerpt.instruments[name].kind in {"position", "pose"}:
        origin, R = tracker_frame(excerpt, name)
        seen = excerpt.observations[source].mapped(R)
        for other in positions(excerpt):
            if other != source:
                apart = seen.value + origin - place(excerpt, other, turned).position
                columns = np.concatenate(
                    [turned.rotation, np.broadcast_to(np.eye(3), (n, 3, 3))], axis=2
                )
                yield _solved(columns, apart)[:3]
        for force_samples in excerpt.quantity("specific_force"):
            own = accelerometer(excerpt, force_samples, turned.rotation).value
            own = moved(
                own,
                turned.omega,
                turned.alpha,
                -np.array(excerpt.instruments[force_samples[0]].position),  # type: ignore[attr-defined]
            )
            tracked = np.einsum("nji,nj->ni", turned.rotation, seen.bend - excerpt.robot.gravity)
            columns = np.concatenate([by_lever, np.broadcast_to(np.eye(3), (n, 3, 3))], axis=2)
            yield _solved(columns, tracked - own)[:3]
    source = (name, "specific_force")
    if source in excerpt.observations:
        own_force = accelerometer(excerpt, source, turned.rotation)
        for other in positions(excerpt):
            force = specific_force(excerpt, turned, place(excerpt, other, turned))
            columns = np.concatenate([by_lever, np.broadcast_to(np.eye(3), (n, 3, 3))], axis=2)
            yield _solved(columns, own_force.value - force)[:3]


def _solved(columns: Array, target: Array) -> Array:
    A = columns.reshape(-1, columns.shape[2])
    scale = np.linalg.norm(A, axis=0).max()
    held = _FREE * scale * np.eye(A.shape[1])
    value, *_ = np.linalg.lstsq(
        np.vstack([A, held]), np.concatenate([target.ravel(), np.zeros(len(held))]), rcond=None
    )
    return np.asarray(value)


def _cross(v: Array) -> Array:
    return np.asarray(np.cross(v[:, None, :], np.eye(3)[None], axisa=2, axisb=2).swapaxes(1, 2))


def _clocks(now: Judged, suspects: set[str]) -> Iterator[Amendment]:
    """Clocks that are late, and events that were exchanged."""
    excerpt = now.excerpt
    experiment, run = excerpt.experiment, excerpt.run
    shared: dict[str, list[str]] = {}
    for name in run.streams:
        shared.setdefault(clock_of(experiment, name), []).append(name)
    # Instruments that are said to share a clock may not.
    groups = dict.fromkeys([*map(tuple, shared.values()), *((name,) for name in run.streams)])
    force = experiment.force_instrument(run)
    for names in groups:
        if force in names or not suspects & set(names):
            continue
        delay = _best_delay(now, names)
        if delay is not None:
            yield of_clock(excerpt, names, delay)
    if run.sync:
        yield from _exchanged(excerpt, list(groups))


def _best_delay(now: Judged, names: tuple[str, ...]) -> float | None:
    """By how much a clock would have to be late, roughly, if at all [s]."""
    relations = [
        r
        for r in now.relations
        if any(n in names for n, _ in r[1]) and not all(n in names for n, _ in r[1])
    ]
    # Against other motion instruments where there are some: it is quicker, and no body needs to be
    # known.
    relations.sort(key=lambda r: (r[0] not in _MOTION, -now.agreements[r].worst))
    relations = relations[:2]
    if not relations:
        return None
    length = float(now.excerpt.time[-1] - now.excerpt.time[0])
    most = min(_LATEST, length / 2)

    def cost(delay: float) -> float:
        amended = of_clock(now.excerpt, names, delay).change(now.excerpt)
        each = [evaluated(amended, r) for r in relations]
        return (
            sum(a.cost for a in each if a is not None)
            if all(a is not None for a in each)
            else np.inf
        )

    grid = np.arange(-most, most + _COARSE / 2, _COARSE)
    best = float(grid[int(np.argmin([cost(float(d)) for d in grid]))])
    fine = best + np.arange(-_COARSE, _COARSE + _FINE / 2, _FINE)
    best = float(fine[int(np.argmin([cost(float(d)) for d in fine]))])
    return best if abs(best) > _LEAST_DELAY else None


def _exchanged(excerpt: Excerpt, groups: Sequence[Sequence[str]]) -> Iterator[Amendment]:
    sync = excerpt.run.sync
    for i, first in enumerate(groups):
        for second in groups[i + 1 :]:
            apart = sync[first[0]] - sync[second[0]]
            if abs(apart) < _LEAST_DELAY or set(first) & set(second):
                continue
            names = (*first, *second)
            delays = {**dict.fromkeys(first, -apart), **dict.fromkeys(second, apart)}

            def change(p: Excerpt, delays: Mapping[str, float] = delays) -> Excerpt:
                return p.with_observations(
                    {
                        s: seen.later(p.time, delays[s[0]])
                        for s, seen in p.observations.items()
                        if s[0] in delays
                    }
                )

            key = "sync: {" + ", ".join(f"{n}: {sync[n] + d:.6g}" for n, d in delays.items()) + "}"
            yield Amendment(
                "clock",
                first[0],
                "sync",
                f"the events of {first[0]} and {second[0]} under 'sync' are exchanged",
                key,
                change,
                0.3,
                frozenset(names),
            )
