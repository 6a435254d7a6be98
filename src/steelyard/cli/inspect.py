"""The verb that says what is in the recordings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from steelyard.cli.progress import progress
from steelyard.cli.verbs import print_json, selected
from steelyard.experiment.read import read_experiment
from steelyard.inspection.inspect import inspect
from steelyard.output import check_target, results_folder, write_json
from steelyard.report.inspection import show_inspection
from steelyard.report.inspection_document import inspection_document
from steelyard.report.write import write_document


def run_inspection(
    experiment: Path,
    *,
    runs: Sequence[str],
    out: Path | None,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Look at the recordings of an experiment, print what was found, and write it where it was
    asked for.
    """
    if out is not None:
        check_target(out, force=force)
    recorded = selected(read_experiment(experiment), runs)
    with progress(quiet=quiet) as tell:
        found = inspect(recorded, tell)
    values = found.to_dict()
    if out is not None:
        with results_folder(out, force=force) as folder:
            write_json(values, folder / "inspection.json")
            write_document(inspection_document(found), folder, "inspection")
    if as_json:
        print_json(values)
    else:
        show_inspection(found)
