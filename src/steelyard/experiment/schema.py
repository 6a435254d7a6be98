"""JSON schemas of the experiment file and the robot file, for editors: drawn from the forms that
the readers check.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Mapping
from functools import cache
from itertools import pairwise
from typing import Any, Literal

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema

from steelyard.experiment.form import RUN_KEYS, ExperimentForm, KnownMassForm, RunForm, StreamForm
from steelyard.experiment.surroundings import DragForm, KnownForm
from steelyard.files.file_model import FileModel
from steelyard.instruments.base import Prior
from steelyard.robot.file import RobotForm

Which = Literal["experiment", "robot"]
_ROOTS: Mapping[Which, type[BaseModel]] = {"experiment": ExperimentForm, "robot": RobotForm}
_TITLES = {"experiment": "steelyard experiment file", "robot": "steelyard robot file"}
_SIGMA = {"type": "number", "minimum": 0}
_SHORT_FORMS: Mapping[type[BaseModel], Any] = {
    Prior: [
        {**_SIGMA, "description": "1-sigma"},
        {"type": "array", "items": _SIGMA, "description": "1-sigma of each"},
        {"type": "null"},
    ],
    KnownForm: [{"type": "number", "description": "exact"}],
    KnownMassForm: [{"type": "number", "description": "exact"}],
    DragForm: [{**_SIGMA, "description": "exact"}],
    StreamForm: [{"type": "string", "description": "Path of the log, relative to this file."}],
}
"""What may stand for a mapping: forms that take it so say it in a validator, which no schema can be
drawn from."""


def schema(which: Which) -> dict[str, Any]:
    """JSON Schema (2020-12) of a file.

    It says what the form of a file says: keys, kinds of values, bounds, choices. What depends on
    several of them, or on the logs, only the reader sees.
    """
    root = _ROOTS[which]
    drawn = root.model_json_schema(schema_generator=_Drawn)
    parts = drawn.get("$defs", {})
    for model in _models(root, {}).values():
        part = drawn if model is root else parts.get(model.__name__)
        if part is not None:
            part.pop("title", None)
            _describe(model, part)
    if RunForm.__name__ in parts:
        _open_run(parts[RunForm.__name__])
    if Prior.__name__ in parts:
        parts[Prior.__name__]["required"] = ["sigma"]
        # By name, an unknown 1-sigma is refused: it may only be left out.
        parts[Prior.__name__]["properties"]["sigma"]["anyOf"] = [
            branch
            for branch in parts[Prior.__name__]["properties"]["sigma"]["anyOf"]
            if branch.get("type") != "null"
        ]
    for model, short in _SHORT_FORMS.items():
        if model.__name__ in parts:
            whole = parts[model.__name__]
            about = {"description": whole["description"]} if "description" in whole else {}
            parts[model.__name__] = {**about, "anyOf": [*short, whole]}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **drawn,
        "title": _TITLES[which],
    }


class _Drawn(GenerateJsonSchema):
    """As pydantic draws it, without names of Python in view and without defaults, which stand in
    the descriptions of the contract.
    """

    def default_schema(self, schema: Any) -> Any:
        """The schema of a field without its default, where that is more than a plain value."""
        plain = schema.get("default")
        if plain is None or isinstance(plain, BaseModel) or "default_factory" in schema:
            return self.generate_inner(schema["schema"])
        return super().default_schema(schema)


def _models(kind: Any, found: dict[str, type[BaseModel]]) -> dict[str, type[BaseModel]]:
    """A form and all forms in it, by name."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        if kind.__name__ not in found:
            found[kind.__name__] = kind
            for field in kind.model_fields.values():
                _models(field.annotation, found)
        return found
    for part in getattr(kind, "__args__", ()):
        _models(part, found)
    return found


def _describe(model: type[BaseModel], part: dict[str, Any]) -> None:
    """Give the fields the descriptions that stand under them in the code."""
    if model.__doc__:
        part["description"] = _one_line(model.__doc__)
    forms = [each for each in model.__mro__ if issubclass(each, BaseModel)]
    for name, entry in part.get("properties", {}).items():
        entry.pop("title", None)
        entry.pop("description", None)
        field = model.model_fields.get(name)
        # A class that narrows the type of a field leaves its description to the one above.
        described = [text for each in forms if (text := _docstrings(each).get(name))]
        words = [_one_line(described[0])] if described else []
        default = _plain_default(field.default) if field else None
        if default is not None:
            words.append(f"Default: {default}")
        if words:
            entry["description"] = ". ".join(word.rstrip(".") for word in words) + (
                "." if default or words[0][-1] == "." else ""
            )


@cache
def _docstrings(model: type[BaseModel]) -> Mapping[str, str]:
    """What stands under the fields of a form in its own code, by name.

    Read here, not by pydantic as each form is made: most commands draw no schema.
    """
    if issubclass(FileModel, model):
        return {}
    (form,) = ast.parse(textwrap.dedent(inspect.getsource(model))).body
    assert isinstance(form, ast.ClassDef)
    return {
        field.target.id: inspect.cleandoc(text.value.value)
        for field, text in pairwise(form.body)
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)
        if isinstance(text.value.value, str)
    }


def _plain_default(value: Any) -> str | None:
    """A default as it would stand in the file; None where there is nothing to say."""
    if isinstance(value, Prior):
        return None if value.sigma is None else f"{value.sigma:g}"
    if isinstance(value, tuple) and value:
        return f"[{', '.join(f'{part:g}' for part in value)}]"
    if isinstance(value, float):
        return f"{value:g}"
    return value if isinstance(value, str) else None


def _one_line(text: str) -> str:
    """Text of the code as a reader of files wants it."""
    return " ".join(text.split()).replace("``", "`").replace("None:", "without it:")


def _open_run(run: dict[str, Any]) -> None:
    """Every key of a run that is not one of its own names an instrument."""
    streams = run["properties"].pop("streams")
    run["required"] = [key for key in run["required"] if key != "streams"]
    run["additionalProperties"] = streams["additionalProperties"]
    # At least one of them.
    run["not"] = {"propertyNames": {"enum": sorted(RUN_KEYS)}}
