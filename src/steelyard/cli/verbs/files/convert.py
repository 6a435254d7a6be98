"""The verb `convert`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from steelyard.cli.options import check_there, common, experiment_argument, force_option, out_option
from steelyard.cli.printing import print_json, print_samples, progress, samples_of
from steelyard.cli.truth import LARGEST_TRUTH, TRUTH
from steelyard.errors import InputError

if TYPE_CHECKING:
    from steelyard.experiment.model import Experiment


@click.command()
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
@common
def convert(
    experiment: Path, out: Path, tables: Any, force: bool, as_json: bool, quiet: bool
) -> None:
    """Put EXPERIMENT with all its logs into one tidy form, on one clock and in SI units, to share
    and to keep.
    """
    check_there(experiment)
    from steelyard.experiment.read import read_experiment
    from steelyard.experiment.tidy import tidied
    from steelyard.experiment.write import write_experiment
    from steelyard.output import check_target, results_folder

    check_target(out, force=force)
    recorded = read_experiment(experiment)
    _check_apart(recorded, experiment, out)
    if any(run.unsynchronised for run in recorded.runs):
        from steelyard.identification.synchronisation import synchronised

        with progress(quiet=quiet) as tell:
            recorded = synchronised(recorded, tell)
    with results_folder(out, force=force) as folder:
        write_experiment(tidied(recorded), folder, tables=tables, with_robot=True)
        _copy_truth(experiment.parent, folder)
        sizes = [path.stat().st_size for path in folder.rglob("*") if path.is_file()]
    _say(out / "experiment.yaml", samples_of(recorded), sizes, as_json=as_json)


def _copy_truth(source: Path, target: Path) -> None:
    """Copy the true body from one folder to another, where there is one."""
    from steelyard.output import write_file

    truth = source / TRUTH
    if truth.is_file() and truth.stat().st_size <= LARGEST_TRUTH:
        write_file(target / TRUTH, truth.read_bytes())


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


def _check_apart(experiment: Experiment, place: Path, out: Path) -> None:
    """See that nothing is written over what is read."""
    target = out.resolve()
    read = [place]
    for run in experiment.runs:
        read += [Path(stream.source) for stream in run.streams.values()]
    for path in read:
        if path.resolve().is_relative_to(target):
            raise InputError(
                f"{out}: expected a folder apart from the recordings, found {path} in it; choose"
                " another with --out"
            )
