"""The verb `import`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from steelyard.cli.options import common, force_option, out_option
from steelyard.cli.printing import print_json, say
from steelyard.errors import InputError


@click.command("import", short_help="A robot file from those of other programs.")
@click.argument(
    "files", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="FILE..."
)
@out_option(help="The robot file to write.", required=True, metavar="ROBOT.yaml")
@click.option(
    "--products",
    type=click.Choice(["matrix", "integral"]),
    help=(
        "What the products of inertia are: elements of the inertia matrix, or +integral(x y dm)."
        " Default: what the format says; asked for where it does not."
    ),
)
@click.option(
    "--inertia-about",
    "about",
    type=click.Choice(["cog", "origin"]),
    help=(
        "About which point the inertia is, where the format does not say: the centre of gravity, or"
        " the origin of the platform frame."
    ),
)
@click.option(
    "--cables",
    "cable_set",
    metavar="NAME",
    help="CASPR: which set of cables. Default: the one that the file names.",
)
@click.option(
    "--robot",
    metavar="ROBOT",
    help="URDF, MJCF: the robot whose platform it is; a bundled name or a robot file.",
)
@force_option(help="Replace a file of the same name.")
@common
def import_(
    files: tuple[Path, ...],
    out: Path,
    products: Any,
    about: Any,
    cable_set: str | None,
    robot: str | None,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Make a robot file of FILE..., from CASPR XML (bodies and cables), WireCenter (.wcrfx), IRMA
    JSON, cdpyr, ROS-style YAML, the configuration of a cable printer, or a URDF or MJCF of the
    platform.

    The format is recognised by what stands in the files. What was taken for what, left out and
    assumed is said, also at the top of the robot file.
    """
    from steelyard.imports.formats import import_robot
    from steelyard.output import check_file_target, results_file, write_file
    from steelyard.robot.file import read_robot

    check_file_target(out, force=force)
    imported = import_robot(files, products=products, about=about, cable_set=cable_set, robot=robot)
    if any(out.exists() and out.samefile(path) for path in imported.files):
        raise InputError(
            f"{out}: expected another file than those that are read, found one of them; choose"
            " another with --out"
        )
    with results_file(out, force=force) as path:
        write_file(path, imported.to_text())
        # What is published is what can be read.
        read_robot(str(path))
    if as_json:
        print_json({"robot": str(out), **imported.to_dict()})
        return
    made = imported.robot
    plural = "" if made.m == 1 else "s"
    say(f"{out}: {made.name}, {made.m} cable{plural}, from {imported.format}")
    for note in imported.notes:
        say(note, "  ")
