"""Values for another process, without what both have already."""

from __future__ import annotations

import io
import pickle
from collections.abc import Sequence
from typing import Any


def packed(value: object, known: Sequence[object] = ()) -> bytes:
    """A value for another process of ours, without what is known there.

    Args:
        value: Of functions and classes of modules.
        known: Objects that the other side has, in the same order.
    """
    out = io.BytesIO()
    _Packer(out, known).dump(value)
    return out.getvalue()


def unpacked(data: bytes, known: Sequence[object] = ()) -> Any:
    """What :func:`packed` has made; never of anything else, as pickles run what they name.

    Args:
        data: From a process of ours.
        known: Objects that stand for those which were known there.
    """
    return _Unpacker(io.BytesIO(data), known).load()


class _Packer(pickle.Pickler):
    """Writes the place of what is known."""

    def __init__(self, out: io.BytesIO, known: Sequence[object]) -> None:
        super().__init__(out, protocol=pickle.HIGHEST_PROTOCOL)
        self._places = {id(each): place for place, each in enumerate(known)}

    def persistent_id(self, obj: Any) -> int | None:
        return self._places.get(id(obj))


class _Unpacker(pickle.Unpickler):
    """Puts what is known into its places."""

    def __init__(self, data: io.BytesIO, known: Sequence[object]) -> None:
        super().__init__(data)
        self._known = known

    def persistent_load(self, pid: int) -> object:
        return self._known[pid]
