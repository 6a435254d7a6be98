"""What every instrument states about itself.

A kind of instrument is one file beside this one. It says once which columns its log has, which
systematic errors it may have and how its reading follows from the state of the platform.
Simulation, estimation and inspection read that one statement.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import casadi as ca
import numpy as np
from pydantic import (
    BeforeValidator,
    Field,
    WithJsonSchema,
    model_serializer,
    model_validator,
)
from scipy.spatial.transform import Rotation

from steelyard import rotations
from steelyard.arrays import Array
from steelyard.batch import Symbol
from steelyard.files.file_model import FileModel
from steelyard.instruments.noise import Disturbance, Sigma
from steelyard.motion.state import State
from steelyard.robot.model import Robot

Vector = tuple[float, float, float]
Part = Literal["position", "rotation"]
"""Of a pose."""
ORIENTATION_FORMS = (
    ("qw", "qx", "qy", "qz"),
    ("roll", "pitch", "yaw"),
    ("r11", "r12", "r13", "r21", "r22", "r23", "r31", "r32", "r33"),
)
"""Columns in which an orientation may stand; the first form that a log has is taken."""

DEFAULT_DELAY = 0.05
"""1-sigma of a clock against the common time [s]."""


class Prior(FileModel):
    """What is known beforehand about one systematic error: a value and its 1-sigma."""

    value: float | tuple[float, ...] | None = None
    """Per axis or cable, or the same for all; None: that of a perfect instrument."""
    sigma: Sigma | tuple[Sigma, ...] | None = None
    """1-sigma; 0 is exact; None: taken from the data."""
    per: Literal["experiment", "run"] = "experiment"
    """Whether the error is constant over the experiment or drawn anew for every run."""

    @model_validator(mode="before")
    @classmethod
    def _number(cls, value: Any) -> Any:
        """A bare number is a sigma; in a mapping it must stand by name."""
        if isinstance(value, dict):
            if value.get("sigma") is None:
                raise ValueError(
                    "expected the key 'sigma', found it missing; add it, or write the 1-sigma as a"
                    " number alone"
                )
            return value
        return {"sigma": value}

    @model_serializer
    def _shortest(self) -> Any:
        """As a person would write it: a number alone where that says it."""
        if self.value is None and self.per == "experiment":
            return self.sigma
        entries = {
            "value": self.value,
            "sigma": self.sigma,
            "per": None if self.per == "experiment" else self.per,
        }
        return {key: entry for key, entry in entries.items() if entry is not None}


def exact() -> Prior:
    """The prior of an error that is not there."""
    return Prior.model_validate({"sigma": 0.0})


def sigma(value: float) -> Prior:
    """The prior of an error of a given 1-sigma about that of a perfect instrument."""
    return Prior.model_validate({"sigma": value})


@dataclass(frozen=True)
class Term:
    """One systematic error of an instrument, a constant vector."""

    key: str
    """Name in the contract; nested keys with a dot."""
    size: int
    unit: str
    prior: Prior
    nominal: float = 0.0
    """Of a perfect instrument: 1 for gains, 0 for everything else."""
    suspected: float | None = None
    """1-sigma of devices that have such an error at all, taken where the readings ask for it and
    nobody has stated one; None: the prior stays."""
    of_reading: str = ""
    """Quantity of which that is a part, times its usual reading; empty: it has the unit."""
    positive: bool = False
    """Whether no device has it below zero; an estimate may be, within its uncertainty."""
    of_motion: bool = False
    """Whether it acts in motion only: of poses at rest there is none."""

    @property
    def mean(self) -> Array:
        """Value known beforehand, shape (size,)."""
        value = self.nominal if self.prior.value is None else self.prior.value
        return np.broadcast_to(np.asarray(value, dtype=np.float64), (self.size,)).copy()

    @property
    def deviation(self) -> Array | None:
        """1-sigma, shape (size,); None: from the data."""
        if self.prior.sigma is None:
            return None
        return np.broadcast_to(np.asarray(self.prior.sigma, dtype=np.float64), (self.size,)).copy()


def is_absent(term: Term) -> bool:
    """Whether it is an error that nobody has stated and good devices do not have."""
    return term.suspected is not None and term.deviation is not None and not term.deviation.any()


@dataclass(frozen=True)
class Quantity:
    """One vector or rotation that an instrument reads."""

    name: str
    forms: tuple[tuple[str, ...], ...]
    """Columns of the log that hold it, in one of these forms."""
    unit: str
    """SI unit of its columns (of angles, where a rotation is given by angles)."""
    noise: float | None
    """White, 1-sigma per sample and axis; None: not stated. Of a rotation: of the rotation vector
    on its right [rad]."""
    rotation: bool = False
    """Whether it is a rotation, shape (3, 3); else a vector."""
    required: bool = True
    determines: tuple[Part, ...] = ()
    """Parts of the pose, or of its derivatives, that follow from its readings alone."""
    disturbed: tuple[Disturbance, ...] = ()
    """Errors that go on for a while, as stated; those that nobody has stated are looked for."""

    @property
    def size(self) -> int:
        """Numbers in a vector; 3 for a rotation."""
        return 3 if self.rotation else len(self.forms[0])


class FrameForm(FileModel):
    """The tracker frame in the world frame."""

    position: Vector = (0.0, 0.0, 0.0)
    """[m]"""
    rpy_deg: Vector = (0.0, 0.0, 0.0)
    """[deg]"""

    @property
    def rotation(self) -> Array:
        """R_world_tracker, shape (3, 3)."""
        return _matrix_of(self.rpy_deg)


class TargetLimits(FileModel):
    """What the target may reach before the instrument loses it."""

    speed: Annotated[float, Field(gt=0)] | None = None
    """[m/s]"""
    acceleration: Annotated[float, Field(gt=0)] | None = None
    """[m/s^2]"""


@dataclass(frozen=True)
class Mounting:
    """Where an instrument sits and which frame its readings stand in, by its keys in the
    experiment file; None: its kind has no such key.
    """

    rpy_deg: Vector | None = None
    """Instrument frame to platform frame [deg]; key ``rpy_deg``."""
    point: Vector | None = None
    """Origin of the instrument, or point that it tracks, in the platform frame [m]."""
    point_key: str = "position"
    """Key of that point."""
    frame: FrameForm | None = None
    """Frame that its readings stand in; key ``frame``; None: the world."""

    @property
    def rotation(self) -> Array:
        """R_platform_instrument, shape (3, 3); that of a kind without the key is no rotation."""
        return _matrix_of(self.rpy_deg or (0.0, 0.0, 0.0))


@dataclass(frozen=True)
class Choice:
    """A key with two values that is easily stated the wrong way round."""

    key: str
    other: str
    """The value that the instrument does not have."""
    quantities: tuple[str, ...]
    """Readings that it is about."""
    kind: str
    """What sort of mistake that is, in two or three words."""
    what: str
    """The mistake in words: what the readings would be instead."""


TIME_CONSTANT = "time_constant"
"""Key of the time constant of a force amplifier's filter: how far forces lag behind the motion."""
LATENCY = "latency"
"""Key of how late an instrument reads what the clock says that it shares with others: a filter of
its own, a radio link."""
LATE = 0.05
"""1-sigma of that time where the readings ask for one [s]."""
_FILTERED = 0.03
"""1-sigma of the time constant of amplifiers that filter visibly [s]: 5 Hz and more."""


