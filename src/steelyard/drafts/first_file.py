"""A first experiment file on disk, once it has been seen that it can be read."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from steelyard.drafts.draft import Draft, Progress, draft
from steelyard.drafts.text import SCHEMA, as_text
from steelyard.errors import InputError
from steelyard.experiment.read import read_experiment
from steelyard.output import check_file_target, results_file, write_file
from steelyard.robot.file import bundled_names, read_robot
from steelyard.robot.model import Robot


def init(
    logs: Sequence[str | Path] | str | Path,
    robot: str | Path,
    out: str | Path,
    progress: Progress | None = None,
    *,
    force: bool = False,
) -> Draft:
    """Draft a first experiment file from logs: guess instruments, columns, units and rates.

    Args:
        logs: Files of any format, or folders with files in them or one level below.
        robot: A bundled name or a robot file.
        out: Experiment file to write; comments in it say what was guessed and what to check.
        progress: Called with what is being done and the fraction that is done.
        force: Whether to replace the file.

    Raises:
        InputError: A log is not there, no run has both forces and motion, or the file cannot be
            written.
    """
    places = [logs] if isinstance(logs, str | os.PathLike) else logs
    robot, out = str(robot), Path(out)
    check_file_target(out, force=force)
    model = read_robot(robot)
    found = draft([Path(each) for each in places], model, progress)
    with results_file(out, force=force) as fresh:
        # What `identify` would refuse must not be written: it is read once, from a place beside its
        # own.
        trial = fresh.parent / "trial.yaml"
        write_file(trial, _text(found, model, robot, out, trial.parent))
        try:
            read_experiment(trial)
        except InputError as error:
            raise InputError(
                error.on_command_line.replace(f"{trial.parent}/../../", "").replace(
                    f"{trial}", f"{out}"
                )
            ) from None
        trial.unlink()
        write_file(fresh, _text(found, model, robot, out, out.resolve().parent))
    return found


def _text(found: Draft, model: Robot, robot: str, out: Path, folder: Path) -> str:
    """The file, with paths as of a folder."""
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
