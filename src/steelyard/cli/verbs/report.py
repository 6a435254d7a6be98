"""The verb `report`."""

from __future__ import annotations

from pathlib import Path

import click

from steelyard.cli.options import common
from steelyard.cli.printing import print_json
from steelyard.errors import InputError


@click.command()
@click.argument("folder", type=click.Path(path_type=Path), metavar="DIR")
@click.option(
    "--certificate",
    is_flag=True,
    help="Draw one page for the file instead: certificate.html and certificate.md.",
)
@common
def report(folder: Path, certificate: bool, as_json: bool, quiet: bool) -> None:
    """Draw the report of DIR, a folder that identify wrote, again: report.html and report.md from
    its report.json.
    """
    from steelyard.output import results_folder
    from steelyard.provenance.record import renew_provenance
    from steelyard.report.evidence.report_file import read_summary
    from steelyard.report.write import CERTIFICATE, DRAWN, draw_certificate, draw_report

    if not folder.is_dir():
        found = "a file" if folder.exists() else "nothing"
        raise InputError(
            f"{folder}: expected a folder that identify wrote with --out, found {found}; check the"
            " path"
        )
    summary = read_summary(folder)
    # What is replaced has been drawn from the same summary.
    with results_folder(folder, force=True) as fresh:
        (draw_certificate if certificate else draw_report)(summary, fresh)
        renew_provenance(fresh, folder)
    drawn = CERTIFICATE if certificate else DRAWN
    written = [str(folder / name) for name in drawn]
    if as_json:
        print_json({"written": written})
    else:
        print(f"{written[0]}: drawn ({written[1]} too); open it in a browser")
