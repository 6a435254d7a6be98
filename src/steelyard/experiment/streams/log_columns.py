"""Which columns of a log hold the columns of the contract: by name, with their units and
factors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from steelyard.errors import InputError
from steelyard.experiment.streams.fields import column_in
from steelyard.experiment.streams.place import StreamPlace
from steelyard.instruments import Instrument, Quantity
from steelyard.logs.log import Log
from steelyard.units import FACTORS, canonical_unit


class LogColumns:
    """Columns of the contract in one log."""

    def __init__(self, log: Log, place: StreamPlace, free: Sequence[str]) -> None:
        self.log, self.place = log, place
        self.free = dict.fromkeys(free)

    def of(self, column: str) -> str | None:
        """Name in the log of a column of the contract; None where it is not there."""
        return column_in(
            self.log.names if column == "t" else self.free, column, self.place.columns.get(column)
        )

    def time(self) -> str:
        """Name in the log of the column with the time.

        Raises:
            InputError: There is none.
        """
        found = self.of("t")
        if found is None:
            raise InputError(
                f"{self.log.path}: expected a column '{self.asked('t')}' with the time, found"
                f" {listed(self.log.names)}; name it under 'columns'"
            )
        return found

    def asked(self, column: str) -> str:
        """What the experiment file calls it."""
        return self.place.columns.get(column, column)

    def check(self, contract: Sequence[str], kind: str) -> None:
        """See that ``columns`` and ``units`` speak of columns that are read."""
        path = self.log.path
        for name in self.place.columns:
            if name not in contract and name != "t":
                raise InputError(
                    f"{path}: 'columns': expected names of the kind '{kind}', found '{name}'; known"
                    f" here: {', '.join(contract)}"
                )
        named = {
            name
            for c in (*contract, "t")
            for name in (c, self.asked(c), self.of(c))
            if name is not None
        }
        for key, stated in (("units", self.place.units), ("scale", self.place.scale)):
            for name in stated:
                if name not in named:
                    raise InputError(
                        f"{path}: '{key}': expected a column that is read, found '{name}'; known"
                        f" here: {', '.join(sorted(named))}"
                    )

    def scale(self, column: str) -> float:
        """What a column of the contract is multiplied by, after its unit."""
        scale, in_log = self.place.scale, str(self.of(column))
        return scale.get(in_log, scale.get(self.asked(column), scale.get(column, 1.0)))

    def factor(self, column: str, unit: str) -> float:
        """From the unit of a column in the log to an SI unit."""
        units, in_log = self.place.units, str(self.of(column))
        # Where axes are exchanged, a name of the contract may be another column of the log.
        taken = column in {self.of(c) for c in self.place.columns} and self.of(column) != column
        stated = units.get(
            in_log, units.get(self.asked(column), None if taken else units.get(column))
        )
        given = stated if stated is not None else self.log.units.get(in_log, unit)
        factors = FACTORS[unit]
        known = given if given in factors else canonical_unit(given)
        if known not in factors:
            cure = (
                "correct it"
                if stated is not None
                else "the log says so itself; state the right one under 'units'"
            )
            raise InputError(
                f"{self.log.path}: unit of column '{in_log}': expected one of {', '.join(factors)},"
                f" found '{given}'; {cure}"
            )
        return factors[known]


def present_quantities(
    names: LogColumns, instrument: Instrument, m: int
) -> list[tuple[Quantity, tuple[str, ...]]]:
    """Which quantities a log has, and in which form."""
    found = []
    path, present = names.log.path, list(names.free)
    for quantity in instrument.quantities(m):
        have = {
            form: [c for c in form if c in instrument.unread or names.of(c) is not None]
            for form in quantity.forms
        }
        complete = next((form for form in quantity.forms if len(have[form]) == len(form)), None)
        if complete:
            found.append((quantity, complete))
            continue
        partial = max(quantity.forms, key=lambda form: len(have[form]))
        if quantity.required or have[partial] or any(c in names.place.columns for c in partial):
            missing = [names.asked(c) for c in partial if c not in have[partial]]
            per_cable = f" for the {m} cables of the robot" if instrument.per_cable else ""
            other = (
                " (or another form of the orientation)"
                if quantity.rotation and not have[partial]
                else ""
            )
            raise InputError(
                f"{path}: expected columns"
                f" {', '.join(names.asked(c) for c in partial)}{per_cable}{other}, found no"
                f" {', '.join(missing)} among {listed(present)}; name them under 'columns'"
            )
    if not found:
        wanted = ", or ".join(" ".join(form) for q in instrument.quantities(m) for form in q.forms)
        raise InputError(
            f"{path}: expected at least one group of columns of kind '{instrument.kind}'"
            f" ({wanted}), found {listed(present)}; name them under 'columns'"
        )
    return found


def needed_columns(instrument: Instrument, m: int, columns: Mapping[str, str]) -> set[str]:
    """Columns of a log that an instrument cannot do without, in any of their forms."""
    return {
        columns.get(c, c)
        for q in instrument.quantities(m)
        if q.required
        for form in q.forms
        for c in form
        if c not in instrument.unread
    }


def listed(names: Sequence[str]) -> str:
    """Names of columns for a message, twenty at the most."""
    shown = ", ".join(name if len(name) <= 30 else name[:29] + "…" for name in names[:20])
    return (shown + (", …" if len(names) > 20 else "")) or "no columns"
