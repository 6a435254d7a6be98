"""A small machine in compiled code that carries out lists of operations on many samples.

Numbers stand in rows, one row for each intermediate result, one column for each sample. An
operation takes one or two rows and fills another one, :data:`WIDTH` samples in one instruction of
the processor. LLVM compiles the machine, not the lists, in some tens of milliseconds; a list of
operations is data to it. Operations are those of CasADi, in the order of the list, and are not
rearranged: what they give does not depend on how many samples there are.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable
from functools import cache
from typing import Any, TypeAlias

import casadi as ca
import numpy as np
from llvmlite import binding, ir
from numpy.typing import NDArray

from steelyard.arrays import Array

Value: TypeAlias = Any
"""A value of LLVM's intermediate language (the library ships no types)."""
Emitted: TypeAlias = Callable[[ir.IRBuilder, Value, Value], Value]
"""Adds the instructions of an operation on two vectors (the second is the first where it has one
operand), and says where its result is."""

WIDTH = 8
"""Samples in a vector: what the processor does not take at once, LLVM takes apart."""
ROW = 128
"""Samples in a row: some hundred rows fit into the cache of a core."""

_NUMBER = ir.DoubleType()
_VECTOR = ir.VectorType(_NUMBER, WIDTH)
_INDEX = ir.IntType(64)
_FIELD = ir.IntType(32)
_POINTER = ir.PointerType()
_ALIGNED = 8
"""Bytes, of numbers of NumPy at least."""
_FIELDS = 4
"""Of an operation in a list: code, row of the result, rows of both operands."""


def _constant(value: float) -> Value:
    return ir.Constant(_VECTOR, [ir.Constant(_NUMBER, value)] * WIDTH)


def _truth(builder: ir.IRBuilder, condition: Value) -> Value:
    return builder.uitofp(condition, _VECTOR)


def _is_true(builder: ir.IRBuilder, value: Value) -> Value:
    # As in C: what is no number is not zero.
    return builder.fcmp_unordered("!=", value, _constant(0.0))


def _compared(sign: str) -> Emitted:
    return lambda b, x, y: _truth(b, b.fcmp_ordered(sign, x, y))


def _sign(builder: ir.IRBuilder, x: Value, _: Value) -> Value:
    """Of zero and of what is no number it is that itself."""
    below = builder.fcmp_ordered("<", x, _constant(0.0))
    above = builder.fcmp_ordered(">", x, _constant(0.0))
    positive = builder.select(above, _constant(1.0), x)
    return builder.select(below, _constant(-1.0), positive)


def _intrinsic(name: str, operands: int) -> Emitted:
    """A function that LLVM knows on vectors."""

    def emitted(builder: ir.IRBuilder, x: Value, y: Value) -> Value:
        kind = ir.FunctionType(_VECTOR, [_VECTOR] * operands)
        function = _declared(builder, kind, f"llvm.{name}.v{WIDTH}f64")
        return builder.call(function, [x, y][:operands])

    return emitted


def _library(name: str, operands: int) -> Emitted:
    """A function of C's library, called for every sample."""

    def emitted(builder: ir.IRBuilder, x: Value, y: Value) -> Value:
        function = _declared(builder, ir.FunctionType(_NUMBER, [_NUMBER] * operands), name)
        result = ir.Constant(_VECTOR, ir.Undefined)
        for i in range(WIDTH):
            place = ir.Constant(_INDEX, i)
            own = [builder.extract_element(each, place) for each in [x, y][:operands]]
            result = builder.insert_element(result, builder.call(function, own), place)
        return result

    return emitted


def _declared(builder: ir.IRBuilder, kind: ir.FunctionType, name: str) -> Value:
    known = builder.module.globals.get(name)
    return ir.Function(builder.module, kind, name) if known is None else known


