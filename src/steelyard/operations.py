"""A CasADi function carried out by :mod:`.machine`: one operation after the other, on many samples
at once.

CasADi goes through all operations for one sample before it turns to the next one, at some
nanoseconds each; the machine takes some tens of nanoseconds to begin an operation, and a fraction
of a nanosecond a sample from there on. Operations and their order are the same, and so is what they
give.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.machine import KNOWN, ROW, machine


@dataclass(frozen=True, eq=False)
class Operations:
    """The operations of a function of one sample, on rows of numbers: intermediate results, then
    the entries of the inputs, of the outputs, and constants.
    """

    operations: NDArray[np.int32]
    """Code, row of the result and rows of both operands of each, shape (m, 4)."""
    places: int
    """Rows for intermediate results."""
    inputs: tuple[int, ...]
    """Entries of each."""
    outputs: tuple[int, ...]
    """Entries of each."""
    constants: Array
    """Shape (c,)."""

    @classmethod
    def of(cls, function: Any) -> Operations | None:
        """Of a CasADi function of dense inputs and outputs; None where it does anything else than
        the operations that the machine knows, or where there is no machine.
        """
        if not function.is_a("SXFunction") or machine() is None:
            return None
        places = function.sz_w()
        inputs = tuple(function.numel_in(i) for i in range(function.n_in()))
        outputs = tuple(function.numel_out(i) for i in range(function.n_out()))
        first_of_inputs = np.cumsum([places, *inputs]).tolist()
        first_of_outputs = np.cumsum([first_of_inputs[-1], *outputs]).tolist()
        constants: dict[float, int] = {}
        # What a place holds: inputs and constants are read where they are.
        held = list(range(places))
        found = []
        for k in range(function.n_instructions()):
            code = function.instruction_id(k)
            written, read = function.instruction_output(k), function.instruction_input(k)
            if code == ca.OP_INPUT:
                held[written[0]] = first_of_inputs[read[0]] + read[1]
            elif code == ca.OP_CONST:
                value = function.instruction_constant(k)
                number = constants.setdefault(value, len(constants))
                held[written[0]] = first_of_outputs[-1] + number
            elif code == ca.OP_OUTPUT:
                row = first_of_outputs[written[0]] + written[1]
                found.append((ca.OP_ASSIGN, row, held[read[0]], held[read[0]]))
            elif code in KNOWN:
                found.append((code, written[0], held[read[0]], held[read[-1]]))
                held[written[0]] = written[0]
            else:
                return None
        operations = np.array(found, dtype=np.int32).reshape(-1, 4)
        return cls(operations, places, inputs, outputs, np.array(list(constants)))

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
        run = machine()
        assert run is not None
        try:
            memory = self._idle.pop()
        except IndexError:
            memory = _Memory.of(self)
        varying = []
        for own, value in zip(memory.inputs, inputs, strict=True):
            if value.ndim > 1:
                varying.append((own, value))
            else:
                own[...] = value[:, None]
        n = len(outputs[0])
        # Blocks of one length: the last one of a few samples only would cost as much as a full one.
        size = math.ceil(n / max(math.ceil(n / ROW), 1))
        for begin in range(0, n, max(size, 1)):
            # What stands beside from before is computed in vain.
            many = min(size, n - begin)
            for own, value in varying:
                own[:, :many] = value[begin : begin + many].T
            run(self.operations, memory.rows, many)
            for own, output in zip(memory.outputs, outputs, strict=True):
                output[begin : begin + many] = own[:, :many].T
        self._idle.append(memory)


@dataclass(frozen=True, eq=False)
class _Memory:
    """Numbers of all samples of a block."""

    rows: Array
    """Shape (r, :data:`.ROW`)."""
    inputs: tuple[Array, ...]
    """Rows of each."""
    outputs: tuple[Array, ...]
    """Rows of each."""

    @classmethod
    def of(cls, operations: Operations) -> _Memory:
        """For one call at a time, with the constants."""
        ends = np.cumsum([operations.places, *operations.inputs, *operations.outputs])
        rows = np.zeros((ends[-1] + len(operations.constants), ROW))
        _, *own, constants = np.split(rows, ends)
        constants[...] = operations.constants[:, None]
        many = len(operations.inputs)
        return cls(rows, tuple(own[:many]), tuple(own[many:]))
