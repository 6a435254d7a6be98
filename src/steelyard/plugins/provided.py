"""What other packages provide, by their entry points.

A package is only imported where a file, an address or an option names what it provides.
"""

from __future__ import annotations

from importlib.metadata import EntryPoint, entry_points
from typing import Any, Literal

from steelyard.errors import InputError

Group = Literal["instruments", "logs", "exports", "sinks"]
"""``instruments``: kind -> class derived from :class:`steelyard.instruments.base.Instrument`;
``logs``: ending without its dot -> function of a path that opens a
:class:`steelyard.logs.log.Log`; ``exports``: format ->
:class:`steelyard.exports.formats.ExportFormat`; ``sinks``: beginning of an address before
``://`` -> class with ``send`` and ``close``."""


def names(group: Group) -> list[str]:
    """What there is, without importing any of it."""
    return sorted({each.name for each in entry_points(group=f"steelyard.{group}")})


def provided(group: Group, name: str) -> Any:
    """What is provided under a name; None: nothing is.

    Raises:
        InputError: Two packages provide it, or it cannot be imported.
    """
    found: list[EntryPoint] = [*entry_points(group=f"steelyard.{group}", name=name)]
    if not found:
        return None
    if len({each.value for each in found}) > 1:
        packages = " and ".join(sorted(each.dist.name if each.dist else "?" for each in found))
        raise InputError(
            f"{group} '{name}': expected one package that provides it, found {packages}; remove one"
        )
    try:
        return found[0].load()
    except Exception as error:
        package = found[0].dist.name if found[0].dist else found[0].value
        raise InputError(
            f"{group} '{name}': expected that package '{package}' can be imported, found"
            f" {type(error).__name__} ({error}); correct or remove it"
        ) from error
