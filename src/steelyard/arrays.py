"""Read-only arrays: what immutable values are made of."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array: TypeAlias = NDArray[np.float64]


def readonly(values: ArrayLike, shape: Sequence[int | None], name: str) -> Array:
    """Copy values into a read-only float64 array of a given shape.

    Args:
        values: Numbers.
        shape: Expected shape; None stands for any length.
        name: What the array is, for the message.

    Returns:
        A copy, C-contiguous, not writeable.

    Raises:
        ValueError: The shape does not fit, or a value is not finite.
    """
    array = np.array(values, dtype=np.float64, order="C")
    fits = array.ndim == len(shape) and all(
        want is None or want == got for want, got in zip(shape, array.shape, strict=True)
    )
    if not fits:
        wanted = " x ".join("n" if n is None else str(n) for n in shape)
        raise ValueError(f"{name}: expected shape {wanted or 'scalar'}, found {array.shape}")
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{name}: expected finite numbers, found {array.tolist()}")
    array.setflags(write=False)
    return array


def stretches(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Where a mask holds in a row: first place of every stretch and the one after its last.

    Args:
        mask: Shape (n,).
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(first), int(last)) for first, last in zip(edges[::2], edges[1::2], strict=True)]


def joined_stretches(time: Array, mask: NDArray[np.bool_], pause: float) -> list[tuple[int, int]]:
    """:func:`stretches` of samples, those with no more than a pause between them taken together.

    Args:
        time: Ascending, shape (n,).
        mask: Shape (n,).
        pause: In units of the time.
    """
    places = np.flatnonzero(mask)
    if not len(places):
        return []
    breaks = np.flatnonzero(np.diff(time[places]) > pause)
    firsts = places[np.concatenate([[0], breaks + 1])]
    lasts = places[np.concatenate([breaks, [len(places) - 1]])]
    return [(int(first), int(last) + 1) for first, last in zip(firsts, lasts, strict=True)]
