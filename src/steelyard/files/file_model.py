"""Models of what a file may hold, and values checked against them: those of a file, and those that
Python hands over under the same keys.
"""

from __future__ import annotations

import os
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError

from steelyard.files.document import YamlDocument
from steelyard.files.problems import first_problem, short

if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass as _ModelMeta
else:
    _ModelMeta = type(BaseModel)

_LARGEST_NUMBER = 1e15
"""Squares of larger numbers lose all digits of others."""


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
        raise document.error(key, f"expected a mapping of keys to values, found {short(values)}")
    _check_sizes(document, values, key)
    try:
        return model.model_validate(_with_tuples(values))
    except ValidationError as error:
        raise document.error(*first_problem(error, model, values, key)) from None


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
