"""What stands in a cell of a text file: a number, an instant, or nothing."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Literal

from steelyard.logs.frames import as_array

if TYPE_CHECKING:
    import polars as pl

Decimal = Literal[".", ","]
"""What stands between the whole and its parts."""

MISSING = [
    *("", "-", "--", "---", "NaN", "nan", "NAN", "-nan", "NaN()", "nan(ind)", "-nan(ind)"),
    *("1.#QNAN", "-1.#IND", "null", "NULL", "None", "none", "N/A", "n/a", "NA", "<NA>"),
    *("#N/A", "#NV"),
]
"""Texts of a cell that stand for no sample."""
_MISSING = frozenset(MISSING)

_NUMBER = {
    ".": re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eEdD][-+]?\d+)?|[-+]?inf(inity)?", re.IGNORECASE),
    ",": re.compile(r"[-+]?(\d+,?\d*|,\d+)([eEdD][-+]?\d+)?|[-+]?inf(inity)?", re.IGNORECASE),
}
_LONGEST = 64
"""Characters of a number or an instant."""

_CLOCK = r"\d\d?:\d\d:\d\d([.,]\d+)?"
_DATE = r"(\d{4}-\d\d?-\d\d?|\d{4}/\d\d?/\d\d?|\d\d?\.\d\d?\.\d{4})[T ]"
_INSTANT = re.compile(rf"({_DATE})?{_CLOCK} ?(Z|UTC|[-+]\d\d:?\d\d)?|-?\d+(\.\d+)? sec")
_SECONDS = " sec"
_DATES = ("%Y-%m-%d", "%Y/%m/%d", "%d.%m.%Y")
_TIME = "%H:%M:%S%.f"
_ZONE = r" ?([-+])(\d\d):?(\d\d)$"


def is_number(cell: str, decimal: Decimal) -> bool:
    """Whether a cell holds a number."""
    return len(cell) <= _LONGEST and _NUMBER[decimal].fullmatch(cell) is not None


def is_instant(cell: str) -> bool:
    """Whether a cell holds a time of day, with a date or without, or a duration of MATLAB."""
    return (
        len(cell) <= _LONGEST
        and (":" in cell or _SECONDS in cell)
        and _INSTANT.fullmatch(cell) is not None
    )


def is_missing(cell: str) -> bool:
    """Whether a cell stands for no sample."""
    return cell in _MISSING


def stripped(cells: pl.Series) -> pl.Series:
    """Cells without blanks and quotation marks around them, null where there is no sample."""
    bare = cells.str.strip_chars().str.strip_chars('"').str.strip_chars()
    return bare.set(bare.is_in(MISSING).fill_null(True), None)


def as_numbers(cells: pl.Series, decimal: Decimal) -> pl.Series:
    """Stripped cells as numbers, null where they are none."""
    import polars as pl

    if decimal == ",":
        # A point beside decimal commas is a thousands separator or a mistake.
        pointed = cells.str.contains(".", literal=True)
        cells = cells.str.replace(",", ".", literal=True).set(pointed.fill_null(False), None)
    # Fortran writes exponents with a D.
    return cells.str.replace(r"^([-+\d.]+)[dD]([-+\d]+)$", "${1}e$2").cast(pl.Float64, strict=False)


def as_instants(cells: pl.Series) -> pl.Series:
    """Stripped cells as seconds since 1970, or since midnight where they have no date; null where
    they are no instants.
    """
    import polars as pl

    text = (
        cells.str.replace("T", " ", literal=True)
        .str.replace(" ?(Z|UTC)$", "+00:00")
        .str.replace(",", ".", literal=True)
    )
    zone = text.str.extract_groups(_ZONE).struct.unnest()
    ahead = (zone["2"].cast(pl.Float64) * 3600 + zone["3"].cast(pl.Float64) * 60).fill_null(0.0)
    ahead = ahead * pl.select(pl.when(zone["1"] == "-").then(-1.0).otherwise(1.0)).to_series()
    text = text.str.replace(_ZONE, "")
    readings = [
        *(text.str.to_datetime(f"{date} {_TIME}", time_unit="ns", strict=False) for date in _DATES),
        text.str.to_time(_TIME, strict=False),
        text.str.strip_suffix(_SECONDS).cast(pl.Float64, strict=False),
    ]
    best = min(readings, key=pl.Series.null_count)
    return pl.Series(as_array(best), nan_to_null=True) - ahead
