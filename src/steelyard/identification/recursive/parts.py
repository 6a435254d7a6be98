"""Parts of a motion that have passed: told from another origin, summed up, or joined to one
motion.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from steelyard.arrays import Array
from steelyard.identification.model.balance import Forces
from steelyard.identification.model.motion_segment import Reading
from steelyard.identification.model.processes import integrals_of
from steelyard.identification.model.segment import Label
from steelyard.identification.model.sources import Source
from steelyard.identification.solve.border.normal_equations import Blocks, summed, together
from steelyard.identification.solve.border.segment_equations import SegmentEquations
from steelyard.identification.tally import Tally
from steelyard.inertia import TEN
from steelyard.smoothing import DEGREE

_BLOCKS = 60
"""That the blocks of parts are summed up to, at most: more tell no more about their scatter."""
_SAME = 1e-6
"""Distance of an end to a beginning that is none, in spacings of the knots."""


def counted_from(part: SegmentEquations, further: Array) -> SegmentEquations:
    """A part with calibration parameters that are counted from elsewhere.

    Args:
        part: As it is.
        further: By how much they are more then, shape (u,).
    """
    more = np.concatenate([np.zeros(TEN), further])
    equations, blocks = part.equations, part.blocks
    return replace(
        part,
        equations=replace(equations, right=equations.right + equations.normal @ more),
        blocks=replace(blocks, right=blocks.right + blocks.normal @ more),
    )


def counted_up(parts: Sequence[SegmentEquations]) -> tuple[Tally, dict[Label, float]]:
    """Residuals of all parts, and the degrees of freedom that the motion takes of them."""
    tally, spent = Tally(), dict[Label, float]()
    for part in parts:
        tally.include(part.tally)
        for label, freedom in part.spent.items():
            spent[label] = spent.get(label, 0.0) + freedom
    return tally, spent


def with_further(
    parts: Sequence[SegmentEquations], part: SegmentEquations
) -> tuple[SegmentEquations, ...]:
    """Parts with one more, which says what the readings of every quantity bring in all of them: the
    matrices of that are most of a part, and only their sum is asked for.
    """
    if not parts:
        return (part,)
    *others, last = parts
    return (*others, replace(last, by_source={}), replace(part, by_source=_brought([last, part])))


def _brought(parts: Sequence[SegmentEquations]) -> dict[Source, Array]:
    """Quantity -> part of the normal matrix that its readings bring, of all parts."""
    found: dict[Source, Array] = {}
    for part in parts:
        for source, matrix in part.by_source.items():
            found[source] = found.get(source, 0.0) + matrix
    return found


def summed_up(parts: Sequence[SegmentEquations]) -> SegmentEquations:
    """What parts of one run say, with the motion of the last of them alone."""
    tally, spent = counted_up(parts)
    return replace(
        parts[-1],
        equations=summed([part.equations for part in parts]),
        blocks=_fewer(together([part.blocks for part in parts])),
        by_source=_brought(parts),
        tally=tally,
        spent=spent,
    )


def motions_of(parts: Sequence[SegmentEquations]) -> list[SegmentEquations]:
    """Parts of one motion each, whose chunks follow each other."""
    groups: list[list[SegmentEquations]] = []
    for part in parts:
        if groups and _follows(part, groups[-1][-1]):
            groups[-1].append(part)
        else:
            groups.append([part])
    return [group[0] if len(group) == 1 else _joined(group) for group in groups]


def _follows(part: SegmentEquations, before: SegmentEquations) -> bool:
    """Whether a chunk begins where another one ends, on the same knots."""
    one, other = before.segment, part.segment
    if one.static or other.static or one.run != other.run:
        return False
    alike = abs(other.spacing - one.spacing) < _SAME * one.spacing
    return alike and abs(other.span[0] - one.span[1]) < _SAME * other.spacing


def _joined(parts: Sequence[SegmentEquations]) -> SegmentEquations:
    """One motion of chunks that follow each other."""
    first, last = parts[0].segment, parts[-1].segment
    # The last functions of a chunk are the first ones of the next.
    own = [len(part.segment.coefficients) - DEGREE for part in parts[:-1]]
    own.append(len(last.coefficients))
    knots = [part.segment.knots[:count] for part, count in zip(parts, own, strict=True)]
    grid = np.concatenate([*knots, last.knots[own[-1] :]])
    integrals = integrals_of(grid) if first.processes else None
    segment = replace(
        first,
        knots=grid,
        coefficients=np.concatenate(
            [part.segment.coefficients[:count] for part, count in zip(parts, own, strict=True)]
        ),
        readings=tuple(_readings(parts)),
        jerks={},
        processes=tuple(
            each if integrals is None else replace(each, integrals=integrals)
            for each in first.processes
        ),
    )
    columns = [count * first.block for count in own]
    return replace(
        summed_up(parts),
        segment=segment,
        force_samples=_forces(parts),
        balances=tuple(chain.from_iterable(part.balances for part in parts)),
        weight=np.concatenate([part.weight for part in parts]),
        covariance=np.hstack(
            [part.covariance[:, :count] for part, count in zip(parts, columns, strict=True)]
        ),
        followed=np.concatenate(
            [part.followed[:count] for part, count in zip(parts, columns, strict=True)]
        ),
    )


def _readings(parts: Sequence[SegmentEquations]) -> Iterator[Reading]:
    """Of every quantity, one after the other."""
    by_source: dict[Source, list[Reading]] = {}
    for part in parts:
        for reading in part.segment.readings:
            by_source.setdefault(reading.source, []).append(reading)
    for own in by_source.values():
        tensions = [each.tension for each in own if each.tension is not None]
        yield replace(
            own[0],
            time=np.concatenate([each.time for each in own]),
            values=np.concatenate([each.values for each in own]),
            tension=np.concatenate(tensions) if tensions else None,
        )


def _forces(parts: Sequence[SegmentEquations]) -> Forces:
    """Of all parts."""
    own = [part.force_samples for part in parts]
    return replace(
        own[0],
        time=np.concatenate([each.time for each in own]),
        readings={q: np.concatenate([each.readings[q] for each in own]) for q in own[0].readings},
        left_out=np.concatenate([each.left_out for each in own]),
    )


def _fewer(blocks: Blocks) -> Blocks:
    """Neighbours together, until there are few enough."""
    while len(blocks.run) > _BLOCKS:
        normal, right = blocks.normal[::2].copy(), blocks.right[::2].copy()
        others = len(blocks.run) // 2
        normal[:others] += blocks.normal[1::2]
        right[:others] += blocks.right[1::2]
        blocks = Blocks(normal, right, blocks.run[::2], blocks.since[::2])
    return blocks
