"""How late each clock is against that of the forces, by the motion and the forces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment, Run
from steelyard.identification.model.calibration_parameters import clock_of
from steelyard.identification.solve.posterior import Posterior
from steelyard.inspection.excerpt import Excerpt, excerpt_of
from steelyard.inspection.motion_agreements import Relation, motion_agreement, motion_relations
from steelyard.inspection.wrench_balance import body_balance, force_relations
from steelyard.smoothing import Samples1D, fit


@dataclass(frozen=True)
class DelaySettings:
    """How a delay is looked for, and when the data determine it."""

    finest: float = 0.03
    """Spacing of the knots [s]: fine enough for vibrations, which tell a clock best."""
    most: int = 800
    """Instants that are looked at: two a knot over thirty seconds with room to spare."""
    reach: float = 0.08
    """By how much a clock is moved [s]: what `sync` is usually good to."""
    step: float = 0.004
    """Steps in which it is moved first [s]: several within the narrowest minimum."""
    largest_sigma: float = 0.02
    """Largest 1-sigma of a delay that the data determine [s]."""
    prior_share: float = 0.5
    """Part of the prior's 1-sigma, for the same."""
    correlated: float = 0.5
    """Time after which what a body leaves of the forces is something new [s]."""
    per_knot: float = 3.0
    """Samples between two knots of a vibration."""
    shaken: float = 0.8
    """Part of the changes of the force that may be left: else the two do not shake together."""
    clear: float = 4.0
    """1-sigmas by which a clock must be off to be worth a remark."""


SETTINGS = DelaySettings()
_JOINT, _SHAKEN_BY = "everything at once", "vibrations"
_TRUSTED = frozenset({_JOINT, _SHAKEN_BY})
"""Ways to find a delay whose 1-sigma contains all that matters."""


