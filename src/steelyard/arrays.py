"""Arrays: read-only ones, which immutable values are made of, their stretches, means and
derivatives.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import WrongValueError

Array: TypeAlias = NDArray[np.float64]

_STEP = 1e-200
"""Imaginary step: its square is zero in double precision, so that derivatives are exact to
rounding."""
_LONGEST_SHOWN = 80
"""Characters of a value in a message."""


def readonly(values: ArrayLike, shape: Sequence[int | None], name: str) -> Array:
    """Copy values into a read-only float64 array of a given shape.

    Args:
        values: Numbers.
        shape: Expected shape; None stands for any length.
        name: What the array is, for the message.

    Returns:
        A copy, C-contiguous, not writeable.

    Raises:
        WrongValueError: These are no numbers, the shape does not fit, or a value is not finite.
    """
    try:
        array = np.array(values, dtype=np.float64, order="C")
    except (TypeError, ValueError):
        raise WrongValueError(
            f"{name}: expected numbers in rows of one length, found {_shown(values)}; correct it"
        ) from None
    fits = array.ndim == len(shape) and all(
        want is None or want == got for want, got in zip(shape, array.shape, strict=True)
    )
    if not fits:
        wanted = " x ".join("n" if n is None else str(n) for n in shape)
        raise WrongValueError(
            f"{name}: expected shape {wanted or 'scalar'}, found {array.shape}; correct it"
        )
    if not np.all(np.isfinite(array)):
        raise WrongValueError(
            f"{name}: expected finite numbers, found {_shown(array.tolist())}; correct it"
        )
    array.setflags(write=False)
    return array


def number_given(
    value: Any,
    name: str,
    *,
    least: float = -np.inf,
    above: float = -np.inf,
    unit: str = "",
) -> float:
    """A number that a caller hands over.

    Args:
        value: What was handed over.
        name: Of the argument.
        least: It is no less.
        above: It is more.
        unit: Of the number.

    Raises:
        WrongValueError: It is no number, or not within these.
    """
    if isinstance(value, int | float | np.integer | np.floating) and (
        least <= value < np.inf and above < value
    ):
        return float(value)
    bounds = f" above {above:g}" if above > -np.inf else ""
    bounds += f" of at least {least:g}" if least > -np.inf else ""
    raise WrongValueError(
        f"{name}: expected a finite number{bounds}{f' {unit}' if unit else ''}, found"
        f" {_shown(value)}; correct it"
    )


def whole_given(value: Any, name: str, *, least: int = 0) -> int:
    """A whole number that a caller hands over.

    Args:
        value: What was handed over.
        name: Of the argument.
        least: It is no less.

    Raises:
        WrongValueError: It is no whole number, or less.
    """
    if isinstance(value, int | np.integer) and value >= least:
        return int(value)
    raise WrongValueError(
        f"{name}: expected a whole number of at least {least}, found {_shown(value)}; correct it"
    )


def _shown(values: Any) -> str:
    """A value for a message, not longer than a line."""
    text = " ".join(repr(values).split())
    return text if len(text) <= _LONGEST_SHOWN else f"{text[:_LONGEST_SHOWN]}…"


def stretches(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Where a mask holds in a row: first place of every stretch and the one after its last.

    Args:
        mask: Shape (n,).
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(first), int(last)) for first, last in zip(edges[::2], edges[1::2], strict=True)]


def binned_means(
    bins: NDArray[np.int64], values: Array, count: int = 0
) -> tuple[Array, NDArray[np.int64]]:
    """Means of the samples in every bin, and how many samples it has.

    Args:
        bins: Place of every sample, shape (n,).
        values: Shape (n, k).
        count: Least number of bins.

    Returns:
        Means, 0 where a bin is empty, shape (b, k), and numbers of samples, shape (b,).
    """
    samples = np.bincount(bins, minlength=count)
    sums = np.column_stack([np.bincount(bins, column, minlength=count) for column in values.T])
    return sums / np.maximum(samples, 1)[:, None], samples


def complex_step_jacobian(function: Callable[[Any], Any], at: Array) -> Array:
    """Derivative of a function by a complex step, exact to rounding (Squire and Trapp,
    doi:10.1137/S003614459631241X).

    Args:
        function: From numbers, shape (k,), to numbers, shape (n,); analytic, and complex where they
            are.
        at: Where, shape (k,).

    Returns:
        Shape (n, k).
    """
    columns = [np.imag(function(at + 1j * _STEP * e)) / _STEP for e in np.eye(len(at))]
    return np.column_stack(columns)


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
