"""Dialects of text files, written by Python's own csv module and read back."""

import csv
import io

import pytest

from steelyard.logs.text.dialect import dialect_of, split

ROWS = [[f"{0.5 * i + j:.2f}" for j in range(3)] for i in range(30)]


def written(separator, *, decimal=".", header=(), quoting=csv.QUOTE_MINIMAL):
    out = io.StringIO()
    writer = csv.writer(out, delimiter=separator, quoting=quoting, lineterminator="\n")
    writer.writerows(header)
    writer.writerows([[cell.replace(".", decimal) for cell in row] for row in ROWS])
    return out.getvalue().splitlines()


@pytest.mark.parametrize("separator", [",", ";", "\t", "|", " "])
@pytest.mark.parametrize("quoting", [csv.QUOTE_MINIMAL, csv.QUOTE_ALL])
def test_separators(separator, quoting):
    found = dialect_of(written(separator, header=[["t", "x", "y"]], quoting=quoting))
    assert (found.separator, found.decimal, found.width, found.first) == (separator, ".", 3, 1)
    assert [list(row) for row in found.rows[:2]] == ROWS[:2]


@pytest.mark.parametrize("separator", [";", "\t", "|"])
def test_a_comma_as_decimal_mark(separator):
    found = dialect_of(written(separator, decimal=",", header=[["t", "x", "y"], ["s", "m", "m"]]))
    assert (found.separator, found.decimal, found.width, found.first) == (separator, ",", 3, 2)


def test_empty_lines_and_a_declared_separator():
    assert dialect_of(["", " ", *written(",")]).blank == 2
    found = dialect_of(["sep=;", *written(";")])
    assert (found.separator, found.width) == (";", 3)


def test_columns_of_instants():
    lines = [f"2024-03-01 12:00:{i:02d},{i}.5" for i in range(20)]
    found = dialect_of(lines)
    assert found.is_dated(0)
    assert not found.is_dated(1)


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_cells_are_those_of_csv(separator):
    line = separator.join(['"a, ""b"" c"', " 1 ", "", "x"])
    (expected,) = csv.reader([line], delimiter=separator)
    assert split(line, separator) == [cell.strip() for cell in expected]
