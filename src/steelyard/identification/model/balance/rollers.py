"""What the rollers between cables and their sensors remember along a segment."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.identification.model.balance.force_readings import Forces
from steelyard.identification.model.balance.moving_body import balance_times
from steelyard.identification.model.calibration_parameters import CalibrationValues
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.segment import motion_at
from steelyard.instruments.tension import Rolled, RollerState, rolled_along


def remembered(
    experiment: Experiment,
    segment: Segment,
    force_samples: Forces,
    calibration: CalibrationValues,
    motion: Mapping[str, Array],
) -> Rolled | None:
    """What the rollers remember of a motion; None where none are read.

    Args:
        experiment: With robot and instruments.
        segment: With its motion.
        force_samples: Force readings within it.
        calibration: Present values of the systematic errors.
        motion: Position and rotation of the platform then, shapes (n, 3) and (n, 3, 3).
    """
    robot, instrument = experiment.robot, experiment.instruments[force_samples.name]
    position, rotation = motion["position"], motion["rotation"]
    if not instrument.remembers:
        return None
    if segment.static:
        # At rest a roller takes nothing in the mean of all that it might hold.
        none = np.zeros((len(position), robot.m))
        return Rolled(none, none, none, none)
    errors = calibration.of(force_samples.name, instrument, segment.run)
    return rolled_along(
        robot, position, rotation, errors, force_samples.before, calibration.geometry
    )


def parts_of(
    experiment: Experiment, segment: Segment, force_samples: Forces, calibration: CalibrationValues
) -> Iterator[Forces]:
    """Force readings, some samples at a time; rollers go on from one part to the next.

    Args:
        experiment: With robot and instruments.
        segment: With its motion.
        force_samples: Force readings within it.
        calibration: Present values of the systematic errors.
    """
    before = force_samples.before
    *earlier, last = force_samples.parts()
    for part in earlier:
        own = replace(part, before=before)
        yield own
        before = _after(experiment, segment, own, calibration)
    yield replace(last, before=before)


def part_of(
    experiment: Experiment,
    segment: Segment,
    force_samples: Forces,
    calibration: CalibrationValues,
    own: slice,
) -> Forces:
    """Force readings in a row, with what rollers remember of all before; arguments as of
    :func:`parts_of`, and which they are.
    """
    part = force_samples.part(own)
    if not own.start:
        return part
    earlier = force_samples.part(slice(0, own.start))
    return replace(part, before=_after(experiment, segment, earlier, calibration))


def _after(
    experiment: Experiment, segment: Segment, part: Forces, calibration: CalibrationValues
) -> RollerState | None:
    """What rollers remember of samples after the last of them; None: they are not read."""
    if segment.static or not experiment.instruments[part.name].remembers:
        return None
    times = balance_times(experiment, segment, part, calibration)
    pose, *_ = motion_at(segment.basis(times), segment.coefficients)
    rotation = Rotation.from_quat(pose[:, 3:], scalar_first=True).as_matrix()
    motion = {"position": pose[:, :3], "rotation": rotation}
    along = remembered(experiment, segment, part, calibration, motion)
    return None if along is None else along.last
