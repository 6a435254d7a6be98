"""The formats that are understood, and the way from files to a robot file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from steelyard.errors import InputError
from steelyard.imports import body_model, caspr, cdpyr, hangprinter, irma, ros, wirecenter
from steelyard.imports.assemble import assemble
from steelyard.imports.description import Convention, Description, Point
from steelyard.imports.imported import Imported
from steelyard.imports.sources import Source, printable, read_source
from steelyard.imports.text_file import TextFile
from steelyard.imports.xml_file import Element
from steelyard.robot.file import read_robot
from steelyard.robot.model import Robot

_MOST_NAMED = 6
"""Files that a message names."""


@dataclass(frozen=True)
class RobotFormat:
    """One format."""

    recognises: Callable[[Source], bool]
    """Whether a file is of it, by what stands in it."""
    describe: Callable[[Sequence[Source], str | None], Description]
    """From its files and the set of cables that was asked for to what they say."""
    signs: str
    """By what one knows it, for messages."""
    has_sets: bool = False
    """Whether a robot may have several sets of cables."""


FORMATS = {
    caspr.NAME: RobotFormat(
        caspr.recognises, caspr.describe, "roots 'bodies_system' and 'cables'", has_sets=True
    ),
    irma.NAME: RobotFormat(irma.recognises, irma.describe, "'actuator' with 'pos_OD_glob'"),
    cdpyr.NAME: RobotFormat(
        cdpyr.recognises, cdpyr.describe, "'frame', 'platforms' and 'kinematic_chains'"
    ),
    wirecenter.NAME: RobotFormat(
        wirecenter.recognises, wirecenter.describe, "root 'models' with 'robot', .wcrfx"
    ),
    ros.NAME: RobotFormat(ros.recognises, ros.describe, "'points' with 'frame' and 'platform'"),
    hangprinter.NAME: RobotFormat(
        hangprinter.recognises, hangprinter.describe, "'M669 K6' or 'anchor_x' in .g or .cfg"
    ),
    body_model.NAME: RobotFormat(
        body_model.recognises, body_model.describe, "roots 'robot' and 'mujoco', with --robot"
    ),
}


def import_robot(
    paths: Sequence[str | Path],
    *,
    products: Convention | None = None,
    about: Point | None = None,
    cable_set: str | None = None,
    robot: Robot | str | Path | None = None,
) -> Imported:
    """Make a robot file of the files of another program.

    Args:
        paths: Files of one robot, in any order.
        products: What the products of inertia are, above what the format says.
        about: About which point the inertia is, where the format does not say.
        cable_set: Which cables, where the files have several sets of them.
        robot: Whose platform the files describe, where they say nothing of cables.

    Raises:
        InputError: A file is wrong or of no known format, this can be no robot file, or something
            must be said that the files do not say.
    """
    sources = [read_source(Path(path)) for path in paths]
    names = [_format_of(source) for source in sources]
    for source, name in zip(sources, names, strict=True):
        if name != names[0]:
            raise InputError(
                f"{source.path}: expected files of one robot, found {name} beside {names[0]};"
                " import one robot at a time"
            )
    chosen = FORMATS[names[0]]
    if cable_set is not None and not chosen.has_sets:
        raise InputError(
            f"--cables: expected none, as {names[0]} has one set of cables, found"
            f" '{printable(cable_set)}'; leave it out"
        )
    description = chosen.describe(sources, cable_set)
    if robot is not None and description.cables:
        raise InputError(
            f"--robot: expected none, as {names[0]} has cables of its own, found one; leave it out"
        )
    owner = robot if robot is None or isinstance(robot, Robot) else read_robot(robot)
    return assemble(description, products=products, about=about, robot=owner)


def _format_of(source: Source) -> str:
    for name, each in FORMATS.items():
        if each.recognises(source):
            return name
    known = ", ".join(f"{name} ({each.signs})" for name, each in FORMATS.items())
    raise InputError(
        f"{source.path}: expected one of {known}, found {_content(source)}; check the file"
    )


def _content(source: Source) -> str:
    if isinstance(source, Element):
        return f"XML with the root '{printable(source.tag)}'"
    if isinstance(source, TextFile):
        return "lines without anchors"
    if isinstance(source.data, dict):
        keys = [f"'{printable(key)}'" for key in list(source.data)[:_MOST_NAMED]]
        return f"the keys {', '.join(keys)}" if keys else "no keys"
    return "no mapping of keys to values"
