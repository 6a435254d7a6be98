"""CasADi expressions evaluated over all samples at once.

The physics is written once, symbolically. This module turns an expression into a function of NumPy
arrays with time on axis 0. Samples go through CasADi's buffer interface in blocks, whose memory stays
with the function from call to call: most calls are of few samples, and to say anew where these stand
would take longer than to compute them. It lets go of the interpreter's lock, so that many blocks are
shared among threads; each sample is computed alike, whoever does it.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
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
_KEPT = 1 << 19
"""Numbers of the last call that are remembered, at most: fit, verdict and conclusion look at one
state in turn."""
_SAMPLES_A_THREAD = 32 * _BLOCK
"""A thread starts and ends in a millisecond or two where others compete; many calls are small."""
_MOST_THREADS = 8
"""They share the memory, which does not get faster."""


def _row_major(expression: Symbol) -> Symbol:
    """Dense column whose entries are those of the expression row by row, as NumPy stores them."""
    return ca.densify(ca.vec(expression.T))


def jacobians(expression: Symbol, by: Mapping[str, Symbol]) -> dict[str, Symbol]:
    """Derivatives of a column by several columns.

    All in one sweep through the expression, whose common parts are found before it: the sweep finds
    them again in each derivative else, which takes ten times as long and leaves more to compute.
    """
    (shared,) = ca.cse([expression])
    whole = ca.jacobian(shared, ca.veccat(*by.values()))
    ends = np.cumsum([0, *(each.numel() for each in by.values())]).tolist()
    return dict(zip(by, ca.horzsplit(whole, ends), strict=True))


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
        self._idle: dict[int, list[_BlockMemory]] = {}
        self._last: _Call | None = None
        shapes = (*self._in_shapes.values(), *self._out_shapes.values())
        self._numbers = sum(math.prod(shape) for shape in shapes)

    def __getstate__(self) -> dict[str, Any]:
        """What another process needs: memory stays here."""
        return {**self.__dict__, "_idle": {}, "_last": None}

    @cached_property
    def _block(self) -> Symbol:
        """The function of a block; many a function is asked for one sample only."""
        return self._single.map(self._size)

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
        given = list(values.values())
        last = self._last
        if last is not None and last.is_of(given):
            return dict(zip(self._out_shapes, (each.copy() for each in last.outputs), strict=True))
        found = self._computed(n, given)
        self._last = _Call.of(given, found.values()) if self._numbers * n <= _KEPT else None
        return found

    def _computed(self, n: int, given: Sequence[Array]) -> dict[str, Array]:
        """All outputs of n samples.

        Args:
            n: Samples.
            given: Values of the inputs, with the sample axis or without.
        """
        size, function = self._blocks_for(n)
        outputs = {key: np.empty((n, *shape)) for key, shape in self._out_shapes.items()}
        found = list(outputs.values())
        blocks = -(-n // size)
        threads = min(_MOST_THREADS, n // _SAMPLES_A_THREAD)
        # Asking for the cores takes longer than a small call.
        threads = min(threads, os.cpu_count() or 1) if threads > 1 else 1
        if threads == 1:
            self._evaluate(function, size, given, found, range(0, n, size))
        else:
            bounds = [blocks * k // threads * size for k in range(threads + 1)]
            with ThreadPoolExecutor(threads) as pool:
                shares = [
                    pool.submit(
                        self._evaluate, function, size, given, found, range(first, last, size)
                    )
                    for first, last in pairwise(bounds)
                ]
            for share in shares:
                share.result()  # raises what went wrong there
        return outputs

    def _evaluate(
        self,
        function: Symbol,
        size: int,
        values: Sequence[Array],
        outputs: Sequence[Array],
        begins: range,
    ) -> None:
        """Fill some blocks of the outputs, of ``size`` samples each.

        Args:
            function: Of a block.
            size: Its samples.
            values: Of the inputs, with the sample axis or without.
            outputs: To be filled.
            begins: Where the blocks begin.
        """
        # One that nobody else works with: taking it from a list is a single step.
        idle = self._idle.setdefault(size, [])
        try:
            block = idle.pop()
        except IndexError:
            block = _BlockMemory.of(
                function, size, self._in_shapes.values(), self._out_shapes.values()
            )
        varying = [
            (own, value)
            for own, value in zip(block.inputs, values, strict=True)
            if value.ndim == own.ndim
        ]
        for own, value in zip(block.inputs, values, strict=True):
            if value.ndim != own.ndim:
                own[...] = value
        for begin in begins:
            # Whole blocks, so that the last one needs no function of its own.
            for own, value in varying:
                part = value[begin : begin + size]
                own[: len(part)] = part
                own[len(part) :] = part[-1]
            block.evaluate()
            for own, output in zip(block.outputs, outputs, strict=True):
                part = output[begin : begin + size]
                part[...] = own[: len(part)]
        idle.append(block)


@dataclass(frozen=True, eq=False)
class _Call:
    """What a function was asked last, and what it said."""

    inputs: tuple[Array, ...]
    outputs: tuple[Array, ...]

    @classmethod
    def of(cls, inputs: Iterable[Array], outputs: Iterable[Array]) -> _Call:
        """Copies of both, which nobody changes."""
        return cls(tuple(np.array(i) for i in inputs), tuple(np.array(o) for o in outputs))

    def is_of(self, inputs: Sequence[Array]) -> bool:
        """Whether it was asked the same."""
        return all(map(np.array_equal, self.inputs, inputs))


@dataclass(frozen=True, eq=False)
class _BlockMemory:
    """Memory for the samples of one block, and the function that reads and fills it."""

    inputs: tuple[Array, ...]
    """Samples on axis 0."""
    outputs: tuple[Array, ...]
    evaluate: Callable[[], None]
    buffer: Any
    """CasADi's, which knows where all of these stand."""

    @classmethod
    def of(
        cls,
        function: Symbol,
        size: int,
        in_shapes: Iterable[tuple[int, ...]],
        out_shapes: Iterable[tuple[int, ...]],
    ) -> _BlockMemory:
        """For so many samples."""
        inputs = tuple(np.zeros((size, *shape)) for shape in in_shapes)
        outputs = tuple(np.zeros((size, *shape)) for shape in out_shapes)
        buffer: Any
        buffer, evaluate = function.buffer()
        for i, array in enumerate(inputs):
            buffer.set_arg(i, array.data)
        for i, array in enumerate(outputs):
            buffer.set_res(i, array.data)
        return cls(inputs, outputs, evaluate, buffer)


def _shape(symbol: Symbol) -> tuple[int, ...]:
    rows, columns = symbol.shape
    return (rows,) if columns == 1 else (rows, columns)
