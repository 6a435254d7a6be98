"""How late each clock is against that of the forces, by the motion and the forces."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.identification.model.calibration_parameters import clock_of
from steelyard.identification.solve.posterior import Posterior
from steelyard.inspection.agreements.excerpt import Excerpt, excerpt_of, instruments_by_clock
from steelyard.inspection.agreements.motion import Relation, motion_agreement, motion_relations
from steelyard.inspection.agreements.settings import AGREEMENT, AgreementSettings
from steelyard.inspection.agreements.wrench_balance import body_balance, force_relations, has_body
from steelyard.inspection.settings import DELAYS, DelaySettings
from steelyard.smoothing import Samples1D, fit

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
    """Whether the data determine it."""
    how: str
    """By what it was found, or why it was not."""

    def is_surprising(self, settings: DelaySettings = DELAYS) -> bool:
        """Whether it is off by more than is stated of it."""
        value, sigma = self.prior
        return (
            self.told
            and self.how in _TRUSTED
            and abs(self.value - value) > settings.clear * float(np.hypot(sigma, self.sigma))
        )

    @property
    def remark(self) -> str:
        """That it is off by so much, and what to change."""
        late = "late" if self.value > 0 else "early"
        return (
            f"run '{self.run}': the clock of {' and '.join(self.instruments)} is {late} by"
            f" {abs(self.value) * 1e3:.0f} ms, more than its prior of {self.prior[1] * 1e3:.0f}"
            " ms allows; correct 'sync', or state calibration: {delay: {value:"
            f" {self.value:.4f}, sigma: {max(self.sigma, 1e-3):.4f}}}}}"
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


def _groups(experiment: Experiment, run: Run) -> list[tuple[str, ...]]:
    """Instruments of a run by their clocks, that of the forces left out."""
    force = experiment.force_instrument(run)
    return [names for names in instruments_by_clock(experiment, run) if force not in names]


def _prior(experiment: Experiment, run: Run, names: tuple[str, ...]) -> tuple[float, float]:
    """Value and 1-sigma of a delay beforehand [s]."""
    priors = [experiment.delay(run, name) for name in names]
    best = min(priors, key=lambda p: float(np.mean(p.sigma or 0.0)))
    return float(np.mean(best.value or 0.0)), float(np.mean(best.sigma or 0.0))


def of_joint(joint: Posterior, name: str, settings: DelaySettings = DELAYS) -> list[Delay]:
    """Delays that a fit of everything has found.

    Args:
        joint: Of the experiment, converged.
        name: Of one of its runs.
        settings: When the data determine a delay.
    """
    experiment, calibration = joint.experiment, joint.calibration
    run = next(each for each in experiment.runs if each.name == name)
    sigma = np.sqrt(np.maximum(np.diag(joint.solution.covariance)[10:], 0.0))
    found = []
    for names in _groups(experiment, run):
        place = calibration.calibration_parameters.place(
            clock_of(experiment, names[0]), "delay", run.name
        )
        prior = _prior(experiment, run, names)
        own = float(sigma[place][0])
        told = prior[1] > 0 and own < min(settings.largest_sigma, settings.prior_share * prior[1])
        how = _JOINT if told else "stated" if not prior[1] else "the readings do not determine it"
        found.append(
            Delay(run.name, names, float(calibration.values[place][0]), own, prior, told, how)
        )
    return found


def of_excerpt(
    experiment: Experiment,
    run: Run,
    settings: DelaySettings = DELAYS,
    agreements: AgreementSettings = AGREEMENT,
) -> list[Delay]:
    """Delays by moving each clock until what it shows agrees best with the forces, or with what
    agrees with them.

    Args:
        experiment: With its instruments.
        run: One in motion.
        settings: How far clocks are moved, and when the data determine a delay.
        agreements: What two accounts of the motion may differ by.
    """
    fine = replace(agreements.excerpt, finest=settings.finest, most=settings.most)
    view = excerpt_of(experiment, run, replace(agreements, excerpt=fine))
    if view is None:
        return []
    return [_best(view, names, settings) for names in _groups(experiment, run)]


def _best(view: Excerpt, names: tuple[str, ...], settings: DelaySettings) -> Delay:
    """Delay of one clock."""
    prior = _prior(view.experiment, view.run, names)
    found = [_by_vibration(view, names, settings)]
    if found == [None]:
        relations = _relations(view, names)
        found = [_least(view, names, relation, settings) for relation in relations]
    there = [each for each in found if each is not None]
    if not there:
        how = "nothing to compare it with"
        return Delay(view.run.name, names, prior[0], np.inf, prior, False, how)
    value, sigma, how = min(there, key=lambda each: each[1])
    told = sigma < settings.largest_sigma
    # Times are counted from the delay that is known beforehand.
    return Delay(view.run.name, names, prior[0] + value, sigma, prior, told, how)


def _relations(view: Excerpt, names: tuple[str, ...]) -> list[Relation]:
    """What a clock can be compared with: the forces where its readings are enough to know the
    motion by, else its fellows.
    """
    own = [
        r
        for r in force_relations(view)
        if has_body(r)
        and any(n in names for n, _ in r[1])
        and not any(view.instruments[n].commanded for n, _ in r[1] if n not in names)
    ]
    if own:
        enough = {"specific_force", "position"}
        alone = [r for r in own if any(n in names and q in enough for n, q in r[1])]
        return alone or own
    return [r for r in motion_relations(view) if any(n in names for n, _ in r[1])]


def _least(
    view: Excerpt, names: tuple[str, ...], relation: Relation, settings: DelaySettings
) -> tuple[float, float, str] | None:
    """Delay of least residual, its 1-sigma, and by what."""

    def left(delay: float) -> float:
        return _left(view.delayed(dict.fromkeys(names, delay)), relation)

    grid = np.arange(-settings.reach, settings.reach + settings.step / 2, settings.step)
    cost = np.array([left(float(delay)) for delay in grid])
    i = int(np.argmin(cost))
    if not np.isfinite(cost).all() or i in {0, len(grid) - 1}:
        return None
    value = float(grid[i])
    for width in (settings.step, settings.step / 4):
        three = np.array([left(value + width * each) for each in (-1.0, 0.0, 1.0)])
        value, bend = _lowest(value, width, three)
        if bend <= 0:
            return None
    # What is left is mostly imperfect models, which change slowly.
    count = float(view.time[-1] - view.time[0]) / settings.correlated
    sigma = float(np.sqrt(2 * three[1] / (bend * count)))
    return value, sigma, " and ".join(dict.fromkeys(n for n, _ in relation[1]))


def _lowest(middle: float, width: float, costs: Array) -> tuple[float, float]:
    """Where the parabola through three costs, a width apart about a middle, is least, and its
    curvature.
    """
    low, here, high = map(float, costs)
    bend = (low - 2 * here + high) / width**2
    return (middle - (high - low) / (2 * width) / bend if bend > 0 else middle), bend


def _by_vibration(
    view: Excerpt, names: tuple[str, ...], settings: DelaySettings
) -> tuple[float, float, str] | None:
    """Delay of an accelerometer against a six-axis sensor: whatever shakes the body shakes both, as
    fast as they are read.

    Changes of the force are a constant matrix times changes of the specific force, for a body that
    vibrates in its own ways; the constant parts, of which attitude and offsets are not known well
    enough, do not matter.
    """
    experiment, run = view.experiment, view.run
    shaken = next((n for n in names if "specific_force" in run.streams[n].values), None)
    force = experiment.force_instrument(run)
    if shaken is None or force is None or "force" not in run.streams[force].values:
        return None
    pair = ((shaken, "specific_force"), (force, "force"))
    times = [experiment.common_time(run, name) for name, _ in pair]
    start = max(t[0] for t in times) + settings.reach
    end = min(t[-1] for t in times) - settings.reach
    spacing = settings.per_knot * max(float(np.median(np.diff(t))) for t in times)
    if end - start < 40 * spacing:
        return None
    end = min(end, start + 30.0)
    fits = []
    for (name, quantity), t in zip(pair, times, strict=True):
        values = run.streams[name].values[quantity]
        there = np.isfinite(values).all(axis=1)
        samples = Samples1D(t[there], values[there])
        fits.append(fit(samples, start - settings.reach, end + settings.reach, spacing))
    acceleration, forces = fits
    if acceleration is None or forces is None:
        return None
    at = np.arange(start, end, spacing / 2)
    target = forces.at(at, 1)

    def left(delay: float) -> float:
        columns = acceleration.at(at + delay, 1)
        value, *_ = np.linalg.lstsq(columns, target, rcond=None)
        return float(np.sum((target - columns @ value) ** 2))

    grid = np.arange(-0.6 * settings.reach, 0.6 * settings.reach, spacing / 12)
    cost = np.array([left(float(d)) for d in grid])
    i = int(np.argmin(cost))
    if not 0 < i < len(grid) - 1 or cost[i] > settings.shaken * float(np.sum(target**2)):
        return None
    value, bend = _lowest(float(grid[i]), float(grid[1] - grid[0]), cost[i - 1 : i + 2])
    # What is left is correlated over a knot.
    return value, float(np.sqrt(2 * cost[i] / (bend * 3 * len(at) / 2))), _SHAKEN_BY


def _left(view: Excerpt, relation: Relation) -> float:
    """Mean square of what is left, in units that do not change."""
    if has_body(relation):
        found = body_balance(view, relation)
        if found is None:
            return np.inf
        wrench = found.measured.wrench
        scale = np.repeat([_rms(wrench[:, :3]), _rms(wrench[:, 3:])], 3)
        return float(np.mean((found.left / scale) ** 2))
    agreement = motion_agreement(view, relation)
    axes = agreement.measured.shape[1]
    return float(np.mean((agreement.left[:axes] / _rms(agreement.measured)) ** 2))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.var(values, axis=0)))) + 1e-12
