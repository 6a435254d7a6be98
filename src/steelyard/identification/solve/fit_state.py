"""What is fitted, where a fit stands, and the normal equations of every segment about there."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.identification.known_body import KnownBody
from steelyard.identification.model.balance import Forces
from steelyard.identification.model.calibration_parameters import (
    CalibrationParameters,
    CalibrationValues,
    columns_of,
)
from steelyard.identification.model.force_residuals import force_residuals
from steelyard.identification.model.motion_residuals import motion_residuals
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.segment import NormalEquations
from steelyard.identification.model.sources import Source
from steelyard.identification.model.tensions.carried import carried_tensions
from steelyard.identification.solve.settings import FIT, FitSettings
from steelyard.identification.tally import Tally
from steelyard.inertia import TEN


@dataclass(frozen=True, eq=False)
class FitState:
    """Present values of everything."""

    segments: tuple[Segment, ...]
    calibration: CalibrationValues
    parameters: Array | None
    """The ten of :data:`steelyard.inertia.LINEAR_PARAMETERS`, shape (10,); None: forces are not
    looked at."""
    factors: Mapping[Source, float] = field(default_factory=dict)
    """Quantity -> noise in units of what its readings say."""
    jitters: Mapping[str, float] = field(default_factory=dict)
    """Instrument -> 1-sigma of the jitter of its time stamps [s], where nobody has stated it and
    the readings ask for it."""

    @property
    def ten(self) -> int:
        """Columns of the border that belong to the body."""
        return 0 if self.parameters is None else TEN


@dataclass(frozen=True, eq=False)
class Task:
    """What is to be fitted."""

    experiment: Experiment
    calibration_parameters: CalibrationParameters
    force_samples: tuple[Forces | None, ...]
    """Of each segment; None: its forces are not looked at."""
    active: NDArray[np.bool_]
    """Systematic errors that are estimated, shape (u,)."""
    stated: frozenset[Source]
    """Quantities whose noise is stated."""
    sizes: Array
    """Plausible sizes of the ten linear parameters, shape (10,)."""
    least: Mapping[Source, float] = field(default_factory=dict)
    """Quantity -> least 1-sigma that its noise may be estimated at."""
    settings: FitSettings = FIT
    """How to fit."""
    known: Callable[[FitState], Sequence[KnownBody]] | None = None
    """What is known beforehand of the bodies, about a state."""

    def border(self, state: FitState) -> int:
        """Number of columns of the border: the body, where forces are looked at, and the active
        errors.
        """
        return state.ten + int(self.active.sum())

    @property
    def columns(self) -> int:
        """Columns of the border of all: the ten and every calibration parameter, estimated or
        not.
        """
        return TEN + len(self.calibration_parameters)

    @property
    def every_column(self) -> NDArray[np.intp]:
        """Column of every calibration parameter there, shape (u,)."""
        return TEN + np.arange(len(self.calibration_parameters), dtype=np.intp)

    def column_of(self, state: FitState) -> NDArray[np.intp]:
        """Column of each systematic error in the border; -1: not there; shape (u,)."""
        return columns_of(self.active, state.ten)


@dataclass(frozen=True, eq=False)
class Linearised:
    """Normal equations of one segment about a state."""

    motion: NormalEquations
    """Of the motion instruments, and of the balance with them where the motion follows it."""
    forces: NormalEquations | None
    """Of the balance where the motion is held; None: it is with them, or not looked at."""
    held: NormalEquations | None = None
    """Of the motion with its smoothness, where it is held; None: it follows the forces."""

    @cached_property
    def all(self) -> NormalEquations:
        """Of all readings."""
        return self.motion if self.forces is None else self.motion + self.forces


@dataclass(frozen=True, eq=False)
class Fit:
    """Where it ended."""

    state: FitState
    equations: tuple[NormalEquations, ...]
    """Of each segment, about the state."""
    tally: Tally
    ratios: Mapping[Source, float]
    """Variance of the residuals over what they count as, freedom taken off."""
    converged: bool
    turns: int
    covariance: Array
    """Of the border: the ten, where forces are looked at, and then the active errors."""
    stated: frozenset[Source]
    """Quantities whose noise is stated."""
    first_sigmas: Mapping[Source, float]
    """1-sigma of every quantity that factors multiply."""
    motions: tuple[Array | None, ...] = ()
    """Covariance of the motion of each segment where it was held, see :func:`.force_residuals`."""
    bias: Array = field(default_factory=lambda: np.zeros((0, TEN)))
    """What noise of the held motion does to the gradient by the border in the mean, with the
    opposite sign, segment by segment, shape (s, b)."""


def linearise(
    task: Task, state: FitState, *, held: bool = False
) -> tuple[tuple[Linearised, ...], Tally]:
    """Normal equations of every segment about a state.

    Args:
        task: What is to be fitted.
        state: Where to linearise.
        held: Whether the motion is held as its instruments alone give it, so that its covariance
            weights the forces; else it follows them.
    """
    border, column_of = task.border(state), task.column_of(state)
    tally = Tally()
    found = []
    for segment, force_samples in zip(state.segments, task.force_samples, strict=True):
        carried = None
        if not held:
            carried = carried_tensions(
                task.experiment,
                segment,
                force_samples,
                state.calibration,
                column_of,
                state.parameters,
                state.factors,
            )
        rows = motion_residuals(
            task.experiment, segment, state.calibration, column_of, state.factors, tally, carried
        )
        if force_samples is None or state.parameters is None:
            by_motion = segment.equations(border, rows)
            found.append(Linearised(by_motion, None, segment.smooth(by_motion) if held else None))
            continue
        balanced = partial(
            force_residuals,
            task.experiment,
            segment,
            force_samples,
            state.calibration,
            column_of,
            state.parameters,
            state.factors,
            tally,
        )
        if not held:
            # In one sum: matrices of a long motion take more memory than anything else.
            found.append(
                Linearised(segment.equations(border, chain(rows, balanced(wide=True))), None)
            )
            continue
        by_motion = segment.equations(border, rows)
        alone = segment.smooth(by_motion)
        forces = segment.equations(border, balanced(alone.inverse))
        found.append(Linearised(by_motion, forces, alone))
    return tuple(found), tally


def smooth(state: FitState, readings: Sequence[NormalEquations]) -> tuple[NormalEquations, ...]:
    """Normal equations of every segment with what is known of its smoothness."""
    return tuple(
        segment.smooth(each) for segment, each in zip(state.segments, readings, strict=True)
    )
