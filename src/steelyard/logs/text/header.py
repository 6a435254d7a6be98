"""Names and units of columns, from what stands above the rows of a text file."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from steelyard.errors import InputError
from steelyard.logs.text.cells import is_missing
from steelyard.logs.text.dialect import SEPARATORS, Dialect, split
from steelyard.logs.text.exporters import motive_units, scope_columns
from steelyard.units import is_unit

_COMMENT = re.compile(r"\s*(#|%|//)+\s*")
_NOTHING = re.compile(r"[\s\-=_+|,;]*|\s*sep=.\s*", re.IGNORECASE)
"""Empty lines, rulers, and the separator for spreadsheet programs."""
_UNITS = re.compile(r"(units?|einheit(en)?|y_unit_label)\b( *[:=])?", re.IGNORECASE)
"""How a line begins that states units."""
_BRACKETS = re.compile(r"(?P<name>.*\S)\s*(?:\[(?P<square>[^\[\]]+)\]|\((?P<round>[^()]+)\))")
_QUOTIENT = re.compile(r"(?P<name>.*\S)\s+(?:/|in)\s+(?P<unit>\S+)")
_ENDING = re.compile(r".+_(?P<unit>ms|us|ns|mm|kN|deg|dps|rpm)")
"""Endings of names that are units; those that are as often something else ('x_m', 'x_cm', 't_s',
'a_g') are not here."""


@dataclass(frozen=True)
class Header:
    """What stands above the rows."""

    first: int
    """Lines above the first row."""
    names: tuple[str, ...]
    """Of the columns, without units in brackets; those without are ``[0]``, ``[1]``, … by their
    place."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Column -> unit as the file states it, known or not."""
    spellings: Mapping[str, str] = field(default_factory=dict)
    """Name with its unit, as the file has it -> name of the column."""
    clocks: Mapping[str, str] = field(default_factory=dict)
    """Column -> column with its times, where there are several of these."""


def header_of(path: Path, lines: Sequence[str], dialect: Dialect) -> Header:
    """Read the header of a table.

    Args:
        path: Of the file, for messages.
        lines: Of the file, from its beginning.
        dialect: Of the file.

    Raises:
        InputError: It does not have as many names as the rows have cells.
    """
    lines = lines[dialect.blank : dialect.first]
    above = [dialect.cells(line) for line in lines]
    scope = scope_columns(above, dialect)
    if scope is not None:
        names, units, clocks = scope
        last = max(
            i
            for i, cells in enumerate(above)
            if cells and cells[0] and not dialect.is_value(cells[0])
        )
        return Header(dialect.blank + last + 1, names, units, clocks=clocks)
    first, rows = _names_and_above(path, lines, dialect)
    first += dialect.blank
    below, rows = (
        (rows[0], rows[1:]) if len(rows) > 1 and _are_units(rows[0], rows[1]) else ([], rows)
    )
    width = max([dialect.width, *map(len, rows[:1])])
    called, behind = _names(rows, width)
    stated = [_labelled(lines, dialect), below, behind, motive_units(above, rows[1:], width)]
    units = {}
    for j, name in enumerate(called):
        unit = next((row[j].strip("[]() ") for row in stated if j < len(row) and row[j]), "")
        if unit not in ("", "SI") and not dialect.is_dated(j):
            units[name] = unit
    return Header(
        first, tuple(called), units, dict(zip(rows[0], called, strict=False)) if rows else {}
    )


def _names_and_above(
    path: Path, lines: Sequence[str], dialect: Dialect
) -> tuple[int, list[list[str]]]:
    """How many of some lines stand above the first row, and the cells of the line of names and of
    those directly above it, from below.
    """
    kinds = [_kind(line, dialect) for line in lines]
    written = [i for i, kind in enumerate(kinds) if kind in ("names", "other")]
    nearest = written[-1] if written else -1
    if nearest >= 0 and kinds[nearest] == "names":
        rows = []
        for i in range(nearest, -1, -1):
            if kinds[i] == "names":
                rows.append(_fitting(lines[i], dialect) or [])
            elif kinds[i] == "other":
                break
        return _next(kinds, nearest), rows
    if nearest >= 0:
        cells = dialect.cells(lines[nearest])
        if len(cells) == dialect.width - 1 and '"' in lines[nearest] and _is_counted(dialect):
            return _next(kinds, nearest), [["", *cells]]
        if not _is_title(lines[nearest], dialect):
            raise InputError(
                f"{path}:{dialect.blank + nearest + 1}: expected {dialect.width} names, one for"
                f" each cell of the rows below, found {len(cells)}"
                f" ('{lines[nearest].strip()[:60]}'); correct the header"
            )
    valued = [i for i, kind in enumerate(kinds) if kind == "values" and i > nearest]
    numbered = _fitting(lines[valued[-1]], dialect) if valued else None
    if numbered and not dialect.is_value(numbered[0]):
        return len(lines), [numbered]
    # Rows that are damaged; keys with a number as their value begin with text.
    while valued and not dialect.is_value(dialect.cells(lines[valued[0]])[0]):
        del valued[0]
    return valued[0] if valued else len(lines), []


