"""What particular programs write above their tables."""

from __future__ import annotations

from collections.abc import Sequence

from steelyard.logs.dialect import Dialect

_FILETIME = 1e15
"""Above it, times of TwinCAT are ticks since 1601 instead of milliseconds."""


def scope_columns(
    lines: Sequence[Sequence[str]], dialect: Dialect
) -> tuple[tuple[str, ...], dict[str, str], dict[str, str]] | None:
    """Columns of a CSV export of TwinCAT Scope: groups of channels, each behind a column with their times.

    Each line of such a header begins with its key, and has it again in the column of the times of every other group.

    Args:
        lines: Cells of the lines above the rows that are as wide as those.
        dialect: Of the file.

    Returns:
        Names of the columns (``t``, ``t[1]``, … the times), their units, and column -> column with its times;
        None: another program wrote it.
    """
    keyed = {line[0]: line for line in reversed(lines)}
    found = [keyed[key] for key in ("Name", "SymbolName") if key in keyed]
    if not found:
        return None
    # Short names may be there several times.
    named = next((line for line in found if len(set(line)) == len(line) - line.count(line[0]) + 1), found[0])
    starts = [j for j, cell in enumerate(named) if cell == named[0]]
    stated = keyed.get("Unit", [""] * len(named))
    names, units, clocks = [], {}, {}
    for j, cell in enumerate(named):
        if j in starts:
            names.append(f"t[{starts.index(j)}]" if j else "t")
            tick = max((_number(row[j]) for row in dialect.rows), default=0.0) > _FILETIME
            units[names[-1]] = "100ns" if tick else "ms"
            clock = names[-1]
        else:
            names.append(cell or f"[{j}]")
            clocks[names[-1]] = clock
            if stated[j].strip("()") not in {"", "None"}:
                units[names[-1]] = stated[j].strip("[]() ")
    return tuple(names), units, clocks if len(starts) > 1 else {}


def motive_units(lines: Sequence[Sequence[str]], levels: Sequence[Sequence[str]], width: int) -> list[str]:
    """Units of the columns of a CSV export of OptiTrack Motive, which states one of all lengths in its first line.

    Args:
        lines: Cells of the lines above the rows.
        levels: Those directly above the names.
        width: Columns.

    Returns:
        One for each column, empty where nothing is stated.
    """
    take = next((dict(zip(line[::2], line[1::2], strict=False)) for line in lines if "Length Units" in line), None)
    units = [""] * width
    if take is None:
        return units
    angle = "" if take.get("Rotation Type", "Quaternion") == "Quaternion" else "deg"
    for level in levels:
        for j, cell in enumerate(level[:width]):
            units[j] = {"Position": take["Length Units"], "Rotation": angle}.get(cell, units[j])
    return units


def _number(cell: str) -> float:
    try:
        return float(cell.replace(",", "."))
    except ValueError:
        return 0.0