@dataclass(frozen=True)
class Delay:
    """One clock in one run."""

    run: str
    instruments: tuple[str, ...]
    value: float
    """How late its stamps are against the common time as stated [s]."""
    sigma: float
    """1-sigma [s]."""
    prior: tuple[float, float]
    """Value and 1-sigma beforehand [s]."""
    told: bool
    how: str
    """By what it was found, or why it was not."""

    @property
    def surprising(self) -> bool:
        """Whether it is off by more than is stated of it."""
        value, sigma = self.prior
        return (
            self.told
            and self.how in _TRUSTED
            and abs(self.value - value) > SETTINGS.clear * float(np.hypot(sigma, self.sigma))
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain values; null where the data do not determine it."""
        return {
            "run": self.run,
            "instruments": list(self.instruments),
            "delay": self.value if self.told else None,
            "standard_deviation": self.sigma if self.told else None,
            "prior": {"value": self.prior[0], "standard_deviation": self.prior[1]},
            "told": self.told,
            "how": self.how,
        }


def groups_of(experiment: Experiment, run: Run) -> list[tuple[str, ...]]:
    """Instruments of a run by their clocks, that of the forces left out."""
    shared: dict[str, list[str]] = {}
    for name in run.streams:
        shared.setdefault(clock_of(experiment, name), []).append(name)
    force = experiment.force_instrument(run)
    return [tuple(names) for names in shared.values() if force not in names]


def prior_of(experiment: Experiment, run: Run, names: tuple[str, ...]) -> tuple[float, float]:
    """Value and 1-sigma of a delay beforehand [s]."""
    priors = [experiment.delay(run, name) for name in names]
    best = min(priors, key=lambda p: float(np.mean(p.sigma or 0.0)))
    return float(np.mean(best.value or 0.0)), float(np.mean(best.sigma or 0.0))


def of_joint(joint: Posterior, run: Run) -> list[Delay]:
    """Delays that a fit of everything has found.

    Args:
        joint: Of the experiment, converged.
        run: One of its runs.
    """
    experiment = joint.experiment
    calibration = joint.calibration
    sigma = np.sqrt(np.maximum(np.diag(joint.solution.covariance)[10:], 0.0))
    found = []
    for names in groups_of(experiment, run):
        place = calibration.calibration_parameters.place(
            clock_of(experiment, names[0]), "delay", run.name
        )
        prior = prior_of(experiment, run, names)
        own = float(sigma[place][0])
        told = prior[1] > 0 and own < min(SETTINGS.largest_sigma, SETTINGS.prior_share * prior[1])
        how = _JOINT if told else "stated" if not prior[1] else "not identifiable from the readings"
        found.append(
            Delay(run.name, names, float(calibration.values[place][0]), own, prior, told, how)
        )
    return found


def of_excerpt(experiment: Experiment, run: Run) -> list[Delay]:
    """Delays by moving each clock until what it shows agrees best with the forces, or with what
    agrees with them.

    Args:
        experiment: With its instruments.
        run: One in motion.
    """
    view = excerpt_of(experiment, run, SETTINGS.finest, SETTINGS.most)
    return [] if view is None else [_best(view, names) for names in groups_of(experiment, run)]


def _best(view: Excerpt, names: tuple[str, ...]) -> Delay:
    """Delay of one clock."""
    prior = prior_of(view.experiment, view.run, names)
    shaken = _by_vibration(view, names)
    if shaken is not None:
        value, sigma = shaken
        return Delay(
            view.run.name,
            names,
            prior[0] + value,
            sigma,
            prior,
            sigma < SETTINGS.largest_sigma,
            _SHAKEN_BY,
        )
    found = [
        each
        for each in (_least(view, names, r) for r in _relations(view, names))
        if each is not None
    ]
    if not found:
        return Delay(
            view.run.name, names, prior[0], np.inf, prior, False, "nothing to compare it with"
        )
    value, sigma, how = min(found, key=lambda each: each[1])
    # Times are counted from the delay that is known beforehand.
    return Delay(
        view.run.name, names, prior[0] + value, sigma, prior, sigma < SETTINGS.largest_sigma, how
    )


def _relations(view: Excerpt, names: tuple[str, ...]) -> list[Relation]:
    """What a clock can be compared with: the forces where its readings are enough to know the motion
    by, else its fellows.
    """
    own = [
        r
        for r in force_relations(view)
        if r[0] in {"cables", "wrench"}
        and any(n in names for n, _ in r[1])
        and not any(view.instruments[n].commanded for n, _ in r[1] if n not in names)
    ]
    if own:
        force_samples = [
            r
            for r in own
            if any(n in names and q in {"specific_force", "position"} for n, q in r[1])
        ]
        return force_samples or own
    return [r for r in motion_relations(view) if any(n in names for n, _ in r[1])]


def _least(
    view: Excerpt, names: tuple[str, ...], relation: Relation
) -> tuple[float, float, str] | None:
    """Delay of least residual, its 1-sigma, and by what."""
    grid = np.arange(-SETTINGS.reach, SETTINGS.reach + SETTINGS.step / 2, SETTINGS.step)
    left = np.array([_left(_moved(view, names, float(d)), relation) for d in grid])
    if not np.isfinite(left).all():
        return None
    i = int(np.argmin(left))
    if i in {0, len(grid) - 1}:
        return None
    value = float(grid[i])
    three, bend = np.zeros(3), 0.0
    for width in (SETTINGS.step, SETTINGS.step / 4):
        around = value + width * np.array([-1.0, 0.0, 1.0])
        three = np.array([_left(_moved(view, names, float(d)), relation) for d in around])
        bend = float(three[0] - 2 * three[1] + three[2]) / width**2
        if bend <= 0:
            return None
        value = float(around[1] - (three[2] - three[0]) / (2 * width) / bend)
    # What is left is mostly imperfect models, which change slowly.
    count = float(view.time[-1] - view.time[0]) / SETTINGS.correlated
    sigma = float(np.sqrt(2 * three[1] / (bend * count)))
    return value, sigma, " and ".join(dict.fromkeys(n for n, _ in relation[1]))


def _by_vibration(view: Excerpt, names: tuple[str, ...]) -> tuple[float, float] | None:
    """Delay of an accelerometer against a six-axis sensor: whatever shakes the body shakes both, as
    fast as they are read.

    Changes of the force are a constant matrix times changes of the specific force, for a body that
    vibrates in its own ways; the constant parts, of which attitude and offsets are not known well
    enough, do not matter.
    """
    experiment, run = view.experiment, view.run
    force_samples = next((n for n in names if "specific_force" in run.streams[n].values), None)
    force = experiment.force_instrument(run)
    if force_samples is None or force is None or "force" not in run.streams[force].values:
        return None
    pair = ((force_samples, "specific_force"), (force, "force"))
    times = [experiment.common_time(run, name) for name, _ in pair]
    start, end = (
        max(t[0] for t in times) + SETTINGS.reach,
        min(t[-1] for t in times) - SETTINGS.reach,
    )
    spacing = SETTINGS.per_knot * max(float(np.median(np.diff(t))) for t in times)
    if end - start < 40 * spacing:
        return None
    end = min(end, start + 30.0)
    fits = []
    for (name, quantity), t in zip(pair, times, strict=True):
        values = run.streams[name].values[quantity]
        there = np.isfinite(values).all(axis=1)
        fits.append(
            fit(
                Samples1D(t[there], values[there]),
                start - SETTINGS.reach,
                end + SETTINGS.reach,
                spacing,
            )
        )
    acceleration, forces = fits
    if acceleration is None or forces is None:
        return None
    at = np.arange(start, end, spacing / 2)
    target = forces.at(at, 1)

    def left(delay: float) -> float:
        columns = acceleration.at(at + delay, 1)
        value, *_ = np.linalg.lstsq(columns, target, rcond=None)
        return float(np.sum((target - columns @ value) ** 2))

    grid = np.arange(-0.6 * SETTINGS.reach, 0.6 * SETTINGS.reach, spacing / 12)
    cost = np.array([left(float(d)) for d in grid])
    i = int(np.argmin(cost))
    if not 0 < i < len(grid) - 1 or cost[i] > SETTINGS.shaken * float(np.sum(target**2)):
        return None
    width = grid[1] - grid[0]
    bend = float(cost[i - 1] - 2 * cost[i] + cost[i + 1]) / width**2
    value = float(grid[i] - (cost[i + 1] - cost[i - 1]) / (2 * width) / bend)
    # What is left is correlated over a knot.
    return value, float(np.sqrt(2 * cost[i] / (bend * 3 * len(at) / 2)))


def _moved(view: Excerpt, names: tuple[str, ...], delay: float) -> Excerpt:
    return view.with_observations(
        {s: seen.later(view.time, delay) for s, seen in view.observations.items() if s[0] in names}
    )


def _left(view: Excerpt, relation: Relation) -> float:
    """Mean square of what is left, in units that do not change."""
    if relation[0] in {"cables", "wrench"}:
        found = body_balance(view, relation)
        if found is None:
            return np.inf
        scale = np.repeat(
            [_rms(found.measured.wrench[:, :3]), _rms(found.measured.wrench[:, 3:])], 3
        )
        return float(np.mean((found.left / scale) ** 2))
    agreement = motion_agreement(view, relation)
    axes = agreement.measured.shape[1]
    return float(np.mean((agreement.left[:axes] / _rms(agreement.measured)) ** 2))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.var(values, axis=0)))) + 1e-12
