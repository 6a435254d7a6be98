"""Tables of documents, and how their numbers are rounded."""

import re

from steelyard.report.blocks.document import Grid, flat


def grids(document):
    """All tables of a document."""
    blocks = (block for section in document.sections for block in flat(section.blocks))
    return [block for block in blocks if isinstance(block, Grid)]


def columns(document, pattern):
    """Cells of all columns whose head matches, table by table."""
    found = []
    for grid in grids(document):
        for place, head in enumerate(grid.head):
            if re.search(pattern, head):
                found += [row[place] for row in grid.rows if re.search(r"\d", row[place])]
    return found


def is_a_deviation(text):
    """Whether a 1-sigma is written with two digits of it, or all of those before the point."""
    digits = text.replace(".", "").lstrip("0")
    return re.fullmatch(r"\d+(\.\d+)?", text) is not None and (
        len(digits) == 2 or ("." not in text and len(digits) > 2)
    )
