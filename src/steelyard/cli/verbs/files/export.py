"""The verb `export`."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from steelyard.cli.options import common, force_option, out_option, pose_option
from steelyard.cli.printing import in_lines, print_json
from steelyard.errors import InputError

if TYPE_CHECKING:
    from steelyard.exports.hanging import Hanging


class Format(click.Choice[str]):
    """A format of this package, or of another that provides one of the name."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """The name, once it is known."""
        from steelyard.plugins.provided import names

        if value not in self.choices and value in names("exports"):
            return str(value)
        return super().convert(value, param, ctx)


@click.command(short_help="Write the platform for a simulator or controller.")
@click.argument("estimate")
@click.option(
    "--format",
    "format_",
    type=Format(
        [
            *("urdf", "sdf", "mjcf", "yaml", "json", "c", "iec61131", "kuka", "abb", "ur"),
            *("franka", "ros"),
        ]
    ),
    help="Of the file: ROS, Pinocchio; Gazebo; MuJoCo; as in a robot file; the same; a C header;"
    " PLCs; load data of KUKA and ABB; payload of Universal Robots, Franka;"
    " geometry_msgs/InertiaStamped. Default: what the ending of --out says.",
)
@click.option("--method", metavar="NAME", help="Which estimate of the file. Default: its result.")
@out_option(help="The file to write; - prints it.", required=True, metavar="FILE")
@click.option(
    "--link",
    default="platform",
    show_default=True,
    metavar="NAME",
    help="urdf, sdf, mjcf, ros: what the body is called.",
)
@click.option(
    "--anyway",
    is_flag=True,
    help=(
        "Also an estimate that is not accepted, a baseline that was not assessed or a body that"
        " cannot exist, with a comment."
    ),
)
@click.option(
    "--robot",
    metavar="ROBOT",
    help="mjcf: the robot with its cables too; a bundled name or a robot file.",
)
@pose_option(
    "--pose",
    help="--robot: where it hangs at rest [m], [deg]. Default: level, about the middle.",
)
@force_option(help="Replace a file of the same name.")
@common
def export(
    estimate: str,
    format_: str | None,
    method: str | None,
    out: Path,
    link: str,
    anyway: bool,
    robot: str | None,
    pose: tuple[float, ...] | None,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Write the identified platform for a simulator or controller, with its verdict and the
    convention as comments.

    ESTIMATE is an estimate.json or a folder with one, with :METHOD behind it for one of its
    methods.
    """
    import numpy as np

    from steelyard.exports.exported import check, read_exported
    from steelyard.exports.formats import export as exported_text
    from steelyard.exports.formats import form_of, format_of
    from steelyard.exports.hanging import hang
    from steelyard.output import check_file_target, results_file, write_file
    from steelyard.robot.file import read_robot

    printed = str(out) == "-"
    if format_ is None and printed:
        raise InputError("--format: expected one with --out -, found none; name the format")
    if printed and as_json:
        raise InputError("--json: expected a file to write beside it, found --out -; name a file")
    format_ = format_of(out) if format_ is None else format_
    if link != "platform" and not form_of(format_).linked:
        raise InputError(
            f"--link: expected a format with names of bodies, found {format_}; leave --link out"
        )
    if robot is not None and format_ != "mjcf":
        raise InputError(
            f"--robot: expected --format mjcf, the only one with cables, found {format_}; leave"
            " one out"
        )
    if pose is not None and robot is None:
        raise InputError(
            "--pose: expected --robot beside it, found none; leave --pose out or name the robot"
        )
    if not printed:
        check_file_target(out, force=force)
    exported = replace(read_exported(estimate, method), link=link)
    if not printed and exported.path is not None and out.exists() and out.samefile(exported.path):
        raise InputError(
            f"{out}: expected another file than the estimate that is read, found it; choose another"
            " with --out"
        )
    form = form_of(format_)
    check(exported, title=form.title, whole=form.whole, anyway=anyway)
    hanging = None
    if robot is not None:
        radians = None if pose is None else [*pose[:3], *np.radians(pose[3:])]
        hanging = hang(read_robot(robot), exported.body, radians)
    text = exported_text(exported, format_, anyway=anyway, hanging=hanging)
    if printed:
        print(text, end="")
        return
    with results_file(out, force=force) as path:
        write_file(path, text)
    if as_json:
        values: dict[str, Any] = {
            "written": str(out),
            "format": format_,
            "convention": form.convention,
            "method": exported.estimate.method,
            "experiment": exported.experiment,
            "accepted": exported.estimate.verdict.accepted,
            "physical": exported.estimate.physical,
            "reasons": list(exported.doubts),
            "unknown": list(exported.unidentifiable),
        }
        if hanging is not None:
            values["robot"] = _robot(hanging)
        print_json(values)
        return
    # A body that cannot exist is not accepted, whatever the file says.
    verdict = exported.estimate.verdict
    said = "not accepted" if verdict.accepted else verdict.short
    doubts = f"; {said.upper()}: {'; '.join(exported.doubts)}" if exported.doubts else ""
    on = "" if hanging is None else f" on the {hanging.robot.m} cables of {hanging.robot.name}"
    said = f"{out}: '{exported.estimate.method}'{on} as {form.title}, {form.convention}{doubts}"
    print(in_lines(said, sys.stdout))


def _robot(hanging: Hanging) -> dict[str, Any]:
    """The robot at rest as plain values, SI."""
    return {
        "name": hanging.robot.name,
        "position": hanging.position.tolist(),
        "quaternion": hanging.quaternion.tolist(),
        "tension": hanging.tension.tolist(),
        "length": hanging.length.tolist(),
        "stiffness": hanging.stiffness.tolist(),
    }
