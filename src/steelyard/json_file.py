"""JSON that steelyard wrote, read back as data: bounded, finite, with one-sentence errors."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NoReturn

from steelyard.errors import InputError

_LARGEST_FILE = 64 << 20
"""Bytes: a report of an hour has a tenth of it."""


def read_json(path: Path) -> Any:
    """Read a file; whole numbers come as floats, one of thousands of digits as infinite.

    Args:
        path: Of a file that is there.

    Raises:
        InputError: It is too large, no UTF-8, no JSON, or nested without end.
    """
    with path.open("rb") as file:
        content = file.read(_LARGEST_FILE + 1)
    if len(content) > _LARGEST_FILE:
        raise InputError(
            f"{path}: expected at most {_LARGEST_FILE >> 20} MiB of JSON, found more; check the"
            " path"
        )
    try:
        return json.loads(content.decode("utf-8-sig"), parse_int=float, parse_constant=_no_number)
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: expected UTF-8 text, found a byte that is not at {error.start}; check the"
            " path"
        ) from None
    except json.JSONDecodeError as error:
        raise InputError(
            f"{path}:{error.lineno}: expected JSON, found a mistake in it"
            f" ({error.msg[:1].lower()}{error.msg[1:]}); let identify write the file again"
        ) from None
    except RecursionError:
        raise InputError(
            f"{path}: expected an estimate that identify wrote, found lists too deep; check the"
            " path"
        ) from None
    except ValueError as error:
        raise InputError(
            f"{path}: expected JSON, found {error}, which JSON does not have; write null instead"
        ) from None


def _no_number(text: str) -> NoReturn:
    raise ValueError(text)
