"""Printers on cables: anchors from a configuration of RepRapFirmware (M669 K6) or of Klipper
(kinematics: winch), both in millimetres.

RepRapFirmware: https://docs.duet3d.com, M669, Hangprinter kinematics: parameters A, B, C, D, …
with x:y:z each, D alone as its height. Klipper: docs/Config_Reference.md, Cable Winch Kinematics:
``anchor_x``, ``anchor_y``, ``anchor_z`` of every stepper. Both firmwares reckon with cables that
meet in one point, the origin of the platform.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from steelyard.errors import InputError
from steelyard.imports.description import Cable, Description, Vector
from steelyard.imports.sources import Source
from steelyard.imports.text_file import TextFile

NAME = "configuration of a cable printer"
_MILLIMETRE = 1e-3
_LETTERS = "ABCDEFGHIJ"
_WORD = re.compile(r"([A-Z])(-?[\d.]+(?::-?[\d.]+)*)")
_SECTION = re.compile(r"\[(stepper_\w+)\]")
_ANCHOR = re.compile(r"anchor_([xyz])\s*[:=]\s*(\S+)")


def recognises(source: Source) -> bool:
    """Whether a file sets anchors."""
    return isinstance(source, TextFile) and bool(_reprap(source) or _sections(source))


def describe(sources: Sequence[Source], cable_set: str | None) -> Description:
    """The robot of a file.

    Args:
        sources: One file.
        cable_set: None: there are no sets.

    Raises:
        InputError: An anchor is not complete, or there are several files.
    """
    if len(sources) > 1 or not isinstance(sources[0], TextFile):
        raise InputError(
            f"{sources[-1].path}: expected one file of a {NAME}, found {len(sources)}; import one"
            " at a time"
        )
    source = sources[0]
    anchors = _reprap(source)
    firmware = "RepRapFirmware (M669 K6)"
    if not anchors:
        anchors = [(line, _of_section(source, line, each)) for line, each in _sections(source)]
        firmware = "Klipper (winch)"
    return Description(
        format=NAME,
        files=(source.path,),
        cables=tuple(
            Cable(f"{source.path}:{line}", anchor, (0.0, 0.0, 0.0)) for line, anchor in anchors
        ),
        notes=(
            f"anchors of {firmware}, taken as millimetres",
            "all cables are assumed to meet in the origin of the platform, as this firmware"
            " reckons: attachments [0, 0, 0]; measure where they are fixed, else nothing is told"
            " about rotation",
            "spools, gears and line buildup are left out",
        ),
    )


def _reprap(source: TextFile) -> list[tuple[int, Vector]]:
    """Line and anchor of every axis of the last M669 K6."""
    found: list[tuple[int, Vector]] = []
    for number, line in enumerate(source.lines, 1):
        code = line.split(";", 1)[0].strip()
        words = dict(_WORD.findall(code))
        if not code.startswith("M669") or words.get("K") != "6":
            continue
        found = []
        for letter in _LETTERS:
            if letter not in words:
                break
            parts = [source.number(number, part) for part in words[letter].split(":")]
            if len(parts) == 1 and letter != "A":
                # The anchor above the middle: its height alone.
                parts = [0.0, 0.0, *parts]
            if len(parts) != 3:
                raise source.error(
                    number,
                    f"expected x:y:z of anchor {letter}, found '{words[letter]}'; correct it",
                )
            x, y, z = (v * _MILLIMETRE for v in parts)
            found.append((number, (x, y, z)))
    return found


def _sections(source: TextFile) -> list[tuple[int, dict[str, tuple[int, str]]]]:
    """Line of every stepper with an anchor, and its coordinates with their lines."""
    found: list[tuple[int, dict[str, tuple[int, str]]]] = []
    inside = False
    for number, line in enumerate(source.lines, 1):
        text = re.split(r"[#;]", line, maxsplit=1)[0].strip()
        if text.startswith("["):
            inside = _SECTION.fullmatch(text) is not None
            if inside:
                found.append((number, {}))
        match = _ANCHOR.fullmatch(text)
        if inside and match:
            found[-1][1][match[1]] = (number, match[2])
    return [entry for entry in found if entry[1]]


def _of_section(source: TextFile, line: int, given: dict[str, tuple[int, str]]) -> Vector:
    """The anchor of a stepper."""
    missing = [axis for axis in "xyz" if axis not in given]
    if missing:
        raise source.error(
            line, f"expected anchor_x, anchor_y and anchor_z, found no anchor_{missing[0]}; add it"
        )
    x, y, z = (source.number(*given[axis]) * _MILLIMETRE for axis in "xyz")
    return x, y, z
