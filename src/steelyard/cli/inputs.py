"""Which files a command was made of."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from steelyard.cli.truth import TRUTH

if TYPE_CHECKING:
    from steelyard.experiment.model import Experiment


def read_files(recorded: Experiment, experiment: Path) -> list[Path]:
    """Files of an experiment, the experiment file first, and the truth that lies beside it."""
    from steelyard.provenance.hashes import inputs_of

    truth = experiment.parent / TRUTH
    return [*inputs_of(recorded), *([truth] if truth.is_file() else [])]


def named_files(words: Sequence[str], out: Path | None) -> list[Path]:
    """Files that the words of a command name, and those that these name."""
    from steelyard.provenance.hashes import mentioned_files

    found: list[Path] = []
    for path in _paths(words):
        if path.is_file() and (out is None or not path.resolve().is_relative_to(out.resolve())):
            found += [path, *mentioned_files(path)]
    return list(dict.fromkeys(found))


def _paths(words: Sequence[str]) -> Iterator[Path]:
    """Places that words name; of a folder, the estimate in it."""
    for word in words:
        # ESTIMATE#LOAD and ESTIMATE:METHOD name files, too.
        for text in (word, word.split("#")[0], word.rsplit(":", 1)[0]):
            try:
                path = Path(text)
                if not word.startswith("-") and path.exists():
                    yield path / "estimate.json" if path.is_dir() else path
                    break
            except (OSError, ValueError):
                continue
