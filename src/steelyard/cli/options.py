"""Arguments and options that several verbs share, and what they mean."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from steelyard.errors import InputError

if TYPE_CHECKING:
    from steelyard.experiment.model import Experiment

_Function = TypeVar("_Function", bound=Callable[..., Any])

experiment_argument = click.argument("experiment", type=click.Path(path_type=Path))
"""The experiment file."""


def common(function: _Function) -> _Function:
    """Options of every verb."""
    quiet = click.option("--quiet", is_flag=True, help="No progress on stderr.")
    as_json = click.option(
        "--json", "as_json", is_flag=True, help="Print the result as JSON alone."
    )
    return as_json(quiet(function))


def out_option(
    text: str,
    *,
    required: bool = False,
    metavar: str | None = None,
    default: Path | None = None,
) -> Callable[[_Function], _Function]:
    """Where results go.

    Args:
        text: What is written there.
        required: Whether nothing is done without.
        metavar: How help calls it; None: the kind of its value.
        default: Where they go without it.
    """
    # To Click a default of None is one: a required option would not be missed.
    settings: dict[str, Any] = {"required": required, "metavar": metavar, "help": text}
    if default is not None:
        settings |= {"default": default, "show_default": True}
    return click.option("--out", type=click.Path(path_type=Path), **settings)


def force_option(
    text: str = "Replace files of the same names.",
) -> Callable[[_Function], _Function]:
    """Whether results may replace others.

    Args:
        text: What is replaced.
    """
    return click.option("--force", is_flag=True, help=text)


def pose_option(name: str, text: str) -> Callable[[_Function], _Function]:
    """A pose of the platform: three lengths [m], three angles [deg].

    Args:
        name: Of the option.
        text: What the platform does there.
    """
    return click.option(name, nargs=6, type=float, metavar="X Y Z ROLL PITCH YAW", help=text)


def sensors_option(text: str) -> Callable[[_Function], _Function]:
    """The sensors of a virtual experiment.

    Args:
        text: What may be named.
    """
    return click.option("--sensors", default="paper", show_default=True, help=text)


def seed_option(text: str) -> Callable[[_Function], _Function]:
    """The seed of whatever is drawn at random.

    Args:
        text: What follows from it.
    """
    return click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help=text)


def runs_option(text: str, *, metavar: str) -> Callable[[_Function], _Function]:
    """Some of the runs; see :func:`selected`.

    Args:
        text: What is done with them.
        metavar: How help calls one.
    """
    return click.option("--run", "runs", multiple=True, metavar=metavar, help=text)


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
