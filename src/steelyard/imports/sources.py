"""Files of other programs as data, whatever they are called: XML, or JSON and YAML, of which one
reader is enough.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict

from steelyard import display
from steelyard.errors import InputError
from steelyard.files.document import YamlDocument
from steelyard.files.file_model import FileModel
from steelyard.files.regular_file import require_file
from steelyard.files.yaml_file import read_yaml
from steelyard.imports.description import Vector
from steelyard.imports.text_file import ENDINGS, TextFile, read_lines
from steelyard.imports.xml_file import Element, read_xml

Source = Element | YamlDocument | TextFile

_HEAD = 1024
"""Bytes that show whether a file is XML."""
_MOST_NAMED = 12
"""Keys that a note names."""
_LONGEST_TEXT = 60
"""Characters of a text from a file in a message."""


class ForeignModel(FileModel):
    """Base of what is expected of the file of another program: it may hold more than is read."""

    model_config = ConfigDict(extra="allow")


def _flat(value: Any) -> Any:
    """A column ((x,), (y,), (z,)) as (x, y, z)."""
    if isinstance(value, tuple) and all(
        isinstance(entry, tuple) and len(entry) == 1 for entry in value
    ):
        return tuple(entry[0] for entry in value)
    return value


Column = Annotated[Vector, BeforeValidator(_flat)]
"""Three numbers, in a list or as a matrix of one column."""

Matrix = tuple[Vector, Vector, Vector]


def read_source(path: Path) -> Source:
    """Read a file of another program.

    Raises:
        InputError: It is not there, not a regular file, too large, or neither XML nor JSON nor
            YAML.
    """
    require_file(path)
    if path.suffix.lower() in ENDINGS:
        return read_lines(path)
    with path.open("rb") as file:
        head = file.read(_HEAD)
    utf_16 = head.startswith((b"\xff\xfe", b"\xfe\xff"))
    if utf_16 or head.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"<"):
        return read_xml(path)
    return read_yaml(path, "XML, JSON or YAML")


def only_document(sources: Sequence[Source], name: str) -> YamlDocument:
    """The one JSON or YAML file of a robot.

    Raises:
        InputError: There are several, or it is XML.
    """
    if len(sources) > 1:
        raise InputError(
            f"{sources[1].path}: expected one file of {name}, found {len(sources)}; import one at a"
            " time"
        )
    source = sources[0]
    if not isinstance(source, YamlDocument):
        raise InputError(
            f"{source.path}: expected JSON or YAML of {name}, found XML; check the path"
        )
    return source


def printable(text: str, longest: int = _LONGEST_TEXT) -> str:
    """Text of a file in one line that steers no terminal and ends no comment."""
    line = display.printable(text)
    return line if len(line) <= longest else f"{line[: longest - 1]}…"


def unread(model: BaseModel) -> tuple[str, ...]:
    """What a file holds beside what was expected of it, as a note."""
    keys = list(dict.fromkeys(_unread(model, "")))
    if not keys:
        return ()
    more = f" and {len(keys) - _MOST_NAMED} more" if len(keys) > _MOST_NAMED else ""
    return (f"not read: {', '.join(printable(key) for key in keys[:_MOST_NAMED])}{more}",)


def _unread(value: Any, key: str) -> list[str]:
    """Keys of a form and of those within it that are not read."""
    if isinstance(value, tuple):
        return [inner for entry in value for inner in _unread(entry, key)]
    if not isinstance(value, BaseModel):
        return []
    inside = f"{key}." if key else ""
    extra = [f"{inside}{name}" for name in value.model_extra or {}]
    return extra + [
        inner
        for name in type(value).model_fields
        for inner in _unread(getattr(value, name), inside + name)
    ]
