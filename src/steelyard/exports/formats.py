"""The formats of an export: the one table of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from steelyard.errors import InputError
from steelyard.exports import c_header, mjcf, plain, sdf, urdf
from steelyard.exports.controllers import abb, iec61131, kuka, messages
from steelyard.exports.exported import Exported, check
from steelyard.exports.hanging import Hanging
from steelyard.plugins.provided import names, provided


@dataclass(frozen=True)
class ExportFormat:
    """A form in which a body is written."""

    title: str
    convention: str
    """In a few words, for the terminal."""
    write: Callable[[Exported], str]
    whole: bool
    """Whether it has no place for numbers that are not known."""
    endings: tuple[str, ...] = ()
    """Of files that are of this format and no other."""
    linked: bool = False
    """Whether it names the body."""


_MATRIX = (
    "inertia about the centre of gravity in platform axes, products are elements of the matrix"
)
_LINK = f"link frame = platform frame, {_MATRIX}"
_BODY = f"body frame = platform frame, {_MATRIX}, order xx yy zz xy xz yz"
_ROBOT_FILE = f"as 'platform' of a robot file, {_MATRIX}, order xx yy zz yz xz xy"
_ARRAYS = f"platform frame, {_MATRIX}, order xx yy zz yz xz xy"
_PRINCIPAL = (
    "platform frame for the flange, mm, principal moments about the centre of gravity and their"
    " axes"
)
_FLANGE = f"platform frame for the flange, {_MATRIX}"

FORMATS = {
    "urdf": ExportFormat(urdf.TITLE, _LINK, urdf.write, True, (".urdf",), linked=True),
    "sdf": ExportFormat(sdf.TITLE, _LINK, sdf.write, True, (".sdf",), linked=True),
    "mjcf": ExportFormat(mjcf.TITLE, _BODY, mjcf.write, True, (".mjcf",), linked=True),
    "yaml": ExportFormat("YAML", _ROBOT_FILE, plain.write_yaml, False, (".yaml", ".yml")),
    "json": ExportFormat("JSON", _ROBOT_FILE, plain.write_json, False, (".json",)),
    "c": ExportFormat(c_header.TITLE, _ARRAYS, c_header.write, True, (".h", ".hpp")),
    "iec61131": ExportFormat(iec61131.TITLE, _ARRAYS, iec61131.write, True, (".st",)),
    "kuka": ExportFormat(kuka.TITLE, _PRINCIPAL, kuka.write, True, (".dat",)),
    "abb": ExportFormat(abb.TITLE, _PRINCIPAL, abb.write, True, (".mod", ".sys")),
    "ur": ExportFormat(messages.UR_TITLE, _FLANGE, messages.write_ur, True, (".script",)),
    "franka": ExportFormat(messages.FRANKA_TITLE, _FLANGE, messages.write_franka, whole=True),
    "ros": ExportFormat(messages.ROS_TITLE, _LINK, messages.write_ros, whole=True, linked=True),
}


def form_of(name: str) -> ExportFormat:
    """A format by its name, of this or another package.

    Raises:
        InputError: There is none.
    """
    if name in FORMATS:
        return FORMATS[name]
    found = provided("exports", name)
    if not isinstance(found, ExportFormat):
        raise InputError(
            f"format: expected one of {', '.join([*FORMATS, *names('exports')])}, found '{name}';"
            " choose one of these"
        )
    return found


def format_of(path: Path) -> str:
    """The format of a file by its ending.

    Args:
        path: Where it is to be written.

    Raises:
        InputError: No format has this ending alone.
    """
    ending = path.suffix.lower()
    for name, form in FORMATS.items():
        if ending in form.endings:
            return name
    raise InputError(
        f"{path}: expected an ending that says the format"
        f" ({', '.join(e for form in FORMATS.values() for e in form.endings)}), found"
        f" '{ending or 'none'}'; choose the format: {', '.join(FORMATS)}"
    )


def export(
    exported: Exported, format_: str, *, anyway: bool = False, hanging: Hanging | None = None
) -> str:
    """An estimate as the text of a file.

    Args:
        exported: The estimate.
        format_: Key of :data:`FORMATS`.
        anyway: Whether also an estimate that is not accepted, or of a body that cannot exist.
        hanging: The same body on its robot, MJCF only.

    Raises:
        InputError: See :func:`steelyard.exports.exported.check`.
    """
    form = form_of(format_)
    check(exported, title=form.title, whole=form.whole, anyway=anyway)
    if hanging is None:
        return form.write(exported)
    if format_ != "mjcf":
        raise InputError(
            f"--robot: expected --format mjcf, the only one with cables, found {format_}; leave"
            " one out"
        )
    return mjcf.write_robot(exported, hanging)
