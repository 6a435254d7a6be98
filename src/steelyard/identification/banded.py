"""Symmetric matrices in lower banded form: entry (r, c) stands in row r - c of column c.

Those of motions are made of blocks, a function of the spline each, which LAPACK's routines for
single diagonals do not see: where many columns are asked for, whole blocks are taken at once.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from scipy.linalg import cho_solve_banded
from scipy.linalg.blas import dsbmv, dtrsm
from scipy.linalg.lapack import dtrtri

from steelyard.arrays import Array

_MANY = 16
"""Columns from which on blocks are faster."""
_COLUMNS = 64
"""That are solved for at once: so many more numbers are held."""


def solved(factor: Array, right: Array, of_function: int) -> Array:
    """Solution with a banded matrix, shape as of the right-hand side.

    Args:
        factor: Its Cholesky factor, lower banded form, shape (42, N); blocks of a function each
            that lie further from the diagonal than the band reaches are zero.
        right: Shape (N,) or (N, k).
        of_function: Coefficients of one function.
    """
    if right.ndim == 1 or right.shape[1] < _MANY:
        return np.asarray(cho_solve_banded((factor, True), right, check_finite=False))
    diagonal, below = _of_blocks(factor, of_function)
    found = np.empty(right.shape)
    for start in range(0, right.shape[1], _COLUMNS):
        own = slice(start, start + _COLUMNS)
        found[:, own] = _solved_by_blocks(diagonal, below, right[:, own])
    return found


def _solved_by_blocks(diagonal: Array, below: Array, right: Array) -> Array:
    """The same by substitution, block by block, there and back; arguments as of :func:`_of_blocks`
    and a right-hand side of some columns, shape (N, k).
    """
    count, block, _ = diagonal.shape
    size, k = right.shape
    rows = np.zeros((count * block, k))
    rows[:size] = right
    # Transposed blocks, which are columns side by side as BLAS has them.
    own = np.ascontiguousarray(rows.reshape(count, block, k).transpose(0, 2, 1))
    for i in range(count):
        if i:
            own[i] -= own[i - 1] @ below[i - 1].T
        own[i] = dtrsm(1.0, diagonal[i].T, own[i].T, trans_a=1, overwrite_b=1).T
    for i in range(count - 1, -1, -1):
        if i < count - 1:
            own[i] -= own[i + 1] @ below[i]
        own[i] = dtrsm(1.0, diagonal[i].T, own[i].T, overwrite_b=1).T
    return np.asarray(own.transpose(0, 2, 1).reshape(-1, k)[:size])


def _of_blocks(factor: Array, of_function: int) -> tuple[Array, Array]:
    """Blocks of a factor on the diagonal, and below each, shape (c, b, b) both; beyond its end
    there are ones on the diagonal.
    """
    width, size = factor.shape
    block = max(width - of_function, of_function)
    padded, blocks = _blocks(width, block, -(-size // block))
    padded[:, :size] = factor
    padded[0, size:] = 1.0
    return np.tril(blocks[:-1, :block]), np.ascontiguousarray(blocks[:-1, block:])


def selected_inverse(factor: Array, of_function: int) -> Array:
    """Parts of the inverse of a banded matrix within its own band, lower banded form, shape (42,
    N).

    Formed by recursion over blocks of the factor [Takahashi1973]_: linear in the length.

    Args:
        factor: See :func:`solved`.
        of_function: Coefficients of one function.
    """
    width, size = factor.shape
    diagonal, below = _of_blocks(factor, of_function)
    count, block, _ = diagonal.shape
    inverse = np.array([dtrtri(each, lower=True)[0] for each in diagonal])
    own, step = inverse.transpose(0, 2, 1) @ inverse, below @ inverse
    across = np.zeros((count, block, block))
    for i in range(count - 2, -1, -1):
        across[i] = -own[i + 1] @ step[i]
        own[i] -= step[i].T @ across[i]
    found, blocks = _blocks(width, block, count)
    blocks[:-1, :block], blocks[:-1, block:] = own, across
    # What lies below the matrix is nothing.
    result = found[:, :size].copy()
    for d in range(1, width):
        result[d, size - d :] = 0.0
    return result


def _blocks(width: int, block: int, count: int) -> tuple[Array, Array]:
    """A matrix of zeros in lower banded form, shape (width, (count + 1) block), and a view of the
    columns of its blocks, each with the block below it, shape (count + 1, 2 block, block).

    Entry (r, c) of a column of blocks stands in row r - c of the band; what is above the diagonal
    or below the band goes to rows that are not returned.
    """
    columns = (count + 1) * block
    rows = np.zeros((3 * block, columns))
    band = rows[block : block + width]
    row, column = rows.strides
    view = np.lib.stride_tricks.as_strided(
        rows[block:],
        shape=(count + 1, 2 * block, block),
        strides=(block * column, row, column - row),
    )
    return band, view


def banded_window(band: Array, start: int, width: int) -> Array:
    """A square on the diagonal of a symmetric matrix in lower banded form, shape (width, width)."""
    place = np.arange(width)
    offset = np.abs(place[:, None] - place)
    return np.asarray(band[offset, start + np.minimum(place[:, None], place)])


def banded_product(band: Array, vector: Array) -> Array:
    """Product of a symmetric matrix in lower banded form with a vector, shape (n,), or with
    columns, shape (n, c).
    """
    # The routine takes no matrix that is narrower than its band.
    inside = min(band.shape)
    own = np.asarray(band[:inside], order="F", dtype=float)
    columns = np.atleast_2d(vector.T)
    product = [dsbmv(inside - 1, 1.0, own, each, lower=1) for each in columns]
    return np.asarray(np.column_stack(product) if vector.ndim == 2 else product[0])


def banded_square(columns: Array, width: int) -> Array:
    """Product of a matrix with its own transpose within a band, lower banded form, shape (width,
    n).

    Args:
        columns: Shape (n, c).
        width: Diagonals, the middle one and those below it.
    """
    found = np.zeros((width, len(columns)))
    for d in range(min(width, len(columns))):
        found[d, : len(columns) - d] = np.einsum(
            "ic,ic->i", columns[d:], columns[: len(columns) - d]
        )
    return found


def banded_sum(bands: Iterable[Array]) -> Array:
    """Sum of symmetric matrices in lower banded form, as wide as the widest of them.

    Args:
        bands: Of as many columns each, at least one.
    """
    every = list(bands)
    found = np.zeros_like(max(every, key=len))
    for each in every:
        found[: len(each)] += each
    return found


def banded_trace(one: Array, other: Array) -> float:
    """Trace of the product of two symmetric matrices in lower banded form, of the second as far as
    the first reaches.
    """
    return float(2 * np.vdot(one, other[: len(one)]) - np.vdot(one[0], other[0]))
