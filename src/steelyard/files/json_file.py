"""JSON that steelyard wrote, read back as data: bounded, finite, with one-sentence errors."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any, NoReturn

from steelyard.display import steers
from steelyard.errors import InputError
from steelyard.files.regular_file import require_file

_LARGEST_FILE = 32 << 20
"""Bytes: a report of an hour has a fifth of it."""
_MOST_VALUES, _MOST_LISTS = 2_000_000, 100_000
"""Commas, and lists and objects: each takes many times the memory of its text. A report of 400 kB
has 44,000 and 1,100."""
_ESCAPE = re.compile(
    r"\\(?:(u[dD][89abAB][0-9a-fA-F]{2}\\u[dD][c-fC-F][0-9a-fA-F]{2})|u([0-9a-fA-F]{4})|.)",
    re.DOTALL,
)
"""Two surrogates that are one character together, any other character, one of letters."""


def read_json(path: Path) -> Any:
    """Read a file; whole numbers come as floats, one of thousands of digits as infinite.

    Args:
        path: Of a file that is there.

    Raises:
        InputError: It is too large, no regular file, no UTF-8, no JSON, states a key twice, or is
            nested without end.
    """
    require_file(path)
    content = b""
    if path.stat().st_size:  # pipes of the kernel have no size, and wait
        with path.open("rb") as file:
            content = file.read(_LARGEST_FILE + 1)
    if len(content) > _LARGEST_FILE:
        raise InputError(
            f"{path}: expected at most {_LARGEST_FILE >> 20} MiB of JSON, found more; check the"
            " path"
        )
    if (
        content.count(b",") > _MOST_VALUES
        or content.count(b"[") + content.count(b"{") > _MOST_LISTS
    ):
        raise InputError(
            f"{path}: expected at most {_MOST_VALUES} values and {_MOST_LISTS} lists of JSON, found"
            " more; check the path"
        )
    try:
        return json.loads(
            _printable(content.decode("utf-8-sig")),
            parse_int=float,
            parse_constant=_no_number,
            object_pairs_hook=_object,
        )
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
    except _DoubleKeyError as error:
        raise InputError(
            f"{path}: expected every key once, found {str(error)!r} twice in one object; let"
            " identify write the file again"
        ) from None
    except ValueError as error:
        raise InputError(
            f"{path}: expected JSON, found {error}, which JSON does not have; write null instead"
        ) from None


def _no_number(text: str) -> NoReturn:
    raise ValueError(text)


class _DoubleKeyError(Exception):
    """A key that stands twice in one object: readers differ in which of its values they take."""


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        raise _DoubleKeyError(next(name for name in names if names.count(name) > 1)[:60])
    return found


def _printable(text: str) -> str:
    """JSON whose texts hold no character that steers a terminal, but for ends of lines, and no half
    of a character, which cannot be written.
    """

    def replaced(match: re.Match[str]) -> str:
        if match[1]:
            letter = json.loads(f'"{match[0]}"')
        elif match[2]:
            letter = chr(int(match[2], 16))
        else:
            letter = {"\\b": "\b", "\\f": "\f"}.get(match[0], " ")
        half = "\ud800" <= letter <= "\udfff"
        return "\\ufffd" if half or steers(letter) else match[0]

    if not text.isascii():
        hidden = {
            ord(letter): "\ufffd" for letter in set(text) if ord(letter) > 31 and steers(letter)
        }
        text = text.translate(hidden)
    return _ESCAPE.sub(replaced, text) if "\\" in text else text
