"""Swings without force sensors, without the stretches in which a cable is slack or a hand touches the
platform.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from steelyard.identification.model.balance import Balance, Forces, balance_of
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.samples.segmentation import Recorded
from steelyard.identification.solve.beginning import (
    Beginning,
    Readings,
    with_body,
)
from steelyard.identification.solve.fit_state import FitState
from steelyard.identification.solve.misfits.hands import touching, without
from steelyard.identification.solve.misfits.slack_cables import SlackCables, around, slack_cables


def undisturbed_swings(readings: Readings, begun: Beginning) -> tuple[Readings, Beginning]:
    """Readings and first body without what slack cables and hands do to a platform whose cables
    nobody reads; the very same where all are read.
    """
    if not any(forces.guessed.all() for forces in readings.force_samples):
        return readings, begun
    return _without_hands(*_without_slack(readings, begun))


def _without_slack(readings: Readings, begun: Beginning) -> tuple[Readings, Beginning]:
    """Readings and first body without the stretches in which a cable is slack."""
    found, records = [], []
    for record, balances in _balances(readings, begun.state):
        force_samples = []
        for segment, forces, at in balances:
            slack = slack_cables(at, forces, readings.settings)
            if slack.any() and not segment.static:
                forces = without(forces, at, around(at.time, slack, readings.settings))
                left_out = float(forces.touched.mean())
                found.append(SlackCables(segment.run, slack.mean(axis=0), left_out))
            force_samples.append(forces)
        records.append(replace(record, force_samples=tuple(force_samples)))
    if not found:
        return readings, begun
    by_run = {each.run: each for each in (*begun.slack, *found)}
    return _begun_anew(readings, begun, records, slack=tuple(by_run.values()))


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
