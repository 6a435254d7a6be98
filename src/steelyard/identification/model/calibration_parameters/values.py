"""Values of all systematic errors, and what each run needs of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.identification.model.calibration_parameters.keys import DRAG, ROBOT, SWIVEL
from steelyard.identification.model.calibration_parameters.surroundings import hose_keys
from steelyard.identification.model.calibration_parameters.vector import CalibrationParameters
from steelyard.inertia import TEN
from steelyard.instruments import Instrument
from steelyard.robot.surroundings import HOSE


@dataclass(frozen=True, eq=False)
class CalibrationValues:
    """Values of all systematic errors, and what each run needs of them."""

    calibration_parameters: CalibrationParameters
    values: Array
    """Shape (u,)."""

    def of(self, name: str, instrument: Instrument, run: str) -> dict[str, Array]:
        """Values of an instrument's terms in a run."""
        places = self.calibration_parameters.places_of(name, instrument, run)
        return {key: self.values[place] for key, place in places.items()}

    def body(self, first: Array, run: str) -> Array:
        """The ten of :data:`steelyard.inertia.LINEAR_PARAMETERS` of what a run carried, shape
        (10,).

        Args:
            first: Those of the first load, shape (10,).
            run: Its name.
        """
        place = self.calibration_parameters.place_of_load(run)
        return first if place is None else first + self.values[place]

    def apparent(self, run: str) -> Array:
        """How what a run carried answers accelerations beside what it weighs, ten of
        :data:`steelyard.inertia.LINEAR_PARAMETERS`, shape (10,); zero of a rigid body.

        Args:
            run: Its name.
        """
        place = self.calibration_parameters.place_of_apparent(run)
        return np.zeros(TEN) if place is None else self.values[place]

    def delay(self, clock: str, run: str) -> float:
        """Of a clock in a run [s]."""
        return float(self.values[self.calibration_parameters.place(clock, "delay", run)][0])

    @property
    def drag(self) -> float:
        """How far the platform feels the inertia of its cables."""
        return float(self.values[self.calibration_parameters.places[ROBOT, DRAG, None]][0])

    @property
    def hoses(self) -> Array:
        """Of all hoses that are stated, one after the other, see
        :data:`steelyard.robot.surroundings.HOSE`, shape (9 h,).
        """
        parts = hose_keys(self.calibration_parameters)
        return self.of_robot(*parts) if parts else np.zeros(0)

    def of_robot(self, *parts: tuple[str, int], run: str | None = None) -> Array:
        """Values of several parameters of the robot, one after the other; zero where they are not
        there.

        Args:
            *parts: Key and size of each.
            run: In which they act, where some have values of their own in runs; None: in all.
        """
        places = self.calibration_parameters.places
        found = []
        for key, size in parts:
            place = places.get((ROBOT, key, run), places.get((ROBOT, key, None)))
            found.append(np.zeros(size) if place is None else self.values[place])
        return np.concatenate(found)

    def swivel(self, run: str | None = None) -> Array:
        """Friction where cables turn about their anchors [N m], shape (m,); (0,) where forces are
        read, beside which it is of no account.

        Args:
            run: In which it acts; None: in those of the first load.
        """
        there = (ROBOT, SWIVEL, None) in self.calibration_parameters.places
        m = self.calibration_parameters.m
        return self.of_robot((SWIVEL, m), run=run) if there else np.zeros(0)

    @property
    def pulling(self) -> tuple[int, int]:
        """Number of hoses that are stated, and of anchors at which cables rub."""
        return len(self.hoses) // sum(size for _, size in HOSE), len(self.swivel())

    @property
    def gravity(self) -> Array:
        """World frame [m/s^2], shape (3,)."""
        return self.values[self.calibration_parameters.places[ROBOT, "gravity", None]]

    @property
    def geometry(self) -> dict[str, Array]:
        """Anchors [m] in the world and attachments [m] in the platform frame, three numbers a
        cable, shape (3 m,) each.
        """
        places = self.calibration_parameters.places
        return {
            f"{key}s": self.values[places[ROBOT, key, None]] for key in ("anchor", "attachment")
        }
