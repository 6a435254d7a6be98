"""XML files from anyone: read as data with line numbers; entities and lists of attributes of
its own, the means of every attack by XML, are refused.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn
from xml.parsers import expat

from steelyard.errors import InputError
from steelyard.files.regular_file import require_file
from steelyard.imports.description import Vector

_LARGEST_FILE = 2**22
"""Bytes: models of robots have a hundredth of it."""
_MOST_ELEMENTS = 100_000
"""Of one file."""
_DEEPEST = 64
"""Elements within elements."""
_LARGEST_NUMBER = 1e15
"""Squares of larger numbers lose all digits of others."""


@dataclass(frozen=True)
class Element:
    """An element with what stands in it."""

    path: Path
    """Of the file."""
    line: int
    tag: str
    attributes: Mapping[str, str]
    text: str
    """Without that of the elements inside."""
    children: tuple[Element, ...]

    @property
    def where(self) -> str:
        """File, line and tag for a message."""
        return f"{self.path}:{self.line}: '{self.tag}'"

    def error(self, message: str) -> InputError:
        """The error of this element."""
        return InputError(f"{self.where}: {message}")

    def all(self, tag: str) -> tuple[Element, ...]:
        """Elements of a tag directly inside."""
        return tuple(child for child in self.children if child.tag == tag)

    def find(self, tag: str) -> Element | None:
        """The one element of a tag directly inside, None if there is none.

        Raises:
            InputError: There are several.
        """
        found = self.all(tag)
        if len(found) > 1:
            raise found[1].error(
                f"expected one '{tag}' in '{self.tag}', found {len(found)}; remove the others"
            )
        return found[0] if found else None

    def child(self, tag: str) -> Element:
        """The one element of a tag directly inside.

        Raises:
            InputError: There is none, or there are several.
        """
        found = self.find(tag)
        if found is None:
            raise self.error(f"expected '{tag}' inside, found none; add it")
        return found

    def attribute(self, name: str) -> str:
        """Value of an attribute.

        Raises:
            InputError: It is missing.
        """
        if name not in self.attributes:
            raise self.error(f"expected the attribute '{name}', found none; add it")
        return self.attributes[name]

    def number(self, *, infinite: bool = False) -> float:
        """The text as a number.

        Args:
            infinite: Whether it may be infinite.

        Raises:
            InputError: It is none.
        """
        return self._numbers(self.text, 1, infinite=infinite)[0]

    def vector(self) -> Vector:
        """The text as three numbers.

        Raises:
            InputError: It is something else.
        """
        x, y, z = self._numbers(self.text, 3)
        return x, y, z

    def numbers_of(self, name: str, count: int, *, infinite: bool = False) -> tuple[float, ...]:
        """An attribute as numbers.

        Args:
            name: Of the attribute.
            count: How many numbers are expected.
            infinite: Whether they may be infinite.

        Raises:
            InputError: It is something else, or missing.
        """
        return self._numbers(self.attribute(name), count, infinite=infinite)

    def _numbers(self, text: str, count: int, *, infinite: bool = False) -> tuple[float, ...]:
        expected = "a number" if count == 1 else f"{count} numbers"
        words = text.replace(",", " ").split()
        if len(words) != count:
            raise self.error(f"expected {expected}, found '{' '.join(words)[:60]}'; correct it")
        return tuple(self._number(word, expected, infinite=infinite) for word in words)

    def _number(self, word: str, expected: str, *, infinite: bool) -> float:
        """A word as a number of a possible size."""
        try:
            value = float(word) if word.isascii() and "_" not in word else math.nan
        except ValueError:
            value = math.nan
        too_large = abs(value) > _LARGEST_NUMBER and not (infinite and math.isinf(value))
        if math.isnan(value) or too_large:
            raise self.error(f"expected {expected}, found '{word[:60]}'; correct it")
        return value


def read_xml(path: Path) -> Element:
    """Read an XML file.

    Raises:
        InputError: It is not there, not a regular file, too large, not XML, or has entities or
            lists of attributes of its own.
    """
    require_file(path)
    if path.stat().st_size > _LARGEST_FILE:
        raise InputError(
            f"{path}: expected at most {_LARGEST_FILE >> 20} MiB of XML, found"
            f" {path.stat().st_size >> 20} MiB"
        )
    return _Builder(path).build(path.read_bytes())


class _Builder:
    """Elements from the events of the parser."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.count = 0
        self.open: list[tuple[int, str, dict[str, str], list[str], list[Element]]] = [
            (0, "", {}, [], [])
        ]
        self.parser = expat.ParserCreate()
        self.parser.buffer_text = True
        self.parser.StartElementHandler = self.start
        self.parser.EndElementHandler = self.end
        self.parser.CharacterDataHandler = self.characters
        # Text may name itself a billion times, and name other files, only by entities; no robot
        # needs them.
        # Defaults of attributes, which a document type may declare, are put into every element.
        self.parser.StartDoctypeDeclHandler = self.document_type
        self.parser.EntityDeclHandler = self.entity
        self.parser.SkippedEntityHandler = self.entity

    def build(self, content: bytes) -> Element:
        """Parse the whole file into its root element."""
        try:
            self.parser.Parse(content, True)
        except expat.ExpatError as error:
            raise InputError(
                f"{self.path}:{error.lineno}: expected XML, found a mistake in it"
                f" ({expat.ErrorString(error.code)}); correct this line"
            ) from None
        except (LookupError, ValueError):
            raise InputError(
                f"{self.path}: expected XML in UTF-8, found an encoding that is not known; save it"
                " as UTF-8"
            ) from None
        return self.open[0][4][0]

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        self.count += 1
        if self.count > _MOST_ELEMENTS or len(self.open) > _DEEPEST:
            self.refuse(f"at most {_MOST_ELEMENTS} elements, {_DEEPEST} deep", "more")
        self.open.append((self.parser.CurrentLineNumber, tag, attributes, [], []))

    def end(self, tag: str) -> None:
        line, _, attributes, text, children = self.open.pop()
        element = Element(self.path, line, tag, attributes, "".join(text).strip(), tuple(children))
        self.open[-1][4].append(element)

    def characters(self, text: str) -> None:
        self.open[-1][3].append(text)

    def document_type(self, name: str, system: object, public: object, own: object) -> None:
        # The name of another file is never followed, so that it may stand there.
        if own:
            self.refuse(
                "XML without entities and attribute lists of its own", f"'<!DOCTYPE {name[:60]} ['"
            )

    def entity(self, name: str, *_: object) -> None:
        self.refuse("XML without entities of its own", f"'{name[:60]}'")

    def refuse(self, expected: str, found: str) -> NoReturn:
        raise InputError(
            f"{self.path}:{self.parser.CurrentLineNumber}: expected {expected}, found {found};"
            " remove what is not needed"
        )
