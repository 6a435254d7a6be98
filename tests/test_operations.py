"""Operations by the machine against CasADi's own evaluation."""

import pickle
from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import numpy as np
import pytest
from llvmlite import binding

from steelyard import operations as operations_module
from steelyard.batch import Batched
from steelyard.machine import KNOWN, ROW, WIDTH, machine
from steelyard.operations import Operations

ROUNDING = 4 * np.finfo(float).eps
ALONE = {
    "negative": lambda x: -x,
    "reciprocal": lambda x: 1 / x,
    "square": lambda x: x * x,
    "twice": lambda x: 2 * x,
    "sqrt": ca.sqrt,
    "exp": ca.exp,
    "log": ca.log,
    "constant power": lambda x: x**2.5,
    "sin": ca.sin,
    "cos": ca.cos,
    "tan": ca.tan,
    "asin": ca.asin,
    "acos": ca.acos,
    "atan": ca.atan,
    "sinh": ca.sinh,
    "cosh": ca.cosh,
    "tanh": ca.tanh,
    "asinh": ca.asinh,
    "acosh": ca.acosh,
    "atanh": ca.atanh,
    "absolute": ca.fabs,
    "sign": ca.sign,
    "floor": ca.floor,
    "ceil": ca.ceil,
    "not": lambda x: ca.logic_not(x > 0.5),
}
OF_TWO = {
    "sum": lambda x, y: x + y,
    "difference": lambda x, y: x - y,
    "product": lambda x, y: x * y,
    "quotient": lambda x, y: x / y,
    "power": lambda x, y: x**y,
    "atan2": ca.atan2,
    "smaller": ca.fmin,
    "larger": ca.fmax,
    "less": lambda x, y: x < y,
    "less or equal": lambda x, y: x <= y,
    "equal": lambda x, y: ca.eq(x, y),
    "unequal": lambda x, y: ca.ne(x, y),
    "and": lambda x, y: ca.logic_and(x > 0, y > 0),
    "or": lambda x, y: ca.logic_or(x > 0, y > 0),
    "if": lambda x, y: ca.if_else(x > 0, y, x),
    "if not": lambda x, y: ca.if_else(x > 0, 1 / x, 1 / y),
}
NUMBERS = np.array([-2.0, -1.0, -0.3, -0.0, 0.0, 0.2, 1.0, 3.7, np.inf, -np.inf, np.nan])


def carried_out(operations, *inputs):
    """All outputs, shape (n, k) each."""
    n = max(len(each) for each in inputs if each.ndim > 1)
    found = [np.full((n, k), 7.0) for k in operations.outputs]
    operations(inputs, found)
    return found


@pytest.mark.parametrize("name", ALONE)
def test_each_operation_is_casadis(name):
    x = ca.SX.sym("x")
    function = ca.Function("f", [x], [ALONE[name](x)])
    (found,) = carried_out(Operations.of(function), NUMBERS[:, None])
    expected = np.array(function(NUMBERS)).ravel()
    np.testing.assert_allclose(found[:, 0], expected, rtol=ROUNDING, atol=0)


@pytest.mark.parametrize("name", OF_TWO)
def test_each_operation_of_two_is_casadis(name):
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    function = ca.Function("f", [x, y], [OF_TWO[name](x, y)])
    pairs = np.array(np.meshgrid(NUMBERS, NUMBERS)).reshape(2, -1)
    (found,) = carried_out(Operations.of(function), *pairs[:, :, None])
    expected = np.array(function(*pairs)).ravel()
    np.testing.assert_allclose(found[:, 0], expected, rtol=ROUNDING, atol=0)


def test_every_operation_is_tested():
    codes = set()
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    for function in ALONE.values():
        codes |= codes_of(ca.Function("f", [x], [function(x)]))
    for function in OF_TWO.values():
        codes |= codes_of(ca.Function("f", [x, y], [function(x, y)]))
    # Copies are of no expression: CasADi leaves them out.
    assert set(KNOWN) - codes <= {ca.OP_ASSIGN}


def codes_of(function):
    return {function.instruction_id(k) for k in range(function.n_instructions())}


def long_expression():
    """One that uses its places again and again, with a number that is no input."""
    x, A = ca.SX.sym("x", 3), ca.SX.sym("A", 9)
    y = x
    for _ in range(12):
        y = ca.sin(ca.reshape(A, 3, 3) @ y) + 0.25 * ca.if_else(y > 0, y, -2 * y)
    return ca.Function("f", [x, A], [y, ca.vertcat(ca.sumsqr(y), 3.0, x[1])])


