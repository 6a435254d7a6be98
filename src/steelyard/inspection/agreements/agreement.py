"""What two instruments say of the same thing, and how far apart they are.

Each agreement allows for what the description allows for (a bias, a small misalignment, a clock
that is a little off), within its prior, and compares what is then left with what noise and
imperfect models would leave. What counts is the ratio of the two: near one in a sound
recording, ten or a hundred where a sign, an axis or a unit is wrong.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from steelyard.arrays import Array
from steelyard.identification.model.sources import Source
from steelyard.inspection.agreements.excerpt import Excerpt


@dataclass(frozen=True)
class AgreementSettings:
    """What two accounts of one motion may differ by; chosen on simulated and real recordings
    (docs/validation.md) so that sound ones stay below a ratio of one and a half.
    """

    bad: float = 1.8
    """Ratio of what is left to what is allowed beyond which instruments contradict each other."""
    measured: float = 0.05
    """What may be left of a motion that two instruments measure, as a part of it: smoothing and
    imperfect models."""
    commanded: float = 0.1
    """The same of a commanded motion, which a platform on elastic cables follows less well."""
    cross: float = 0.3
    """Part of these two, of the other axes: what misalignment takes from them."""
    effective: float = 10.0
    """Samples that count as independent when a calibration error is compared with its prior:
    imperfect models change slowly."""
    far_from_prior: float = 3.0
    """1-sigmas that a calibration error may be off."""
    late: float = 1.33
    """1-sigmas that a clock may be off; clocks are as good as they are said to be."""
    least: Mapping[str, float] = field(
        default_factory=lambda: {"rad/s": 2e-3, "rad": 5e-3, "m/s^2": 0.05, "m": 5e-3}
    )
    """Unit -> difference that is always allowed, whatever the noise."""
    least_sigma: Mapping[str, float] = field(
        default_factory=lambda: {"rad/s": 0.005, "rad": 0.02, "m/s^2": 0.1, "m": 0.02}
    )
    """Unit -> 1-sigma of a calibration error that any description may have, whatever it states."""
    least_reference: float = 0.03
    """The same of the reference of an orientation [rad]."""
    least_lever: float = 0.03
    """The same of the place of an accelerometer [m]."""
    least_clock: float = 0.02
    """1-sigma that a clock is allowed at least [s]: half a knot of the fastest motion."""
    clock: float = 0.05
    """1-sigma of a clock whose error is taken from the data [s], the contract's default."""
    command_clock: float = 0.3
    """1-sigma of how late a platform follows its command [s]."""
    command_place: float = 0.03
    """1-sigma of how far the world of a controller is from that of the robot file [m]."""
    scatter: float = 0.05
    """What an orientation may scatter about a smooth motion [rad]."""
    vibration: float = 0.3
    """What a platform shakes beyond its commanded motion [m/s^2]."""
    gravity: float = 0.15
    """What the mean length of an accelerometer's reading may differ from gravity, as a
    logarithm."""
    unknown_motion: float = 0.5
    """Part of the accelerometer's changes that may be left where no instrument gives the place."""


SETTINGS = AgreementSettings()


@dataclass(frozen=True, eq=False)
class InstrumentAgreement:
    """Two accounts of one thing."""

    name: str
    between: tuple[Source, ...]
    """Whose readings it depends on."""
    channels: tuple[str, ...]
    left: Array
    """What is left between them, root mean square, shape (k,)."""
    allowed: Array
    """What noise and imperfect models would leave, shape (k,)."""
    unit: str
    measured: Array
    """Shape (n, 3) or (n, m), for figures."""
    predicted: Array
    """The same, with what was allowed for added."""
    robot: bool = False
    """Whether it depends on the robot file."""

    @property
    def ratio(self) -> Array:
        """Shape (k,)."""
        return np.asarray(self.left / self.allowed)

    @property
    def worst(self) -> float:
        """Largest ratio."""
        return float(self.ratio.max(initial=0.0))

    @property
    def agrees(self) -> bool:
        """Whether nothing but noise and imperfect models is left."""
        return self.worst <= SETTINGS.bad

    @property
    def cost(self) -> float:
        """How bad it is: grows with the logarithm, since ten times too bad is bad enough."""
        return float(np.sum(np.log1p(self.ratio**2)))


@dataclass(frozen=True, eq=False)
class Freedom:
    """Constants that a description leaves open."""

    columns: Array
    """Derivative of what is left by them, shape (n, k, c) or, at all instants the same, (k, c)."""
    sigma: Array
    """1-sigma beforehand, shape (c,)."""
    name: str


