"""A drafted experiment file for people: what was guessed, and what to check."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from steelyard.display import printable
from steelyard.report.blocks.document import Document, Grid, Section, Statement, Statements

_HEAD = ("run", "instrument", "log", "columns", "units", "rate", "samples")
_NUMBERS = frozenset({5, 6})
_LONGEST = 400
"""Characters of a text from a log."""
_FEW_COLUMNS = 4
"""Columns of a stream that are all named."""


def draft_document(values: Mapping[str, Any]) -> Document:
    """What was guessed of the instruments, and what to check.

    Args:
        values: What ``steelyard init --json`` prints.
    """
    place = _shown(values["experiment"])
    lead = Statement(f"{place}: a draft of an experiment file; check what follows.", "note")
    grid = Grid("streams", _HEAD, tuple(_rows(values)), _NUMBERS, repeated=2)
    said = Statements(tuple(_statements(values)))
    return Document(place, lead, (Section("draft", "What was guessed", (grid, said)),))


def _rows(values: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    """A row a stream."""
    for run, entry in values["runs"].items():
        for name, stream in entry["streams"].items():
            log = _beside(stream["log"], values["experiment"])
            if stream["topic"] is not None:
                log = f"{log} {stream['topic']}"
            rate = "" if stream["rate"] is None else f"{stream['rate']:g} Hz"
            cells = (
                run,
                f"{name} ({stream['kind']})",
                log,
                _columns(stream["columns"]),
                ", ".join(dict.fromkeys(stream["units"].values())) or "SI",
                "at rest" if entry["static"] else rate,
                str(stream["samples"]),
            )
            yield tuple(map(_shown, cells))


def _statements(values: Mapping[str, Any]) -> Iterator[Statement]:
    """What was not used, what to check, and what to do next; each once."""
    unused: dict[str, dict[str, None]] = {}
    for each in values["unused"]:
        log = _beside(each["log"], values["experiment"])
        unused.setdefault(log, {})[each["what"]] = None
    for log, whats in unused.items():
        yield Statement(_shown(f"not used: {log}: {'; '.join(whats)}"))
    for check in dict.fromkeys(_checks(values)):
        yield Statement(_shown(f"check: {check}"))
    yield Statement(
        _shown(
            "Fill in where the instruments sit (position, rpy_deg, target), then: steelyard"
            f" inspect {values['experiment']}"
        )
    )


def _beside(log: str, experiment: str) -> str:
    """A log as the experiment file has it, where it lies below that."""
    folder = Path(experiment).absolute().parent
    path = Path(log).absolute()
    return str(path.relative_to(folder)) if path.is_relative_to(folder) else log


def _checks(values: Mapping[str, Any]) -> Iterator[str]:
    for run, entry in values["runs"].items():
        for name, stream in entry["streams"].items():
            yield from (f"{name}: {check}" for check in stream["check"])
        if not entry["static"]:
            word = "the clocks agree" if entry["clocks_agree"] else "sync: auto"
            yield f"run '{run}': {word}: {entry['why']}"


def _columns(names: Sequence[str]) -> str:
    if len(names) <= _FEW_COLUMNS:
        return " ".join(names)
    return f"{names[0]} {names[1]} … {names[-1]}"


def _shown(text: str) -> str:
    return printable(text)[:_LONGEST]
