"""How values show themselves in a session or a notebook: a small table and sentences below it, as
text and as HTML.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

_NUMBERS = 2
"""Columns before it are words, the others numbers."""
_TOLD, _LEAST_ELAPSED = 0.05, 1.5
"""Fraction and time [s] from which on it can be said how long the rest takes."""
_MINUTES = 3
"""From how many on the rest is said in minutes."""


@dataclass(frozen=True)
class Display:
    """What is shown; whatever stands in the texts."""

    title: str
    rows: tuple[tuple[str, ...], ...]
    """All of one length; first a name, then a unit, then numbers."""
    head: tuple[str, ...] = ()
    """As long as a row; empty: none."""
    sentences: tuple[str, ...] = ()

    def text(self) -> str:
        """For a terminal; lines have no blanks at their ends."""
        rows = [self.head, *self.rows] if self.head else list(self.rows)
        grid = [[printable(cell) for cell in row] for row in rows]
        widths = [max(map(len, column)) for column in zip(*grid, strict=True)]
        lines = [_aligned(row, widths) for row in grid]
        return "\n".join([printable(self.title), *lines, *map(printable, self.sentences)])

    def html(self) -> str:
        """For a notebook; without colours of its own, so that it is readable on light and on
        dark.
        """
        head = f"<thead>{_row('th', self.head)}</thead>" if self.head else ""
        body = "".join(_row("td", row) for row in self.rows)
        caption = f'<caption style="text-align: left">{_escaped(self.title)}</caption>'
        below = "".join(f"<div>{_escaped(each)}</div>" for each in self.sentences)
        return f"<div><table>{caption}{head}<tbody>{body}</tbody></table>{below}</div>"


def _aligned(cells: Sequence[str], widths: Sequence[int]) -> str:
    """A line of a table: words to the left, numbers to the right."""
    padded = []
    for i, (cell, width) in enumerate(zip(cells, widths, strict=True)):
        padded.append(cell.ljust(width) if i < _NUMBERS else cell.rjust(width))
    return "  ".join(padded).rstrip()


def _row(tag: str, cells: Sequence[str]) -> str:
    sides = ("left" if i < _NUMBERS else "right" for i in range(len(cells)))
    inner = (
        f'<{tag} style="text-align: {side}">{_escaped(cell)}</{tag}>'
        for side, cell in zip(sides, cells, strict=True)
    )
    return f"<tr>{''.join(inner)}</tr>"


def _escaped(text: str) -> str:
    return escape(printable(text))


def printable(text: str) -> str:
    """In one line, without anything that steers a terminal."""
    # Not by its name: names are looked up while this is compiled, where an interruption gets lost.
    return "".join(c if c.isprintable() else "\ufffd" for c in " ".join(text.split()))


def time_left(done: float, elapsed: float) -> str:
    """In words, from the fraction that is done and how long that took [s]; empty where too little
    is done to tell.
    """
    if done < _TOLD or elapsed < _LEAST_ELAPSED or done >= 1:
        return ""
    left = elapsed * (1 - done) / done
    if left < _MINUTES * 60:
        return f"about {max(round(left), 1)} s left"
    return f"about {round(left / 60)} min left"


_ASCII = str.maketrans(
    {
        "±": "+/-", "²": "^2", "³": "^3", "°": "deg", "µ": "u", "·": "*", "√": "sqrt ", "…": "...",
        "\u00d7": "x", "\u2013": "-", "\u2014": "-",
        "\u2212": "-", "\u2019": "'", "✓": "+", "✗": "x",
        **{bar: str(i) for i, bar in enumerate("▁▂▃▄▅▆▇█", start=1)},
    }
)  # fmt: skip


def in_ascii(text: str) -> str:
    """The same for a terminal that has no other characters; those that have no likeness are
    escaped.
    """
    return text.translate(_ASCII).encode("ascii", "backslashreplace").decode("ascii")


def steers(letter: str) -> bool:
    """Whether a character controls a terminal or the direction of text, or cannot be seen; ends of
    lines and tabulators do not count.
    """
    return letter not in "\n\t\r" and unicodedata.category(letter) in {"Cc", "Cf", "Zl", "Zp"}
