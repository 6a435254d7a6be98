"""The verb `campaign`."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from steelyard.cli.options import common, limits_option, out_option
from steelyard.cli.printing import print_result, progress
from steelyard.errors import InputError

if TYPE_CHECKING:
    from steelyard.campaigns.tasks import Engine

PROBLEMS = 3
"""Exit status where all is written, but an experiment was rejected, refused or lost."""


@click.command(short_help="Identify many experiments.")
@click.argument("experiments", nargs=-1, required=True, metavar="EXPERIMENT|FOLDER|GLOB...")
@click.option(
    "--method",
    "methods",
    multiple=True,
    metavar="NAME",
    help="As in identify; may be repeated. Default: the best there is, with the baseline beside"
    " it.",
)
@click.option(
    "--verb",
    type=click.Choice(["identify", "inspect"]),
    default="identify",
    show_default=True,
    help="What is done with each experiment.",
)
@click.option("--reports", is_flag=True, help="Write a report beside every estimate.")
@click.option(
    "--jobs",
    type=click.IntRange(1),
    metavar="N",
    help="Processes on this machine; default: as many as it has cores.",
)
@click.option(
    "--scheduler", metavar="ADDRESS", help="Work on a Dask cluster instead: tcp://HOST:PORT."
)
@click.option(
    "--slurm",
    metavar="OPTIONS",
    help="Work in job arrays of SLURM instead, such as partition=short,time=30,mem_gb=4.",
)
@click.option(
    "--table",
    metavar="URL",
    help="Also write the rows to a database: postgresql://USER@HOST:PORT/DATABASE, with #TABLE"
    " behind it where that is not 'campaign'. The password is best left to ~/.pgpass.",
)
@out_option(
    required=True,
    help="Folder for campaign.parquet, campaign.html and all estimates; new, or of a campaign,"
    " which is gone on with.",
)
@limits_option
@common
def campaign(
    experiments: tuple[str, ...],
    methods: tuple[str, ...],
    verb: str,
    reports: bool,
    jobs: int | None,
    scheduler: str | None,
    slurm: str | None,
    table: str | None,
    out: Path,
    as_json: bool,
    quiet: bool,
) -> None:
    """Identify many experiments: files, all experiment.yaml in folders, or globs.

    What was done before, from the same files by the same version, is not done again: after Ctrl-C
    or a failure the same command goes on. An experiment that fails costs none of the others; its
    row says why, and the exit status is 3; so it is where a result is rejected.
    """
    from steelyard.campaigns.brief import brief
    from steelyard.campaigns.run import campaign as campaigned

    with (
        engine_for(jobs, scheduler, slurm, out, quiet=quiet) as engine,
        keeping(out),
        progress(quiet=quiet) as tell,
    ):
        found = campaigned(
            experiments,
            out,
            methods,
            verb=verb,
            reports=reports,
            table=table,
            engine=engine,
            progress=tell,
        )
    print_result(found.to_dict(), brief(found), as_json=as_json)
    if not found.sound:
        sys.exit(PROBLEMS)


@contextmanager
def engine_for(
    jobs: int | None, scheduler: str | None, slurm: str | None, out: Path, *, quiet: bool
) -> Iterator[Engine]:
    """Where to work, as the options say.

    Raises:
        InputError: Several are named, or one that is not there.
    """
    from steelyard.campaigns.run import engine_of, prepared

    named = {"--jobs": jobs, "--scheduler": scheduler, "--slurm": slurm}
    given = [name for name, value in named.items() if value is not None]
    if len(given) > 1:
        raise InputError(f"{given[1]}: expected one engine, found {given[0]} too; keep one of them")
    if scheduler is not None:
        from steelyard.campaigns.engines.dask_cluster import DaskCluster, connected

        with connected(scheduler) as client:
            if not quiet and sys.stderr.isatty():
                sys.stderr.write(f"Dask dashboard: {client.dashboard_link}\n")
            yield DaskCluster(client)
    elif slurm is not None:
        from steelyard.campaigns.engines.slurm import Slurm, SlurmOptions, require_slurm

        options = SlurmOptions.of(slurm)
        require_slurm()
        yield Slurm(options, prepared(out) / "slurm")
    else:
        yield engine_of(jobs, None)


@contextmanager
def keeping(out: Path) -> Iterator[None]:
    """Say what is left where Ctrl-C or a polite kill ends the work."""
    try:
        yield
    except (KeyboardInterrupt, SystemExit) as end:
        status = end.code if isinstance(end, SystemExit) else 130
        sys.stderr.write(
            f"steelyard: interrupted; what was done is in {out}: the same command goes on from"
            " there\n"
        )
        sys.exit(status)
