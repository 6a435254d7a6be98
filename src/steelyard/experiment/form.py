"""The form of the experiment file."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from steelyard.experiment.surroundings import (
    AttachedForm,
    Bending,
    DragForm,
    KnownForm,
    NotNegative,
    Surroundings,
    Unmodelled,
)
from steelyard.files.file_model import FileModel
from steelyard.instruments import AnyInstrument
from steelyard.robot.file import PlatformForm

FORMAT = "steelyard/1"
Vector = tuple[float, float, float]


class KnownVectorForm(FileModel):
    """Components of the centre of gravity known beforehand [m]."""

    x: KnownForm | None = None
    y: KnownForm | None = None
    z: KnownForm | None = None


class KnownInertiaForm(FileModel):
    """Moments and products about the centre of gravity known beforehand [kg m^2]."""

    xx: KnownForm | None = None
    yy: KnownForm | None = None
    zz: KnownForm | None = None
    yz: KnownForm | None = None
    xz: KnownForm | None = None
    xy: KnownForm | None = None


class KnownMassForm(FileModel):
    """A mass known beforehand, or one that changes slowly; a bare number is exact."""

    value: float | None = None
    """[kg]; of one that changes that at the beginning."""
    sigma: NotNegative = 0.0
    """[kg]"""
    walk: NotNegative = 0.0
    """Random walk of what runs out or in [kg/sqrt(s)], for the method recursive and for watch."""

    @model_validator(mode="before")
    @classmethod
    def _number(cls, value: Any) -> Any:
        """A bare number is the value; a mapping says that, or how it walks."""
        if not isinstance(value, dict):
            return {"value": value}
        if value.get("value") is None and ("sigma" in value or "walk" not in value):
            raise ValueError(
                "expected the key 'value' [kg], or 'walk' [kg/sqrt(s)] alone, found"
                f" {', '.join(map(str, value)) or 'nothing'}; add it"
            )
        return value


class KnownBodyForm(FileModel):
    """What is known beforehand about the body."""

    mass: KnownMassForm | None = None
    """[kg]"""
    center_of_gravity: KnownVectorForm = KnownVectorForm()
    """Platform frame [m]."""
    inertia: KnownInertiaForm = KnownInertiaForm()
    """About the centre of gravity, platform axes [kg m^2]."""


class AddedBodyForm(FileModel):
    """What is known beforehand about a body that was added to the first load."""

    mass: KnownForm | None = None
    """[kg]"""
    center_of_gravity: KnownVectorForm = KnownVectorForm()
    """Platform frame [m]; needs the mass."""


class LoadForm(FileModel):
    """A body that runs carry, the platform included."""

    known: KnownBodyForm = KnownBodyForm()
    """What is known beforehand about it: a weighed body calibrates the force sensors."""
    added: AddedBodyForm = AddedBodyForm()
    """What is known beforehand about what it has more than the first load: a weighed body that was
    added to it."""
    nominal: PlatformForm | None = None
    """As it was drawn; without it: of the first load the platform of the robot file."""
    rigid: bool = True
    """Whether nothing moves in it; of one in which something does only poses at rest are looked
    at."""


class UncertaintyForm(FileModel):
    """1-sigma of the robot file's values, per coordinate, and of the wrench that nothing
    explains.
    """

    anchor: NotNegative = 0.002
    """[m]"""
    attachment: NotNegative = 0.002
    """[m]"""
    gravity: NotNegative = 0.005
    """[m/s^2]"""
    length_noise: Annotated[float, Field(gt=0)] | None = None
    """By how much unstrained lengths are off a constant in runs with locked winches [m]; None: that
    they are constant is not used."""
    unmodelled: Unmodelled | None = None
    """Wrench on the platform that nothing explains; None: estimated, and zero where the readings do
    not ask for it; 0: there is none."""

    @property
    def of_robot(self) -> dict[str, float]:
        """What is about the robot file."""
        return {"anchor": self.anchor, "attachment": self.attachment, "gravity": self.gravity}


class StreamForm(FileModel):
    """Where the stream of one instrument in one run is; a bare text is the file."""

    file: str
    """Path of the log, relative to this file."""
    topic: str | None = None
    """Which of the topics or groups of the log."""
    columns: dict[str, str] = Field(default_factory=dict)
    """Column of the contract -> name in the log, where they differ."""
    units: dict[str, str] = Field(default_factory=dict)
    """Column -> unit, where it is neither SI nor what the log itself states: g, deg, deg/s, mm, kN,
    us, …"""
    scale: dict[str, float] = Field(default_factory=dict)
    """Column -> what it is multiplied by, after its unit: -1 where a sign is turned."""

    @model_validator(mode="before")
    @classmethod
    def _text(cls, value: Any) -> Any:
        return {"file": value} if isinstance(value, str) else value


RUN_KEYS = frozenset({"name", "load", "static", "sync", "window"})
"""Keys of a run that are not instruments."""
_LOCKED = {"winches": "locked"}
"""One more, where it has this value: encoders may be called so, and have a file."""


class RunForm(FileModel):
    """One run; every further key is an instrument with its stream."""

    name: str
    load: str | None = None
    """Which of the loads it carries; without it the first."""
    static: bool = False
    """Whether the rows are poses at rest, row by row across the streams; no time column is needed
    then."""
    sync: dict[str, float] | Literal["auto"] | None = None
    """Instrument -> time of one common event on its clock [s]; 'auto' finds them from the data;
    without it the clocks agree."""
    winches: Literal["locked"] | None = None
    """Whether the unstrained lengths of the cables are constant; a run without forces needs it."""
    window: tuple[float, float] | None = None
    """Part to use [s], after that event, or after the first force sample."""
    streams: dict[str, StreamForm]
    """Instrument -> where its stream is."""

    @model_validator(mode="before")
    @classmethod
    def _gather(cls, value: Any) -> Any:
        """Keys that are not those of a run name instruments."""
        if not isinstance(value, dict):
            return value
        own = {
            key: entry
            for key, entry in value.items()
            if key in RUN_KEYS or (key in _LOCKED and entry == _LOCKED[key])
        }
        rest = {key: entry for key, entry in value.items() if key not in own}
        return {**own, "streams": rest}


class DatumForm(FileModel):
    """What the world frame is, for the calibration of the robot; one of both."""

    anchors: tuple[int, ...] | None = None
    """Numbers of at least three anchors, from 1: the world frame is that in which they are nearest
    to those of the robot file."""
    pose: str | None = None
    """Name of a run of poses at rest: the world frame is that in which its first pose is as its
    command, or else an instrument of kind pose, says."""

    @model_validator(mode="after")
    def _one(self) -> DatumForm:
        if (self.anchors is None) == (self.pose is None):
            raise ValueError(
                "expected one of the keys 'anchors' and 'pose', found"
                f" {'none' if self.pose is None else 'both'}; keep one"
            )
        return self


class ExperimentForm(FileModel):
    """One robot, the instruments on it, and the runs recorded with them."""

    format: Literal["steelyard/1"]
    name: str | None = None
    robot: str
    """Name of a bundled robot, or path of a robot file relative to this file."""
    known: KnownBodyForm = KnownBodyForm()
    loads: dict[str, LoadForm] = Field(default_factory=dict)
    """Name -> body that runs carry; without it there is one."""
    uncertainty: UncertaintyForm = UncertaintyForm()
    attached: tuple[AttachedForm, ...] = ()
    """Hoses and umbilicals."""
    drag: DragForm | None = None
    """Of the air; None: estimated, and zero where the readings do not ask for it."""
    bending: Bending | None = None
    """Of parts of the platform; None: estimated, and zero where the readings do not ask for it."""
    datum: DatumForm | None = None
    """What the world frame is, for the calibration of the robot; None: as the readings and the
    robot file have it."""
    instruments: dict[str, AnyInstrument] = Field(min_length=1)
    """Name -> instrument."""
    runs: tuple[RunForm, ...] = Field(min_length=1)

    @property
    def surroundings(self) -> Surroundings:
        """What acts on the platform beside its cables."""
        unmodelled = self.uncertainty.unmodelled
        return Surroundings(
            unmodelled=unmodelled, attached=self.attached, drag=self.drag, bending=self.bending
        )


class PlanForm(ExperimentForm):
    """The same before anything has been recorded."""

    runs: tuple[RunForm, ...] = ()
