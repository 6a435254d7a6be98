"""A CasADi function carried out by NumPy: one operation after the other, on many samples at once.

CasADi goes through all operations for one sample before it turns to the next one, at some nanoseconds
each. NumPy takes half a microsecond to begin an operation, and a fraction of a nanosecond a sample from
there on. Operations and their order are the same, and so is what they give.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, TypeAlias

import casadi as ca
import numpy as np

from steelyard.arrays import Array

Step: TypeAlias = tuple[Callable[..., Any], tuple[Array, ...]]
"""A function and what it is called with; the last one is written to."""

_AT_ONCE = 1024
"""Samples: with more, what has been computed no longer fits into the cache of a core."""


class _Operation(NamedTuple):
    """One of a function, on numbered places for intermediate results."""

    code: int
    result: int
    """Place; of an output its number."""
    operands: tuple[int, ...]
    """Places; of an input its number and that of the entry, of an output the entry and the place."""
    value: float
    """Of a constant."""


def _twice(of: Array, result: Array) -> None:
    np.add(of, of, out=result)


def _if_else_zero(condition: Array, value: Array, result: Array) -> None:
    # The result may stand where one of the others does.
    result[...] = np.where(condition != 0, value, 0.0)


_FUNCTIONS: dict[int, Callable[..., Any]] = {
    ca.OP_ASSIGN: np.positive,
    ca.OP_ADD: np.add,
    ca.OP_SUB: np.subtract,
    ca.OP_MUL: np.multiply,
    ca.OP_DIV: np.divide,
    ca.OP_NEG: np.negative,
    ca.OP_INV: np.reciprocal,
    ca.OP_SQ: np.square,
    ca.OP_TWICE: _twice,
    ca.OP_SQRT: np.sqrt,
    ca.OP_EXP: np.exp,
    ca.OP_LOG: np.log,
    ca.OP_POW: np.power,
    ca.OP_CONSTPOW: np.power,
    ca.OP_SIN: np.sin,
    ca.OP_COS: np.cos,
    ca.OP_TAN: np.tan,
    ca.OP_ASIN: np.arcsin,
    ca.OP_ACOS: np.arccos,
    ca.OP_ATAN: np.arctan,
    ca.OP_ATAN2: np.arctan2,
    ca.OP_SINH: np.sinh,
    ca.OP_COSH: np.cosh,
    ca.OP_TANH: np.tanh,
    ca.OP_ASINH: np.arcsinh,
    ca.OP_ACOSH: np.arccosh,
    ca.OP_ATANH: np.arctanh,
    ca.OP_FABS: np.fabs,
    ca.OP_SIGN: np.sign,
    ca.OP_FMIN: np.fmin,
    ca.OP_FMAX: np.fmax,
    ca.OP_FLOOR: np.floor,
    ca.OP_CEIL: np.ceil,
    ca.OP_LT: np.less,
    ca.OP_LE: np.less_equal,
    ca.OP_EQ: np.equal,
    ca.OP_NE: np.not_equal,
    ca.OP_NOT: np.logical_not,
    ca.OP_AND: np.logical_and,
    ca.OP_OR: np.logical_or,
    ca.OP_IF_ELSE_ZERO: _if_else_zero,
}
"""What carries an operation out: takes its operands, and where the result goes last."""


@dataclass(frozen=True, eq=False)
class Operations:
    """The operations of a function of one sample."""

    operations: tuple[_Operation, ...]
    places: int
    """For intermediate results."""
    inputs: tuple[int, ...]
    """Entries of each."""
    outputs: tuple[int, ...]
    """Entries of each."""

    @classmethod
    def of(cls, function: Any) -> Operations | None:
        """Of a CasADi function of dense inputs and outputs; None where it does anything else than the
        operations that NumPy knows.
        """
        if not function.is_a("SXFunction"):
            return None
        found = []
        for k in range(function.n_instructions()):
            code = function.instruction_id(k)
            written, read = function.instruction_output(k), tuple(function.instruction_input(k))
            if code == ca.OP_OUTPUT:
                found.append(_Operation(code, written[0], (written[1], *read), 0.0))
                continue
            if code not in (ca.OP_CONST, ca.OP_INPUT) and code not in _FUNCTIONS:
                return None
            value = function.instruction_constant(k) if code == ca.OP_CONST else 0.0
            found.append(_Operation(code, written[0], read, value))
        return cls(
            tuple(found),
            function.sz_w(),
            tuple(function.numel_in(i) for i in range(function.n_in())),
            tuple(function.numel_out(i) for i in range(function.n_out())),
        )

    @cached_property
    def _idle(self) -> list[_Memory]:
        """Memory that nobody works with: taking one from a list is a single step."""
        return []

    def __getstate__(self) -> dict[str, Any]:
        """What another process needs: memory stays here."""
        return {key: value for key, value in self.__dict__.items() if key != "_idle"}

    def __call__(self, inputs: Sequence[Array], outputs: Sequence[Array]) -> None:
        """Carry them out.

        Args:
            inputs: Entries of each, shape (n, k), or (k,) where it is the same for all samples.
            outputs: To be filled, shape (n, k) each.
        """
        n = len(outputs[0])
        size = math.ceil(n / max(math.ceil(n / _AT_ONCE), 1))
        try:
            memory = self._idle.pop()
        except IndexError:
            memory = None
        if memory is None or memory.size != size:
            memory = _Memory.of(self, size)
        for own, value in zip(memory.inputs, inputs, strict=True):
            if value.ndim == 1:
                own[...] = value[:, None]
        with np.errstate(all="ignore"):
            for begin in range(0, n, max(size, 1)):
                # The last block may be shorter: what stands there from before is computed in vain.
                many = min(size, n - begin)
                for own, value in zip(memory.inputs, inputs, strict=True):
                    if value.ndim > 1:
                        own[:, :many] = value[begin : begin + many].T
                for function, arguments in memory.steps:
                    function(*arguments)
                for own, output in zip(memory.outputs, outputs, strict=True):
                    output[begin : begin + many] = own[:, :many].T
        self._idle.append(memory)


@dataclass(frozen=True, eq=False)
class _Memory:
    """Numbers of all samples of a block, and what is done to them."""

    size: int
    """Samples."""
    inputs: tuple[Array, ...]
    """Shape (k, size) each."""
    outputs: tuple[Array, ...]
    steps: tuple[Step, ...]

    @classmethod
    def of(cls, operations: Operations, size: int) -> _Memory:
        """For so many samples."""
        inputs = tuple(np.zeros((k, size)) for k in operations.inputs)
        outputs = tuple(np.zeros((k, size)) for k in operations.outputs)
        own = list(np.zeros((operations.places, size)))
        constants: dict[float, Array] = {}
        # What a place holds: inputs and constants are read where they are.
        held = list(own)
        steps: list[Step] = []
        for code, result, operands, value in operations.operations:
            if code == ca.OP_INPUT:
                held[result] = inputs[operands[0]][operands[1]]
            elif code == ca.OP_CONST:
                if value not in constants:
                    constants[value] = np.full(size, value)
                held[result] = constants[value]
            elif code == ca.OP_OUTPUT:
                entry, place = operands
                steps.append((np.positive, (held[place], outputs[result][entry])))
            else:
                read = tuple(held[each] for each in operands)
                held[result] = own[result]
                steps.append((_FUNCTIONS[code], (*read, own[result])))
        return cls(size, inputs, outputs, tuple(steps))
