"""What verbs print: JSON, narration and progress, and lines that several of them share."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from steelyard.experiment.model import Experiment
    from steelyard.report.blocks.document import Document


def print_json(values: Mapping[str, Any]) -> None:
    """Print the result as JSON alone."""
    from steelyard.output import to_json

    print(to_json(values, ascii_only=True))


def print_result(values: Mapping[str, Any], document: Document, *, as_json: bool) -> None:
    """Print the result as JSON alone, or as people read it."""
    if as_json:
        print_json(values)
        return
    from steelyard.report.forms.terminal import show

    show(document)


def say(text: str, *, quiet: bool) -> None:
    """Narrate on stderr where a person looks at it."""
    if not quiet and sys.stderr.isatty():
        sys.stderr.write(text + "\n")


@contextmanager
def progress(*, quiet: bool) -> Iterator[Callable[[str, float], None] | None]:
    """Progress of long work on stderr: a function of what is being done and the fraction that is
    done; None where nobody looks.
    """
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1.0)

        def tell(what: str, fraction: float) -> None:
            bar.update(task, description=what, completed=min(1.0, fraction))

        yield tell


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
