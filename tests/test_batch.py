import pickle

import casadi as ca
import numpy as np
import pytest

from steelyard.batch import Batched, jacobians

ROUNDING = 1e-13  # a few additions and products of numbers near one


def products() -> Batched:
    A, v, k = ca.SX.sym("A", 2, 3), ca.SX.sym("v", 3), ca.SX.sym("k")
    return Batched(
        "products",
        {"A": A, "v": v, "k": k},
        {"Av": A @ v, "kA": k * A, "row": v.T, "norm": ca.norm_2(v)},
    )


def numbers(n: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(n)
    return {
        "A": rng.normal(size=(n, 2, 3)),
        "v": rng.normal(size=(n, 3)),
        "k": rng.normal(size=(n, 1)),
    }


@pytest.mark.parametrize("n", [1, 2, 255, 256, 257, 600])
def test_equals_numpy_sample_by_sample(n):
    given = numbers(n)
    A, v, k = given.values()
    result = products()(**given)
    np.testing.assert_allclose(
        result["Av"], np.einsum("nij,nj->ni", A, v), rtol=ROUNDING, atol=ROUNDING
    )
    np.testing.assert_allclose(result["kA"], k[:, :, None] * A, rtol=ROUNDING)
    np.testing.assert_array_equal(result["row"], v[:, None, :])
    np.testing.assert_allclose(result["norm"], np.linalg.norm(v, axis=1)[:, None], rtol=ROUNDING)


@pytest.mark.parametrize("cores", [1, 2, 3, None])
def test_threads_change_nothing(cores, monkeypatch):
    given, whole = numbers(20_001), products()
    pieces = [
        whole(**{key: value[a : a + 500] for key, value in given.items()})
        for a in range(0, 20_001, 500)
    ]
    monkeypatch.setattr("os.cpu_count", lambda: cores)
    for key, values in whole(**given).items():
        np.testing.assert_array_equal(values, np.concatenate([piece[key] for piece in pieces]))


@pytest.mark.parametrize("constant", ["A", "v", "k"])
def test_an_input_without_sample_axis_is_the_same_for_all_samples(constant):
    given = numbers(300)
    repeated = given | {constant: np.repeat(given[constant][:1], 300, axis=0)}
    once = given | {constant: given[constant][0]}
    for key, values in products()(**repeated).items():
        np.testing.assert_array_equal(products()(**once)[key], values)


def test_only_constants_make_one_sample():
    result = products()(A=np.ones((2, 3)), v=np.arange(3.0), k=np.array([2.0]))
    assert result["Av"].shape == (1, 2)
    np.testing.assert_array_equal(result["Av"], [[3.0, 3.0]])


def test_no_samples_give_no_results():
    result = products()(**numbers(0))
    assert {key: value.shape for key, value in result.items()} == {
        "Av": (0, 2), "kA": (0, 2, 3), "row": (0, 1, 3), "norm": (0, 1)
    }  # fmt: skip


def test_matrices_that_are_not_stored_row_by_row_are_read_right():
    given = numbers(40)
    turned = {key: np.asfortranarray(value) for key, value in given.items()}
    sliced = {key: np.repeat(value, 2, axis=0)[::2] for key, value in given.items()}
    for key, values in products()(**given).items():
        np.testing.assert_array_equal(products()(**turned)[key], values)
        np.testing.assert_array_equal(products()(**sliced)[key], values)


def test_integers_and_lists_are_numbers_too():
    result = products()(A=[[1, 2, 3], [4, 5, 6]], v=[[1, 0, 0], [0, 1, 0]], k=[3])
    np.testing.assert_array_equal(result["Av"], [[1, 4], [2, 5]])


def test_structurally_zero_entries_of_an_output_are_zeros():
    x = ca.SX.sym("x")
    result = Batched("sparse", {"x": x}, {"D": ca.diag(ca.vertcat(x, 2 * x))})(x=[[1.0], [2.0]])
    np.testing.assert_array_equal(result["D"], [np.diag([1.0, 2.0]), np.diag([2.0, 4.0])])


def test_inputs_stay_as_they_are_and_outputs_are_ones_own():
    given = numbers(10)
    before = {key: value.copy() for key, value in given.items()}
    first = products()
    one = first(**given)
    kept = one["kA"].copy()
    first(**numbers(11))
    np.testing.assert_array_equal(one["kA"], kept)
    for key, value in given.items():
        np.testing.assert_array_equal(value, before[key])


@pytest.mark.parametrize("n", [1, 12, 300])
def test_a_call_remembers_nothing_of_those_before(n):
    given, used = numbers(n), products()
    fresh = used(**given)
    constant = {key: value[0] for key, value in numbers(5).items()}
    used(**constant)
    used(**numbers(290))
    with pytest.raises(ValueError):
        used(**numbers(n) | {"v": np.zeros((n, 2))})
    used(**numbers(n - 1) if n > 1 else constant)
    for key, values in used(**given).items():
        np.testing.assert_array_equal(values, fresh[key])


def test_the_function_of_one_sample_takes_and_gives_matrices_row_by_row():
    A, v, k = (value[0] for value in numbers(1).values())
    kA = products().function(A.ravel(), v, k)[1]
    np.testing.assert_allclose(np.array(kA).ravel(), (k * A).ravel(), rtol=ROUNDING)


def test_mx_symbols_work_like_sx_symbols():
    A = ca.MX.sym("A", 2, 3)
    given = numbers(5)["A"]
    np.testing.assert_array_equal(
        Batched("t", {"A": A}, {"T": A.T})(A=given)["T"], given.transpose(0, 2, 1)
    )


def test_unequal_numbers_of_samples_are_refused():
    given = numbers(4) | {"v": np.zeros((5, 3))}
    with pytest.raises(ValueError, match=r"expected equal numbers of samples, found \[4, 5\]"):
        products()(**given)


def test_a_wrong_shape_is_refused():
    with pytest.raises(ValueError):
        products()(**numbers(4) | {"v": np.zeros((4, 2))})


def test_another_process_computes_the_same():
    function, given = products(), numbers(300)
    here = function(**given)
    there = pickle.loads(pickle.dumps(function))(**given)
    for name, value in here.items():
        np.testing.assert_array_equal(there[name], value)


def test_derivatives_by_several_columns_are_central_differences():
    x, y, unused = ca.SX.sym("x", 3), ca.SX.sym("y", 2), ca.SX.sym("unused", 4)
    shared = ca.sin(ca.dot(x, x) * y[0])
    column = ca.vertcat(shared * x, y[1] / (1 + shared**2))
    found = jacobians(column, {"by_x": x, "by_y": y, "by_unused": unused})
    assert found["by_unused"].shape == (4, 4)
    assert found["by_unused"].nnz() == 0
    value = ca.Function("value", [x, y], [column])
    derivative = ca.Function("derivative", [x, y], [found["by_x"], found["by_y"]])
    at, step = np.array([0.3, -0.7, 0.5, 0.9, -0.4]), 1e-6
    differences = [
        np.array(value(*np.split(at + d, [3])) - value(*np.split(at - d, [3]))) / (2 * step)
        for d in step * np.eye(5)
    ]
    np.testing.assert_allclose(
        np.hstack([np.array(each) for each in derivative(*np.split(at, [3]))]),
        np.hstack(differences),
        atol=1e-9,
    )
