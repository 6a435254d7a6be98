"""What force readings say carries the platform."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.identification.model.balance.equations import structure_matrices
from steelyard.identification.model.balance.force_readings import Forces
from steelyard.identification.model.balance.noise import UnmodelledWrench
from steelyard.identification.model.calibration_parameters import CalibrationValues
from steelyard.identification.model.motion_segment import Segment
from steelyard.instruments.equations import follows_readings, solve_for
from steelyard.robot.model import DIRECTIONS


@dataclass(frozen=True, eq=False)
class MeasuredForce:
    """What the readings say carries the platform: tensions, or the wrench itself, k numbers."""

    values: Array
    """Tensions [N], shape (n, m), or the wrench [N], [N m], shape (n, 6)."""
    by_reading: Array
    """How these follow the readings, shape (n, k, r) or, alike everywhere, (1, k, r)."""
    structure: Array | None
    """Structure matrices of the cables, shape (n, 6, m); None: the wrench itself is read."""

    @property
    def quantity(self) -> Literal["tension", "wrench"]:
        """What it is."""
        return "wrench" if self.structure is None else "tension"

    @cached_property
    def wrench(self) -> Array:
        """On the platform [N], [N m], shape (n, 6)."""
        return self.as_wrench(self.values)

    @cached_property
    def wrench_by_reading(self) -> Array:
        """How that follows the readings, shape (n, 6, r)."""
        return self.changes_of_wrench(self.by_reading)

    @cached_property
    def unmodelled(self) -> UnmodelledWrench:
        """How an unmodelled wrench shows in it."""
        n = len(self.values)
        structure = self.structure
        if structure is None:
            structure = np.broadcast_to(np.eye(DIRECTIONS), (n, DIRECTIONS, DIRECTIONS))
        by_reading = np.broadcast_to(self.by_reading, (n, *self.by_reading.shape[1:]))
        return UnmodelledWrench.of(structure, by_reading)

    def as_wrench(self, values: Array) -> Array:
        """Wrench on the platform of tensions or of a wrench, shape (n, 6).

        Args:
            values: Shape (n, k).
        """
        if self.structure is None:
            return values
        return np.asarray(np.einsum("nkm,nm->nk", self.structure, values))

    @cached_property
    def carried_directions(self) -> Array | None:
        """Part of a wrench that the cables can carry, shape (n, 6, 6); None: all of it."""
        structure = self.structure
        if structure is None or structure.shape[2] >= DIRECTIONS:
            return None
        return np.asarray(structure @ np.linalg.pinv(structure))

    def behind_filter(self, plain: Array, filtered: Array) -> Array:
        """What a filter of the readings makes of wrenches, or of changes of them: in directions
        that no cable carries nothing, for there the motion balances by itself.

        Args:
            plain: Without the filter, shape (n, 6, ...).
            filtered: Behind it, shape (n, 6, ...).
        """
        if self.carried_directions is None:
            return filtered
        return np.asarray(
            plain + np.einsum("nij,nj...->ni...", self.carried_directions, filtered - plain)
        )

    def changes_of_wrench(self, changes: Array) -> Array:
        """Changes of the wrench on the platform by changes of tensions or of a wrench, shape (n, 6,
        c).

        Args:
            changes: Shape (n, k, c) or (1, k, c).
        """
        found = changes if self.structure is None else self.structure @ changes
        return np.broadcast_to(found, (len(self.values), DIRECTIONS, changes.shape[2]))


def measured_force(
    experiment: Experiment,
    segment: Segment,
    force_samples: Forces,
    calibration: CalibrationValues,
    motion: Mapping[str, Array],
) -> MeasuredForce:
    """What the readings say carries the platform.

    Args:
        experiment: With robot and instruments.
        segment: Along which they are read.
        force_samples: Force readings.
        calibration: Present values of the systematic errors.
        motion: Position, rotation and velocities of the platform then, and what the rollers
            remember.
    """
    robot, instrument = experiment.robot, experiment.instruments[force_samples.name]
    readings, position, rotation = force_samples.readings, motion["position"], motion["rotation"]
    errors = calibration.of(force_samples.name, instrument, segment.run)
    unknown = instrument.measured_force
    assert unknown is not None  # it is the force instrument of a run
    values = solve_for(unknown, instrument, robot, readings, motion, errors)
    structure = None
    if unknown == "tension":
        structure = structure_matrices(robot, calibration, position, rotation, values)
    state = {**motion, unknown: values}
    by_reading = follows_readings(unknown, instrument, robot, tuple(readings), state, errors)
    return MeasuredForce(values, by_reading, structure)
