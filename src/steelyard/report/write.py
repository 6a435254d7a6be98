"""The report in all its forms, from one summary."""

from __future__ import annotations

from pathlib import Path

from steelyard.report.compose import document_of
from steelyard.report.markdown import markdown
from steelyard.report.page import page
from steelyard.report.report_file import FILE_NAME, write_summary
from steelyard.report.summary import Summary

DRAWN = ("report.html", "report.md")
"""What is drawn from :data:`steelyard.report.report_file.FILE_NAME`."""


def write_report(summary: Summary, folder: Path) -> None:
    """Write the summary and the report.

    Args:
        summary: What there is to show.
        folder: Where ``report.json``, ``report.html`` and ``report.md`` belong.
    """
    write_summary(summary, folder / FILE_NAME)
    draw_report(summary, folder)


def draw_report(summary: Summary, folder: Path) -> None:
    """Write ``report.html`` and ``report.md``, the same bytes for the same summary."""
    document = document_of(summary)
    for name, text in zip(DRAWN, (page(document), markdown(document)), strict=True):
        (folder / name).write_text(text, encoding="utf-8", newline="\n")
