"""Natural frequencies that somebody has seen: observations of the body that belong to no motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.experiment.observations import SeenFrequencies
from steelyard.experiment.recording import Run, Stream
from steelyard.instruments.swing_frequencies import SwingFrequencies

_BY_HAND = 0.01
"""1-sigma of a frequency whose noise is not stated, over the frequency."""


def with_frequencies_apart(experiment: Experiment) -> Experiment:
    """The experiment with all rows of natural frequencies taken out of the runs, and without runs
    of which nothing else is left.

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
            noise=instrument.noise,
        )


def with_frequencies_together(experiment: Experiment) -> Experiment:
    """The experiment with its natural frequencies as tables of its runs, as files have them.

    Args:
        experiment: Of :func:`with_frequencies_apart`.
    """
    tables: dict[tuple[str, str], list[SeenFrequencies]] = {}
    for each in experiment.frequencies:
        tables.setdefault((each.run, each.instrument), []).append(each)
    instruments, runs = dict(experiment.instruments), {run.name: run for run in experiment.runs}
    for (name, instrument), rows in tables.items():
        stated = {} if rows[0].noise is None else {"noise": rows[0].noise}
        instruments[instrument] = SwingFrequencies.model_validate({"kind": "frequencies", **stated})
        run = runs.get(name, Run(name, {}))
        runs[name] = replace(run, streams={**run.streams, instrument: _table(rows)})
    return replace(experiment, instruments=instruments, runs=tuple(runs.values()), frequencies=())


def _table(rows: Sequence[SeenFrequencies]) -> Stream:
    """Rows of one table, NaN where nothing stands."""
    seen = np.full((len(rows), max(len(each.frequency) for each in rows)), np.nan)
    for own, each in zip(seen, rows, strict=True):
        own[: len(each.frequency)] = each.frequency
    values = {"frequencies": seen}
    poses, lengths = (
        [each for each in places if each is not None]
        for places in ([each.pose for each in rows], [each.lengths for each in rows])
    )
    if poses:
        whole = np.array([np.full(6, np.nan) if r.pose is None else r.pose for r in rows])
        values |= {"position": whole[:, :3], "angles": whole[:, 3:]}
    if lengths:
        none = np.full(len(lengths[0]), np.nan)
        values["lengths"] = np.array([none if r.lengths is None else r.lengths for r in rows])
    return Stream(np.arange(float(len(rows))), values, rows[0].instrument)
