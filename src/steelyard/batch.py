"""CasADi expressions evaluated over all samples at once.

The physics is written once, symbolically. This module turns an expression into a function of NumPy
arrays with time on axis 0. Samples go through CasADi's buffer interface in blocks: no conversion,
no copy of the block. It lets go of the interpreter's lock, so that many blocks are shared among
threads; each sample is computed alike, whoever does it.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from itertools import pairwise
from typing import Any, TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array

Symbol: TypeAlias = Any
"""A CasADi SX or MX expression (the library ships no types)."""

_BLOCK = 256
"""Samples a call: large enough to hide the call, small enough to build in a millisecond."""
_SMALL_BLOCK = 16
"""The same of long expressions, beside which a call is nothing, and of few samples: the last block
computes less in vain."""
_FEW = 128
"""Samples that are few."""
_LONG = 4000
"""Operations of an expression from which on it is long."""
_SAMPLES_A_THREAD = 32 * _BLOCK
"""A thread starts and ends in a millisecond or two where others compete; many calls are small."""
_MOST_THREADS = 8
"""They share the memory, which does not get faster."""


def _row_major(expression: Symbol) -> Symbol:
    """Dense column whose entries are those of the expression row by row, as NumPy stores them."""
    return ca.densify(ca.vec(expression.T))


class Batched:
    """A function of arrays with samples on axis 0, made from symbolic inputs and outputs.

    An input symbol of shape (r, c) takes an array of shape (n, r, c), a column (r, 1) one of shape
    (n, r); without the leading axis the value is the same for all samples. Outputs follow the same
    rule and are named as given.
    """

    def __init__(
        self, name: str, inputs: Mapping[str, Symbol], outputs: Mapping[str, Symbol]
    ) -> None:
        self._in_shapes = {key: _shape(symbol) for key, symbol in inputs.items()}
        self._out_shapes = {key: _shape(symbol) for key, symbol in outputs.items()}
        flat = {key: type(symbol).sym(key, symbol.numel()) for key, symbol in inputs.items()}
        matrices = [
            ca.reshape(flat[key], symbol.shape[1], symbol.shape[0]).T
            for key, symbol in inputs.items()
        ]
        self._inner = ca.Function(name, list(inputs.values()), list(outputs.values()))
        results = self._inner.call(matrices, True, False)
        self._single = ca.Function(name, list(flat.values()), [_row_major(r) for r in results])
        self._size = _BLOCK if self._single.n_instructions() < _LONG else _SMALL_BLOCK
        self._block = self._single.map(self._size)

    @cached_property
    def _small(self) -> Symbol:
        """The function of a small block."""
        return self._single.map(_SMALL_BLOCK)

    def _blocks_for(self, n: int) -> tuple[int, Symbol]:
        """Size of the blocks of n samples, and their function."""
        if n == 1:
            return 1, self._single
        if n <= _FEW and self._size > _SMALL_BLOCK:
            return _SMALL_BLOCK, self._small
        return self._size, self._block

    @property
    def function(self) -> Symbol:
        """The CasADi function of one sample; matrices go in and come out row by row."""
        return self._single

    @property
    def inputs(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(self._in_shapes)

    def at(self, **symbols: Symbol) -> dict[str, Symbol]:
        """The same expressions of other symbols, of the shapes of the inputs."""
        results = self._inner.call([symbols[key] for key in self._in_shapes], True, False)
        return dict(zip(self._out_shapes, results, strict=True))

    def __call__(self, **arrays: ArrayLike) -> dict[str, Array]:
        """Evaluate.

        Args:
            **arrays: One value per input, shapes as the class says.

        Returns:
            One array per output, samples on axis 0 (also where all inputs were constant: n = 1).
        """
        values = {key: np.asarray(arrays[key], dtype=np.float64) for key in self._in_shapes}
        lengths = set()
        for key, value in values.items():
            if value.ndim == len(self._in_shapes[key]) + 1:
                lengths.add(value.shape[0])
        if len(lengths) > 1:
            raise ValueError(f"expected equal numbers of samples, found {sorted(lengths)}")
        n = lengths.pop() if lengths else 1
        # Whole blocks, so that the last one needs no function of its own; one sample is none.
        size, function = self._blocks_for(n)
        padded = -(-n // size) * size
        inputs = [_stack(values[key], shape, n, padded) for key, shape in self._in_shapes.items()]
        outputs = {key: np.empty((padded, *shape)) for key, shape in self._out_shapes.items()}
        blocks = padded // size
        threads = min(_MOST_THREADS, padded // _SAMPLES_A_THREAD)
        # Asking for the cores takes longer than a small call.
        threads = min(threads, os.cpu_count() or 1) if threads > 1 else 1
        if threads == 1:
            _evaluate(function, size, inputs, list(outputs.values()), range(blocks))
        else:
            bounds = [blocks * k // threads for k in range(threads + 1)]
            with ThreadPoolExecutor(threads) as pool:
                shares = [
                    pool.submit(
                        _evaluate,
                        function,
                        size,
                        inputs,
                        list(outputs.values()),
                        range(first, last),
                    )
                    for first, last in pairwise(bounds)
                ]
            for share in shares:
                share.result()  # raises what went wrong there
        return {key: array[:n] for key, array in outputs.items()}


def _evaluate(
    function: Symbol, size: int, inputs: list[Array], outputs: list[Array], blocks: range
) -> None:
    """Fill some blocks of the outputs, of ``size`` samples each; a buffer has memory of its own, so
    that calls may overlap.
    """
    buffer: Any
    buffer, evaluate = function.buffer()
    for k in blocks:
        part = slice(k * size, (k + 1) * size)
        for i, array in enumerate(inputs):
            buffer.set_arg(i, array[part].data)
        for i, array in enumerate(outputs):
            buffer.set_res(i, array[part].data)
        evaluate()


def _shape(symbol: Symbol) -> tuple[int, ...]:
    rows, columns = symbol.shape
    return (rows,) if columns == 1 else (rows, columns)


def _stack(value: Array, shape: tuple[int, ...], n: int, padded: int) -> Array:
    stacked = np.empty((padded, *shape))
    stacked[:n] = value
    if n:
        stacked[n:] = stacked[n - 1]
    return stacked
