"""The verb `robots`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from steelyard.cli.options import common
from steelyard.cli.printing import print_json

if TYPE_CHECKING:
    from steelyard.robot.model import Robot


@click.command()
@click.argument("name", required=False)
@common
def robots(name: str | None, as_json: bool, quiet: bool) -> None:
    """List the bundled robots, or print NAME as a robot file."""
    from steelyard.robot.file import bundled_names, bundled_text, read_robot, robot_file

    if name is not None:
        text = bundled_text(name)
        if as_json:
            print_json(robot_file(read_robot(name)))
        else:
            print(text.rstrip("\n"))
        return
    bundled = {each: read_robot(each) for each in bundled_names()}
    if as_json:
        entries = [
            {"name": each, "cables": robot.m, "mass": _mass(robot)}
            for each, robot in bundled.items()
        ]
        print_json({"robots": entries})
        return
    for each, robot in bundled.items():
        print(f"{each:16} {robot.m} cables, nominal platform {_mass(robot) or 0:.3f} kg")


def _mass(robot: Robot) -> float | None:
    return None if robot.platform is None else robot.platform.mass
