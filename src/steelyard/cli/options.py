"""Arguments and options that several verbs share, and what they mean."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import date
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from steelyard.errors import InputError

if TYPE_CHECKING:
    from steelyard.experiment.model import Experiment

_Function = TypeVar("_Function", bound=Callable[..., Any])


experiment_argument = click.argument("experiment", type=click.Path(path_type=Path))
"""The experiment file."""


def check_there(path: Path) -> None:
    """See that a file is there before anything heavy is loaded for it.

    Raises:
        InputError: There is nothing, or what there is are recordings.
    """
    if not path.exists():
        raise InputError(f"{path}: expected a file, found nothing there; check the path")
    if path.is_dir():
        inside = path / "experiment.yaml"
        if inside.is_file():
            raise InputError(f"{path}: expected an experiment file, found a folder; name {inside}")
        raise InputError(
            f"{path}: expected an experiment file, found a folder; draft one from the logs in it"
            f" with 'steelyard init {path} --robot ROBOT --out {inside}'"
        )
    if path.suffix.lower() not in (".yaml", ".yml", ".json", ""):
        from steelyard.logs.formats import ending_of

        if ending_of(path) is not None:
            raise InputError(
                f"{path}: expected an experiment file, found a log; draft one from all logs of the"
                f" recording with 'steelyard init {path} … --robot ROBOT --out experiment.yaml'"
            )


def common(function: _Function) -> _Function:
    """Options of every verb."""
    quiet = click.option("--quiet", is_flag=True, help="No progress on stderr.")
    as_json = click.option(
        "--json", "as_json", is_flag=True, help="Print the result as JSON alone."
    )
    return as_json(quiet(function))


def facts_options(function: _Function) -> _Function:
    """What is to stand under the title of a report; names are those of
    :data:`steelyard.report.evidence.made.FACTS`.
    """
    for name, metavar, text in (
        ("date", "DAY", "day of the recording, as 2026-05-31; default: as its clocks say"),
        ("operator", "NAME", "who recorded it"),
        ("project", "NAME", "what it belongs to"),
    ):
        given = click.option(f"--{name}", metavar=metavar, help=f"For the report: {text}.")
        function = given(function)
    return function


def checked_day(day: str | None) -> str | None:
    """A date as the report has it.

    Raises:
        InputError: It is none.
    """
    if day is None:
        return None
    try:
        return date.fromisoformat(day).isoformat()
    except ValueError:
        raise InputError(
            f"--date: expected a day such as 2026-05-31, found '{day}'; correct it"
        ) from None


out_option = partial(click.option, "--out", type=click.Path(path_type=Path))
"""Where results go."""
force_option = partial(
    click.option, "--force", is_flag=True, help="Replace files of the same names."
)
"""Whether results may replace others."""
pose_option = partial(click.option, nargs=6, type=float, metavar="X Y Z ROLL PITCH YAW")
"""A pose of the platform: three lengths [m], three angles [deg]; the first argument is its name."""
sensors_option = partial(
    click.option, "--sensors", default="paper", show_default=True, metavar="NAME|FILE"
)
"""The sensors of a virtual experiment."""
seed_option = partial(click.option, "--seed", type=click.IntRange(0), default=0, show_default=True)
"""The seed of whatever is drawn at random."""
runs_option = partial(click.option, "--run", "runs", multiple=True)
"""Some of the runs; see :func:`selected`."""


def limits_option(function: _Function) -> _Function:
    """What reading one log may take; holds for the processes that the verb begins, too."""
    return click.option(
        "--limits",
        metavar="S,MIB",
        expose_value=False,
        callback=_limited,
        help="What reading one log may take: seconds of the processor and MiB of memory.  [default:"
        " 6,768 and what its size adds]",
    )(function)


def _limited(context: click.Context, _option: click.Parameter, text: str | None) -> None:
    """Set the variable of the environment that readers look at, until the verb has ended."""
    if text is None:
        return
    from steelyard.logs.fence import VARIABLE, limits_of

    limits_of(text, "--limits")
    before = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = text

    def restore() -> None:
        if before is None:
            os.environ.pop(VARIABLE, None)
        else:
            os.environ[VARIABLE] = before

    context.call_on_close(restore)


def selected(experiment: Experiment, names: Sequence[str]) -> Experiment:
    """The experiment with some of its runs; all of them where none is named.

    Raises:
        InputError: There is no run of such a name.
    """
    if not names:
        return experiment
    known = [run.name for run in experiment.runs]
    for name in names:
        if name not in known:
            raise InputError(
                f"--run: expected one of {', '.join(known)}, found '{name}'; choose one of these"
            )
    return replace(experiment, runs=tuple(run for run in experiment.runs if run.name in names))
