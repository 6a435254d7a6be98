"""Swings without force sensors, without the stretches in which a cable is slack or a hand touches
the platform; cables that keep their lengths stretch by what carries it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.identification.model.balance import Balance, Forces, balance_of
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.samples.segmentation import Recorded
from steelyard.identification.solve.beginning.begin import Beginning, with_body
from steelyard.identification.solve.beginning.readings import Readings
from steelyard.identification.solve.fit_state import FitState
from steelyard.identification.solve.misfits.hands import touching, without
from steelyard.identification.solve.misfits.slack_cables import SlackCables, around, slack_cables
from steelyard.smoothing import Samples1D, fit

_SWINGING = 0.125
"""Spacing of the knots of tensions that change as a platform swings [s]: they pass what has up to 4
Hz. Of what is slower alone, ropes that stretch by millimetres ask for more; what is faster is
noise."""


def undisturbed_swings(readings: Readings, begun: Beginning) -> tuple[Readings, Beginning]:
    """Readings and first body without what slack cables and hands do to a platform whose cables
    nobody reads; the very same where all are read.
    """
    if not any(forces.guessed.all() for forces in readings.force_samples):
        return readings, begun
    readings, begun = _without_hands(*_without_slack(readings, begun))
    return readings, _with_tensions_carried(readings, begun)


def _without_slack(readings: Readings, begun: Beginning) -> tuple[Readings, Beginning]:
    """Readings and first body without the stretches in which a cable is slack."""
    found, records, segments = [], [], []
    for record, balances in _balances(readings, begun.state):
        force_samples = []
        for segment, forces, at in balances:
            slack = slack_cables(at, forces, readings.settings)
            if slack.any() and not segment.static:
                stretches = around(at.time, slack, readings.settings)
                forces = without(forces, at, stretches)
                segment = _without_lengths(readings, segment, stretches)
                left_out = float(forces.touched.mean())
                found.append(SlackCables(segment.run, slack.mean(axis=0), left_out))
            force_samples.append(forces)
            segments.append(segment)
        records.append(replace(record, force_samples=tuple(force_samples)))
    if not found:
        return readings, begun
    begun = replace(begun, state=replace(begun.state, segments=tuple(segments)))
    by_run = {each.run: each for each in (*begun.slack, *found)}
    return _begun_anew(readings, begun, records, slack=tuple(by_run.values()))


def _without_lengths(
    readings: Readings, segment: Segment, slack: Sequence[tuple[float, float]]
) -> Segment:
    """A segment in which nothing is said of lengths while a cable is slack: its ends are nearer to
    each other then than it is long.

    Args:
        readings: Of the experiment.
        segment: One of its segments.
        slack: Stretches of it, by the clock that both are told by [s].
    """
    kept = []
    for each in segment.readings:
        if readings.experiment.instruments[each.source[0]].tells_stretch:
            use = np.ones(len(each.time), dtype=bool)
            for start, end in slack:
                use &= (each.time < start) | (each.time > end)
            if not use.any():
                continue
            tension = None if each.tension is None else each.tension[use]
            each = replace(each, time=each.time[use], values=each.values[use], tension=tension)
        kept.append(each)
    return replace(segment, readings=tuple(kept))


def slowly(time: Array, tensions: Array) -> Array:
    """Tensions without what changes faster than a platform swings, shape (n, m).

    Noise of a motion is noise of its accelerations. Cables that stretch by it would let the motion
    have it: the stretch was found three times as large, and the inertia 7 of its 1-sigma off.

    Args:
        time: Ascending [s], shape (n,).
        tensions: That carry the platform [N], shape (n, m).
    """
    if len(time) < 2:
        return tensions
    found = fit(Samples1D(time, tensions), float(time[0]), float(time[-1]), _SWINGING)
    return tensions if found is None else found.at(time)


def _with_tensions_carried(readings: Readings, begun: Beginning) -> Beginning:
    """A beginning in which constant lengths stretch by the tensions that carry the first body; the
    very same where nothing is said of them.
    """
    instruments = readings.experiment.instruments
    if not any(
        instruments[each.source[0]].tells_stretch
        for segment in begun.state.segments
        for each in segment.readings
    ):
        return begun
    segments = []
    for _, balances in _balances(readings, begun.state):
        for segment, _, at in balances:
            slow, own = slowly(at.time, at.carried), []
            for each in segment.readings:
                if instruments[each.source[0]].tells_stretch:
                    columns = [np.interp(each.time, at.time, column) for column in slow.T]
                    each = replace(each, tension=np.column_stack(columns))
                own.append(each)
            segments.append(replace(segment, readings=tuple(own)))
    return replace(begun, state=replace(begun.state, segments=tuple(segments)))


def _without_hands(readings: Readings, begun: Beginning) -> tuple[Readings, Beginning]:
    """Readings and first body without what a hand does to the platform."""
    touched: dict[str, list[tuple[float, float]]] = {}
    for _ in range(readings.settings.hand_turns):
        changed, records = False, []
        for record, balances in _balances(readings, begun.state):
            force_samples = []
            for segment, forces, at in balances:
                hands = () if segment.static else touching(at, forces, readings.settings)
                cut = without(forces, at, hands)
                if hands and cut.touched.mean() < readings.settings.most_touched:
                    touched.setdefault(segment.run, []).extend(hands)
                    changed, forces = True, cut
                force_samples.append(forces)
            records.append(replace(record, force_samples=tuple(force_samples)))
        if not changed:
            break
        readings, begun = _begun_anew(readings, begun, records, touched=touched)
    return readings, begun


def _balances(
    readings: Readings, state: FitState
) -> Iterator[tuple[Recorded, list[tuple[Segment, Forces, Balance]]]]:
    """Every record with its segments, their forces and the balance of these about a state."""
    assert state.parameters is not None
    segments = iter(state.segments)
    shared = state.calibration, state.parameters, state.factors
    for record in readings.records:
        own = []
        for forces in record.force_samples:
            segment = next(segments)
            at = balance_of(readings.experiment, segment, forces, *shared)
            own.append((segment, forces, at))
        yield record, own


def _begun_anew(
    readings: Readings, begun: Beginning, records: Sequence[Recorded], **changes: Any
) -> tuple[Readings, Beginning]:
    """Other records and the first body by them; changes are of the beginning."""
    readings = replace(readings, records=tuple(records))
    anew = replace(begun, state=replace(begun.state, parameters=None))
    return readings, replace(with_body(readings, anew), **changes)
