"""The verb that makes a robot file of the files of another program."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from steelyard.errors import InputError
from steelyard.imports.formats import import_robot
from steelyard.output import check_file_target, results_file, to_json
from steelyard.robot.file import read_robot


def run_import(
    files: Sequence[Path],
    out: Path,
    *,
    products: Any,
    about: Any,
    cable_set: str | None,
    force: bool,
    as_json: bool,
) -> None:
    """Write a robot file, and tell what was taken for what, left out and assumed."""
    check_file_target(out, force=force)
    imported = import_robot(files, products=products, about=about, cable_set=cable_set)
    if any(out.exists() and out.samefile(path) for path in imported.files):
        raise InputError(
            f"{out}: expected another file than those that are read, found one of them; choose"
            " another with --out"
        )
    with results_file(out, force=force) as path:
        path.write_text(imported.to_text(), encoding="utf-8", newline="\n")
        # What is published is what can be read.
        read_robot(str(path))
    if as_json:
        print(to_json({"robot": str(out), **imported.to_dict()}, ascii_only=True))
        return
    robot = imported.robot
    print(
        f"{out}: {robot.name}, {robot.m} cable{'s' if robot.m > 1 else ''}, from {imported.format}"
    )
    for note in imported.notes:
        print(f"  {note}")
