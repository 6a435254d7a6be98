"""The verb `report`."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import click

from steelyard.cli.options import checked_day, common, facts_options
from steelyard.cli.printing import in_lines, print_json, progress
from steelyard.errors import InputError


@click.command(short_help="Draw the report of a result again: page, PDF, certificate.")
@click.argument("folder", type=click.Path(path_type=Path), metavar="DIR")
@click.option(
    "--certificate",
    is_flag=True,
    help="Draw one page for the file instead: certificate.html and certificate.md.",
)
@click.option(
    "--pdf", is_flag=True, help="Print the page to a PDF file beside it, by Chromium or Chrome."
)
@facts_options
@common
def report(
    folder: Path,
    certificate: bool,
    pdf: bool,
    project: str | None,
    operator: str | None,
    date: str | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Draw the report of DIR, a folder that identify wrote, again: report.html and report.md from
    its report.json.
    """
    facts = {"project": project, "operator": operator, "date": checked_day(date)}
    if not folder.is_dir():
        found = "a file" if folder.exists() else "nothing"
        raise InputError(
            f"{folder}: expected a folder that identify wrote with --out, found {found}; check the"
            " path"
        )
    from steelyard.output import results_folder
    from steelyard.provenance.record import renew_provenance
    from steelyard.report.evidence.made import with_facts
    from steelyard.report.evidence.report_file import read_summary
    from steelyard.report.pdf import browser_for_pdf, write_pdf
    from steelyard.report.write import CERTIFICATE, DRAWN, draw_certificate, draw_report

    browser = browser_for_pdf() if pdf else None
    summary = read_summary(folder)
    summary = replace(summary, made=with_facts(summary.made, facts))
    drawn: tuple[str, ...] = CERTIFICATE if certificate else DRAWN
    with progress(quiet=quiet) as tell, results_folder(folder, force=True) as fresh:
        # What is replaced has been drawn from the same summary.
        (draw_certificate if certificate else draw_report)(summary, fresh)
        if browser is not None:
            if tell:
                tell(f"printing by {Path(browser).name}", 0.2)
            page = fresh / drawn[0]
            write_pdf(page, page.with_suffix(".pdf"), browser)
            drawn = (*drawn, page.with_suffix(".pdf").name)
        renew_provenance(fresh, folder)
    written = [str(folder / name) for name in drawn]
    if as_json:
        print_json({"written": written})
    else:
        said = f"{written[0]}: drawn ({', '.join(written[1:])} too); open it in a browser"
        print(in_lines(said, sys.stdout))
