"""The verb that gives the platform to a simulator or controller."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.cli.verbs import print_json
from steelyard.errors import InputError
from steelyard.exports.exported import check, read_exported
from steelyard.exports.formats import FORMATS, export
from steelyard.exports.hanging import Hanging, hang
from steelyard.output import check_file_target, results_file
from steelyard.robot.file import read_robot


def run_export(
    place: str,
    out: Path,
    *,
    format_: str,
    method: str | None,
    anyway: bool,
    robot: str | None,
    pose: Sequence[float] | None,
    force: bool,
    as_json: bool,
) -> None:
    """Write an estimate in a format."""
    if robot is not None and format_ != "mjcf":
        raise InputError(
            f"--robot: expected --format mjcf, the only one with cables, found {format_}; leave"
            " one out"
        )
    if pose is not None and robot is None:
        raise InputError(
            "--pose: expected --robot beside it, found none; leave --pose out or name the robot"
        )
    check_file_target(out, force=force)
    exported = read_exported(place, method)
    if exported.path is not None and out.exists() and out.samefile(exported.path):
        raise InputError(
            f"{out}: expected another file than the estimate that is read, found it; choose another"
            " with --out"
        )
    form = FORMATS[format_]
    check(exported, title=form.title, whole=form.whole, anyway=anyway)
    hanging = None
    if robot is not None:
        radians = None if pose is None else [*pose[:3], *np.radians(pose[3:])]
        hanging = hang(read_robot(robot), exported.body, radians)
    text = export(exported, format_, anyway=anyway, hanging=hanging)
    with results_file(out, force=force) as path:
        path.write_text(text, encoding="utf-8", newline="\n")
    if as_json:
        print_json(
            {
                "written": str(out),
                "format": format_,
                "convention": form.convention,
                "method": exported.estimate.method,
                "experiment": exported.experiment,
                "accepted": exported.estimate.verdict.accepted,
                "physical": exported.estimate.physical,
                "reasons": list(exported.doubts),
                "unknown": list(exported.untold),
                **({} if hanging is None else {"robot": _robot(hanging)}),
            }
        )
        return
    doubts = f"; NOT ACCEPTED: {'; '.join(exported.doubts)}" if exported.doubts else ""
    on = "" if hanging is None else f" on the {hanging.robot.m} cables of {hanging.robot.name}"
    print(f"{out}: '{exported.estimate.method}'{on} as {form.title}, {form.convention}{doubts}")


def _robot(hanging: Hanging) -> dict[str, Any]:
    return {
        "name": hanging.robot.name,
        "position": hanging.position.tolist(),
        "quaternion": hanging.quaternion.tolist(),
        "tension": hanging.tension.tolist(),
        "length": hanging.length.tolist(),
        "stiffness": hanging.stiffness.tolist(),
    }
