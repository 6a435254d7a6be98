"""YAML files from anyone: read as data, checked against a model, with errors that name file, line
and key.
"""

from __future__ import annotations

import difflib
import io
import json
import os
import re
import typing
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError

from steelyard.display import steers
from steelyard.errors import InputError

if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass as _ModelMeta
else:
    _ModelMeta = type(BaseModel)

_LARGEST_FILE = 2**19
"""Bytes: reading line numbers along takes seconds beyond it."""
_LARGEST_NUMBER = 1e15
"""Squares of larger numbers lose all digits of others."""
_DEEPEST = 200
"""Brackets in each other: beyond, the parser spends seconds before it gives up."""
_MOST_SIGNS = 40_000
"""Signs between values: the loader takes 0.1 ms for each."""
_SIGN = re.compile(r"[,:?\[{&*\n]|- ")
_NAMES_IN_LOGS = {"columns", "units", "scale", "topic"}
"""Keys below which names of others stand, which may be anything and are shown escaped."""
_MOST_VALUES = 200_000
"""After aliases are expanded: a file of a few lines can name itself a billion times."""


_SIGNS = {
    "greater_than": "above",
    "greater_than_equal": "at least",
    "less_than": "below",
    "less_than_equal": "at most",
}
"""Problems of pydantic with numbers out of bounds, in words."""


class _FromPython(_ModelMeta):
    """What a call of a model in Python means: the same keys, checks and sentences as in a file.

    Reading a file does not pass here: pydantic fills a model without calling its class.
    """

    def __call__(self, *args: Any, **keys: Any) -> Any:
        """A value of the class, from keys by name; sequences and arrays of any kind do.

        Raises:
            InputError: A key is unknown, missing or wrong.
        """
        document = YamlDocument(Path(self.__name__), {}, {})
        if args:
            raise document.error((), "expected keys by name, found a value without one; name it")
        model = typing.cast("type[BaseModel]", self)
        kind = model.model_fields.get("kind")
        if kind is not None and typing.get_origin(kind.annotation) is Literal:
            # A class of one kind says it; it is written all the same.
            keys = {"kind": typing.get_args(kind.annotation)[0], **keys}
        return validate(model, document, plain_values(keys))


