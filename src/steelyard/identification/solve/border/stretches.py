"""What stretches of a segment say about the border: they show whether residuals scatter more than
white noise has them do.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.segment import NormalEquations, Rows
from steelyard.identification.model.sources import Source
from steelyard.identification.solve.settings import FitSettings

_ROWS_AT_ONCE = 2048
"""Rows of a stretch whose product is formed at once: enough that the sums are little beside it."""


def numbers_of(segment: Segment, settings: FitSettings) -> NDArray[np.intp]:
    """Which stretch of a segment each instant belongs to, an instant being what depends on the same
    coefficients.
    """
    instants = (
        len(segment.coefficients)
        if segment.static
        else len(segment.coefficients) - segment.width // segment.block + 1
    )
    length = float(segment.knots[-1] - segment.knots[0])
    spacing = length / max(instants, 1)
    if segment.static:
        count = min(instants, settings.most_blocks)
    else:
        block = max(settings.block, settings.block_spacings * spacing)
        count = int(np.clip(length / block, 1, settings.most_blocks))
    return np.arange(instants) * count // instants


def beginnings(segment: Segment, number: NDArray[np.intp]) -> Array:
    """When each stretch begins [s], shape (s,).

    Args:
        segment: With its knots.
        number: Of the stretch that each instant belongs to.
    """
    knots = segment.knots
    start, end = (float(knots[0]), float(knots[-1])) if segment.static else segment.span
    first = np.searchsorted(number, np.arange(number[-1] + 1))
    return np.asarray(start + (end - start) * first / len(number))


def by_stretches(
    segment: Segment, rows: Iterable[Rows], equations: NormalEquations, number: NDArray[np.intp]
) -> tuple[Array, Array, dict[Source, Array]]:
    """What stretches of a segment say about the border once the motion has followed, matrices of
    shape (s, k, k) and right-hand sides of shape (s, k), and the matrices' sum by the quantities
    that are read.

    Args:
        segment: With its motion.
        rows: Its readings.
        equations: Of the motion, which may be known from more than these.
        number: Of the stretch that each instant belongs to.
    """
    count, border = int(number[-1]) + 1, equations.side.shape[1]
    normal, right = np.zeros((count, border, border)), np.zeros((count, border))
    by_source: dict[Source, Array] = {}
    for part in rows:
        if part.label is None:
            continue
        of_source = by_source.setdefault(part.label, np.zeros((border, border)))
        columns = np.arange(border) if part.columns is None else part.columns
        order = np.argsort(part.first, kind="stable")
        edges = np.searchsorted(part.first[order], np.arange(len(number) + 1))
        each = part.residual.shape[1]
        for stretch, instants in _together(number, np.diff(edges) * each):
            samples = order[edges[instants[0]] : edges[instants[-1] + 1]]
            E = np.empty((len(samples) * each, border))
            for i in instants:
                own = order[edges[i] : edges[i + 1]]
                begin = (edges[i] - edges[instants[0]]) * each
                motion = part.by_motion[own].reshape(len(own) * each, -1)
                start = i * segment.block
                followed = equations.followed[start : start + motion.shape[1]]
                np.matmul(-motion, followed, out=E[begin : begin + len(own) * each])
            E[:, columns] += part.by_errors[samples].reshape(-1, len(columns))
            square = E.T @ E
            normal[stretch] += square
            of_source += square
            right[stretch] -= E.T @ part.residual[samples].ravel()
    return normal, right, by_source


def _together(number: NDArray[np.intp], rows: NDArray[np.intp]) -> Iterator[tuple[int, list[int]]]:
    """Stretches, and instants of each that are taken at once: those that have rows, as far as these
    are not too many.

    Args:
        number: Of the stretch that each instant belongs to.
        rows: Of each instant.
    """
    found, held = list[int](), 0
    for i in np.flatnonzero(rows):
        if found and (number[i] != number[found[0]] or held + rows[i] > _ROWS_AT_ONCE):
            yield int(number[found[0]]), found
            found, held = [], 0
        found.append(int(i))
        held += int(rows[i])
    if found:
        yield int(number[found[0]]), found
