"""A document as Markdown: what it says without its pictures."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from steelyard.report.blocks.document import (
    Block,
    Document,
    Figure,
    Fold,
    Grid,
    OneOf,
    Scene,
    Statements,
)

_SPECIAL = {ord(character): f"&#{ord(character)};" for character in "\\|<>&*_`[]#~"}
_START = re.compile(r"^(?:[-+=]|\d+[.)])")
"""What makes a line something else than a paragraph."""


def escaped(text: str) -> str:
    """Text within a line of Markdown, so that it stays text."""
    return " ".join(text.translate(_SPECIAL).split())


def markdown(document: Document) -> str:
    """Markdown of a document; the same bytes for the same input."""
    lines = [f"# {escaped(document.title)}", "", _line(document.lead.text)]
    if document.facts:
        facts = (f"{escaped(name)}: {escaped(value)}" for name, value in document.facts)
        lines += ["", "; ".join(facts)]
    for section in document.sections:
        lines += ["", f"## {escaped(section.title)}"]
        for block in section.blocks:
            lines += ["", *_block(block)]
    return "\n".join(lines) + "\n"


def _block(block: Block) -> Iterator[str]:
    """Lines of a block; a picture is named by its title and its alternative."""
    match block:
        case Statements(items):
            yield from (f"- {_line(each.text)}" for each in items)
        case Grid():
            yield from _grid(block)
        case Figure():
            yield f"*Picture: {escaped(block.title)}. {escaped(block.alternative)}*"
        case Scene():
            yield from _block(block.figure)
        case Fold(title, blocks):
            yield from _titled(title, blocks)
        case OneOf(label, options):
            for i, (name, blocks) in enumerate(options):
                yield from ([""] if i else [])
                yield from _titled(f"{label} {name}", blocks)


def _titled(title: str, blocks: Iterable[Block]) -> Iterator[str]:
    """Blocks under a heading of their own."""
    yield f"### {escaped(title)}"
    for block in blocks:
        yield ""
        yield from _block(block)


def _grid(grid: Grid) -> Iterator[str]:
    yield f"**{escaped(grid.caption)}**"
    yield ""
    yield _row(grid.head)
    yield "|" + "|".join("---:" if i in grid.right else "---" for i in range(len(grid.head))) + "|"
    yield from map(_row, grid.rows)


def _row(cells: tuple[str, ...]) -> str:
    return "| " + " | ".join(map(escaped, cells)) + " |"


def _line(text: str) -> str:
    """Text that begins a line."""
    # The last character of the mark is what makes it one.
    return _START.sub(lambda mark: f"{mark[0][:-1]}&#{ord(mark[0][-1])};", escaped(text))
