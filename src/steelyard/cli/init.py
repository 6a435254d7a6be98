"""The verb that drafts a first experiment file from logs."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.table import Table
from rich.text import Text

from steelyard.cli.progress import progress
from steelyard.cli.verbs import print_json
from steelyard.drafts.draft import Draft, describe, draft
from steelyard.drafts.text import SCHEMA, as_text
from steelyard.errors import InputError
from steelyard.experiment.read import read_experiment
from steelyard.output import check_file_target, results_file
from steelyard.report.terminal import console
from steelyard.robot.file import bundled_names, read_robot
from steelyard.robot.model import Robot


def run_init(
    logs: Sequence[Path], robot: str, out: Path, *, force: bool, as_json: bool, quiet: bool
) -> None:
    """Guess the experiment that logs were recorded in, and write its file."""
    check_file_target(out, force=force)
    model = read_robot(robot)
    with progress(quiet=quiet) as tell:
        found = draft(logs, model, tell)
    with results_file(out, force=force) as fresh:
        # What `identify` would refuse must not be written: it is read once, from a place beside its
        # own.
        trial = fresh.parent / "trial.yaml"
        trial.write_text(_text(found, model, robot, out, trial.parent), encoding="utf-8")
        try:
            read_experiment(trial)
        except InputError as error:
            raise InputError(
                f"{error}".replace(f"{trial.parent}/../", "").replace(f"{trial}", f"{out}")
            ) from None
        trial.unlink()
        fresh.write_text(
            _text(found, model, robot, out, out.resolve().parent), encoding="utf-8", newline="\n"
        )
    values = _values(found, out)
    if as_json:
        print_json(values)
    else:
        _show(values)


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


def _values(found: Draft, out: Path) -> dict[str, Any]:
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


def _show(values: dict[str, Any]) -> None:
    screen = console()
    table = Table(
        title=Text(f"{values['experiment']}"),
        title_justify="left",
        title_style="bold",
        header_style="bold",
    )
    for heading in ("run", "instrument", "log", "columns", "units", "rate", "samples"):
        table.add_column(heading, justify="right" if heading in {"rate", "samples"} else "left")
    checks: dict[str, None] = {}
    for run, entry in values["runs"].items():
        for name, stream in entry["streams"].items():
            log = stream["log"] if stream["topic"] is None else f"{stream['log']} {stream['topic']}"
            units = ", ".join(dict.fromkeys(stream["units"].values())) or "SI"
            rate = (
                "at rest"
                if entry["static"]
                else ""
                if stream["rate"] is None
                else f"{stream['rate']:g} Hz"
            )
            cells = [
                run,
                f"{name} ({stream['kind']})",
                log,
                _columns(stream["columns"]),
                units,
                rate,
                str(stream["samples"]),
            ]
            table.add_row(*(Text(_seen(cell)) for cell in cells))
            checks.update(dict.fromkeys(f"{name}: {check}" for check in stream["check"]))
        if not entry["static"]:
            word = "the clocks agree" if entry["clocks_agree"] else "sync: auto"
            checks[f"run '{run}': {word}: {entry['why']}"] = None
    screen.print(table)
    for each in values["unused"]:
        screen.print(Text(_seen(f"not used: {each['log']}: {each['what']}")))
    for check in checks:
        screen.print(Text(_seen(f"check: {check}")))
    screen.print(
        Text(
            _seen(
                "Fill in where the instruments sit (position, rpy_deg, target), then: steelyard"
                " inspect " + values["experiment"]
            )
        )
    )


def _columns(names: Sequence[str]) -> str:
    return " ".join(names) if len(names) < 5 else f"{names[0]} {names[1]} … {names[-1]}"


def _seen(text: str) -> str:
    """Text of a file with nothing in it that steers a terminal."""
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)[:400]
