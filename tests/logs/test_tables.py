"""Columns side by side, logs over them, and trees of arrays, against NumPy."""

import numpy as np
import pytest

from steelyard.errors import InputError
from steelyard.logs.arrays.nested import Arrays, Source, with_rows_first
from steelyard.logs.log import Log, NoRowsError, RowRange
from steelyard.logs.table import table_of

COLUMNS = {"t": np.arange(4.0), "x": np.array([1.0, np.nan, 3.0, 4.0]), "y": np.ones(4)}


def log(columns, path="a.csv"):
    def load(names, part, rows):
        use = slice(rows)
        if part is not None:
            inside = (columns[part.column] >= part.start) & (columns[part.column] <= part.end)
            use = np.flatnonzero(inside)[:rows]
        return {name: columns[name][use] for name in names}

    return Log(path, tuple(columns), load)


def test_a_table_is_its_columns():
    table = table_of(COLUMNS)
    assert list(table) == ["t", "x", "y"]
    for name, values in COLUMNS.items():
        np.testing.assert_array_equal(table[name], values)


def test_neighbours_side_by_side_are_a_view_and_others_a_copy():
    table = table_of(COLUMNS)
    np.testing.assert_array_equal(
        table.beside(["x", "y"]), np.column_stack([table["x"], table["y"]])
    )
    assert np.shares_memory(table.beside(["t", "x"]), table.cells)
    swapped = table.beside(["y", "t"])
    np.testing.assert_array_equal(swapped, np.column_stack([table["y"], table["t"]]))
    assert not np.shares_memory(swapped, table.cells)


def test_a_part_of_the_rows():
    part = RowRange("t", 0.5, 2.5)
    np.testing.assert_array_equal(log(COLUMNS).read(["y", "t"], part)["t"], [1, 2])
    np.testing.assert_array_equal(log(COLUMNS).read(["t"], None, 3)["t"], [0, 1, 2])
    with pytest.raises(NoRowsError, match="rows with 't' between 7 and 8, found none"):
        log(COLUMNS).read(["t"], RowRange("t", 7, 8))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ([], "expected rows of numbers, found none"),
        ([np.nan, np.nan], "column 'x': expected numbers, found not a single one"),
        ([1, np.inf], "row 2: column 'x': expected a finite number, found infinity"),
        ([1, 2, -1e31], "row 3: column 'x': expected a number that a sensor can read, found -1e"),
    ],
)
def test_what_no_sensor_reads_is_refused_with_its_row(values, message):
    with pytest.raises(InputError, match=message):
        log({"x": np.array(values, dtype=float)}).read(["x"])


def test_a_name_twice_is_no_name():
    twice = Log("a.csv", ("x", "x"), lambda *_: {})
    with pytest.raises(InputError, match="found 'x' twice"):
        twice.read(["x"])


def source(values):
    array = np.asarray(values)
    return Source(array.shape, array.dtype, lambda: array)


def test_elements_of_arrays_are_columns(tmp_path):
    force, pose = np.arange(6.0).reshape(3, 2), np.arange(12.0).reshape(3, 2, 2)
    tree = {("run", "force"): source(force), ("run", "pose"): source(pose)}
    found = Arrays(tmp_path, tree).log(None)
    assert set(found.names) == {"force[0]", "force[1]"} | {
        f"pose[{i}][{j}]" for i in range(2) for j in range(2)
    }
    table = found.read(["force[1]", "pose[1][0]"])
    np.testing.assert_array_equal(table["force[1]"], force[:, 1])
    np.testing.assert_array_equal(table["pose[1][0]"], pose[:, 1, 0])


def test_one_of_several_groups_is_named(tmp_path):
    tree = {("a", "x"): source(np.ones(3)), ("b", "x"): source(np.zeros(3))}
    with pytest.raises(InputError, match="found a, b"):
        Arrays(tmp_path, tree).log(None)
    assert Arrays(tmp_path, tree).log("b").read(["x"])["x"].sum() == 0


def test_a_row_vector_is_a_column():
    row = np.arange(5.0)[None]
    turned = with_rows_first(row.shape, row.dtype, lambda: row)
    assert turned.shape == (5,)
    np.testing.assert_array_equal(turned.open()[1:3], [1, 2])


def test_images_are_left_out_by_name(tmp_path):
    with pytest.raises(InputError, match="left out: camera: more than 1000 numbers at an instant"):
        Arrays(tmp_path, {("camera",): source(np.ones((2, 40, 40)))}).log(None)
