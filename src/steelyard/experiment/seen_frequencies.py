"""Natural frequencies that somebody has seen: observations of the body that belong to no motion."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.experiment.model import Experiment, Run, SeenFrequencies, Stream
from steelyard.instruments.swing_frequencies import SwingFrequencies

_BY_HAND = 0.01
"""1-sigma of a frequency whose noise is not stated, over the frequency."""


def with_frequencies_apart(experiment: Experiment) -> Experiment:
    """The experiment with all rows of natural frequencies taken out of the runs, and without runs of
    which nothing else is left.

    Args:
        experiment: As it was read.

    Raises:
        InputError: A row says neither where the platform hung nor on which lengths, or its
            frequencies are no ascending positive numbers.
    """
    tables = {
        name for name, each in experiment.instruments.items() if isinstance(each, SwingFrequencies)
    }
    if not tables:
        return experiment
    seen = []
    runs = []
    for run in experiment.runs:
        for name in tables & run.streams.keys():
            seen += list(_rows(experiment, run, name, run.streams[name]))
        rest = {name: each for name, each in run.streams.items() if name not in tables}
        if rest:
            sync = {name: time for name, time in run.sync.items() if name in rest}
            runs.append(replace(run, streams=rest, sync=sync))
    instruments = {k: v for k, v in experiment.instruments.items() if k not in tables}
    return replace(experiment, instruments=instruments, runs=tuple(runs), frequencies=tuple(seen))


def _rows(experiment: Experiment, run: Run, name: str, stream: Stream) -> Iterator[SeenFrequencies]:
    """The rows of one table."""
    instrument = experiment.instruments[name]
    assert isinstance(instrument, SwingFrequencies)
    values = stream.values
    whole = "position" in values and "angles" in values
    for i, row in enumerate(values["frequencies"]):
        where = f"run '{run.name}': row {i + 1} of '{name}'"
        seen = row[np.isfinite(row)]
        if not len(seen) or (seen <= 0).any() or (np.diff(seen) <= 0).any():
            raise InputError(
                f"{where}: expected natural frequencies above zero in ascending order [Hz], found"
                f" {', '.join(f'{f:g}' for f in row)}; correct them"
            )
        pose = np.concatenate([values["position"][i], values["angles"][i]]) if whole else None
        lengths = values["lengths"][i] if "lengths" in values else None
        given = [each for each in (pose, lengths) if each is not None and np.isfinite(each).all()]
        if len(given) != 1:
            raise InputError(
                f"{where}: expected either the pose (x y z roll pitch yaw) or the lengths of all"
                f" cables (l1 … l{experiment.robot.m}), found {'both' if given else 'neither'};"
                " give one of them"
            )
        sigma = np.full(len(seen), instrument.noise) if instrument.noise else _BY_HAND * seen
        yield SeenFrequencies(
            run=run.name,
            instrument=name,
            row=i + 1,
            pose=given[0] if given[0] is pose else None,
            lengths=given[0] if given[0] is not pose else None,
            frequency=seen,
            sigma=sigma,
        )


def frequency_table(seen: list[SeenFrequencies]) -> dict[str, Array]:
    """Rows of one table as columns of the contract, NaN where nothing stands, shape (n,) each."""
    columns: dict[str, Array] = {}
    most = max(len(each.frequency) for each in seen)
    rows = []
    for each in seen:
        place = each.pose if each.pose is not None else each.lengths
        assert place is not None
        padded = np.full(most, np.nan)
        padded[: len(each.frequency)] = each.frequency
        rows.append((each.pose is not None, place, padded))
    for posed, names in (
        (True, ["x", "y", "z", "roll", "pitch", "yaw"]),
        (False, [f"l{i + 1}" for i in range(max(len(p) for _, p, _ in rows))]),
    ):
        if any(own == posed for own, *_ in rows):
            for i, name in enumerate(names):
                columns[name] = np.array([p[i] if own == posed else np.nan for own, p, _ in rows])
    return columns | {f"f{i + 1}": np.array([f[i] for *_, f in rows]) for i in range(most)}
