"""The formats of an export: the one table of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from steelyard.errors import InputError
from steelyard.exports import c_header, mjcf, plain, sdf, urdf
from steelyard.exports.exported import Exported, check
from steelyard.exports.hanging import Hanging


@dataclass(frozen=True)
class ExportFormat:
    """A form in which a body is written."""

    title: str
    convention: str
    """In a few words, for the terminal."""
    write: Callable[[Exported], str]
    whole: bool
    """Whether it has no place for numbers that are not known."""


_MATRIX = (
    "inertia about the centre of gravity in platform axes, products are elements of the matrix"
)
_LINK = f"link frame = platform frame, {_MATRIX}"
_BODY = f"body frame = platform frame, {_MATRIX}, order xx yy zz xy xz yz"
_ROBOT_FILE = f"as 'platform' of a robot file, {_MATRIX}, order xx yy zz yz xz xy"
_ARRAYS = f"platform frame, {_MATRIX}, order xx yy zz yz xz xy"

FORMATS = {
    "urdf": ExportFormat(urdf.TITLE, _LINK, urdf.write, whole=True),
    "sdf": ExportFormat(sdf.TITLE, _LINK, sdf.write, whole=True),
    "mjcf": ExportFormat(mjcf.TITLE, _BODY, mjcf.write, whole=True),
    "yaml": ExportFormat("YAML", _ROBOT_FILE, plain.write_yaml, whole=False),
    "json": ExportFormat("JSON", _ROBOT_FILE, plain.write_json, whole=False),
    "c": ExportFormat(c_header.TITLE, _ARRAYS, c_header.write, whole=True),
}


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
    if format_ not in FORMATS:
        raise InputError(
            f"format: expected one of {', '.join(FORMATS)}, found '{format_}'; choose one of these"
        )
    form = FORMATS[format_]
    check(exported, title=form.title, whole=form.whole, anyway=anyway)
    if hanging is None:
        return form.write(exported)
    if format_ != "mjcf":
        raise InputError(
            f"--robot: expected --format mjcf, the only one with cables, found {format_}; leave"
            " one out"
        )
    return mjcf.write_robot(exported, hanging)
