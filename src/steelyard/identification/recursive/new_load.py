"""The platform carries something else from now on: motion and calibration parameters go on, and a
further body stands beside them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment, Load
from steelyard.identification.model.balance import Forces
from steelyard.identification.model.calibration_parameters import CalibrationValues, with_last_load
from steelyard.identification.model.segment import NormalEquations, Rows
from steelyard.identification.recursive.recursion import Recursion
from steelyard.identification.recursive.window.chunk import Chunk
from steelyard.identification.recursive.window.past import Linear
from steelyard.identification.solve.border.normal_equations import Blocks, BorderEquations
from steelyard.identification.solve.border.segment_equations import SegmentEquations
from steelyard.inertia import TEN

FIRST = "load 1"
"""What was carried before anything changed, where nobody has named it."""


def with_further_load(experiment: Experiment, run: str) -> Experiment:
    """An experiment in which a run goes on as another one, the last, with a load of its own.

    Args:
        experiment: As it was.
        run: Name of the run.
    """
    first = Load(FIRST, experiment.known, experiment.robot.platform)
    loads = experiment.loads or (first,)
    name = _free(f"load {len(loads) + 1}", {each.name for each in loads})
    before = experiment.run(run)
    after = replace(
        before,
        name=_free(f"{before.continues or run}, {name}", {each.name for each in experiment.runs}),
        load=name,
        continues=before.continues or run,
    )
    return replace(experiment, loads=(*loads, Load(name)), runs=(*experiment.runs, after))


def opened(recursion: Recursion, experiment: Experiment, number: int, change: Array) -> Recursion:
    """A recursion that goes on with the last load of an experiment.

    Args:
        recursion: As it was, with a window.
        experiment: See :func:`with_further_load`.
        number: Of the chunk of the window in which the load changed: its forces tell nothing.
        change: By how much the ten linear parameters are more than before, about, shape (10,).

    Raises:
        numpy.linalg.LinAlgError: The motion is not determined.
    """
    task, state, window = recursion.task, recursion.state, recursion.window
    assert window is not None
    parameters = with_last_load(task.calibration_parameters, experiment)
    before = task.calibration_parameters.place_of_load(window.like.run)
    present = np.zeros(TEN) if before is None else state.calibration.values[before]
    values = np.concatenate([state.calibration.values, present + change])
    task = replace(
        task,
        experiment=experiment,
        calibration_parameters=parameters,
        active=np.concatenate([task.active, np.ones(TEN, dtype=bool)]),
    )
    own = values[-TEN:]
    window = replace(
        window,
        like=replace(window.like, run=experiment.runs[-1].name),
        chunks=tuple(_wider_chunk(each, own) for each in window.chunks),
        past=None if window.past is None else _wider(window.past, own),
    )
    found = replace(
        recursion,
        task=task,
        state=replace(state, calibration=CalibrationValues(parameters, values)),
        told=_wider_border(recursion.told),
        window=window,
        solution=None,
    )
    for i, chunk in enumerate(window.chunks[number:], start=number):
        run = window.like.run if i > number else chunk.segment.run
        forces = chunk.forces if i > number else unheard(chunk.forces)
        found = found.relinearised(i, replace(chunk.segment, run=run), forces)
    return found.settled()


def restarted(recursion: Recursion, number: int, change: Array) -> Recursion:
    """A recursion whose last load begins later than it was thought.

    Args:
        recursion: With a window that holds the beginning of that load.
        number: Of the chunk up to which forces tell nothing of it.
        change: By how much the ten linear parameters are more than was thought, about, shape (10,).

    Raises:
        numpy.linalg.LinAlgError: The motion is not determined.
    """
    window, state = recursion.window, recursion.state
    assert window is not None
    values = state.calibration.values.copy()
    values[-TEN:] += change
    found = replace(
        recursion, state=replace(state, calibration=replace(state.calibration, values=values))
    )
    for i, chunk in enumerate(window.chunks):
        if chunk.segment.run == window.like.run:
            forces = unheard(chunk.forces) if i <= number else chunk.forces
            found = found.relinearised(i, chunk.segment, forces)
    return found.settled()


def unheard_since(recursion: Recursion, number: int) -> Recursion:
    """A recursion whose forces tell nothing since a chunk of the window: something touches the
    platform.

    Args:
        recursion: With a window.
        number: Of that chunk.

    Raises:
        numpy.linalg.LinAlgError: The motion is not determined.
    """
    assert recursion.window is not None
    found = recursion
    for i, chunk in enumerate(recursion.window.chunks[number:], start=number):
        if not chunk.forces.touched.all():
            found = found.relinearised(i, chunk.segment, unheard(chunk.forces))
    return found.settled()


def unheard(forces: Forces) -> Forces:
    """Forces that tell nothing of the body."""
    return replace(forces, left_out=np.ones_like(forces.left_out))


def with_columns(part: SegmentEquations) -> SegmentEquations:
    """What has passed, with columns of a further load of which it tells nothing."""
    blocks = part.blocks
    return replace(
        part,
        equations=_wider_border(part.equations),
        blocks=Blocks(
            np.pad(blocks.normal, ((0, 0), *_BOTH)),
            np.pad(blocks.right, ((0, 0), _MORE)),
            blocks.run,
            blocks.since,
        ),
        by_source={source: np.pad(matrix, _BOTH) for source, matrix in part.by_source.items()},
        followed=np.pad(part.followed, ((0, 0), _MORE)),
        border=None if part.border is None else np.pad(part.border, _MORE),
    )


_MORE = (0, TEN)
"""Columns before and after."""
_BOTH = (_MORE, _MORE)


def _free(name: str, taken: set[str]) -> str:
    """A name that is not taken."""
    return name if name not in taken else _free(f"{name}'", taken)


def _wider_border(equations: BorderEquations) -> BorderEquations:
    """With columns of a further load."""
    by_noise = None if equations.by_noise is None else np.pad(equations.by_noise, _BOTH)
    normal, right = np.pad(equations.normal, _BOTH), np.pad(equations.right, _MORE)
    return replace(equations, normal=normal, right=right, by_noise=by_noise)


def _wider(linear: Linear, values: Array) -> Linear:
    """With columns of a further load.

    Args:
        linear: Equations without it.
        values: Of these columns, shape (10,).
    """
    equations = linear.equations
    wider: NormalEquations = replace(
        equations,
        side=np.pad(equations.side, ((0, 0), _MORE)),
        corner=np.pad(equations.corner, _BOTH),
        border_gradient=np.pad(equations.border_gradient, _MORE),
    )
    at = replace(linear.at, border=np.concatenate([linear.at.border, values]))
    return Linear(wider, at)


def _wider_chunk(chunk: Chunk, values: Array) -> Chunk:
    """A chunk with columns of a further load, of which its readings tell nothing.

    Args:
        chunk: Without them.
        values: Of these columns, shape (10,).
    """
    rows = [each if each.columns is not None else _named(each) for each in chunk.rows]
    use = np.concatenate([chunk.use, len(chunk.border) + np.arange(TEN, dtype=np.intp)])
    return replace(chunk, rows=rows, border=np.concatenate([chunk.border, values]), use=use)


def _named(rows: Rows) -> Rows:
    """Rows that say which columns they have."""
    return replace(rows, columns=np.arange(rows.by_errors.shape[2], dtype=np.intp))
