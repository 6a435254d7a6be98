"""What pydantic finds wrong with the values of a file, as one sentence: what was expected, what was
found, what to do.
"""

from __future__ import annotations

import difflib
import json
import typing
from collections.abc import Sequence
from typing import Any

from pydantic import BaseModel, ValidationError

from steelyard.display import printable

_SIGNS = {
    "greater_than": "above",
    "greater_than_equal": "at least",
    "less_than": "below",
    "less_than_equal": "at most",
}
"""Problems of pydantic with numbers out of bounds, in words."""


def first_problem(
    error: ValidationError, model: type[BaseModel], values: Any, key: tuple[str | int, ...]
) -> tuple[tuple[str | int, ...], str]:
    """The first place where values do not fit a model, and what is wrong there; other places are
    counted.

    Args:
        error: What pydantic has found.
        model: What was expected.
        values: What was checked.
        key: Where they stand in the file.
    """
    problems = error.errors(include_url=False)
    # Of a number-or-list, the branch that was meant is the one whose shape was given.
    fitting = [
        p for p in problems if not (p["type"] == "float_type" and isinstance(p.get("input"), tuple))
    ]
    first = (fitting or problems)[0]
    # Branches of a union appear in the location under their tag; only real keys help the reader.
    path = key + _real_keys(tuple(first["loc"]), values)
    known = _known_keys(model, tuple(first["loc"]))
    places = {_real_keys(tuple(p["loc"]), values) for p in problems}
    others = sum(1 for place in places if key + place[: len(path) - len(key)] != path)
    more = f" (and {others} more)" if others else ""
    return path, _sentence(_all_missing(first, problems), path, known) + more


def _all_missing(first: Any, problems: Sequence[Any]) -> Any:
    """The first missing value of a list as the whole of what is missing in it."""
    if first["type"] != "missing" or not isinstance(first["loc"][-1], int):
        return first
    beside = [p for p in problems if p["type"] == "missing" and p["loc"][:-1] == first["loc"][:-1]]
    return {**first, "loc": beside[-1]["loc"], "ctx": {"there": first["loc"][-1]}}


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
        return f"expected a known key, found {short(name)}; {hint}"
    if kind in {"union_tag_invalid", "literal_error"}:
        expected = context.get("expected_tags") or context.get("expected")
        return (
            f"expected one of {expected}, found {short(context.get('tag', found))}; choose one of"
            " these"
        )
    if kind == "union_tag_not_found":
        return "expected the key 'kind', found it missing; add it"
    if kind in {"float_type", "int_type", "float_parsing", "finite_number", "int_from_float"}:
        return f"expected a number, found {short(found)}; write a number"
    if kind in _SIGNS:
        bound = next(iter(context.values()), 0)
        return f"expected a number {_SIGNS[kind]} {bound:g}, found {short(found)}; correct it"
    if kind in {"too_short", "too_long", "tuple_type", "list_type"}:
        if kind == "too_long":
            return (
                f"expected at most {context.get('max_length')} values, found {short(found)};"
                " correct it"
            )
        least = f" of at least {context['min_length']} values" if "min_length" in context else ""
        return f"expected a list{least}, found {short(found)}; correct it"
    if kind == "string_type":
        return f"expected text, found {short(found)}; put it in quotes if it is meant as text"
    if kind in {"model_type", "dict_type", "model_attributes_type"}:
        return f"expected a mapping of keys to values, found {short(found)}; correct it"
    if kind == "bool_type":
        return f"expected true or false, found {short(found)}; correct it"
    if kind == "value_error":
        return str(context.get("error", problem["msg"]))
    return f"{problem['msg'][0].lower()}{problem['msg'][1:]}, found {short(found)}; correct it"


def short(value: Any) -> str:
    """A value for a message, in one line of 60 letters at the most."""
    if value is None:
        return "nothing"
    text = f"'{printable(value)}'" if isinstance(value, str) else json.dumps(value, default=str)
    return text if len(text) <= 60 else text[:57] + "..."
