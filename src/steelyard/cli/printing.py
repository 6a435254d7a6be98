"""What verbs print: JSON, narration, and lines that several of them share."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from steelyard.experiment.model import Experiment


def print_json(values: Mapping[str, Any]) -> None:
    """Print the result as JSON alone."""
    from steelyard.output import to_json

    print(to_json(values, ascii_only=True))


def say(text: str, *, quiet: bool) -> None:
    """Narrate on stderr where a person looks at it."""
    if not quiet and sys.stderr.isatty():
        sys.stderr.write(text + "\n")


def samples_of(experiment: Experiment) -> dict[str, dict[str, int]]:
    """Run -> instrument -> number of samples."""
    return {
        run.name: {name: len(stream) for name, stream in run.streams.items()}
        for run in experiment.runs
    }


def print_samples(samples: Mapping[str, Mapping[str, int]]) -> None:
    """Print a line a run; see :func:`samples_of`."""
    for name, streams in samples.items():
        counts = (f"{count} samples of {stream}" for stream, count in streams.items())
        print(f"  {name}: {', '.join(counts)}")
