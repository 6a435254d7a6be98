"""What verbs print: JSON, narration and progress, and lines that several of them share."""

from __future__ import annotations

import shutil
import sys
import textwrap
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from time import monotonic
from typing import TYPE_CHECKING, Any, TextIO

from steelyard.display import time_left

Tell = Callable[[str, float], None]
"""Is told what is being done and the fraction that is done."""

if TYPE_CHECKING:
    from steelyard.experiment.model import Experiment
    from steelyard.report.blocks.document import Document


def print_json(values: Mapping[str, Any]) -> None:
    """Print the result as JSON alone."""
    from steelyard.output import to_json

    print(to_json(values, ascii_only=True))


def in_lines(text: str, stream: TextIO, indent: str = "") -> str:
    """A sentence in lines of whole words where it is for a terminal; elsewhere in one line."""
    if not stream.isatty():
        return f"{indent}{text}"
    return textwrap.fill(
        text,
        shutil.get_terminal_size().columns,
        initial_indent=indent,
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,
    )


def say(text: str, indent: str = "") -> None:
    """Print a sentence; see :func:`in_lines`. Commands are printed as they are, to be copied."""
    print(in_lines(text, sys.stdout, indent))


def print_result(values: Mapping[str, Any], document: Document, *, as_json: bool) -> None:
    """Print the result as JSON alone, or as people read it."""
    if as_json:
        print_json(values)
        return
    from steelyard.report.forms.terminal import show

    show(document)


@contextmanager
def progress(*, quiet: bool) -> Iterator[Tell | None]:
    """One bar on stderr for the whole of a verb, there at once, with the time that is left where
    that can be told: a function of what is being done and the fraction that is done; None where
    nobody looks. A terminal that cannot move its cursor gets a line for each thing that is done.
    """
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    screen = Console(stderr=True)
    if screen.is_dumb_terminal:
        from steelyard.report.progress_bar import tell_in_lines

        in_words = tell_in_lines()
        in_words("loading", 0.0)
        yield in_words
        return
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TextColumn("{task.fields[left]}"),
    )
    with Progress(*columns, console=screen, transient=True) as bar:
        task = bar.add_task("loading", total=1.0, left="")
        begun, done = monotonic(), 0.0

        def tell(what: str, fraction: float) -> None:
            nonlocal done
            # Parts that begin again, such as a fit that is tried twice, do not take anything back.
            done = max(done, min(1.0, fraction))
            left = time_left(done, monotonic() - begun)
            bar.update(task, description=what or "loading", completed=done, left=left)

        yield tell


def parts(tell: Tell | None, *weights: float) -> list[Tell | None]:
    """Functions for works that follow each other, each of which tells its own fraction.

    Args:
        tell: For the whole.
        weights: How long each takes, in any unit.
    """
    return [_part(tell, sum(weights[:i]), w, sum(weights)) for i, w in enumerate(weights)]


def _part(tell: Tell | None, before: float, weight: float, whole: float) -> Tell | None:
    if tell is None:
        return None
    return lambda what, fraction: tell(what, (before + weight * min(1.0, fraction)) / whole)


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
        say(f"{name}: {', '.join(counts)}", "  ")