class Calibration(FileModel):
    """Systematic errors of an instrument, 1-sigma; every kind adds its own."""

    delay: Prior | None = None
    """Of its clock against the common time [s]; None: not stated."""
    jitter: Sigma | None = None
    """Time stamps are late by the absolute value of a normal number of this 1-sigma, each [s];
    None: not stated."""


class ForceCalibration(Calibration):
    """Systematic errors of force sensors, 1-sigma."""

    time_constant: Prior = exact()
    """Of the first-order filter of the amplifier [s]; not stated: none, unless the readings ask for
    one."""
    drift: Sigma | None = None
    """Random walk of the offset [N/sqrt(s)], of torques [N m/sqrt(s)]; None: not stated."""

    @property
    def filter_term(self) -> Term:
        """The time constant; it acts on the time of a reading, not on the reading."""
        stated = TIME_CONSTANT in self.model_fields_set
        suspected = None if stated else _FILTERED
        return Term(TIME_CONSTANT, 1, "s", self.time_constant, suspected=suspected, positive=True)


def _pairs(given: Any) -> Any:
    """A mapping as pairs, which are immutable."""
    return tuple(given.items()) if isinstance(given, Mapping) else given


_TEXTS = {"type": "object", "additionalProperties": {"type": "string"}}
_NUMBERS = {"type": "object", "additionalProperties": {"type": "number"}}
Words = Annotated[tuple[tuple[str, str], ...], BeforeValidator(_pairs), WithJsonSchema(_TEXTS)]
"""Column -> word: another column, a node of a controller."""
Scale = Annotated[
    float | tuple[tuple[str, float], ...],
    BeforeValidator(_pairs),
    WithJsonSchema({"anyOf": [{"type": "number"}, _NUMBERS]}),
]
"""One factor, or column -> factor."""


