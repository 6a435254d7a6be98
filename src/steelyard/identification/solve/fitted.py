"""A fit with what was left out of it, and its equations over every column of the border."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.identification.model.balance import Balance, Forces, balance_of
from steelyard.identification.model.motion_segment import AT_REST
from steelyard.identification.model.sources import Source
from steelyard.identification.solve.beginning.readings import Readings
from steelyard.identification.solve.border.segment_equations import (
    BalanceCourse,
    SegmentEquations,
    segment_equations,
)
from steelyard.identification.solve.fit_state import Fit, Task
from steelyard.identification.solve.misfits.slack_cables import SlackCables
from steelyard.inertia import TEN


@dataclass(frozen=True, eq=False)
class Fitted:
    """A fit, and what was left out of it."""

    task: Task
    fit: Fit
    motion: Fit
    """Of the motion instruments alone."""
    force_samples: tuple[Forces, ...]
    """Of each segment, those of runs held out too."""
    lost: Sequence[str]
    """Notes of instruments that have lost the motion."""
    contacts: Mapping[str, Sequence[tuple[float, float]]]
    """Run -> stretches in which something touched the platform [s]."""
    spikes: Mapping[str, int]
    """Run -> force readings that stood alone."""
    held_out: frozenset[str] = frozenset()
    """Runs whose forces were not looked at."""
    slack: tuple[SlackCables, ...] = ()
    """Cables that may hang slack for a while, of runs that have such ones."""

    @property
    def balances(self) -> tuple[Balance, ...]:
        """Of every segment."""
        state = self.fit.state
        assert state.parameters is not None
        return tuple(
            balance_of(
                self.task.experiment,
                segment,
                forces,
                state.calibration,
                state.parameters,
                state.factors,
            )
            for segment, forces in zip(state.segments, self.force_samples, strict=True)
        )

    def without_equations(self) -> Fitted:
        """The same without the large matrices of its knots."""
        fit, motion = (replace(each, equations=(), motions=()) for each in (self.fit, self.motion))
        return replace(self, fit=fit, motion=motion)


@dataclass(frozen=True, eq=False)
class FittedStretch:
    """All runs of an experiment, or a stretch of one of them, with the fit."""

    readings: Readings
    fitted: Fitted
    parts: tuple[SegmentEquations, ...]
    """Its segments, with equations over all columns of the border."""


def stretch_of(readings: Readings, fitted: Fitted) -> FittedStretch:
    """A fit with its equations.

    Raises:
        numpy.linalg.LinAlgError: The motion is not determined.
    """
    return FittedStretch(readings, fitted, tuple(_equations_of(fitted)))


def without_knots(chunk: FittedStretch) -> FittedStretch:
    """A chunk without what has done its work: the large matrices of its knots, its streams, samples
    and readings beside those of its segments, the noise of its balance. How the motion follows the
    border is drawn, not computed with.
    """
    estimated = estimated_columns(chunk.fitted.task)
    parts = tuple(
        replace(
            part,
            segment=replace(part.segment, jerks={}),
            followed=part.followed[:, estimated].astype(np.float32),
            balances=tuple(map(BalanceCourse.of, part.balances)),
        )
        for part in chunk.parts
    )
    records = tuple(replace(each, segments=(), force_samples=()) for each in chunk.readings.records)
    fitted = chunk.fitted.without_equations()
    state = replace(fitted.fit.state, segments=tuple(part.segment for part in parts))
    fitted = replace(fitted, fit=replace(fitted.fit, state=state))
    runs = tuple(replace(run, streams={}) for run in chunk.readings.runs)
    none = np.zeros(0, dtype=np.intp)
    samples = tuple(each.part(none) for each in chunk.readings.samples)
    readings = replace(chunk.readings, runs=runs, records=records, samples=samples)
    return FittedStretch(readings, fitted, parts)


def handed_on(before: FittedStretch, after: FittedStretch) -> tuple[FittedStretch, FittedStretch]:
    """Two chunks, with what the readings of both bring in the second: by their quantities, and
    where both are of one run the normal equations. Of many chunks only the sum is asked for, and
    matrices of each would take more memory than its readings.
    """
    first, *others = (replace(part, by_source={}) for part in after.parts)
    first = replace(first, by_source=by_source(before.parts + after.parts))
    emptied = []
    for part in before.parts:
        if part.segment.run == first.segment.run:
            first = replace(first, equations=part.equations + first.equations)
            part = replace(part, equations=part.equations.emptied)
        emptied.append(replace(part, by_source={}))
    return replace(before, parts=tuple(emptied)), replace(after, parts=(first, *others))


def by_source(parts: Sequence[SegmentEquations]) -> dict[Source, Array]:
    """Quantity -> part of the normal matrix that its readings bring, shape (k, k)."""
    found: dict[Source, Array] = {}
    for part in parts:
        for (owner, name), matrix in part.by_source.items():
            source = (owner, name.removesuffix(AT_REST))
            found[source] = found.get(source, 0.0) + matrix
    return found


def _equations_of(fitted: Fitted) -> Sequence[SegmentEquations]:
    """Equations of every segment over all columns of the border."""
    task, found = fitted.task, fitted.fit
    names = [run.name for run in task.experiment.runs]
    count = len(found.state.segments)
    motions = found.motions or (None,) * count
    return [
        segment_equations(
            task,
            found.state,
            segment,
            forces,
            motion,
            run=names.index(segment.run),
            looked_at=segment.run not in fitted.held_out,
        )
        for segment, forces, motion in zip(
            found.state.segments, fitted.force_samples, motions, strict=True
        )
    ]


def estimated_columns(task: Task) -> NDArray[np.bool_]:
    """Columns of the border that are estimated, shape (k,)."""
    return np.concatenate([np.ones(TEN, dtype=bool), task.active])
