"""The verb `init`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from steelyard.cli.options import common, force_option, limits_option, out_option
from steelyard.cli.printing import print_result, progress
from steelyard.errors import InputError

if TYPE_CHECKING:
    from steelyard.drafts.draft import Draft


@click.command(short_help="Draft a first experiment file from logs.")
@click.argument("logs", nargs=-1, required=True, metavar="LOG...", type=click.Path(path_type=Path))
@click.option(
    "--robot", metavar="ROBOT", help="A bundled name or a robot file; without it, what there is."
)
@out_option(help="Experiment file to write.", required=True)
@force_option(help="Replace the file.")
@limits_option
@common
def init(
    logs: tuple[Path, ...], robot: str | None, out: Path, force: bool, as_json: bool, quiet: bool
) -> None:
    """Draft a first experiment file from logs: guess instruments, columns, units and rates, and say
    what to check.

    LOG is a file of any format, or a folder with files in it or one level below.
    """
    if robot is None:
        from steelyard.robot.file import bundled_names

        raise InputError(
            f"--robot: expected one of {', '.join(bundled_names())}, or a robot file, found none;"
            " name it ('steelyard new' writes a robot file to fill in, 'steelyard import' makes"
            " one from other programs' files)"
        )
    from steelyard.drafts.first_file import init as written
    from steelyard.report.documents.draft import draft_document

    with progress(quiet=quiet) as tell:
        found = written(logs, robot, out, tell, force=force)
    values = _values(found, out)
    print_result(values, draft_document(values), as_json=as_json)


def _values(found: Draft, out: Path) -> dict[str, Any]:
    """What was guessed, as plain values."""
    from steelyard.drafts.draft import describe

    return {
        "experiment": str(out),
        "instruments": {name: dict(keys) for name, keys in found.instruments.items()},
        "runs": {
            run.name: {
                "static": run.static,
                "clocks_agree": run.agree,
                "why": run.why,
                "streams": {name: describe(stream) for name, stream in run.streams.items()},
            }
            for run in found.runs
        },
        "unused": [{"log": each.log, "what": each.what} for each in found.unused],
    }
