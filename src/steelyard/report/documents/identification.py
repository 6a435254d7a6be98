"""From the summary of an identification to the document that all forms of its report are drawn
from.
"""

from __future__ import annotations

from dataclasses import replace

from steelyard.report.blocks.document import Document, Statement, Statements
from steelyard.report.documents.sections.budget import budget
from steelyard.report.documents.sections.calibration import calibration
from steelyard.report.documents.sections.correlation import correlation
from steelyard.report.documents.sections.disturbances import disturbances
from steelyard.report.documents.sections.made import made
from steelyard.report.documents.sections.platform import platform
from steelyard.report.documents.sections.residuals import residuals, wrench
from steelyard.report.documents.sections.result import lead, result
from steelyard.report.documents.sections.swings import swings
from steelyard.report.evidence.summary import Summary

SECTIONS = (
    result,
    platform,
    swings,
    wrench,
    residuals,
    disturbances,
    budget,
    calibration,
    correlation,
    made,
)
"""In the order in which they are shown; each is left out where it has nothing to say."""


def document_of(summary: Summary) -> Document:
    """The report as values."""
    found = (section(summary) for section in SECTIONS)
    sections = tuple(each for each in found if each is not None)
    return Document(summary.table.title, lead(summary), sections, facts=summary.made.facts)


def brief_of(summary: Summary, *, details: bool = False) -> Document:
    """What a terminal shows of a report: its first section.

    Args:
        summary: What there is to show.
        details: Whether to show what each run says alone, too; else it is said how to see it.
    """
    section = result(summary if details else replace(summary, runs=()))
    if summary.runs and not details:
        hint = Statement("What each run says alone: --details shows it.")
        section = replace(section, blocks=(*section.blocks, Statements((hint,))))
    return Document(summary.table.title, lead(summary), (section,))
