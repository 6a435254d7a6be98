"""Which stream is read for what: Table I of [Tempel2017]_ for any set of instruments."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run

Source = tuple[str, str]
"""Instrument and quantity."""

Acceleration = Literal["imu", "tracker"]


@dataclass(frozen=True)
class Sources:
    """Which quantity of which instrument is used for what."""

    force: str
    """Instrument of kind tension or wrench."""
    rotation: Source | None
    omega: Source | None
    specific_force: Source | None
    position: Source | None

    def used(self) -> list[Source]:
        """All but the forces."""
        return list(
            dict.fromkeys(
                s for s in (self.rotation, self.omega, self.specific_force, self.position) if s
            )
        )


def choose_sources(
    experiment: Experiment, run: Run, acceleration: Acceleration | None, *, commanded: bool = False
) -> Sources:
    """Decide what is read from where (Table I of the paper); of several instruments the first in
    the file is taken.

    Args:
        experiment: With its instruments.
        run: With its streams.
        acceleration: Where to take the acceleration from; None: the IMU where there is one, else
            the tracker.
        commanded: Whether the commanded orientation will do where none is measured.

    Raises:
        InputError: Something is missing; the message names it.
    """

    def first(quantity: str, *, commanded: bool = False) -> Source | None:
        return next(
            (
                (name, quantity)
                for name, instrument in experiment.instruments.items()
                if name in run.streams
                and quantity in run.streams[name].values
                and instrument.commanded == commanded
            ),
            None,
        )

    def needed(source: Source | None, what: str) -> Source:
        if source is None:
            raise InputError(
                f"{experiment.source or experiment.name}: run '{run.name}': expected {what}, found"
                " none; add a stream that has it"
            )
        return source

    force = experiment.force_instrument(run)
    if force is None:
        raise InputError(
            f"{experiment.name}: run '{run.name}': expected forces, found none; add a stream of"
            " kind 'tension' or 'wrench'"
        )
    cables = experiment.instruments[force].measured_force == "tension"
    rotation = first("orientation")
    position = first("position")
    if cables:
        # Where nothing measures its place the platform is taken to be where it was told to go.
        rotation = needed(
            rotation or (first("orientation", commanded=True) if commanded else None),
            "an orientation (imu, attitude or pose) to know where the cables pull",
        )
        position = (
            position
            or first("position", commanded=True)
            or needed(
                first("length"),
                "a position (position, pose, length or command) to know where the cables pull",
            )
        )
    specific_force = first("specific_force")
    if run.static:
        # At rest the attitude says where gravity pulls; an accelerometer is asked only where there
        # is none.
        force_samples = (
            None
            if rotation
            else needed(
                specific_force, "an orientation or an accelerometer for the direction of gravity"
            )
        )
        return Sources(force, rotation, None, force_samples, position if cables else None)
    omega = first("angular_velocity") or needed(
        rotation, "an angular velocity (gyro) or an orientation to differentiate"
    )
    if acceleration == "imu" or (acceleration is None and specific_force is not None):
        force_samples = needed(specific_force, "an accelerometer for --acceleration imu")
        return Sources(force, rotation, omega, force_samples, position if cables else None)
    what = (
        "a position or pose to take the acceleration from"
        if acceleration
        else "an accelerometer or a tracker"
    )
    tracked = needed(
        first("position") or (first("position", commanded=True) if commanded else None), what
    )
    return Sources(
        force,
        needed(rotation, "an orientation beside the tracker's acceleration"),
        omega,
        None,
        tracked,
    )
