"""Where the result comes from: versions, options, and the files that were read."""

from __future__ import annotations

from steelyard.report.blocks.document import Block, Grid, Section
from steelyard.report.evidence.summary import Summary


def made(summary: Summary) -> Section:
    """The section."""
    found = summary.made
    blocks: list[Block] = [Grid("Versions", ("program or library", "version"), found.versions)]
    if found.options:
        blocks.append(Grid("Options", ("option", "value"), found.options))
    if found.inputs:
        rows = tuple((each.name, str(each.size), each.sha256) for each in found.inputs)
        blocks.append(Grid("Input files", ("file", "bytes", "SHA-256"), rows, frozenset({1})))
    return Section("made", "Provenance", tuple(blocks))