class FileModel(BaseModel, metaclass=_FromPython):
    """Base of everything that a file may hold: no unknown keys, no silent conversion, never
    changed. In Python it is called with the same keys.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


Model = TypeVar("Model", bound=BaseModel)


def plain_values(value: Any) -> Any:
    """What Python hands over as the values that a file has: arrays and tuples as lists, numbers of
    NumPy as numbers.
    """
    if isinstance(value, Mapping):
        return {str(key): plain_values(entry) for key, entry in value.items()}
    if isinstance(value, np.generic | np.ndarray):
        return plain_values(value.tolist())
    if isinstance(value, list | tuple | set | frozenset | range):
        return [plain_values(entry) for entry in value]
    return os.fspath(value) if isinstance(value, os.PathLike) else value


@dataclass(frozen=True)
class YamlDocument:
    """A YAML file as plain values, with the lines they came from."""

    path: Path
    data: Any
    lines: dict[tuple[str | int, ...], int]

    def where(self, key: Sequence[str | int] = ()) -> str:
        """File, line and key for a message."""
        named = [part for part in key if part != ""]
        for length in range(len(named), -1, -1):
            line = self.lines.get(tuple(named[:length]))
            if line is not None and length:
                return f"{self.path}:{line}: '{_dotted(named)}'"
        return f"{self.path}: '{_dotted(named)}'" if named else f"{self.path}"

    def error(self, key: Sequence[str | int], message: str) -> InputError:
        """The error of one key."""
        return InputError(f"{self.where(key)}: {message}")


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


def read_text(path: Path) -> str:
    """Read a small text file.

    Raises:
        InputError: It is not there, not a regular file, too large, or not UTF-8.
    """
    require_file(path)
    if path.stat().st_size > _LARGEST_FILE:
        raise InputError(
            f"{path}: expected at most {_LARGEST_FILE >> 10} KiB of YAML, found"
            f" {path.stat().st_size >> 10} KiB"
        )
    if not path.stat().st_size:
        return ""  # never opened: pipes of the kernel say so of themselves, and wait
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: expected UTF-8 text, found a byte that is not at {error.start}; save it as"
            " UTF-8"
        ) from None


def require_printable(document: YamlDocument) -> None:
    """Refuse texts that steer a terminal or hide what they are, names first of all.

    Names reach terminals, pages and files of other programs, which is why they are looked at where
    they enter. Those of columns and topics belong to logs, and are shown escaped.

    Raises:
        InputError: A key or a text holds such a character.
    """
    _require_printable(document, document.data, ())


def _require_printable(document: YamlDocument, value: Any, key: tuple[str | int, ...]) -> None:
    """See :func:`require_printable`; for a part of a document."""
    if isinstance(value, dict):
        for name, inner in value.items():
            if name not in _NAMES_IN_LOGS:
                _require_printable(document, name, key)
                _require_printable(document, inner, (*key, name))
    elif isinstance(value, list):
        for i, inner in enumerate(value):
            _require_printable(document, inner, (*key, i))
    elif isinstance(value, str):
        hidden = next(filter(steers, value), None)
        if hidden is not None:
            raise document.error(
                key,
                f"expected text that can be printed, found the character U+{ord(hidden):04X};"
                " remove it",
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


def require_file(path: Path, what: str = "file") -> None:
    """Raise InputError unless a path is a regular file."""
    try:
        if path.is_file():
            return
        found = "something that is no regular file" if path.exists() else "nothing there"
        found = "a folder" if path.is_dir() else found
    except OSError as error:
        found = f"'{error.strerror}'"
    except ValueError as error:
        found = f"'{error}'"
    raise InputError(f"{path}: expected a {what}, found {found}; check the path")


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


def validate(
    model: type[Model], document: YamlDocument, data: Any = None, key: tuple[str | int, ...] = ()
) -> Model:
    """Check plain values against a model.

    Args:
        model: What is expected.
        document: Where the values come from.
        data: The values; None: the whole document.
        key: Where they stand in the document.

    Raises:
        InputError: They do not fit; the sentence names the first place and counts the others.
    """
    values = document.data if data is None else data
    if not isinstance(values, dict):
        raise document.error(key, f"expected a mapping of keys to values, found {_short(values)}")
    _check_sizes(document, values, key)
    try:
        return model.model_validate(_with_tuples(values))
    except ValidationError as error:
        problems = error.errors(include_url=False)
        # Of a number-or-list, the branch that was meant is the one whose shape was given.
        fitting = [
            p
            for p in problems
            if not (p["type"] == "float_type" and isinstance(p.get("input"), tuple))
        ]
        first = (fitting or problems)[0]
        # Branches of a union appear in the location under their tag; only real keys help the
        # reader.
        path = key + _real_keys(tuple(first["loc"]), values)
        known = _known_keys(model, tuple(first["loc"]))
        places = {_real_keys(tuple(p["loc"]), values) for p in problems}
        others = sum(1 for place in places if key + place[: len(path) - len(key)] != path)
        more = f" (and {others} more)" if others else ""
        raise document.error(
            path, _sentence(_all_missing(first, problems), path, known) + more
        ) from None


def _all_missing(first: Any, problems: Sequence[Any]) -> Any:
    """The first missing value of a list as the whole of what is missing in it."""
    if first["type"] != "missing" or not isinstance(first["loc"][-1], int):
        return first
    beside = [p for p in problems if p["type"] == "missing" and p["loc"][:-1] == first["loc"][:-1]]
    return {**first, "loc": beside[-1]["loc"], "ctx": {"there": first["loc"][-1]}}


def _check_sizes(document: YamlDocument, value: Any, key: tuple[str | int, ...]) -> None:
    """Refuse numbers that no quantity has, and whose squares would overflow."""
    if isinstance(value, dict | list):
        for part, entry in value.items() if isinstance(value, dict) else enumerate(value):
            _check_sizes(document, entry, (*key, part))
    elif isinstance(value, float) and _LARGEST_NUMBER < abs(value) < float("inf"):
        raise document.error(
            key, f"expected a number of a possible size, found {value:g}; correct it"
        )


def _with_tuples(value: Any) -> Any:
    """Lists as tuples: strict validation takes nothing for anything else, and the models hold
    tuples.
    """
    if isinstance(value, dict):
        return {key: _with_tuples(entry) for key, entry in value.items()}
    return tuple(_with_tuples(entry) for entry in value) if isinstance(value, list) else value


def _real_keys(location: tuple[str | int, ...], data: Any) -> tuple[str | int, ...]:
    """Keys of a location of pydantic that stand in the file."""
    real: list[str | int] = []
    for i, part in enumerate(location):
        inside = (isinstance(data, dict) and part in data) or (
            isinstance(data, list) and isinstance(part, int) and part < len(data)
        )
        if inside:
            data = data[part]
            real.append(part)
        elif (
            i == len(location) - 1
            and isinstance(data, dict)
            and not str(part).startswith(("function-", "constrained"))
        ):
            real.append(part)
    return tuple(real)


def _known_keys(model: type[BaseModel], location: tuple[str | int, ...]) -> list[str]:
    """Keys of the model at the parent of a location, as far as they can be followed."""
    current: Any = model
    for part in location[:-1]:
        current = _inside(current, part)
    return list(current.model_fields) if _is_model(current) else []


def _is_model(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, BaseModel)


def _inside(kind: Any, part: str | int) -> Any:
    """Type of a part of a value: of a key of a mapping, of an item of a list, of a branch of a
    union by its tag.
    """
    while typing.get_origin(kind) is typing.Annotated:
        kind = typing.get_args(kind)[0]
    if _is_model(kind):
        field = kind.model_fields.get(str(part))
        return None if field is None else field.annotation
    arguments = [a for a in typing.get_args(kind) if a not in (type(None), ...)]
    if typing.get_origin(kind) in (dict, tuple, list):
        return arguments[-1]
    for branch in arguments:
        tag = branch.model_fields.get("kind") if _is_model(branch) else None
        if tag is not None and part in typing.get_args(tag.annotation):
            return branch
    models = [a for a in arguments if _is_model(a)]
    return _inside(models[0], part) if models else None


def _sentence(problem: Any, path: tuple[str | int, ...], known: list[str]) -> str:
    """One sentence for a problem of pydantic: what was expected, what was found, what to do."""
    kind, found = problem["type"], problem.get("input")
    context = problem.get("ctx", {})
    location = problem["loc"]
    name = str(path[-1]) if path else ""
    if kind == "missing" and location and isinstance(location[-1], int):
        return (
            f"expected at least {location[-1] + 1} values, found"
            f" {context.get('there', location[-1])}; add what is missing"
        )
    if kind == "missing":
        return f"expected this key, found it missing; add '{name}'"
    if kind == "extra_forbidden":
        close = difflib.get_close_matches(name, known, n=1)
        others = f"known here: {', '.join(known)}" if known else "remove it"
        hint = f"did you mean '{close[0]}'?" if close else others
        return f"expected a known key, found '{name}'; {hint}"
    if kind in {"union_tag_invalid", "literal_error"}:
        expected = context.get("expected_tags") or context.get("expected")
        return (
            f"expected one of {expected}, found {_short(context.get('tag', found))}; choose one of"
            " these"
        )
    if kind == "union_tag_not_found":
        return "expected the key 'kind', found it missing; add it"
    if kind in {"float_type", "int_type", "float_parsing", "finite_number", "int_from_float"}:
        return f"expected a number, found {_short(found)}; write a number"
    if kind in _SIGNS:
        bound = next(iter(context.values()), 0)
        return f"expected a number {_SIGNS[kind]} {bound:g}, found {_short(found)}; correct it"
    if kind in {"too_short", "too_long", "tuple_type", "list_type"}:
        if kind == "too_long":
            return (
                f"expected at most {context.get('max_length')} values, found {_short(found)};"
                " correct it"
            )
        least = f" of at least {context['min_length']} values" if "min_length" in context else ""
        return f"expected a list{least}, found {_short(found)}; correct it"
    if kind == "string_type":
        return f"expected text, found {_short(found)}; put it in quotes if it is meant as text"
    if kind in {"model_type", "dict_type", "model_attributes_type"}:
        return f"expected a mapping of keys to values, found {_short(found)}; correct it"
    if kind == "bool_type":
        return f"expected true or false, found {_short(found)}; correct it"
    if kind == "value_error":
        return str(context.get("error", problem["msg"]))
    return f"{problem['msg'][0].lower()}{problem['msg'][1:]}, found {_short(found)}; correct it"


def _dotted(key: Sequence[str | int]) -> str:
    parts = [f"[{part}]" if isinstance(part, int) else f".{part}" for part in key]
    return "".join(parts).removeprefix(".")


def _short(value: Any) -> str:
    if value is None:
        return "nothing"
    text = f"'{value}'" if isinstance(value, str) else json.dumps(value, default=str)
    return text if len(text) <= 60 else text[:57] + "..."