_OF_ONE: dict[int, Emitted] = {
    ca.OP_ASSIGN: lambda b, x, y: x,
    ca.OP_NEG: lambda b, x, y: b.fneg(x),
    ca.OP_INV: lambda b, x, y: b.fdiv(_constant(1.0), x),
    ca.OP_SQ: lambda b, x, y: b.fmul(x, x),
    ca.OP_TWICE: lambda b, x, y: b.fadd(x, x),
    ca.OP_SIGN: _sign,
    ca.OP_NOT: lambda b, x, y: _truth(b, b.fcmp_ordered("==", x, _constant(0.0))),
    ca.OP_SQRT: _intrinsic("sqrt", 1),
    ca.OP_FABS: _intrinsic("fabs", 1),
    ca.OP_FLOOR: _intrinsic("floor", 1),
    ca.OP_CEIL: _intrinsic("ceil", 1),
}
_OF_TWO: dict[int, Emitted] = {
    ca.OP_ADD: lambda b, x, y: b.fadd(x, y),
    ca.OP_SUB: lambda b, x, y: b.fsub(x, y),
    ca.OP_MUL: lambda b, x, y: b.fmul(x, y),
    ca.OP_DIV: lambda b, x, y: b.fdiv(x, y),
    ca.OP_FMIN: _intrinsic("minnum", 2),
    ca.OP_FMAX: _intrinsic("maxnum", 2),
    ca.OP_LT: _compared("<"),
    ca.OP_LE: _compared("<="),
    ca.OP_EQ: _compared("=="),
    ca.OP_NE: lambda b, x, y: _truth(b, b.fcmp_unordered("!=", x, y)),
    ca.OP_AND: lambda b, x, y: _truth(b, b.and_(_is_true(b, x), _is_true(b, y))),
    ca.OP_OR: lambda b, x, y: _truth(b, b.or_(_is_true(b, x), _is_true(b, y))),
    ca.OP_IF_ELSE_ZERO: lambda b, x, y: b.select(_is_true(b, x), y, _constant(0.0)),
}
_LIBRARY_OF_ONE: dict[int, str] = {
    ca.OP_EXP: "exp",
    ca.OP_LOG: "log",
    ca.OP_SIN: "sin",
    ca.OP_COS: "cos",
    ca.OP_TAN: "tan",
    ca.OP_ASIN: "asin",
    ca.OP_ACOS: "acos",
    ca.OP_ATAN: "atan",
    ca.OP_SINH: "sinh",
    ca.OP_COSH: "cosh",
    ca.OP_TANH: "tanh",
    ca.OP_ASINH: "asinh",
    ca.OP_ACOSH: "acosh",
    ca.OP_ATANH: "atanh",
}
_LIBRARY_OF_TWO: dict[int, str] = {
    ca.OP_POW: "pow",
    ca.OP_CONSTPOW: "pow",
    ca.OP_ATAN2: "atan2",
}
_EMITTED: dict[int, tuple[int, Emitted]] = {
    **{code: (1, own) for code, own in _OF_ONE.items()},
    **{code: (2, own) for code, own in _OF_TWO.items()},
    **{code: (1, _library(name, 1)) for code, name in _LIBRARY_OF_ONE.items()},
    **{code: (2, _library(name, 2)) for code, name in _LIBRARY_OF_TWO.items()},
}
"""Code of an operation, as CasADi numbers them -> number of its operands, and what carries it
out."""
KNOWN = frozenset(_EMITTED)
"""Codes of the operations that the machine knows, as CasADi numbers them."""


