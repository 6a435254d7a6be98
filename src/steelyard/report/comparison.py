"""Estimates side by side, and what was added between two of them, as tables in a terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from steelyard.digits import LABELS, ten_numbers
from steelyard.estimates.comparison import SIGNIFICANT, USUAL, Agreement, Comparison, Pair
from steelyard.estimates.estimate_file import NamedEstimate
from steelyard.estimates.payload import Payload

_PIPED_WIDTH = 160


def show_comparison(comparison: Comparison, *, fail_above: float | None = None) -> None:
    """Print estimates, their differences from the first, and whether they agree.

    Args:
        comparison: Of two or more estimates.
        fail_above: Sigmas above which differences are named; None: none are.
    """
    console = _console()
    of_first = comparison.pairs[: len(comparison.estimates) - 1]
    for other, pair in zip(comparison.estimates[1:], of_first, strict=True):
        console.print(_drawn(comparison.estimates[0], other, pair))
    for text, style in comparison_statements(comparison, fail_above):
        console.print(Text(text, style=style))


def comparison_statements(
    comparison: Comparison, fail_above: float | None = None
) -> Iterator[tuple[str, str]]:
    """Sentences under the tables, each with the style it is printed in."""
    yield from _doubted(comparison.estimates)
    for pair in comparison.pairs:
        yield f"{pair.first} and {pair.second}: {pair.agreement}", _style(pair.agreement)
    if comparison.whole is not None:
        yield (
            f"all of different recordings ({'; '.join(comparison.whole_of)}): {comparison.whole}",
            _style(comparison.whole),
        )
    for note in comparison.notes:
        yield f"note: {note}", ""
    if fail_above is not None:
        exceeding = comparison.exceeding(fail_above)
        for text in exceeding:
            yield f"above {fail_above:g} sigmas: {text}", "red"
        if not exceeding:
            yield f"nothing differs by more than {fail_above:g} sigmas", "green"


def show_payload(payload: Payload) -> None:
    """Print what was added between two estimates."""
    console = _console()
    drawn = _table("payload: what was added")
    columns = (payload.before.name, payload.after.name, "added")
    for heading in columns:
        drawn.add_column(Text(heading), justify="right")
    estimates = (payload.before.estimate, payload.after.estimate, payload.estimate)
    cells = [ten_numbers(e.value, e.standard_deviation) for e in estimates]
    for row, (label, unit, _) in enumerate(LABELS):
        drawn.add_row(label, unit, *(column[row] for column in cells), end_section=row in (0, 3))
    console.print(drawn)
    for text, style in payload_statements(payload):
        console.print(Text(text, style=style))


def payload_statements(payload: Payload) -> Iterator[tuple[str, str]]:
    """Sentences under the table, each with the style it is printed in."""
    yield from _doubted((payload.before, payload.after))
    verdict, physical = payload.estimate.verdict, payload.estimate.physical
    if verdict.accepted:
        can = {
            True: ", of a body that can exist",
            None: "; whether such a body can exist is not known",
        }
        within = f"; a body that can exist lies within {SIGNIFICANT:g} sigmas of it"
        yield f"payload: accepted{can.get(physical, within)}", "green"
    for reason in verdict.reasons:
        yield f"payload: not accepted: {reason}", "red"
    for note in payload.estimate.notes:
        yield f"note: {note}", ""


def _console() -> Console:
    console = Console(highlight=False)
    # Nothing is cut where a file or a pipe reads along.
    return console if console.is_terminal else Console(width=_PIPED_WIDTH, highlight=False)


def _table(title: str) -> RichTable:
    drawn = RichTable(
        title=Text(title), title_justify="left", title_style="bold", header_style="bold"
    )
    drawn.add_column("")
    drawn.add_column("unit")
    return drawn


def _drawn(first: NamedEstimate, second: NamedEstimate, pair: Pair) -> RichTable:
    drawn = _table(f"{second.name}, compared with {first.name}")
    for heading in (first.name, second.name, "difference", "in sigmas"):
        drawn.add_column(Text(heading), justify="right")
    values = [
        ten_numbers(each.estimate.value, each.estimate.standard_deviation)
        for each in (first, second)
    ]
    differences = ten_numbers(pair.difference, pair.standard_deviation, sign=True)
    for row, (label, unit, _) in enumerate(LABELS):
        z = pair.z[row]
        sigmas = "-" if np.isnan(z) else "exact" if np.isinf(z) else f"{z:+.1f}"
        style = "red" if abs(z) > SIGNIFICANT else ""
        cells = (values[0][row], values[1][row], differences[row], Text(sigmas, style=style))
        drawn.add_row(label, unit, *cells, end_section=row in (0, 3))
    return drawn


def _doubted(estimates: Sequence[NamedEstimate]) -> Iterator[tuple[str, str]]:
    for each in estimates:
        verdict = each.estimate.verdict
        if not verdict.accepted:
            yield (
                (
                    f"{each.name}: was not accepted when it was made:"
                    f" {'; '.join(verdict.reasons) or 'no reason given'}"
                ),
                "red",
            )


def _style(found: Agreement) -> str:
    if np.isnan(found.p_value):
        return ""
    return "green" if found.sigmas <= USUAL else "yellow" if found.sigmas <= SIGNIFICANT else "red"
