"""The verb that puts an experiment into one tidy form."""

from __future__ import annotations

import shutil
from pathlib import Path

from steelyard.cli.progress import progress
from steelyard.cli.verbs import print_json
from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.experiment.read import read_experiment
from steelyard.experiment.tidy import tidied
from steelyard.experiment.write import TableFormat, write_experiment
from steelyard.output import check_target, results_folder

TRUTH = "truth.json"
_LARGEST_TRUTH = 1 << 24  # bytes


def run_conversion(
    place: Path, out: Path, *, tables: TableFormat, force: bool, as_json: bool, quiet: bool
) -> None:
    """Write an experiment with all its streams on one clock."""
    check_target(out, force=force)
    experiment = read_experiment(place)
    _check_apart(experiment, place, out)
    if any(run.unsynchronised for run in experiment.runs):
        from steelyard.identification.synchronisation import synchronised

        with progress(quiet=quiet) as tell:
            experiment = synchronised(experiment, tell)
    with results_folder(out, force=force) as folder:
        write_experiment(tidied(experiment), folder, tables=tables, with_robot=True)
        truth = place.parent / TRUTH
        if truth.is_file() and truth.stat().st_size <= _LARGEST_TRUTH:
            shutil.copyfile(truth, folder / TRUTH)
        written = [path for path in folder.rglob("*") if path.is_file()]
        size = sum(path.stat().st_size for path in written)
    runs = {
        run.name: {name: len(stream) for name, stream in run.streams.items()}
        for run in experiment.runs
    }
    if as_json:
        print_json(
            {
                "experiment": str(out / "experiment.yaml"),
                "samples": runs,
                "files": len(written),
                "bytes": size,
            }
        )
        return
    print(
        f"{out / 'experiment.yaml'}: {len(runs)} run{'s' if len(runs) > 1 else ''}, {len(written)}"
        f" files, {size / 1e6:.1f} MB"
    )
    for name, samples in runs.items():
        print(
            f"  {name}: "
            + ", ".join(f"{count} samples of {stream}" for stream, count in samples.items())
        )


def _check_apart(experiment: Experiment, place: Path, out: Path) -> None:
    """See that nothing is written over what is read."""
    target = out.resolve()
    read = [
        place,
        *(Path(stream.source) for run in experiment.runs for stream in run.streams.values()),
    ]
    for path in read:
        if path.resolve().is_relative_to(target):
            raise InputError(
                f"{out}: expected a folder apart from the recordings, found {path} in it; choose"
                " another with --out"
            )
