"""YAML as data: plain values with the lines that they came from, and plain values as YAML."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from functools import lru_cache
from itertools import accumulate
from pathlib import Path
from typing import Any

from steelyard.errors import InputError
from steelyard.files.document import YamlDocument
from steelyard.files.regular_file import read_text

_DEEPEST = 200
"""Brackets in each other: beyond, the parser spends seconds before it gives up."""
_MOST_SIGNS = 40_000
"""Signs between values: the loader takes 0.1 ms for each."""
_SIGN = re.compile(r"[,:?\[{&*\n]|- ")
_MOST_VALUES = 200_000
"""After aliases are expanded: a file of a few lines can name itself a billion times."""


def read_yaml(path: Path, what: str = "YAML") -> YamlDocument:
    """Read a YAML 1.2 file. JSON is YAML too, in which a comma may also stand behind the last item.

    Args:
        path: Of the file.
        what: Was expected, for the messages.

    Raises:
        InputError: It is not there, not a regular file, too large, or not YAML.
    """
    from ruamel.yaml.error import YAMLError

    text = read_text(path)
    if _depth(text) > _DEEPEST:
        raise InputError(
            f"{path}: expected {what}, found something that cannot be read (brackets more than"
            f" {_DEEPEST} deep); correct it"
        )
    if len(_SIGN.findall(text)) > _MOST_SIGNS:
        raise InputError(
            f"{path}: expected at most {_MOST_SIGNS} lines, commas and colons of {what}, found"
            " more; numbers in rows belong into a table"
        )
    try:
        node = _nodes(text)
    except YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f":{mark.line + 1}" if mark is not None else ""
        problem = getattr(error, "problem", None) or "cannot be read"
        raise InputError(
            f"{path}{line}: expected {what}, found a mistake in it ({problem}); correct this line"
        ) from None
    # A merge of a mapping into itself is an AttributeError, a list for a key may be a TypeError, a
    # letter beyond the last one an OverflowError.
    except (ValueError, TypeError, AttributeError, ArithmeticError, RecursionError) as error:
        raise InputError(
            f"{path}: expected {what}, found something that cannot be read ({error}); correct it"
        ) from None
    values = _Values(path)
    try:
        return YamlDocument(path, values.plain(node, ()), values.lines)
    except RecursionError:
        raise values.too_many() from None


@lru_cache(maxsize=8)
def _nodes(text: str) -> Any:
    """What the loader makes of a text, never changed: experiments name the same robot file again
    and again, and 2 kB take it 20 ms.
    """
    from ruamel.yaml import YAML

    return YAML(typ="rt", pure=True).load(text)


def _depth(text: str) -> int:
    """How deep brackets stand in each other, at most; those in strings count too."""
    steps = (1 if bracket in "[{" else -1 for bracket in re.findall(r"[\[\]{}]", text))
    return max(accumulate(steps), default=0)


class _Values:
    """Plain values of the loader's nodes, and the lines that they came from."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.lines: dict[tuple[str | int, ...], int] = {}
        self._count = 0

    def plain(self, node: Any, key: tuple[str | int, ...]) -> Any:
        """A node as dicts, lists, strings, numbers and None.

        Raises:
            InputError: It is more than a file may hold, or no text.
        """
        self._count += 1
        if self._count > _MOST_VALUES:
            raise self.too_many()
        if isinstance(node, dict | list):
            return self._nested(node, key)
        if isinstance(node, bool) or node is None:
            return node
        if isinstance(node, int):
            # Beyond this, Python refuses even to print it.
            return int(node) if node.bit_length() < 10_000 else float("inf")
        if isinstance(node, float):
            return float(node)
        # Scalar booleans of the round-trip loader are integers with a mark of their own.
        return bool(node) if type(node).__name__ == "ScalarBoolean" else self._text(node)

    def _nested(self, node: Any, key: tuple[str | int, ...]) -> Any:
        """A mapping or a list, with the lines of its values."""
        is_mapping = isinstance(node, dict)
        place_of = node.lc.key if is_mapping else node.lc.item
        above, found = self.lines.get(key, 1), {}
        for name, value in node.items() if is_mapping else enumerate(node):
            part = str(name) if is_mapping else name
            known = name in (node.lc.data or {})
            self.lines[*key, part] = place_of(name)[0] + 1 if known else above
            found[part] = self.plain(value, (*key, part))
        return found if is_mapping else list(found.values())

    def _text(self, node: Any) -> str:
        text = str(node)
        try:
            text.encode()
        except UnicodeEncodeError:
            raise InputError(
                f"{self.path}: expected text, found half a character (a lone surrogate); remove it"
            ) from None
        return text

    def too_many(self) -> InputError:
        """The error of a file with more values than it may hold."""
        return InputError(
            f"{self.path}: expected at most {_MOST_VALUES} values, found more; remove nested"
            " aliases"
        )


def to_yaml(values: Mapping[str, Any]) -> str:
    """Plain values as YAML 1.2, lists of numbers in one line."""
    from ruamel.yaml import YAML

    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = None
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    yaml.width = 120
    text = io.StringIO()
    yaml.dump(values, text)
    return text.getvalue()
