"""The verb `new`."""

from __future__ import annotations

from pathlib import Path

import click

from steelyard.cli.options import common, force_option
from steelyard.cli.printing import print_json


@click.command(short_help="A folder with robot, sensors and experiment to fill in.")
@click.argument("name", type=click.Path(path_type=Path))
@click.option("--cables", type=int, default=8, show_default=True, help="Of the robot.")
@force_option()
@common
def new(name: Path, cables: int, force: bool, as_json: bool, quiet: bool) -> None:
    """Write a folder NAME with a robot file, sensors and an experiment to fill in, with
    comments.
    """
    from steelyard.drafts.blank import new as written

    paths = written(name, cables, force=force)
    if as_json:
        print_json({"written": [str(path) for path in paths]})
        return
    robot, sensors, experiment = paths
    print(f"{robot}: where the cables are fixed; every [] is to be filled in")
    print(f"{sensors}: what the data sheets say, to simulate and to design")
    print(f"{experiment}: what was recorded, and where the logs are")
    print("Then look at what they say:")
    print(f"  steelyard robots {robot} --out {name / 'robot.html'}")
    print(f"  steelyard inspect {experiment}")