def is_command(excerpt: Excerpt, source: Source) -> bool:
    """Whether an instrument says what was asked for rather than what was."""
    return excerpt.instruments[source[0]].commanded


def title(*sources: Source) -> str:
    """Sources for people."""
    return " against ".join(f"{quantity.replace('_', ' ')} of {name}" for name, quantity in sources)


def compare(
    excerpt: Excerpt,
    sources: tuple[Source, ...],
    unit: str,
    measured: Array,
    predicted: Array,
    freedoms: Sequence[Freedom],
    *,
    rate: Array,
    noise: float,
    beside: tuple[Source, ...] = (),
    motion: tuple[Source, ...] | None = None,
    robot: bool = False,
    axes: Sequence[str] | None = None,
) -> InstrumentAgreement:
    """Compare two accounts, each on a clock that may be late.

    Args:
        excerpt: Of the run.
        sources: Whose readings these are.
        unit: Of both.
        measured: Shape (n, k).
        predicted: Shape (n, k).
        freedoms: Constants that may be chosen within their priors, beside the delay.
        rate: How fast both change, shape (n, k).
        noise: 1-sigma left in one number of the difference.
        beside: Other readings that they depend on.
        motion: Which of all these give the motion, of which a part may be left; None: the sources.
        robot: Whether the robot file matters.
        axes: Names of the k numbers; None: x, y, z of three, else their places.
    """
    commanded = any(is_command(excerpt, source) for source in motion or sources)
    tolerance = SETTINGS.commanded if commanded else SETTINGS.measured
    late = np.array([_clock_sigma(excerpt, sources)])
    freedoms = [*freedoms, Freedom(-rate[:, :, None], late, "delay")]
    spread = np.minimum(measured.std(axis=0), predicted.std(axis=0))
    allowed = np.sqrt(
        noise**2
        + (tolerance * spread) ** 2
        + (SETTINGS.cross * tolerance) ** 2 * float(np.mean(spread**2))
        + SETTINGS.least.get(unit, 0.0) ** 2
    )
    left, taken, far = _settled(measured - predicted, allowed, freedoms)
    if axes is None:
        k = measured.shape[1]
        axes = "xyz" if k == 3 else [str(i + 1) for i in range(k)]
    levels = [SETTINGS.late if f.name == "delay" else SETTINGS.far_from_prior for f in freedoms]
    return InstrumentAgreement(
        title(*sources),
        tuple(dict.fromkeys((*sources, *beside))),
        (*axes, *(f.name for f in freedoms)),
        np.concatenate([np.sqrt(np.mean(left**2, axis=0)), far]),
        np.concatenate([allowed, levels]),
        unit,
        measured,
        predicted + taken,
        robot,
    )


def _clock_sigma(excerpt: Excerpt, sources: Sequence[Source]) -> float:
    """How far clocks may be apart [s]."""
    total = 0.0
    for source in sources:
        if is_command(excerpt, source):
            total += SETTINGS.command_clock**2
            continue
        stated = excerpt.experiment.delay(excerpt.run, source[0]).sigma
        own = float(np.mean(stated)) if stated is not None else SETTINGS.clock
        total += max(SETTINGS.least_clock, own) ** 2
    return float(np.sqrt(total))


def _settled(
    residual: Array, allowed: Array, freedoms: Sequence[Freedom]
) -> tuple[Array, Array, Array]:
    """What is left once constants are chosen, what they took, and how many 1-sigmas each group of
    them is off, (n, k), (n, k), (groups,).
    """
    n, k = residual.shape
    parts = [np.broadcast_to(f.columns, (n, k, len(f.sigma))) for f in freedoms]
    columns = np.concatenate(parts, axis=2)
    sigma = np.concatenate([f.sigma for f in freedoms])
    A = (columns / allowed[:, None]).reshape(n * k, -1) * sigma
    b = (residual / allowed).ravel()
    weight = SETTINGS.effective / n
    value = np.linalg.solve(weight * A.T @ A + np.eye(len(sigma)), weight * A.T @ b)
    taken = (columns @ (value * sigma)).reshape(residual.shape)
    groups = np.split(np.abs(value), np.cumsum([len(f.sigma) for f in freedoms])[:-1])
    return residual - taken, taken, np.array([float(np.sqrt(np.mean(g**2))) for g in groups])
