"""The verb `study`."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from steelyard.cli.options import common, limits_option, out_option, seed_option
from steelyard.cli.printing import print_result, progress
from steelyard.cli.verbs.campaign import PROBLEMS, engine_for, keeping


@click.command(short_help="Check by simulation what estimates state of themselves.")
@click.argument("what", metavar="ROBOT|EXPERIMENT")
@click.option(
    "--draws", type=click.IntRange(2), default=None, metavar="N", help="Experiments to simulate."
)
@click.option(
    "--bootstrap",
    type=click.IntRange(2),
    default=None,
    metavar="N",
    help="Draw from the recordings of EXPERIMENT instead, with replacement.",
)
@click.option(
    "--block",
    type=click.FloatRange(0.5),
    default=None,
    metavar="S",
    help="Of --bootstrap: draw blocks of this length; default: whole runs.",
)
@click.option("--method", "methods", multiple=True, metavar="NAME", help="As in identify.")
@click.option("--sensors", metavar="NAME|FILE", help="Of a robot: as in simulate.")
@click.option("--trajectory", metavar="NAME|FILE", help="Of a robot: as in simulate.")
@click.option("--duration", type=float, metavar="S", help="Of a robot: as in simulate.")
@seed_option(help="Of the first draw.")
@click.option(
    "--mistakes",
    "all_mistakes",
    is_flag=True,
    help="Also make every mistake that people make (units, signs, orders, places, clocks, a hand on"
    " the platform) in every draw, one at a time, and count how often the verdict rejects it.",
)
@click.option(
    "--mistake",
    "mistakes",
    multiple=True,
    metavar="NAME",
    help="The same with this one only; may be repeated. A wrong name prints all of them.",
)
@click.option("--jobs", type=click.IntRange(1), metavar="N", help="As in campaign.")
@click.option("--scheduler", metavar="ADDRESS", help="As in campaign.")
@click.option("--slurm", metavar="OPTIONS", help="As in campaign.")
@out_option(
    required=True,
    help="Folder for study.json, study.html and the rows of all draws; new, or of the same study,"
    " which is gone on with.",
)
@limits_option
@common
def study(
    what: str,
    draws: int | None,
    bootstrap: int | None,
    block: float | None,
    methods: tuple[str, ...],
    sensors: str | None,
    trajectory: str | None,
    duration: float | None,
    seed: int,
    all_mistakes: bool,
    mistakes: tuple[str, ...],
    jobs: int | None,
    scheduler: str | None,
    slurm: str | None,
    out: Path,
    as_json: bool,
    quiet: bool,
) -> None:
    """Check what estimates state of themselves: simulate ROBOT, or EXPERIMENT as it was recorded,
    many times, and count.

    Of each method: errors against the bound, coverage of the intervals, chi-square of each
    parameter, verdicts; with --mistakes also the power of the verdict against each. Ends with
    status 3 where a draw gave no estimate.
    """
    from steelyard.campaigns.study.document import study_document
    from steelyard.campaigns.study.run import ALL
    from steelyard.campaigns.study.run import study as studied

    with (
        engine_for(jobs, scheduler, slurm, out, quiet=quiet) as engine,
        keeping(out),
        progress(quiet=quiet) as tell,
    ):
        found = studied(
            what,
            out,
            draws or 0,
            methods,
            bootstrap=bootstrap or 0,
            block=block or 0.0,
            sensors=sensors,
            trajectory=trajectory,
            duration=duration,
            seed=seed,
            mistakes=(ALL,) if all_mistakes else mistakes,
            engine=engine,
            progress=tell,
        )
    print_result(found.to_dict(), study_document(found), as_json=as_json)
    if found.problems:
        sys.exit(PROBLEMS)
