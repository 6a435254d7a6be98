"""Types of ROS messages: from the definitions that a recording holds, or the common ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from steelyard.errors import InputError
from steelyard.logs.messages.idl import types_in_idl
from steelyard.logs.packages import require_package, shown

Types = Mapping[str, Sequence[tuple[str, Any]]]
"""Type -> its fields: names and descriptions as ``rosbags.interfaces.typing.FieldDesc`` has
them."""

TIMES = {"builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration"}
"""Types of times and durations, in whole seconds and nanoseconds."""
_LONGEST = 1 << 18
"""Characters of a definition together with those it needs; a parser takes seconds beyond it."""
_SEPARATOR = "=" * 80 + "\n"


def types_of(path: Path, name: str, form: str, definition: str, *, ros1: bool) -> Types:
    """A type and all that it is made of.

    Args:
        path: Of the recording, for messages.
        name: Of the type.
        form: Language of the definition: ``msg``, ``idl``; empty: there is none.
        definition: As the recording holds it.
        ros1: Whether common types are those of ROS 1.

    Raises:
        InputError: The definition cannot be read, or there is none and the type is not a common
            one.
    """
    require_package(path, "rosbags", "rosbags", "ROS")
    stated: dict[str, Any] = {}
    if form:
        if len(definition) > _LONGEST:
            raise _wrong(path, name, f"{len(definition)} characters")
        # Parsers of text from anyone: they fail in ways of their own, with assertions and errors of
        # keys and types among them.
        try:
            stated = _parsed_msg(definition, name) if form == "msg" else _parsed_idl(definition)
        except Exception as error:
            raise _wrong(
                path, name, (str(error).splitlines() or [""])[0].rstrip(":") or type(error).__name__
            ) from None
    types = {kind: fields for kind, (_, fields) in stated.items()}
    if full_name(name) not in types or not _is_complete(types, full_name(name)):
        types = {**_common(ros1), **types}
    if full_name(name) not in types:
        raise InputError(
            f"{path}: expected a definition of the type {shown(name)} in the file, found none;"
            " convert it with: ros2 bag convert (to MCAP, where the type is installed)"
        )
    return types


def full_name(name: str) -> str:
    """Name of a type as ROS 2 has it: ``sensor_msgs/msg/Imu``, also for ``sensor_msgs/Imu``."""
    parts = name.split("/")
    return "/".join([parts[0], "msg", parts[1]]) if len(parts) == 2 else name


def _is_complete(types: Types, name: str) -> bool:
    """Whether a type and all that it is made of are there."""
    open_names, seen = [name], set()
    while open_names:
        kind = open_names.pop()
        if kind in seen or kind in TIMES:
            continue
        if kind not in types:
            return False
        seen.add(kind)
        for _, description in types[kind]:
            # Of a list, what its elements are.
            inner = description if isinstance(description[1], str) else description[1][0]
            if isinstance(inner, tuple) and isinstance(inner[1], str):
                open_names.append(inner[1])
    return True


@cache
def _common(ros1: bool) -> dict[str, Any]:
    from rosbags.typesys import Stores, get_typestore

    # Humble is the last of ROS 2 whose recorder left definitions out.
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    return {name: fields for name, (_, fields) in store.fielddefs.items()}


@lru_cache(maxsize=32)
def _parsed_msg(definition: str, name: str) -> dict[str, Any]:
    """Types of a definition, never changed: every stream of a recording asks for them again."""
    from rosbags.typesys import get_types_from_msg

    return get_types_from_msg(definition.replace("\r\n", "\n"), full_name(name))


def _parsed_idl(definition: str) -> dict[str, Any]:
    """Types of a definition in IDL: files behind each other, with lines between them."""
    types: dict[str, Any] = {}
    for text in definition.split(_SEPARATOR):
        header, _, rest = text.partition("\n")
        if text.strip():
            found = types_in_idl(rest if header.startswith("IDL: ") else text)
            types.update({name: ((), fields) for name, fields in found.items()})
    return types


def _wrong(path: Path, name: str, found: str) -> InputError:
    return InputError(
        f"{path}: expected a definition of the type {shown(name)}, found one that cannot be read"
        f" ({shown(found, 120)}); copy the file again"
    )
