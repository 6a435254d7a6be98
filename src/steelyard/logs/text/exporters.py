"""What particular programs write above their tables."""

from __future__ import annotations

from collections.abc import Sequence

from steelyard.logs.text.cells import is_missing
from steelyard.logs.text.dialect import Dialect

_FILETIME = 16
"""Digits of times of TwinCAT that are ticks since 1601 instead of milliseconds."""


def scope_columns(
    above: Sequence[Sequence[str]], dialect: Dialect
) -> tuple[tuple[str, ...], dict[str, str], dict[str, str]] | None:
    """Columns of a CSV export of TwinCAT Scope: groups of channels, each behind a column with their
    times.

    Each line of such a header begins with its key, and has it again in the column of the times of
    every other group.

    Args:
        above: Cells of the lines above the first row.
        dialect: Of the file.

    Returns:
        Names of the columns (``t``, ``t[1]``, … the times), their units, and column -> column with
        its times;
        None: another program wrote it.
    """
    keyed = {cells[0]: cells for cells in reversed(above) if len(cells) == dialect.width}
    found = [keyed[key] for key in ("Name", "SymbolName") if key in keyed]
    # Short names may be there several times.
    unique = [cells for cells in found if len(set(cells)) == len(cells) - cells.count(cells[0]) + 1]
    named = (unique or found or [[]])[0]
    times = [j for j, cell in enumerate(named) if cell == named[0]]
    if not times or not all(
        dialect.is_value(row[j]) or is_missing(row[j]) for row in dialect.rows for j in times
    ):
        return None
    stated = [cell.strip("[]() ") for cell in keyed.get("Unit", [""] * len(named))]
    names, units, clocks = [], {}, {}
    for j, cell in enumerate(named):
        if j in times:
            clock = f"t[{times.index(j)}]" if j else "t"
            names.append(clock)
            cells = [row[j] for row in dialect.rows]
            ticks = any(len(each) >= _FILETIME and each.isdecimal() for each in cells)
            units[clock] = "100ns" if ticks else "ms"
        else:
            names.append(cell or f"[{j}]")
            clocks[names[-1]] = clock
            if stated[j] not in {"", "None"}:
                units[names[-1]] = stated[j]
    return tuple(names), units, clocks if len(times) > 1 else {}


def motive_units(
    above: Sequence[Sequence[str]], levels: Sequence[Sequence[str]], width: int
) -> list[str]:
    """Units of the columns of a CSV export of OptiTrack Motive, which states one of all lengths in
    its first line.

    Args:
        above: Cells of the lines above the first row.
        levels: Of these, those directly above the names.
        width: Columns.

    Returns:
        One for each column, empty where nothing is stated.
    """
    units = [""] * width
    stated = next((cells for cells in above if "Length Units" in cells), None)
    if stated is None:
        return units
    take = dict(zip(stated[::2], stated[1::2], strict=False))
    # Angles of Euler are in degrees.
    angle = "" if take.get("Rotation Type", "Quaternion") == "Quaternion" else "deg"
    for level in levels:
        for j, cell in enumerate(level[:width]):
            units[j] = {"Position": take["Length Units"], "Rotation": angle}.get(cell, units[j])
    return units