class Machine:
    """What carries lists of operations out; see :func:`machine`."""

    def __init__(self) -> None:
        binding.initialize_native_target()
        binding.initialize_native_asmprinter()
        binding.check_jit_execution()
        for name, address in _library_functions().items():
            binding.add_symbol(name, address)
        target = binding.Target.from_default_triple().create_target_machine(
            cpu=binding.get_host_cpu_name(),
            features=binding.get_host_cpu_features().flatten(),
            opt=2,
        )
        module = binding.parse_assembly(str(_program()))
        # The compiled code lives as long as this does.
        self._engine = binding.create_mcjit_compiler(module, target)
        self._engine.finalize_object()
        kind = ctypes.CFUNCTYPE(
            None, ctypes.c_void_p, ctypes.c_int64, ctypes.c_void_p, ctypes.c_int64
        )
        self._run = kind(self._engine.get_function_address("run"))

    def __call__(self, operations: NDArray[np.int32], rows: Array, samples: int) -> None:
        """Carry a list of operations out.

        Args:
            operations: Code, row of the result and rows of both operands of each, shape (m, 4); the
                second operand counts for nothing where there is one only.
            rows: Numbers, of which the results are changed, shape (r, :data:`ROW`), contiguous.
            samples: How many columns count, at most :data:`ROW`; up to :data:`WIDTH` - 1 others are
                computed in vain.
        """
        vectors = -(-samples // WIDTH)
        self._run(operations.ctypes.data, len(operations), rows.ctypes.data, vectors)


@cache
def machine() -> Machine | None:
    """The machine of this process; None where none may be compiled, as on systems that let no
    process write code for itself.
    """
    try:
        return Machine()
    except (OSError, RuntimeError):
        return None


def _library_functions() -> dict[str, int]:
    """Name of a function of C's library -> its address."""
    library = ctypes.CDLL("ucrtbase" if os.name == "nt" else None)
    return {
        name: ctypes.cast(getattr(library, name), ctypes.c_void_p).value or 0
        for name in {*_LIBRARY_OF_ONE.values(), *_LIBRARY_OF_TWO.values()}
    }


def _program() -> ir.Module:
    """The machine: for every operation of a list, the loop over vectors of its code."""
    module = ir.Module("machine")
    kind = ir.FunctionType(ir.VoidType(), [_POINTER, _INDEX, _POINTER, _INDEX])
    run = ir.Function(module, kind, "run")
    operations, count, rows, vectors = run.args
    zero, one = ir.Constant(_INDEX, 0), ir.Constant(_INDEX, 1)
    begin, each, after, end = (
        run.append_basic_block(name) for name in ("begin", "each", "after", "end")
    )
    builder = ir.IRBuilder(begin)
    some = builder.icmp_signed("<", zero, builder.mul(count, vectors))
    builder.cbranch(some, each, end)

    builder.position_at_end(each)
    number = builder.phi(_INDEX)
    number.add_incoming(zero, begin)
    place = builder.mul(number, ir.Constant(_INDEX, _FIELDS))
    code, *at = (
        builder.load(
            builder.gep(
                operations, [builder.add(place, ir.Constant(_INDEX, i))], source_etype=_FIELD
            ),
            typ=_FIELD,
        )
        for i in range(_FIELDS)
    )
    starts = [builder.mul(builder.zext(row, _INDEX), ir.Constant(_INDEX, ROW)) for row in at]
    result, first, second = (builder.gep(rows, [own], source_etype=_NUMBER) for own in starts)
    choice = builder.switch(code, after)
    for own, (operands, emitted) in _EMITTED.items():
        loop = run.append_basic_block(f"operation{own}")
        choice.add_case(ir.Constant(_FIELD, own), loop)
        builder.position_at_end(loop)
        vector = builder.phi(_INDEX)
        vector.add_incoming(zero, each)
        x, y = (
            builder.load(
                builder.gep(row, [vector], source_etype=_VECTOR), align=_ALIGNED, typ=_VECTOR
            )
            for row in (first, second if operands > 1 else first)
        )
        found = emitted(builder, x, y)
        builder.store(found, builder.gep(result, [vector], source_etype=_VECTOR), align=_ALIGNED)
        further = builder.add(vector, one)
        vector.add_incoming(further, loop)
        builder.cbranch(builder.icmp_signed("<", further, vectors), loop, after)

    builder.position_at_end(after)
    following = builder.add(number, one)
    number.add_incoming(following, after)
    builder.cbranch(builder.icmp_signed("<", following, count), each, end)
    builder.position_at_end(end)
    builder.ret_void()
    return module
