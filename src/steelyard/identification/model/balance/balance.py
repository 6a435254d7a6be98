"""Forces against motion along a segment: what the readings say carries the platform, the wrench
that the moving body needs, and what is left over.

The readings enter through an implicit equation, *wrench of the cables less what moves the body is
zero*; the internal tension is free. It is solved for the readings that fulfil it with the least
correction in their 1-sigma.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.identification.model.balance.behind_filter import BehindFilter
from steelyard.identification.model.balance.bending import bending_along
from steelyard.identification.model.balance.equations import motion_and_wrench
from steelyard.identification.model.balance.force_readings import (
    UNMODELLED_PARTS,
    Forces,
    undisturbed,
)
from steelyard.identification.model.balance.measured_force import MeasuredForce, measured_force
from steelyard.identification.model.balance.moving_body import (
    MovingAt,
    moving_at,
)
from steelyard.identification.model.balance.noise import BalanceNoise
from steelyard.identification.model.balance.rollers import remembered
from steelyard.identification.model.balance.slopes import smoothed
from steelyard.identification.model.calibration_parameters import (
    BENDING,
    CalibrationValues,
)
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.segment import Basis
from steelyard.identification.model.sources import Source
from steelyard.instruments.tension import Rolled
from steelyard.robot.model import DIRECTIONS

_LOUD = 1.3
"""Factor of the noise of readings from which on they are louder than it is stated, or seen in
them."""


@dataclass(frozen=True, eq=False)
class Balance:
    """Forces against motion at n samples with r readings each."""

    time: Array
    """Within the segment [s], shape (n,)."""
    motion: Mapping[str, Array]
    """Position, rotation, velocity, angular velocity and acceleration, specific force of the
    platform."""
    measured: MeasuredForce
    """As the readings are, not corrected."""
    left_over: Array
    """Wrench that neither the body nor the processes explain [N], [N m], shape (n, 6)."""
    sigmas: Array
    """1-sigma of the readings, shape (n, r)."""
    unmodelled_sigma: Array
    """1-sigma of the white part of the unmodelled wrench [N], [N m], shape (6,)."""
    noise: BalanceNoise
    """Of what is left over."""
    disturbance: Array
    """Unmodelled wrench of the processes of the segment [N], [N m], shape (n, 6)."""
    coloured: Array
    """What processes add to the readings, shape (n, r)."""
    told: NDArray[np.bool_]
    """Samples of which the motion is known, as far back as a filter remembers, shape (n,)."""
    unread: NDArray[np.bool_] | None = None
    """Readings of cables without a sensor, shape (r,); None: there are none."""
    loud: bool = False
    """Whether readings along a motion scatter more than is stated or seen in them."""
    rolled: Rolled | None = None
    """What the rollers of the cables remember; None: forces are read before them."""
    behind: BehindFilter | None = None
    """What is left over behind the filter of the forces; None: there is none."""
    off: Array | None = None
    """What the filter changes of what is left over beside its delay [N], [N m], shape (n, 6); None:
    there is none."""

    @property
    def by_wrench(self) -> Array:
        """What the unmodelled wrench of the processes makes of the balance [N], [N m], shape (n,
        6).
        """
        if not self.disturbance.any():
            return self.disturbance
        return np.asarray(
            np.einsum("nij,nj->ni", self.measured.unmodelled.wrench, self.disturbance)
        )

    @property
    def by_processes(self) -> Array:
        """What all processes make of it: the unmodelled wrench and coloured noise of the readings
        [N], [N m], shape (n, 6).
        """
        if not self.coloured.any():
            return self.by_wrench
        return np.asarray(self.by_wrench + np.einsum("nir,nr->ni", self.by_reading, self.coloured))

    @property
    def structure(self) -> Array | None:
        """Shape (n, 6, m); None without cables."""
        return self.measured.structure

    @property
    def wrench(self) -> Array:
        """On the platform, of the measured readings [N], [N m], shape (n, 6)."""
        return self.measured.wrench

    @property
    def by_reading(self) -> Array:
        """How the wrench follows the readings, shape (n, 6, r)."""
        return self.measured.wrench_by_reading

    @property
    def whitener(self) -> Array:
        """Matrices that make its noise white with unit variance, shape (n, 6, 6)."""
        return self.noise.whitener

    @cached_property
    def residual(self) -> Array:
        """What is left over, whitened, shape (n, 6)."""
        return np.asarray(np.einsum("nij,nj->ni", self.whitener, self.left_over))

    @property
    def size(self) -> Array:
        """Length of the residual of each sample, shape (n,)."""
        return np.asarray(np.sqrt(np.sum(self.residual**2, axis=1)))

    @cached_property
    def correction(self) -> Array:
        """Of the readings, and then of the unmodelled wrench where there is one, so that they
        balance, in their 1-sigma, shape (n, r) or (n, r + 6).
        """
        return self.noise.correction(self.residual)

    @cached_property
    def carried(self) -> Array:
        """``tension`` or ``wrench`` of the corrected readings, shape (n, m) or (n, 6)."""
        off = self.correction[:, : self.noise.readings] * self.sigmas
        if self.unread is not None:
            off[:, self.unread] = np.einsum("nfi,ni->nf", self.noise.pulled, self.left_over)
        return np.asarray(self.measured.values - np.einsum("nkr,nr->nk", self._by_reading, off))

    @cached_property
    def unexplained(self) -> Array:
        """The unmodelled wrench, its white part with it, in units of the readings [N], [N m], shape
        (n, 6).
        """
        if not self.unmodelled_sigma.any():
            return self.disturbance
        white = self.noise.unmodelled(self.correction)
        return np.asarray(self.disturbance + white / self.measured.unmodelled.usual[:, None])

    @cached_property
    def asked(self) -> Array:
        """The part of it that the body asks for: what nothing explains tells no gain."""
        if not self.unexplained.any():
            return self.carried
        shown = self.measured.unmodelled.reading
        other = np.einsum("nkr,nri,ni->nk", self._by_reading, shown, self.unexplained)
        return np.asarray(self.carried - other)

    def calmed(self, values: Array) -> Array:
        """Tensions or a wrench without what changes from sample to sample in the tensions that make
        no wrench, shape as of the values.

        The body and its motion say all of the others. These are as noisy as the readings, and where
        the noise of a reading is akin to that of another (mains, a common supply, a drive that
        shakes the frame), it meets itself in the derivative by gains and crosstalk. The very same
        where they scatter as is stated: then all of it is told.

        Args:
            values: :attr:`carried` or :attr:`asked`.
        """
        structure = self.structure
        if structure is None or structure.shape[2] <= DIRECTIONS or not self.loud:
            return values
        inverse = self.measured.unmodelled.reading
        balancing = np.einsum("nmk,nk->nm", inverse, self.measured.as_wrench(values))
        return np.asarray(balancing + smoothed(self.time, values - balancing))

    @property
    def uncarried(self) -> Array:
        """The part of the unmodelled wrench that no cable carries, in units of the readings [N],
        [N m], shape (n, 6).
        """
        structure = self.structure
        if structure is None:
            return np.zeros_like(self.unexplained)
        shown = np.einsum("nri,ni->nr", self.measured.unmodelled.reading, self.unexplained)
        return np.asarray(self.unexplained - np.einsum("nkr,nr->nk", structure, shown))

    @property
    def _by_reading(self) -> Array:
        """How tensions or wrench follow the readings, shape (n, k, r)."""
        by_reading = self.measured.by_reading
        return np.broadcast_to(by_reading, (len(self.time), *by_reading.shape[1:]))


def balance_of(
    experiment: Experiment,
    segment: Segment,
    force_samples: Forces,
    calibration: CalibrationValues,
    parameters: Array,
    factors: Mapping[Source, float],
) -> Balance:
    """Forces against motion.

    Args:
        experiment: With robot and instruments.
        segment: With its motion.
        force_samples: Force readings within it.
        calibration: Present values of the systematic errors.
        parameters: The ten of :data:`steelyard.inertia.LINEAR_PARAMETERS`, of the first load where
            there are several, shape (10,).
        factors: Quantity -> by how much its noise exceeds what the readings say.
    """
    moving = moving_at(experiment, segment, force_samples, calibration, parameters)
    return balance_at(moving, experiment, segment, force_samples, calibration, factors)


def balance_at(
    moving: MovingAt,
    experiment: Experiment,
    segment: Segment,
    force_samples: Forces,
    calibration: CalibrationValues,
    factors: Mapping[Source, float],
) -> Balance:
    """Forces against a moving body.

    Args:
        moving: The body.
        experiment: With robot and instruments.
        segment: With its motion.
        force_samples: Force readings within it.
        calibration: Present values of the systematic errors.
        factors: Quantity -> by how much its noise exceeds what the readings say.
    """
    times, local, inputs, parameters, constant = moving
    motion = motion_and_wrench(experiment.robot, *calibration.pulling)(**inputs)
    needed = motion.pop("wrench")
    rolled = remembered(experiment, segment, force_samples, calibration, motion)
    if rolled is not None:
        motion["rolling"] = rolled.value
    coloured = disturbance_of_forces(segment, force_samples, local)
    told = undisturbed(force_samples, coloured)
    measured = measured_force(experiment, segment, told, calibration, motion)
    left_over = measured.wrench - needed
    bending = calibration.of_robot(*BENDING)
    if bending.any():
        left_over -= bending_along(segment, times, calibration) @ bending
    behind, off = None, None
    if constant:
        behind = BehindFilter.of(
            experiment, segment, told, calibration, parameters, times, abs(constant)
        )
        off = measured.behind_filter(np.zeros_like(left_over), behind.left_over - left_over)
        off = np.copysign(1.0, constant) * off
        left_over = left_over + off
    disturbance = unmodelled_processes(segment, local, motion["rotation"])
    if disturbance.any():
        left_over -= np.einsum("nij,nj->ni", measured.unmodelled.wrench, disturbance)
    sigmas = told.sigmas(segment, factors)
    unmodelled_sigma = force_samples.unmodelled_sigma(segment, factors)
    white = None
    if unmodelled_sigma.any():
        wrench = measured.unmodelled
        white = wrench.wrench if force_samples.everywhere else wrench.across
        white = white * unmodelled_sigma
    noise = BalanceNoise.of(measured.wrench_by_reading, sigmas, white, force_samples.unread)
    return Balance(
        times,
        motion,
        measured,
        left_over,
        sigmas,
        unmodelled_sigma,
        noise,
        disturbance,
        coloured,
        segment.holds(times) if behind is None else segment.holds(times) & behind.told,
        force_samples.unread,
        not segment.static
        and any(
            factors.get(segment.label(force_samples.name, q), 1.0) > _LOUD
            for q in force_samples.readings
        ),
        rolled,
        behind,
        off,
    )


def disturbance_of_forces(segment: Segment, force_samples: Forces, local: Basis) -> Array:
    """What processes add to force readings [N], [N m], shape (n, r).

    Args:
        segment: With its processes.
        force_samples: Within it.
        local: Spline functions at their times.
    """
    parts = [
        np.broadcast_to(segment.disturbance_of((force_samples.name, quantity), local), values.shape)
        for quantity, values in force_samples.readings.items()
    ]
    return np.concatenate(parts, axis=1)


def unmodelled_processes(segment: Segment, local: Basis, rotation: Array, order: int = 0) -> Array:
    """Unmodelled wrench of the processes of a segment in P [N], [N m], or a derivative of it by
    time, zero where it has none, shape (n, 6).

    How an upright one follows the rotation is of no account: it is as small beside the weight as
    the noise of a rotation is beside a radian.

    Args:
        segment: With its processes.
        local: Spline functions at n times.
        rotation: R_world_platform there, shape (n, 3, 3).
        order: Of the derivative.
    """
    found = np.zeros((len(local.first), DIRECTIONS))
    for each in segment.processes:
        part = UNMODELLED_PARTS.get(each.source)
        if part is not None:
            along = segment.disturbance(each, local, order)
            if each.upright:
                along = np.einsum("nji,nj->ni", rotation, along)
            found[:, part] = along
    return found
