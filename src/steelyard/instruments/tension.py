"""Force sensors in the cables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal, NamedTuple

import casadi as ca
import numpy as np
from pydantic import Field, model_validator
from scipy.linalg.lapack import dtbtrs

from steelyard.arrays import Array
from steelyard.batch import Symbol
from steelyard.instruments.base import (
    ForceCalibration,
    Instrument,
    Prior,
    Quantity,
    Term,
    exact,
    sigma,
)
from steelyard.instruments.noise import Noise, drift, white_part, with_colored_part
from steelyard.motion.state import State
from steelyard.robot.kinematics import attachments_at, cables_at, paid_out, shapes
from steelyard.robot.model import Robot

TURNAROUND = 0.01
"""Rate of a cable at which the friction of its roller has three quarters of its size, the
hyperbolic tangent of one [m/s]."""
_FRICTION = 0.02
"""Default 1-sigma of the friction of a roller."""
_TRAVEL = 0.003
"""Default of the travel over which it builds up, and its 1-sigma [m]."""
_VISCOUS = 0.03
"""1-sigma of the resistance to the rate of rollers that have one, as a part of the usual tension
[s/m]: rollers are made for the cables that they carry."""
_CROSSTALK = 0.005
"""1-sigma of the part of another cable that a sensor reads where sensors do so."""
CROSSTALK = "crosstalk"
"""Key of these parts."""
GAINS = ("gain", "common_gain")
"""Keys of errors by which a reading is a multiple of its tension: all tensions, the body and the
stretch of cables multiplied alike read the same."""
PRESLIDING = "presliding"
"""Key of that travel."""
PRESLIDING_START = "presliding_start"
"""Key of how far the friction of rollers has built up where a run begins."""
_START = 0.6
"""Its 1-sigma: anything between the whole friction one way and the other."""
_LEAST_TRAVEL = 3e-4
"""Travel that is none at the rates of real sensors [m]."""
_STEPS = 0
"""Towards the shape of a hanging cable: of a shallow one the height is right to micrometres
already, and with it the weight."""


class TensionCalibration(ForceCalibration):
    """Systematic errors, 1-sigma."""

    offset: Prior = Prior.model_construct(value=None, sigma=None, per="experiment")
    """Added to each cable [N]; default: 1 % of the median tension."""
    gain: Prior = sigma(0.01)
    """Factor on each cable."""
    common_gain: Prior = sigma(0.005)
    """Factor common to all cables."""
    crosstalk: Prior | None = None
    """Part of the tension of every other cable that a sensor reads too: a common frame, a shared
    supply; None: none, unless the readings ask for it."""
    friction: Prior | None = None
    """Part of the tension that the roller between sensor and platform takes; None: .02 at the
    winch, where there is one."""
    presliding: Prior | None = None
    """Travel of the cable over which that builds up after it has turned around [m]; None: .003
    about .003 at the winch."""
    presliding_start: Prior | None = None
    """How far it has built up where a run begins, from -1 to 1; None: 0 +- .6 in every run at the
    winch, since nobody knows how a robot came to be where it is."""
    viscous: Prior | None = None
    """Resistance of the roller to its rate [N s/m]; None: none at the winch, unless the readings
    ask for it."""


class Tension(Instrument):
    """One force sensor per cable, in the order of the robot file, positive pulling."""

    measured_force: ClassVar[Literal["tension"]] = "tension"
    per_cable: ClassVar[bool] = True

    kind: Literal["tension"]
    noise: Noise | None = None
    """1-sigma per sample [N]."""
    calibration: TensionCalibration = TensionCalibration()
    without: tuple[Annotated[int, Field(ge=1)], ...] = ()
    """Numbers of the cables that have no sensor, from 1; their columns are not read and may be
    absent."""
    end: Literal["platform", "winch"] = "platform"
    """At which end of the cable the sensors sit; at the winch its weight and its roller are between
    them and the platform."""

    @model_validator(mode="after")
    def _only_rollers_rub(self) -> Tension:
        for key in ("friction", "presliding", "presliding_start", "viscous"):
            if self.end == "platform" and getattr(self.calibration, key) is not None:
                raise ValueError(
                    f"expected no key '{key}' under 'calibration' of sensors at the platform end,"
                    " where no roller is in between, found one; remove it, or add 'end: winch'"
                )
        return self

    @property
    def unread(self) -> frozenset[str]:
        """See :class:`Instrument`."""
        return frozenset(f"f{number}" for number in self.without)

    @property
    def remembers(self) -> bool:
        """See :class:`Instrument`."""
        return self.end == "winch"

    def quantities(self, m: int) -> tuple[Quantity, ...]:
        """See :class:`Instrument`."""
        return (
            Quantity(
                "tension",
                (tuple(f"f{i + 1}" for i in range(m)),),
                "N",
                white_part(self.noise),
                disturbed=with_colored_part(self.noise, drift(self.calibration.drift)),
            ),
        )

    def terms(self, m: int) -> tuple[Term, ...]:
        """See :class:`Instrument`."""
        c = self.calibration
        always = (
            Term("offset", m, "N", c.offset),
            Term("gain", m, "1", c.gain, nominal=1.0),
            Term("common_gain", 1, "1", c.common_gain, nominal=1.0),
            c.filter_term,
            Term(
                CROSSTALK,
                m * (m - 1),
                "1",
                c.crosstalk or exact(),
                suspected=None if c.crosstalk else _CROSSTALK,
            ),
        )
        return (
            always
            if self.end == "platform"
            else (
                *always,
                Term("friction", m, "1", c.friction or sigma(_FRICTION), positive=True),
                Term(PRESLIDING, 1, "m", c.presliding or _presliding(), positive=True),
                Term(
                    "viscous",
                    m,
                    "N s/m",
                    c.viscous or exact(),
                    suspected=None if c.viscous else _VISCOUS,
                    of_reading="tension",
                    positive=True,
                ),
                Term(PRESLIDING_START, m, "1", c.presliding_start or _anything(), of_motion=True),
            )
        )

    def predict(
        self, state: State, calibration: Mapping[str, Symbol], robot: Robot
    ) -> dict[str, Symbol]:
        """Gain times tension plus offset, with a part of the other cables' tensions; at the winch
        with the weight that hangs between and less what the roller takes.
        """
        c = calibration
        tension = (
            state.tension
            if self.end == "platform"
            else _behind_rollers(state, c["friction"], c["viscous"], robot)
        )
        mixed = tension + _of_others(c[CROSSTALK], robot.m) @ tension
        return {"tension": c["common_gain"] * c["gain"] * mixed + c["offset"]}


def _of_others(parts: Symbol, m: int) -> Symbol:
    """Matrix of the parts of other cables that each sensor reads, row by row without the diagonal,
    shape (m, m).
    """
    found = ca.SX.zeros(m, m)
    places = [(i, j) for i in range(m) for j in range(m) if i != j]
    for k, (i, j) in enumerate(places):
        found[i, j] = parts[k]
    return found


def _behind_rollers(state: State, friction: Symbol, viscous: Symbol, robot: Robot) -> Symbol:
    r"""Tensions at the winches' side of the rollers [N], shape (m,).

    :math:`T_w = T (1 - \mu \tanh(\dot l / v))` with T the tension where the cable reaches the
    roller and :math:`\dot l` the rate at which it is paid out: a roller resists, so that paying out
    the winch pulls less than the cable does, and hauling in more. How a roller turns around is not
    known; within v it does so smoothly. At rest it takes nothing, the mean of all that it might
    hold.
    """
    rate = paid_out(robot, state.position, state.rotation, state.velocity, state.omega)
    rolling = ca.tanh(rate / TURNAROUND) if state.rolling is None else state.rolling
    pulling = (state.tension + _hanging(state, robot)) * (1 - friction * rolling)
    return pulling - viscous * rate


class RollerState(NamedTuple):
    """What rollers remember at an instant; see :class:`Rolled`, without its first axis."""

    length: Array
    value: Array
    by_travel: Array
    by_start: Array


class Rolled(NamedTuple):
    """What rollers remember along a motion of n samples, shape (n, m) each."""

    length: Array
    """Of the straight cables, by which the rollers turn [m]."""
    value: Array
    """How far the friction has built up, from -1 to 1."""
    by_travel: Array
    """How that follows the travel over which it builds up [1/m]."""
    by_start: Array
    """How it follows what it was where the run began."""

    @property
    def last(self) -> RollerState:
        """At the last sample."""
        # Copies: views would hold on to all samples before.
        return RollerState(*(each[-1].copy() for each in self))


def rolled(
    lengths: Array, presliding: float, start: Array, before: Array | None = None
) -> tuple[Array, Array, Array]:
    r"""How far the friction of rollers builds up along a motion, how that follows the travel over
    which it does so [1/m], and how it follows what it was, shape (n, m) each.

    :math:`\mathrm{d}z / \mathrm{d}l = (1 - z \operatorname{sgn} \dot l) / s` (Dahl [Dahl1968]_),
    exact where a cable runs one way between samples.

    Args:
        lengths: Of the cables, one sample after the other [m], shape (n, m).
        presliding: Travel s over which it builds up [m].
        start: What it was, shape (m,).
        before: Lengths then [m], shape (m,); None: those of the first sample.
    """
    steps = np.diff(lengths, axis=0, prepend=lengths[:1] if before is None else before[None])
    share, sign = np.abs(steps) / presliding, np.sign(steps)
    kept = np.exp(-share)
    # From sample to sample it is kept in part, which is a band of two: solved, not stepped through.
    right, by_start = sign * (1 - kept), np.zeros_like(kept)
    right[:1] += kept[:1] * start
    by_start[:1] = kept[:1]
    value = _kept_on(kept, right[..., None])[..., 0]
    away = kept * (np.concatenate([start[None], value[:-1]])[: len(value)] - sign)
    found = _kept_on(kept, np.stack([away * share / presliding, by_start], axis=2))
    return value, found[..., 0], found[..., 1]


def _kept_on(kept: Array, right: Array) -> Array:
    """Solution of ``x[i] - kept[i] x[i - 1] = right[i]``, with nothing before, shape (n, m, p).

    Args:
        kept: Part that is kept from the sample before, shape (n, m).
        right: Shape (n, m, p).
    """
    found = np.empty_like(right)
    if len(kept):
        for i in range(kept.shape[1]):
            band = np.stack([np.ones(len(kept)), np.append(-kept[1:, i], 0.0)])
            found[:, i], _ = dtbtrs(band, right[:, i], uplo="L")
    return found


def rolled_along(
    robot: Robot,
    position: Array,
    rotation: Array,
    errors: Mapping[str, Array],
    before: RollerState | None = None,
    geometry: Mapping[str, Array] | None = None,
) -> Rolled:
    """What rollers remember along a motion.

    Args:
        robot: Whose rollers turn.
        position: Of the platform in the world frame [m], shape (n, 3).
        rotation: Platform to world frame, shape (n, 3, 3).
        errors: Systematic errors of :class:`Tension`. What an estimate takes the travel for may be
            negative, which is none: so it is smooth from one to the other.
        before: What they remember of before; None: the run begins.
        geometry: ``anchors`` and ``attachments`` as they are believed to be [m], shape (3 m,) each:
            some tenths of a millimetre decide whether a cable that nearly stops turns around; None:
            those of the robot.
    """
    lengths = cables_at(robot.with_straight_cables(), position, rotation, np.ones(robot.m)).length
    if geometry is not None:
        anchors, attachments = (geometry[k].reshape(-1, 3) for k in ("anchors", "attachments"))
        apart = robot.anchors - attachments_at(position, rotation, robot)
        turned = np.swapaxes(rotation @ (attachments - robot.attachments).T, -1, -2)
        moved = apart + (anchors - robot.anchors) - turned
        lengths = lengths + np.linalg.norm(moved, axis=2) - np.linalg.norm(apart, axis=2)
    travel = float(np.squeeze(errors[PRESLIDING]))
    wide = float(np.hypot(travel, _LEAST_TRAVEL))
    by_stated = (1 + travel / wide) / 2
    if before is None:
        start, none = np.broadcast_to(errors[PRESLIDING_START], robot.m), np.zeros(robot.m)
        before = RollerState(lengths[:1].sum(axis=0), start, none, none + 1)
    value, by_travel, kept = rolled(lengths, (travel + wide) / 2, before.value, before.length)
    by_travel = by_stated * by_travel + kept * before.by_travel
    return Rolled(lengths, value, by_travel, kept * before.by_start)


def _anything() -> Prior:
    """Of friction that may have been built up by anything."""
    return Prior.model_validate({"sigma": _START, "per": "run"})


def _presliding() -> Prior:
    """What rollers on ball bearings and ropes show."""
    return Prior.model_validate({"value": _TRAVEL, "sigma": _TRAVEL})


def _hanging(state: State, robot: Robot) -> Symbol:
    """By how much the weight of the cables makes them pull harder at the rollers than at the
    platform [N], shape (m,).
    """
    if not robot.cable.linear_density:
        return ca.SX.zeros(robot.m)
    # What does not even bear its own weight across has no shape to speak of, and adds what a cable
    # does that just bears it.
    weight = robot.cable.linear_density * float(np.linalg.norm(robot.gravity))
    corners = [state.position + state.rotation @ ca.DM(b) for b in robot.attachments]
    reach = ca.vertcat(
        *[ca.norm_2(ca.DM(a) - b) for a, b in zip(robot.anchors, corners, strict=True)]
    )
    below = ca.fmax(state.tension, weight * reach)
    cables = shapes(robot, state.position, state.rotation, below, steps=_STEPS)
    return ca.vertcat(*[c.winch_tension for c in cables]) - below