def _kind(line: str, dialect: Dialect) -> str:
    """What a line above the first row is: ``names`` for the columns, ``values``, ``other`` text, or
    ``nothing``.
    """
    bare = _COMMENT.sub("", line, count=1)
    if _NOTHING.fullmatch(line) or _UNITS.match(bare):
        return "nothing"
    cells = dialect.cells(line)
    if 2 * sum(map(dialect.is_value, cells)) >= sum(1 for cell in cells if not is_missing(cell)):
        # A damaged row, a key with its value, or names that are numbers.
        return "values"
    if _fitting(line, dialect):
        return "names"
    return "nothing" if bare != line else "other"


def _next(kinds: Sequence[str], i: int) -> int:
    """The first line behind another that is not nothing."""
    return next((j for j in range(i + 1, len(kinds)) if kinds[j] != "nothing"), len(kinds))


def _fitting(line: str, dialect: Dialect) -> list[str] | None:
    """Cells of a line of the header if they are as many as there are columns."""
    if not dialect.width:
        return dialect.cells(_COMMENT.sub("", line, count=1))
    filled = 1 + max(j for row in dialect.rows for j, cell in enumerate(row) if cell)
    for cells in _splits(line, dialect.separator):
        ends = len(cells)
        while ends and not cells[ends - 1]:
            ends -= 1
        # LabVIEW announces a column of comments that most rows do not have.
        if {len(cells), ends} & {filled, dialect.width} or (
            ends == dialect.width + 1 and cells[-1] == "Comment"
        ):
            return (cells + [""] * dialect.width)[: max(dialect.width, ends)]
    return None


def _splits(line: str, separator: str) -> Iterator[list[str]]:
    """Ways to separate the cells of a line of the header."""
    bare = (
        _COMMENT.sub("", line, count=1).strip()
        if separator == " "
        else _COMMENT.sub("", line, count=1)
    )
    yield split(bare, separator)
    if separator == " ":
        # Names with blanks in them, units behind a blank.
        yield re.split(r"\s{2,}|\t", bare)
        yield split(re.sub(r"\s+(?=[\[(])", "", bare), separator)
    elif bare != line:
        # Comments are written by hand.
        yield split(bare, " ")
        yield split(bare, ",")


def _is_title(line: str, dialect: Dialect) -> bool:
    """Whether a line is a title, or a key and its value, rather than names."""
    misread = any(
        len(split(line, separator)) == dialect.width for separator in SEPARATORS if separator != " "
    )
    return not misread and (
        dialect.separator == " " or len(list(filter(None, dialect.cells(line)))) <= 2
    )


def _is_counted(dialect: Dialect) -> bool:
    """Whether the first column has names of rows, as R writes them without a name of their own."""
    names = [row[0] for row in dialect.rows]
    if names[0].isdecimal():
        return names == [str(int(names[0]) + i) for i in range(len(names))]
    return not any(map(dialect.is_value, names))


def _are_units(cells: Sequence[str], names: Sequence[str]) -> bool:
    """Whether the cells of a line below that of the names are their units."""
    filled = [cell for cell in cells if cell]
    known = sum(
        1 for cell in filled if is_unit(cell.strip("[]() ")) or cell[0] + cell[-1] in ("[]", "()")
    )
    # No known one among them: what stands there again and again are no names.
    repeated = len(set(filled)) < len(filled) and len({*names}) == len(names) and all(names)
    return 2 * known >= len(filled) or repeated


def _labelled(lines: Sequence[str], dialect: Dialect) -> list[str]:
    """Units of a line that says that it states them."""
    for line in reversed(lines):
        bare = _COMMENT.sub("", line, count=1)
        label = _UNITS.match(bare)
        if label:
            return _fitting(bare[label.end() :], dialect) or []
    return []


def _names(rows: Sequence[Sequence[str]], width: int) -> tuple[list[str], list[str]]:
    """Names of the columns and the units in them.

    Args:
        rows: Cells of the line of names and of those directly above it, from below.
        width: Columns.
    """
    row, *levels = [[*row, *[""] * (width - len(row))] for row in rows] or [[""] * width]
    parts = [_name_and_unit(name) for name in row]
    names, units = [name for name, _ in parts], [unit for _, unit in parts]
    # "force (left)" and "force (right)" are not both "force".
    counts = Counter(names)
    names = [whole if counts[name] > 1 else name for name, whole in zip(names, row, strict=True)]
    counts = Counter(names)
    first = next((j for j, name in enumerate(names) if not name or counts[name] > 1), width)
    for level in levels:
        counts = Counter(names)
        label = next((cell for cell in level[:first] if cell), "Name")
        if label != "Name" or not any(not name or counts[name] > 1 for name in names):
            continue
        longer, group = names[:first], ""
        for name, cell in zip(names[first:], level[first:], strict=False):
            group = cell or (group if not name or counts[name] > 1 else "")
            longer.append(f"{group}.{name}".strip("."))
        if len(set(longer)) > len(set(names)):
            names = longer
    return [name or f"[{j}]" for j, name in enumerate(names)], units


def _name_and_unit(name: str) -> tuple[str, str]:
    """A name without its unit, and the unit."""
    found = _BRACKETS.fullmatch(name)
    if found:
        unit = found["square"] or found["round"]
        if unit.isdecimal():
            return name, ""
        # Other things than units stand between round brackets, but none that may be passed over.
        return (found["name"] if found["square"] or is_unit(unit) else name), unit.strip()
    found = _QUOTIENT.fullmatch(name)
    if found and is_unit(found["unit"]):
        return found["name"], found["unit"]
    found = _ENDING.fullmatch(name)
    return name, found["unit"] if found else ""
