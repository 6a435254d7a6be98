"""What two instruments say of the same thing, and how far apart they are.

Each agreement allows for what the description allows for (a bias, a small misalignment, a clock
that is a little off), within its prior, and compares what is then left with what noise and
imperfect models would leave. What counts is the ratio of the two: near one in a sound
recording, ten or a hundred where a sign, an axis or a unit is wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.identification.model.sources import Source
from steelyard.inspection.agreements.excerpt import Excerpt
from steelyard.inspection.agreements.settings import AGREEMENT, AgreementSettings


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
    bad: float = AGREEMENT.bad
    """Ratio beyond which they contradict each other."""
    time: Array | None = None
    """Common time [s], shape (n,); None: not stated."""

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
        return self.worst <= self.bad

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
    settings = excerpt.settings
    commanded = any(is_command(excerpt, source) for source in motion or sources)
    tolerance = settings.commanded if commanded else settings.measured
    late = np.array([_clock_sigma(excerpt, sources)])
    freedoms = [*freedoms, Freedom(-rate[:, :, None], late, "delay")]
    spread = np.minimum(measured.std(axis=0), predicted.std(axis=0))
    allowed = np.sqrt(
        noise**2
        + (tolerance * spread) ** 2
        + (settings.cross * tolerance) ** 2 * float(np.mean(spread**2))
        + settings.least.get(unit, 0.0) ** 2
    )
    left, taken, far = _settled(measured - predicted, allowed, freedoms, settings)
    if axes is None:
        k = measured.shape[1]
        axes = "xyz" if k == 3 else [str(i + 1) for i in range(k)]
    levels = [settings.late if f.name == "delay" else settings.far_from_prior for f in freedoms]
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
        settings.bad,
    )


def _clock_sigma(excerpt: Excerpt, sources: Sequence[Source]) -> float:
    """How far clocks may be apart [s]."""
    settings, total = excerpt.settings, 0.0
    for source in sources:
        if is_command(excerpt, source):
            total += settings.command_clock**2
            continue
        stated = excerpt.experiment.delay(excerpt.run, source[0]).sigma
        own = float(np.mean(stated)) if stated is not None else settings.clock
        total += max(settings.least_clock, own) ** 2
    return float(np.sqrt(total))


def _settled(
    residual: Array, allowed: Array, freedoms: Sequence[Freedom], settings: AgreementSettings
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
    weight = settings.effective / n
    value = np.linalg.solve(weight * A.T @ A + np.eye(len(sigma)), weight * A.T @ b)
    taken = (columns @ (value * sigma)).reshape(residual.shape)
    groups = np.split(np.abs(value), np.cumsum([len(f.sigma) for f in freedoms])[:-1])
    return residual - taken, taken, np.array([float(np.sqrt(np.mean(g**2))) for g in groups])
