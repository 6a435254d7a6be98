"""Normal equations of linearised readings: their products, summed up where the motion puts them."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.identification.banded import banded_sum
from steelyard.identification.model.segment import POSE, WIDTH, Label, NormalEquations, Rows

_AT_ONCE = 512
"""Instants whose products are held at once."""
_NUMBERS = 1 << 22
"""In these products, at most."""
_FEW = 16
"""Instants that are fewer than the columns of what one of them depends on."""
_MOST_TOUCHED = 0.75
"""Part of the coefficients that rows may depend on for the others to be left out."""


def accumulate(
    functions: int,
    border: int,
    rows: Iterable[Rows],
    *,
    width: int = WIDTH,
    block: int = POSE,
) -> NormalEquations:
    """Normal equations of linearised readings.

    Args:
        functions: Of the motion.
        border: Number of border parameters.
        rows: All there are.
        width: Coefficients that one instant depends on, of rows that are no wider.
        block: Coefficients of one function.
    """
    size = functions * block
    parts: dict[Label, Array] = {}
    side = np.zeros((size, border))
    corner, by_motion, by_border = (
        np.zeros((border, border)),
        np.zeros(size),
        np.zeros(border),
    )
    for part in rows:
        reach = part.by_motion.shape[2] // block
        band = parts.setdefault(part.label, np.zeros((reach * block, size)))
        columns = np.arange(border) if part.columns is None else part.columns
        touched = _touched(part.by_motion, block) if functions > _FEW else np.arange(block)
        is_all = len(touched) == block
        places = (np.arange(reach)[:, None] * block + touched).ravel()
        first, order = part.first, None
        if len(first) and np.any(np.diff(first) < 0):
            order = np.argsort(first, kind="stable")
            first = first[order]
        # Products over many columns are large: so many instants at once as fit into a bound.
        at_once = int(np.clip(_NUMBERS // (len(places) + len(columns) + 1) ** 2, _FEW, _AT_ONCE))
        for start in range(0, functions, at_once):
            span = slice(*np.searchsorted(first, [start, start + at_once]))
            if span.start == span.stop:
                continue
            origin, last = int(first[span.start]), int(first[span.stop - 1])
            own = span if order is None else order[span]
            by_own = part.by_motion[own] if is_all else part.by_motion[own][:, :, places]
            together = np.concatenate(
                [by_own, part.by_errors[own], part.residual[own, :, None]], axis=2
            )
            count = last - origin + 1
            products = _products(together, first[span] - origin, count)
            _scatter(band, products, origin, block, places)
            across = _across(products, reach, len(touched))
            lines = (np.arange(origin, last + reach)[:, None] * block + touched).ravel()
            side[np.ix_(lines, columns)] += across[:, :-1]
            by_motion[lines] -= across[:, -1]
            total = products[:, len(places) :, len(places) :].sum(axis=0)
            corner[np.ix_(columns, columns)] += total[:-1, :-1]
            by_border[columns] -= total[:-1, -1]
    band = banded_sum([np.zeros((width, size)), *parts.values()])
    return NormalEquations(band, side, corner, by_motion, by_border, parts, block)


def _touched(by_motion: Array, block: int) -> NDArray[np.intp]:
    """Which of the coefficients of a function rows depend on, where these are few of them, as a
    pose and the process of one instrument are; else all.

    Args:
        by_motion: Shape (n, k, w).
        block: Coefficients of one function.
    """
    n, k, width = by_motion.shape
    whole = by_motion.reshape(n, k, width // block, block)
    # A few samples tell of most rows that they depend on nearly all.
    for part in (whole[:_FEW], whole):
        touched = np.flatnonzero(part.any(axis=(0, 1, 2)))
        if len(touched) > _MOST_TOUCHED * block:
            return np.arange(block)
    return touched if len(touched) else np.arange(block)


def _products(rows: Array, instant: NDArray[np.intp], count: int) -> Array:
    """Rows with themselves, summed over the samples of every instant, shape (count, c, c)."""
    edges = np.searchsorted(instant, np.arange(count + 1))
    k, c = rows.shape[1:]
    flat = rows.reshape(-1, c)
    products = np.zeros((count, c, c))
    for i in np.flatnonzero(np.diff(edges)):
        own = flat[edges[i] * k : edges[i + 1] * k]
        np.matmul(own.T, own, out=products[i])
    return products


def _across(products: Array, reach: int, block: int) -> Array:
    """Products of the motion with all else, summed up over consecutive functions, shape
    ((count + reach - 1) block, c).

    Args:
        products: Of consecutive instants, shape (count, c, c).
        reach: Functions that one instant depends on.
        block: Coefficients of one function.
    """
    count, width = len(products), reach * block
    across = np.zeros((count + reach - 1, block, products.shape[2] - width))
    for function in range(reach):
        own = slice(function * block, (function + 1) * block)
        across[function : function + count] += products[:, own, width:]
    return across.reshape(-1, across.shape[2])


def _scatter(
    band: Array, products: Array, origin: int, block: int, places: NDArray[np.intp]
) -> None:
    """Add products of consecutive instants to a banded matrix.

    Args:
        band: Lower banded form, shape (w, N).
        products: Shape (count, c, c), first of the coefficients that are touched.
        origin: The first function.
        block: Coefficients of one function.
        places: Of these coefficients among the w of an instant, ascending.
    """
    count, width = len(products), len(band)
    is_all = len(places) == width
    if is_all and count < _FEW:
        length = (count - 1) * block + width
        own, squares = _squares(width, length, block, count)
        for square, product in zip(squares, products, strict=True):
            square += product[:width, :width]
        band[:, origin * block : origin * block + length] += own
        return
    for column, place in enumerate(places):
        start = origin * block + place
        own = band[:, start : start + (count - 1) * block + 1 : block]
        below = slice(width - place) if is_all else places[column:] - place
        own[below] += products[:, column : len(places), column].T


def _squares(width: int, length: int, block: int, count: int) -> tuple[Array, Array]:
    """A matrix of zeros in lower banded form, shape (width, length), and a view of the squares on
    its diagonal that begin a block apart, shape (count, width, width).

    Entry (r, c) of a square stands in row r - c of the band; what is above the diagonal goes to
    rows that are not returned.
    """
    rows = np.zeros((2 * width - 1, length))
    band = rows[width - 1 :]
    row, column = rows.strides
    view = np.lib.stride_tricks.as_strided(
        band, shape=(count, width, width), strides=(block * column, row, column - row)
    )
    return band, view
