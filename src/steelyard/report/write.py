"""The report in all its forms, from one summary."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from steelyard.estimates.named_estimate import FILE_NAME as ESTIMATE
from steelyard.identification.identification import Identification
from steelyard.identification.model.fitted_motion import FORMAT as FORMAT_OF_MOTION
from steelyard.inertia import Inertia
from steelyard.output import results_folder, write_file, write_json, write_table
from steelyard.provenance.hashes import inputs_of
from steelyard.provenance.record import origin
from steelyard.report.blocks.document import Document
from steelyard.report.documents.certificate import certificate_of
from steelyard.report.documents.identification import document_of
from steelyard.report.evidence.made import made_of
from steelyard.report.evidence.report_file import FILE_NAME, write_summary
from steelyard.report.evidence.summary import Summary, summarise
from steelyard.report.forms.markdown import markdown
from steelyard.report.forms.page import page

MOTION = "motion.parquet"
"""The fitted motion as a table that other programs read."""
DRAWN = ("report.html", "report.md")
"""What is drawn from :data:`steelyard.report.evidence.report_file.FILE_NAME`."""
CERTIFICATE = ("certificate.html", "certificate.md")
"""One page of it, on request."""


def write_results(
    found: Identification, folder: str | Path, truth: Inertia | None = None, *, force: bool = False
) -> Path:
    """Write what `identify --out` writes: the estimate, the report and the fitted motion; all of it
    or nothing.

    Args:
        found: As :func:`steelyard.identify` gives it.
        folder: New or empty.
        truth: The true body, where it is known, to compare with.
        force: Whether to replace files of the same names.

    Returns:
        The path of ``report.html``.

    Raises:
        InputError: The folder cannot be written to, or has files.
    """
    made = made_of(found.recorded, {}) if found.recorded else None
    with results_folder(Path(folder), force=force) as fresh:
        write_identification(found, summarise(found, truth, made=made), fresh)
    return Path(folder) / DRAWN[0]


def write_identification(found: Identification, summary: Summary, folder: Path) -> None:
    """Write estimate, report and motion into a folder that is there."""
    write_json(identification_values(found), folder / ESTIMATE)
    write_report(summary, folder)
    if found.motion:
        # A row per instant, the run in the first column, SI units.
        write_table(
            [(each.run, each.columns()) for each in found.motion], folder / MOTION, FORMAT_OF_MOTION
        )


def identification_values(found: Identification) -> dict[str, Any]:
    """What stands in ``estimate.json``: the estimates, and what they were made of."""
    recorded = found.recorded
    if recorded is None or not recorded.source:
        return found.to_dict()
    made = origin(inputs_of(recorded), Path(recorded.source).parent)
    return {**found.to_dict(), "provenance": made}


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
    write_document(document_of(summary), folder, "report")


def draw_certificate(summary: Summary, folder: Path) -> None:
    """Write ``certificate.html`` and ``certificate.md``."""
    write_document(certificate_of(summary), folder, "certificate")


def write_document(document: Document, folder: Path, name: str) -> None:
    """Write a document as a page and as Markdown.

    Args:
        document: What it says.
        folder: One that is there.
        name: Of the files, without their endings.
    """
    for ending, form in (("html", page), ("md", markdown)):
        write_file(folder / f"{name}.{ending}", form(document))
