"""One run as its instruments saw it, turned into parts of the platform's state by their own
measurement equations.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.identification.model.calibration_parameters import CalibrationValues, clock_of
from steelyard.identification.model.sources import Source, Sources
from steelyard.instruments.equations import linearised, means, needed_for, solve_for
from steelyard.robot.kinematics import cables_at
from steelyard.robot.model import Robot
from steelyard.robot.surroundings import middle_of

_HANGING_STEPS = 12
"""Newton steps to the pose in which the platform hangs at rest."""


@dataclass(frozen=True, eq=False)
class RunReader:
    """One run and how to read it."""

    experiment: Experiment
    robot: Robot
    run: Run
    sources: Sources
    calibration: CalibrationValues | None = None
    """Values of the systematic errors; None: as known beforehand."""

    @property
    def where(self) -> str:
        """File and run, for messages."""
        return f"{self.experiment.source or self.experiment.name}: run '{self.run.name}'"

    def time(self, name: str) -> Array:
        """Times of a stream on the common clock [s], shape (n,)."""
        delay = None
        if self.calibration and not self.run.static:
            delay = self.calibration.delay(clock_of(self.experiment, name), self.run.name)
        return self.experiment.common_time(self.run, name, delay)

    @property
    def gravity(self) -> Array:
        """World frame [m/s^2], shape (3,)."""
        return self.calibration.gravity if self.calibration else self.robot.gravity

    def _errors(self, name: str) -> dict[str, Array]:
        instrument = self.experiment.instruments[name]
        if self.calibration is None:
            return means(instrument, self.robot.m)
        return self.calibration.of(name, instrument, self.run.name)

    def solve(self, unknown: str, source: Source, readings: Array, **given: Array) -> Array:
        """Part of the platform's state behind the readings of one quantity."""
        name, quantity = source
        instrument = self.experiment.instruments[name]
        return solve_for(
            unknown, instrument, self.robot, {quantity: readings}, given, self._errors(name)
        )

    def hung_at(
        self, source: Source, lengths: Array, rotation: Array, force_samples: Array
    ) -> Array:
        """Place of the platform origin [m] for cable lengths and an attitude, by Gauss-Newton,
        shape (n, 3).

        Args:
            source: An instrument of lengths.
            lengths: Its readings [m], shape (n, m).
            rotation: R_world_platform, shape (n, 3, 3).
            force_samples: Tensions, roughly: cables stretch [N], shape (n, m).
        """
        instrument = self.experiment.instruments[source[0]]
        n, errors = len(lengths), np.concatenate(list(self._errors(source[0]).values()))
        quaternion = Rotation.from_matrix(rotation).as_quat(scalar_first=True)
        # Below the anchors: above them there is another answer.
        position, still = np.tile(middle_of(self.robot), (n, 1)), np.zeros((n, 7))
        for _ in range(_HANGING_STEPS):
            motion = (np.hstack([position, quaternion]), still, still)
            at = linearised(
                instrument,
                "length",
                self.robot,
                lengths,
                motion,
                errors,
                self.gravity,
                force_samples,
            )
            J = at["by_pose"][:, :, :3]
            step = np.linalg.solve(
                J.transpose(0, 2, 1) @ J, np.einsum("nkp,nk->np", J, at["residual"])[:, :, None]
            )
            position = position - step[:, :, 0]
        return position

    @cached_property
    def behind_rollers(self) -> bool:
        """Whether the force sensors read what depends on how the cables move."""
        name = self.sources.force
        instrument = self.experiment.instruments[name]
        quantities = tuple(q.name for q in instrument.quantities(self.robot.m))
        return instrument.measured_force == "tension" and "velocity" in needed_for(
            "tension", instrument, self.robot, quantities
        )

    def force_samples(self, readings: Mapping[str, Array], motion: Mapping[str, Array]) -> Array:
        """What is behind the readings of the force instrument: tensions at the platform, shape (n,
        m), or the wrench on it, shape (n, 6).

        Args:
            readings: All quantities of it.
            motion: Parts of the state: pose, velocity and angular velocity, where sensors do not
                sit at the platform.
        """
        name = self.sources.force
        instrument = self.experiment.instruments[name]
        assert instrument.measured_force is not None  # choose_sources() has made sure
        return solve_for(
            instrument.measured_force, instrument, self.robot, readings, motion, self._errors(name)
        )

    def carried(
        self, force_samples: Array, position: Array | None, rotation: Array | None
    ) -> dict[str, Array]:
        """What carries the platform.

        Args:
            force_samples: See :meth:`force_samples`.
            position: Of the platform origin, world frame [m], shape (n, 3).
            rotation: R_world_platform, shape (n, 3, 3).

        Returns:
            ``wrench`` on the platform, shape (n, 6); on cables also their ``tension`` [N], shape
            (n, m), and ``structure``, shape (n, 6, m).
        """
        if self.experiment.instruments[self.sources.force].measured_force == "wrench":
            return {"wrench": force_samples}
        assert position is not None  # choose_sources() has made sure
        assert rotation is not None
        structure = cables_at(self.robot, position, rotation, force_samples).structure
        return {
            "wrench": np.einsum("nkm,nm->nk", structure, force_samples),
            "tension": force_samples,
            "structure": structure,
        }

    @property
    def free_offset(self) -> bool:
        """Whether the wrench has a constant offset that is not known."""
        instrument = self.experiment.instruments[self.sources.force]
        return instrument.measured_force == "wrench" and any(
            term.key.startswith("offset") and (term.deviation is None or bool(term.deviation.any()))
            for term in instrument.terms(self.robot.m)
        )

    @property
    def position_sigma(self) -> float:
        """1-sigma of the place on the platform whose acceleration is measured [m]."""
        source = self.sources.specific_force or self.sources.position
        if source is None:
            return 0.0
        terms = {
            term.key: term for term in self.experiment.instruments[source[0]].terms(self.robot.m)
        }
        place = terms.get("position") or terms.get("target")
        if place is None or place.deviation is None:
            return 0.0
        return float(np.sqrt(np.mean(place.deviation**2)))