@pytest.mark.parametrize("n", [1, 2, ROW - 1, ROW, ROW + 1, 2500])
@pytest.mark.parametrize("constant", [False, True])
def test_a_long_expression_is_casadis(n, constant):
    function, rng = long_expression(), np.random.default_rng(n)
    x, A = rng.normal(size=(n, 3)), rng.normal(size=(n, 9))
    if constant:
        A = A[0]
    found = carried_out(Operations.of(function), x, A)
    every = np.broadcast_to(A, (n, 9))
    expected = [np.array(each).T for each in function(x.T, every.T)]
    for own, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(own, other, rtol=1e-12, atol=1e-12)


def test_a_call_remembers_nothing_of_those_before():
    function, rng = long_expression(), np.random.default_rng(5)
    used = Operations.of(function)
    x, A = rng.normal(size=(1500, 3)), rng.normal(size=(1500, 9))
    fresh = carried_out(Operations.of(function), x, A)
    for n in (1500, 40, 1500):
        carried_out(used, rng.normal(size=(n, 3)), rng.normal(size=9))
    for own, other in zip(carried_out(used, x, A), fresh, strict=True):
        np.testing.assert_array_equal(own, other)


def test_threads_and_processes_compute_the_same():
    operations, rng = Operations.of(long_expression()), np.random.default_rng(6)
    given = [(rng.normal(size=(3000, 3)), rng.normal(size=(3000, 9))) for _ in range(6)]
    alone = [carried_out(operations, *each) for each in given]
    with ThreadPoolExecutor(3) as pool:
        together = list(pool.map(lambda each: carried_out(operations, *each), given))
    elsewhere = pickle.loads(pickle.dumps(operations))
    for one, other, each in zip(alone, together, given, strict=True):
        for own, *others in zip(one, other, carried_out(elsewhere, *each), strict=True):
            for found in others:
                np.testing.assert_array_equal(found, own)


def test_what_the_machine_does_not_know_is_left_to_casadi():
    x = ca.SX.sym("x")
    assert Operations.of(ca.Function("f", [x], [ca.erf(x)])) is None
    m = ca.MX.sym("m")
    assert Operations.of(ca.Function("f", [m], [m + 1])) is None


def test_a_wrong_shape_is_refused():
    operations = Operations.of(long_expression())
    with pytest.raises(ValueError):
        carried_out(operations, np.zeros((5, 2)), np.zeros((5, 9)))


def test_without_a_machine_casadi_computes_the_same(monkeypatch):
    x, A = ca.SX.sym("x", 3), ca.SX.sym("A", 3, 3)
    given = {"x": np.arange(3 * 2000.0).reshape(-1, 3) / 999, "A": np.eye(3) / 7}
    expressions = {"y": ca.sin(A @ x) + ca.sqrt(ca.sumsqr(x)), "z": A @ A}

    def found():
        return Batched("f", {"x": x, "A": A}, expressions)(**given)

    compiled = found()
    monkeypatch.setattr(operations_module, "machine", lambda: None)
    for name, each in found().items():
        np.testing.assert_array_equal(each, compiled[name])


def test_a_system_that_forbids_compiled_code_has_no_machine(monkeypatch):
    def forbidden():
        raise OSError("not permitted")

    monkeypatch.setattr(binding, "check_jit_execution", forbidden)
    assert machine.__wrapped__() is None


@pytest.mark.parametrize("samples", [0, 1, 7, 8, 9, 127, 128])
def test_the_machine_fills_the_columns_that_count(samples):
    run = machine()
    rows = np.full((3, ROW), 7.0)
    rows[0] = np.arange(ROW)
    # The second operation works on the row that it reads.
    run(np.array([[ca.OP_ADD, 2, 0, 1], [ca.OP_MUL, 2, 2, 2]], dtype=np.int32), rows, samples)
    computed = -(-samples // WIDTH) * WIDTH
    np.testing.assert_array_equal(rows[2, :computed], (np.arange(computed) + 7.0) ** 2)
    np.testing.assert_array_equal(rows[2, computed:], 7.0)


def test_a_list_without_operations_changes_nothing():
    rows = np.ones((2, ROW))
    machine()(np.zeros((0, 4), dtype=np.int32), rows, ROW)
    np.testing.assert_array_equal(rows, 1.0)
