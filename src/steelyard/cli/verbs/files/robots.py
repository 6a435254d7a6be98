"""The verb `robots`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from steelyard.cli.options import common, force_option, out_option
from steelyard.cli.printing import print_json, say

if TYPE_CHECKING:
    from steelyard.robot.model import Robot


@click.command(short_help="List bundled robots; print one; check and draw your own.")
@click.argument("name", required=False)
@out_option(
    help="FILE.html: a page with a picture of NAME; FILE.yaml or FILE.json: its robot file, to"
    " copy from. Without NAME: a folder with a page for each robot."
)
@force_option()
@common
def robots(name: str | None, out: Path | None, force: bool, as_json: bool, quiet: bool) -> None:
    """List the bundled robots, print one as a robot file, or check a robot file of your own.

    NAME is a bundled name or a robot file.
    """
    from steelyard.robot.file import bundled_names, bundled_text, read_robot, robot_file

    bundled = bundled_names()
    if name is not None:
        robot = read_robot(name)
        written = None if out is None else _write(robot, name, out, force=force)
        if as_json:
            print_json(robot_file(robot))
        elif name in bundled and out is None:
            print(bundled_text(name).rstrip("\n"))
        else:
            _check(robot, name)
        if written is not None and not as_json:
            print(f"{out}: {written}")
        return
    every = {each: read_robot(each) for each in bundled}
    if out is not None:
        _draw_all(every, out, force=force)
    if as_json:
        entries = [
            {"name": each, "cables": robot.m, "mass": _mass(robot)} for each, robot in every.items()
        ]
        print_json({"robots": entries})
        return
    for each, robot in every.items():
        print(f"{each:16} {robot.m} cables, nominal platform {_mass(robot) or 0:.3f} kg")
    if out is not None:
        say(f"{out}: a page with a picture of each, such as {out / next(iter(every))}.html")


def _check(robot: Robot, name: str) -> None:
    """Say what stands in a robot file."""
    from steelyard.report.documents.robot import robot_document
    from steelyard.report.forms.terminal import show

    show(robot_document(robot))
    print(f"{name}: a robot file that can be used")


def _write(robot: Robot, name: str, out: Path, *, force: bool) -> str:
    """Write a page or a robot file, by the ending of the name; what it is, in words.

    Raises:
        InputError: Another ending.
    """
    from steelyard.errors import InputError
    from steelyard.output import check_file_target, results_file, write_file

    ending = out.suffix.lower()
    if ending not in {".html", ".yaml", ".yml", ".json"}:
        raise InputError(
            f"--out {out}: expected FILE.html (a page with a picture) or FILE.yaml or FILE.json "
            f"(the robot file), found {ending or 'no ending'!r}"
        )
    check_file_target(out, force=force)
    text, what = _contents(robot, name, ending)
    with results_file(out, force=force) as fresh:
        write_file(fresh, text)
    return what


def _contents(robot: Robot, name: str, ending: str) -> tuple[str, str]:
    """The text of the file and what it is."""
    if ending == ".html":
        from steelyard.report.documents.robot import robot_document
        from steelyard.report.forms.page import page

        return page(robot_document(robot)), "a picture of it, with its table"
    from steelyard.files.yaml_file import to_yaml
    from steelyard.output import to_json
    from steelyard.robot.file import bundled_names, bundled_text, robot_file

    if ending == ".json":
        return to_json(robot_file(robot)) + "\n", "its robot file"
    text = bundled_text(name) if name in bundled_names() else to_yaml(robot_file(robot))
    return text, "its robot file, to copy from"


def _draw_all(robots: dict[str, Robot], out: Path, *, force: bool) -> None:
    """Write a page for each."""
    from steelyard.output import results_folder, write_file
    from steelyard.report.documents.robot import robot_document
    from steelyard.report.forms.page import page

    with results_folder(out, force=force) as folder:
        for name, robot in robots.items():
            text = page(robot_document(robot))
            write_file(folder / f"{name}.html", text)


def _mass(robot: Robot) -> float | None:
    return None if robot.platform is None else robot.platform.mass
