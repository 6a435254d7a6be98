"""The verb `convert`."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from steelyard.cli.options import (
    check_there,
    common,
    experiment_argument,
    force_option,
    limits_option,
    out_option,
)
from steelyard.cli.printing import print_json, print_samples, progress, samples_of

if TYPE_CHECKING:
    from steelyard.experiment.model import Experiment


@click.command(short_help="An experiment in one tidy form, on one clock.")
@experiment_argument
@out_option(help="Folder for the experiment; must be new or empty.", required=True)
@click.option(
    "--format",
    "tables",
    type=click.Choice(["parquet", "csv"]),
    default="parquet",
    show_default=True,
    help="Of the streams.",
)
@force_option()
@limits_option
@common
def convert(
    experiment: Path, out: Path, tables: Any, force: bool, as_json: bool, quiet: bool
) -> None:
    """Put EXPERIMENT with all its logs into one tidy form, on one clock and in SI units, to share
    and to keep.
    """
    check_there(experiment)
    from steelyard.cli.inputs import read_files
    from steelyard.identification.conversion import convert as converted
    from steelyard.provenance.record import write_provenance

    def sealed(folder: Path, recorded: Experiment) -> None:
        write_provenance(folder, out, read_files(recorded, experiment), sys.argv[1:])

    with progress(quiet=quiet) as tell:
        found = converted(experiment, out, tell, tables=tables, force=force, sealed=sealed)
    _say(found.path, samples_of(found.experiment), found.sizes, as_json=as_json)


def _say(
    experiment: Path,
    samples: Mapping[str, Mapping[str, int]],
    sizes: Sequence[int],
    *,
    as_json: bool,
) -> None:
    """Say what was written: an experiment file, its samples, and files of these sizes [bytes]."""
    if as_json:
        values = {"experiment": str(experiment), "samples": samples}
        print_json({**values, "files": len(sizes), "bytes": sum(sizes)})
        return
    runs = f"{len(samples)} run{'s' if len(samples) > 1 else ''}"
    print(f"{experiment}: {runs}, {len(sizes)} files, {sum(sizes) / 1e6:.1f} MB")
    print_samples(samples)
