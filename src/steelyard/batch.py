"""CasADi expressions evaluated over all samples at once.

The physics is written once, symbolically. This module turns an expression into a function of NumPy
arrays with time on axis 0. Samples go through it one operation after the other
(:mod:`.operations`) once there have been enough of them to make a list of these worth while, before
that and alone sample by sample: through CasADi's buffer interface in blocks, whose memory stays
with the function from call to call, since to say anew where these stand would take longer than to
compute them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array
from steelyard.operations import Operations

Symbol: TypeAlias = Any
"""A CasADi SX or MX expression (the library ships no types)."""

_BLOCK = 16
"""Samples a call of CasADi: the last block computes less in vain than a large one."""
_MANY = 16
"""Samples from which on :mod:`.operations` are faster, whatever the expression."""
_WORTH = 1000
"""Samples, over all calls of so many, after which a list of operations has saved what it took to
make."""
_KEPT = 1 << 19
"""Numbers of the last call that are remembered, at most: fit, verdict and conclusion look at one
state in turn."""


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
        self._idle: dict[int, list[_BlockMemory]] = {}
        self._many = 0
        self._last: _Call | None = None
        shapes = (*self._in_shapes.values(), *self._out_shapes.values())
        self._numbers = sum(math.prod(shape) for shape in shapes)

    def __getstate__(self) -> dict[str, Any]:
        """What another process needs: memory stays here."""
        return {**self.__dict__, "_idle": {}, "_last": None}

    @cached_property
    def _block(self) -> Symbol:
        """The function of a block; many a function is asked for one sample only."""
        return self._single.map(_BLOCK)

    @cached_property
    def _operations(self) -> Operations | None:
        """One after the other; None: these are not known."""
        return Operations.of(self._single)

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
        outputs = {key: np.empty((n, *shape)) for key, shape in self._out_shapes.items()}
        self._many += n if n >= _MANY else 0
        if n >= _MANY and self._many >= _WORTH and self._operations is not None:
            inputs = [
                value.reshape(n, -1) if value.ndim > len(shape) else value.ravel()
                for value, shape in zip(given, self._in_shapes.values(), strict=True)
            ]
            self._operations(inputs, [each.reshape(n, -1) for each in outputs.values()])
        elif n == 1:
            self._evaluate(self._single, 1, given, list(outputs.values()))
        else:
            self._evaluate(self._block, _BLOCK, given, list(outputs.values()))
        return outputs

    def _evaluate(
        self,
        function: Symbol,
        size: int,
        values: Sequence[Array],
        outputs: Sequence[Array],
    ) -> None:
        """Fill the outputs, block by block.

        Args:
            function: Of a block.
            size: Its samples.
            values: Of the inputs, with the sample axis or without.
            outputs: To be filled.
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
        for begin in range(0, len(outputs[0]), size):
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
