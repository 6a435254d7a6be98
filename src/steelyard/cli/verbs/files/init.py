"""The verb `init`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from steelyard.cli.options import common, force_option, out_option
from steelyard.cli.printing import print_result, progress
from steelyard.errors import InputError

if TYPE_CHECKING:
    from steelyard.drafts.draft import Draft
    from steelyard.robot.model import Robot


@click.command()
@click.argument("logs", nargs=-1, required=True, metavar="LOG...", type=click.Path(path_type=Path))
@click.option("--robot", required=True, help="A bundled name or a robot file.")
@out_option(help="Experiment file to write.", required=True)
@force_option(help="Replace the file.")
@common
def init(
    logs: tuple[Path, ...], robot: str, out: Path, force: bool, as_json: bool, quiet: bool
) -> None:
    """Draft a first experiment file from logs: guess instruments, columns, units and rates, and say
    what to check.

    LOG is a file of any format, or a folder with files in it or one level below.
    """
    with progress(quiet=quiet) as tell:
        from steelyard.drafts.draft import draft
        from steelyard.experiment.read import read_experiment
        from steelyard.output import check_file_target, results_file, write_file
        from steelyard.report.documents.draft import draft_document
        from steelyard.robot.file import read_robot

        check_file_target(out, force=force)
        model = read_robot(robot)
        found = draft(logs, model, tell)
    with results_file(out, force=force) as fresh:
        # What `identify` would refuse must not be written: it is read once, from a place beside its
        # own.
        trial = fresh.parent / "trial.yaml"
        write_file(trial, _text(found, model, robot, out, trial.parent))
        try:
            read_experiment(trial)
        except InputError as error:
            raise InputError(
                f"{error}".replace(f"{trial.parent}/../../", "").replace(f"{trial}", f"{out}")
            ) from None
        trial.unlink()
        write_file(fresh, _text(found, model, robot, out, out.resolve().parent))
    values = _values(found, out)
    print_result(values, draft_document(values), as_json=as_json)


def _text(found: Draft, model: Robot, robot: str, out: Path, folder: Path) -> str:
    """The file, with paths as of a folder."""
    from steelyard.drafts.text import SCHEMA, as_text
    from steelyard.robot.file import bundled_names

    home = out.resolve().parent
    paths = {found_in.place.path for run in found.runs for found_in in run.streams.values()}
    return as_text(
        found,
        model,
        name=_name(home),
        robot_place=robot if robot in bundled_names() else _relative(Path(robot), folder),
        files={str(path): _relative(path, folder) for path in paths},
        with_schema=(home / SCHEMA).is_file(),
    )


def _name(folder: Path) -> str:
    return os.fsencode(folder.name).decode(errors="replace") or "experiment"


def _relative(path: Path, folder: Path) -> str:
    """A path relative to the folder of the file that names it."""
    relative = Path(os.path.relpath(path.resolve(), folder)).as_posix()
    try:
        relative.encode()
    except UnicodeEncodeError:
        raise InputError(
            f"{path}: expected a path that is text, found other bytes; rename it"
        ) from None
    return relative


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
