"""The verb `identify`."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from steelyard.cli.inputs import read_files
from steelyard.cli.options import (
    check_there,
    checked_day,
    common,
    experiment_argument,
    facts_options,
    force_option,
    limits_option,
    out_option,
    runs_option,
    selected,
)
from steelyard.cli.printing import print_result, progress
from steelyard.cli.truth import known_truth, known_truth_of_loads
from steelyard.errors import InputError

if TYPE_CHECKING:
    from steelyard.bodies.mass_region import Box, Ellipsoid

NOT_ACCEPTED = 3
"""Exit status of an estimate that was made and written, but is not accepted."""


@click.command(short_help="Estimate mass, centre of gravity and inertia.")
@experiment_argument
@click.option(
    "--method",
    "methods",
    multiple=True,
    metavar="NAME",
    help=(
        "two-step, least-squares, instrumental-variables, consistent, recursive,"
        " maximum-likelihood, or all; may be repeated. Default: maximum-likelihood, with two-step"
        " beside it."
    ),
)
@click.option(
    "--acceleration",
    type=click.Choice(["imu", "tracker"]),
    help="two-step: where the acceleration comes from.",
)
@click.option(
    "--combine",
    type=click.Choice(["median", "pooled"]),
    default="median",
    show_default=True,
    help="two-step: the median over the runs, or one fit over all of them.",
)
@runs_option(help="Use this run only; may be repeated.", metavar="RUN")
@click.option(
    "--holdout",
    multiple=True,
    metavar="RUN",
    help="Leave this run out and predict its forces; may be repeated.",
)
@click.option(
    "--without",
    multiple=True,
    metavar="INSTRUMENT",
    help="Leave out what this instrument has recorded; may be repeated.",
)
@click.option(
    "--box",
    nargs=6,
    type=float,
    metavar="X0 Y0 Z0 X1 Y1 Z1",
    help="consistent, maximum-likelihood: corners of a box that holds all mass [m].",
)
@click.option(
    "--ellipsoid",
    nargs=6,
    type=float,
    metavar="X Y Z A B C",
    help="consistent, maximum-likelihood: centre and semi-axes of an ellipsoid, likewise [m].",
)
@click.option(
    "--towards-nominal",
    is_flag=True,
    help=(
        "consistent, maximum-likelihood: pull towards the nominal body as far as that predicts runs"
        " left out better."
    ),
)
@click.option(
    "--anyway",
    is_flag=True,
    help="Run all methods though the recordings give away that the description is wrong.",
)
@click.option(
    "--jobs",
    type=click.IntRange(1),
    default=1,
    show_default=True,
    metavar="N",
    help="Processes that work at a time: fits of several methods and of runs left out, and windows"
    " of a long recording.",
)
@out_option(
    help="Folder for estimate.json, the report (report.html, .md, .json) and motion.parquet;"
    " without it nothing is written."
)
@force_option()
@click.option("--details", is_flag=True, help="Print what each run says alone, too.")
@limits_option
@facts_options
@common
def identify(
    experiment: Path,
    methods: tuple[str, ...],
    acceleration: Any,
    combine: Any,
    runs: tuple[str, ...],
    holdout: tuple[str, ...],
    without: tuple[str, ...],
    box: tuple[float, ...] | None,
    ellipsoid: tuple[float, ...] | None,
    towards_nominal: bool,
    anyway: bool,
    jobs: int,
    out: Path | None,
    force: bool,
    details: bool,
    project: str | None,
    operator: str | None,
    date: str | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Estimate mass, centre of gravity and inertia from the recordings that EXPERIMENT lists."""
    check_there(experiment)
    with progress(quiet=quiet) as tell:
        from steelyard.experiment.read import read_experiment
        from steelyard.identification.chosen_methods import chosen_methods, default_methods
        from steelyard.identification.methods.consistent import Consistent
        from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
        from steelyard.identification.methods.two_step import TwoStep
        from steelyard.inspection.identify import identify as identified
        from steelyard.output import check_target, results_folder
        from steelyard.provenance.record import write_provenance
        from steelyard.report.documents.identification import brief_of
        from steelyard.report.evidence.made import made_of
        from steelyard.report.evidence.summary import summarise
        from steelyard.report.write import identification_values, write_identification

        facts = {"project": project, "operator": operator, "date": checked_day(date)}
        regions = _regions(box, ellipsoid)
        with_options: tuple[TwoStep | Consistent | MaximumLikelihood, ...] = (
            TwoStep(acceleration=acceleration, combine=combine),
            Consistent(regions=regions, towards_nominal=towards_nominal),
            MaximumLikelihood(regions=regions, towards_nominal=towards_nominal),
        )
        ready: dict[str, Any] = {method.name: method for method in with_options}
        # A name that is wrong is said before anything is read.
        chosen_methods(methods, ready)
        if out is not None:
            check_target(out, force=force)
        recorded = selected(read_experiment(experiment), runs).without(*without)
        found = identified(
            recorded, methods, tell, holdout=holdout, ready=ready, anyway=anyway, jobs=jobs
        )
    truth, of_loads = known_truth(experiment.parent), known_truth_of_loads(experiment.parent)
    if out is None:
        summary = summarise(found, truth, with_evidence=False, truth_of_loads=of_loads)
    else:
        options = _in_words(
            {
                "method": methods or list(reversed(default_methods(recorded))),
                "acceleration": acceleration,
                "combine": combine,
                "run": runs,
                "holdout": holdout,
                "without": without,
                "box": box,
                "ellipsoid": ellipsoid,
                "towards-nominal": towards_nominal,
                "anyway": anyway,
            }
        )
        made = made_of(recorded, options, facts)
        summary = summarise(found, truth, made=made, truth_of_loads=of_loads)
        with results_folder(out, force=force) as folder:
            write_identification(found, summary, folder)
            write_provenance(folder, out, read_files(recorded, experiment), sys.argv[1:])
    print_result(identification_values(found), brief_of(summary, details=details), as_json=as_json)
    if found.amendment and not as_json:
        print(f"\nTo merge into {experiment}:\n\n{found.amendment}")
    if found.is_rejected:
        sys.exit(NOT_ACCEPTED)


def _in_words(given: Mapping[str, Any]) -> dict[str, str]:
    """What was asked for; options that were not given are left out."""
    options = {}
    for name, value in given.items():
        if value is True:
            options[name] = "yes"
        elif isinstance(value, str):
            options[name] = value
        elif value:
            options[name] = ", ".join(map(str, value))
    return options


def _regions(
    box: Sequence[float] | None, ellipsoid: Sequence[float] | None
) -> tuple[Box | Ellipsoid, ...]:
    """Where the mass lies, as the user says."""
    import numpy as np

    from steelyard.bodies.mass_region import Box, Ellipsoid

    regions: list[Box | Ellipsoid] = []
    if box:
        lower, upper = box[:3], box[3:]
        if not all(low < high for low, high in zip(lower, upper, strict=True)):
            raise InputError(
                "--box: expected the lower corner, then the upper one [m], found"
                f" {' '.join(map(str, box))}; order them"
            )
        regions.append(Box(np.array(lower), np.array(upper)))
    if ellipsoid:
        if min(ellipsoid[3:]) <= 0:
            raise InputError(
                "--ellipsoid: expected the centre, then three semi-axes above 0 [m], found"
                f" {' '.join(map(str, ellipsoid))}; correct it"
            )
        regions.append(Ellipsoid(np.array(ellipsoid[:3]), np.array(ellipsoid[3:])))
    return tuple(regions)
