"""The verb `inspect`."""

from __future__ import annotations

from pathlib import Path

import click

from steelyard.cli.options import (
    check_there,
    common,
    experiment_argument,
    force_option,
    limits_option,
    out_option,
    runs_option,
    selected,
)
from steelyard.cli.printing import print_result, progress


@click.command(short_help="Say what is in the recordings, and what is wrong with them.")
@experiment_argument
@runs_option(help="Look at this run only; may be repeated.", metavar="RUN")
@out_option(
    help="Folder for inspection.json, inspection.md and inspection.html; must be new or empty."
)
@force_option()
@limits_option
@common
def inspect(
    experiment: Path,
    runs: tuple[str, ...],
    out: Path | None,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Say what is in the recordings that EXPERIMENT lists: rates, gaps, noise, clocks, mistakes of
    sign and unit, what can be found.

    Ends with status 0 also where it names mistakes.
    """
    check_there(experiment)
    with progress(quiet=quiet) as tell:
        from steelyard.experiment.read import read_experiment
        from steelyard.inspection.inspect import inspect as inspected
        from steelyard.output import check_target, results_folder, write_json
        from steelyard.report.documents.inspection_document import inspection_document
        from steelyard.report.write import write_document

        if out is not None:
            check_target(out, force=force)
        recorded = selected(read_experiment(experiment), runs)
        found = inspected(recorded, tell)
    values, document = found.to_dict(), inspection_document(found)
    if out is not None:
        with results_folder(out, force=force) as folder:
            write_json(values, folder / "inspection.json")
            write_document(document, folder, "inspection")
    print_result(values, document, as_json=as_json)
