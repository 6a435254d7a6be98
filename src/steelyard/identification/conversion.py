"""An experiment with all its logs in one tidy form, to share and to keep."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from steelyard.errors import InputError
from steelyard.experiment.equivalent.tidy import tidied
from steelyard.experiment.given import GivenExperiment, experiment_of
from steelyard.experiment.model import Experiment
from steelyard.experiment.write import TableFormat, write_experiment
from steelyard.identification.synchronisation import Progress, synchronised
from steelyard.output import check_target, results_folder, write_file

TRUTH = "truth.json"
"""True body that a simulation leaves beside its experiment."""
LARGEST_TRUTH = 1 << 24
"""[bytes]; a larger file was written by something else."""


@dataclass(frozen=True, eq=False)
class Converted:
    """What was written."""

    path: Path
    """Of the experiment file."""
    experiment: Experiment
    """As it was read, its clocks found."""
    sizes: tuple[int, ...]
    """Of all files [bytes]."""

    def __repr__(self) -> str:
        return f"{self.path}: {len(self.sizes)} files, {sum(self.sizes) / 1e6:.1f} MB"


def convert(
    experiment: GivenExperiment,
    out: str | Path,
    progress: Progress = None,
    *,
    tables: TableFormat = "parquet",
    force: bool = False,
    sealed: Callable[[Path, Experiment], None] | None = None,
) -> Converted:
    """Write an experiment with all its streams on one clock and in SI units; all of it or nothing.

    Args:
        experiment: A value, or the path of its file.
        out: A new folder, or an empty one.
        progress: Called with what is being done and the fraction that is done.
        tables: ``parquet`` or ``csv``.
        force: Whether to replace files of the same names.
        sealed: Is given the folder once it is complete, before it is seen, and what was read; what
            it writes there belongs to the results.

    Raises:
        InputError: The folder cannot be written to, or holds what is read.
    """
    out = Path(out)
    check_target(out, force=force)
    recorded = experiment_of(experiment)
    _check_apart(recorded, out)
    if any(run.unsynchronised for run in recorded.runs):
        recorded = synchronised(recorded, progress)
    with results_folder(out, force=force) as folder:
        write_experiment(tidied(recorded), folder, tables=tables, with_robot=True)
        if recorded.source:
            _copy_truth(Path(recorded.source).parent, folder)
        if sealed is not None:
            sealed(folder, recorded)
        sizes = tuple(each.stat().st_size for each in folder.rglob("*") if each.is_file())
    return Converted(out / "experiment.yaml", recorded, sizes)


def _copy_truth(source: Path, target: Path) -> None:
    """Copy the true body from one folder to another, where there is one."""
    truth = source / TRUTH
    if truth.is_file() and truth.stat().st_size <= LARGEST_TRUTH:
        write_file(target / TRUTH, truth.read_bytes())


def _check_apart(experiment: Experiment, out: Path) -> None:
    """See that nothing is written over what is read."""
    target = out.resolve()
    read = [experiment.source, *(s.source for run in experiment.runs for s in run.streams.values())]
    for place in read:
        path = Path(place)
        if place and os.path.lexists(path) and path.resolve().is_relative_to(target):
            raise InputError(
                f"{out}: expected a folder apart from the recordings, found {path} in it; choose"
                " another with --out"
            )
