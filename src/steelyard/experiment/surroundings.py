"""What acts on the platform beside its cables, as an experiment file states it."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from steelyard.files.file_model import FileModel

NotNegative = Annotated[float, Field(ge=0)]


class KnownForm(FileModel):
    """A value known beforehand; a bare number is exact."""

    value: float
    sigma: NotNegative = 0.0

    @model_validator(mode="before")
    @classmethod
    def _number(cls, value: Any) -> Any:
        return value if isinstance(value, dict) else {"value": value}


def _exactly(value: float) -> KnownForm:
    return KnownForm.model_validate(value)


KnownVector = tuple[KnownForm, KnownForm, KnownForm]


class UnmodelledForm(FileModel):
    """A wrench on the platform that nothing explains, a Gauss-Markov process in the platform's
    axes; what is absent is estimated.
    """

    force: NotNegative | None = None
    """1-sigma per axis [N]."""
    torque: NotNegative | None = None
    """1-sigma per axis [N m]."""
    time: Annotated[float, Field(gt=0)] | None = None
    """Correlation time [s]."""


class BendingForm(FileModel):
    """Parts of the platform that bend, by a frequency of their own above those of the motion."""

    frequency: Annotated[float, Field(gt=0)]
    """The lowest of the platform's own frequencies [Hz]."""
    share: Annotated[float, Field(gt=0, le=1)] = 0.1
    """Part of what is carried that moves with it, 1-sigma."""


def _none(keys: str, example: str) -> AfterValidator:
    """0, the only number that says something of several ones."""

    def nothing(value: float) -> float:
        if value:
            raise ValueError(
                f"expected 0, or a mapping of {keys}, found {value:g}; write {example}"
            )
        return value

    return AfterValidator(nothing)


def _form(value: Any) -> str:
    return "stated" if isinstance(value, dict | FileModel) else "none"


Unmodelled = Annotated[
    Annotated[UnmodelledForm, Tag("stated")]
    | Annotated[float, _none("'force', 'torque' and 'time'", "{force: …, torque: …}"), Tag("none")],
    Discriminator(_form),
]
"""0: there is none."""
Bending = Annotated[
    Annotated[BendingForm, Tag("stated")]
    | Annotated[float, _none("'frequency' and 'share'", "{frequency: …}"), Tag("none")],
    Discriminator(_form),
]
"""0: there is none."""


class AttachedForm(FileModel):
    """A hose or an umbilical from a point of the platform to one of the world; any number may be
    uncertain, ``{value, sigma}``.
    """

    at: KnownVector
    """Where it is fixed to the platform, platform frame [m]."""
    to: KnownVector
    """Where it comes from, world frame [m]."""
    force: KnownForm = _exactly(0.0)
    """Part of its weight that the platform carries [N]."""
    stiffness: KnownForm = _exactly(0.0)
    """By how much it pulls towards where it comes from when it is longer than ``free`` [N/m]."""
    free: KnownForm = _exactly(0.0)
    """Length up to which it does not pull [m]."""


class DragForm(FileModel):
    """Air: drag coefficient times area [m^2]; a bare number is exact."""

    value: NotNegative = 0.0
    sigma: NotNegative = 0.0

    @model_validator(mode="before")
    @classmethod
    def _number(cls, value: Any) -> Any:
        return value if isinstance(value, dict) else {"value": value}


class Surroundings(FileModel):
    """All of it."""

    unmodelled: Unmodelled | None = None
    """None: estimated, and zero where the readings do not ask for it."""
    attached: tuple[AttachedForm, ...] = ()
    drag: DragForm | None = None
    """None: estimated, and zero where the readings do not ask for it."""
    bending: Bending | None = None
    """None: estimated, and zero where the readings do not ask for it."""