class Instrument(FileModel, ABC):
    """An instrument as an experiment file describes it."""

    commanded: ClassVar[bool] = False
    """Whether it says what was asked for rather than what was."""
    measured_force: ClassVar[Literal["tension", "wrench"] | None] = None
    """Field of :class:`steelyard.motion.state.State` that a force instrument reads."""
    per_cable: ClassVar[bool] = False
    """Whether it has a reading for every cable."""
    may_rest: ClassVar[bool] = False
    """Whether one channel may rightly read the same all along while others change: the encoder of a
    winch that stands still."""
    tabular: ClassVar[bool] = False
    """Whether its rows are observations without a time, each about a pose of its own."""

    kind: str
    clock: str | None = None
    """Instruments of one clock share its error."""
    rate: Annotated[float, Field(gt=0, le=100_000)] | None = None
    """[Hz]; for simulation and design."""
    nodes: Words = ()
    """Column -> node of a controller that has its value (OPC UA: a node id, Beckhoff: the name of a
    variable); for `watch`."""
    calibration: Calibration = Calibration()
    """1-sigma of its systematic errors."""
    columns: Words = ()
    """Column of the contract -> column that it is read from in all runs, on top of what its streams
    say: what is exchanged in every log."""
    scale: Scale = 1.0
    """What its columns are multiplied by in all runs, on top of what its streams say: one factor,
    or column of the contract -> factor; -1 where a sign is turned."""

    def factor(self, column: str) -> float:
        """What a column of the contract is multiplied by, after what its stream says."""
        if isinstance(self.scale, float | int):
            return float(self.scale)
        return dict(self.scale).get(column, 1.0)

    @property
    def is_force(self) -> bool:
        """Whether it reads the forces on the platform."""
        return self.measured_force is not None

    @property
    def is_measurement(self) -> bool:
        """Whether it says how far its readings may be from the truth."""
        return not self.commanded

    @property
    def is_motion(self) -> bool:
        """Whether it measures how the platform moves, by itself and not by its cables."""
        otherwise = self.is_force or self.per_cable or self.tabular
        return self.is_measurement and not otherwise

    @property
    def is_cable_motion(self) -> bool:
        """Whether it measures how the platform moves by its cables."""
        return self.per_cable and not self.is_force

    @property
    def tells_stretch(self) -> bool:
        """Whether it looks at how far cables stretch, whatever the robot file says of it."""
        return False

    @property
    def calibrates(self) -> str | None:
        """Name of the instrument whose errors its rows tell; None: they tell of the body."""
        return None

    @property
    def remembers(self) -> bool:
        """Whether its reading depends on how the cables have moved before."""
        return False

    @property
    def unread(self) -> frozenset[str]:
        """Columns of the contract that it does not have though its kind does."""
        return frozenset()

    def stands_in(self, m: int) -> bool:
        """Whether nobody reads anything of it: it stands in for sensors that are not there.

        Args:
            m: Number of cables.
        """
        columns = {c for q in self.quantities(m) for form in q.forms for c in form}
        return bool(columns) and columns <= self.unread

    @property
    def target_limits(self) -> TargetLimits | None:
        """What the point that it tracks may reach; None: it does not lose it."""
        return None

    @property
    def mounting(self) -> Mounting:
        """Where it sits; nothing to say unless a kind has keys for it."""
        return Mounting()

    @abstractmethod
    def quantities(self, m: int) -> tuple[Quantity, ...]:
        """What it reads, on a robot of m cables."""

    @property
    def choices(self) -> tuple[Choice, ...]:
        """Keys with two values that are easily stated the wrong way round."""
        return ()

    def quantity(self, name: str, m: int) -> Quantity:
        """One of :meth:`quantities`."""
        return next(each for each in self.quantities(m) if each.name == name)

    @abstractmethod
    def terms(self, m: int) -> tuple[Term, ...]:
        """Its systematic errors, but for the delay of its clock."""

    @abstractmethod
    def predict(
        self, state: State, calibration: Mapping[str, Symbol], robot: Robot
    ) -> dict[str, Symbol]:
        """Its measurement equation: noise-free readings of a platform state.

        Args:
            state: Symbols.
            calibration: A symbol of shape (size,) for each of :meth:`terms`.
            robot: Its cables.

        Returns:
            One symbol for each of :meth:`quantities`.
        """


def _matrix_of(rpy_deg: Vector) -> Array:
    """Rotation matrix of roll, pitch, yaw [deg], as experiment files have them, shape (3, 3)."""
    return np.asarray(Rotation.from_euler("ZYX", rpy_deg[::-1], degrees=True).as_matrix())


def mounting_rotation(rpy_deg: Vector, misalignment: Symbol) -> Symbol:
    """R(rpy) Exp(misalignment): R_platform_instrument, or R_world_tracker of a frame."""
    return rotations.from_rpy(ca.DM(np.radians(rpy_deg))) @ rotations.exp(misalignment)
