"""What each pose at rest tells of the geometry, by the rows of the fit that will read it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from steelyard.arrays import Array
from steelyard.calibration.fit import GeometryFit
from steelyard.excitation.poses.pose_choice import PoseChoice
from steelyard.identification.model.balance import Forces
from steelyard.identification.model.motion_segment import Reading, Segment
from steelyard.identification.solve.fit_state import linearise
from steelyard.identification.solve.newton_step import border_prior


def pose_choice(found: GeometryFit) -> PoseChoice:
    """What every pose of a fit tells, each by itself, with the geometry as what is wanted.

    Args:
        found: Of a noise-free recording.

    Raises:
        numpy.linalg.LinAlgError: A pose is not determined by its own readings.
    """
    task, state = found.task, found.fit.state
    split = [
        part
        for segment, forces in zip(state.segments, task.force_samples, strict=True)
        for part in _each_pose(segment, forces)
    ]
    alone = replace(state, segments=tuple(segment for segment, _ in split))
    task = replace(task, force_samples=tuple(forces for _, forces in split))
    parts, _ = linearise(task, alone)
    information = np.array([part.all.reduced()[0] for part in parts])
    prior, _ = border_prior(task, alone)
    wanted = np.zeros(len(prior), dtype=bool)
    columns = task.column_of(alone)[task.calibration_parameters.of_geometry]
    wanted[columns[columns >= 0]] = True
    # In units of what is known beforehand, so that no unit makes a parameter large or small.
    scale = 1 / np.sqrt(np.diag(prior))
    sizes = np.outer(scale, scale)
    return PoseChoice(prior * sizes, information * sizes, wanted)


def _each_pose(segment: Segment, forces: Forces | None) -> Iterator[tuple[Segment, Forces | None]]:
    """Every pose of a run as a segment of its own, with its forces."""
    for i, number in enumerate(segment.knots):
        readings = tuple(_of_pose(each, number) for each in segment.readings)
        own = replace(
            segment,
            knots=segment.knots[i : i + 1],
            coefficients=segment.coefficients[i : i + 1],
            readings=tuple(each for each in readings if len(each.time)),
        )
        yield own, None if forces is None else _forces_of_pose(forces, number)


def _of_pose(reading: Reading, number: float) -> Reading:
    """The samples of one pose."""
    use = reading.time == number
    return replace(
        reading,
        time=reading.time[use],
        values=reading.values[use],
        tension=_rows(reading.tension, use),
        late=_rows(reading.late, use),
    )


def _forces_of_pose(forces: Forces, number: float) -> Forces:
    """The same of forces."""
    use = forces.time == number
    return replace(
        forces,
        time=forces.time[use],
        readings={quantity: values[use] for quantity, values in forces.readings.items()},
        left_out=forces.left_out[use],
        late=_rows(forces.late, use),
    )


def _rows(values: Array | None, use: Array) -> Array | None:
    """Some rows of what may not be there."""
    return None if values is None else values[use]
