"""Which free swings tell centre of gravity and inertia per mass best, and how well `identify` will
know them from these.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array, number_given, whole_given
from steelyard.errors import InputError
from steelyard.estimates.estimate import Estimate
from steelyard.estimates.per_mass import PerMass
from steelyard.excitation.information.noise_free_recording import fit_recorded, with_noise_free_runs
from steelyard.excitation.plan import is_experiment, planned
from steelyard.excitation.poses.pose_choice import PoseChoice
from steelyard.excitation.search.design_set_up import designed_body
from steelyard.excitation.settings import DEFAULT, DesignSettings
from steelyard.excitation.swings.candidate_swings import (
    Swing,
    cable_sets,
    frequency_value,
    places_of_rest,
    swings_at,
)
from steelyard.experiment.model import Experiment
from steelyard.experiment.read import read_plan
from steelyard.experiment.unread import with_unread_cables
from steelyard.identification.known_body import plausible
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.solve.posterior import Posterior, Progress
from steelyard.inertia import TEN, Inertia, body_jacobian
from steelyard.natural_frequencies.free_swing import hung_on
from steelyard.robot.model import DIRECTIONS, Robot
from steelyard.simulation.sensors import SWING_SENSORS, Sensors

USUAL_SWINGS = 6
"""How many where nobody says."""
USUAL_DURATION = 10.0
"""Of each [s]."""
_GEOMETRY = {"anchor": 0.002, "attachment": 0.002}
"""1-sigma of the geometry of a robot that comes alone [m]: by a tracker or with care by a tape."""


@dataclass(frozen=True, eq=False)
class CableSet:
    """What swings on some of the cables tell, at best."""

    cables: tuple[int, ...]
    """Numbers of the cables that stay, counted from 1 as in ``f1 … fm``."""
    swings: tuple[Swing, ...]
    """In the order in which they help."""
    steps: tuple[PerMass, ...]
    """After the first, the first two, …: what they tell together, by the rows of the fit about
    every swing alone."""


@dataclass(frozen=True, eq=False)
class SwingDesign:
    """Free swings to record."""

    experiment: Experiment
    """Robot and instruments, the robot with the cables on which the platform hangs."""
    best: CableSet
    """What is proposed."""
    sets: tuple[CableSet, ...]
    """All that were compared, the most telling first, each with one swing in all directions at
    every place of rest."""
    predicted: Estimate
    """What `identify` would say of them, without noise and errors."""
    duration: float
    """Of each swing [s]."""
    candidates: int
    """Swings that there were to choose from."""
    assumed: bool
    """Whether nobody has named sensors: motion capture is assumed."""

    @property
    def cables(self) -> tuple[int, ...]:
        """Numbers of the cables that stay, counted from 1 as in ``f1 … fm``."""
        return self.best.cables

    @property
    def swings(self) -> tuple[Swing, ...]:
        """What to record, in the order in which they help."""
        return self.best.swings


def design_swings(
    subject: Experiment | Robot | str | Path,
    swings: int = USUAL_SWINGS,
    *,
    duration: float = USUAL_DURATION,
    cables: Sequence[int] | None = None,
    sensors: Sensors | str = SWING_SENSORS,
    progress: Progress = None,
    settings: DesignSettings = DEFAULT,
) -> SwingDesign:
    """Find free swings that tell centre of gravity and inertia per mass best.

    The choice leaves the least volume of their uncertainty (D-optimal), with everything else that
    is uncertain found beside them.

    Args:
        subject: An experiment, of which robot, instruments and ``uncertainty`` count; a robot; or
            the path or bundled name of one of them.
        swings: How many.
        duration: Of each [s].
        cables: Numbers of the cables that stay, counted from 1 as in ``f1 … fm``; None: all of a
            robot with fewer than six, of others those that tell most.
        sensors: Instruments of a robot that comes alone; ``swings``: motion capture of .3 mm and
            .5 mrad.
        progress: Is given what is being done.
        settings: Of the design.

    Raises:
        InputError: No instrument tells how the platform moves, or one states no noise; the platform
            hangs on these cables nowhere.
    """
    tell = progress or (lambda what, fraction: None)
    swings, duration = whole_given(swings, "--poses"), number_given(duration, "--duration")
    if not 1 <= swings <= settings.most_swings:
        raise InputError(
            f"--poses: expected 1 to {settings.most_swings} swings, found {swings}; choose another"
            " number"
        )
    if not settings.shortest_swing <= duration <= settings.longest_swing:
        raise InputError(
            f"--duration: expected {settings.shortest_swing:g} to {settings.longest_swing:g} s of a"
            f" swing, found {duration:g}; choose another"
        )
    experiment = _described(subject, sensors)
    robot = experiment.robot
    body = designed_body(robot)
    own = _cables(robot, cables)
    tell("swings: where the platform can hang", 0.05)
    chosen = [own] if own is not None else []
    others = _most_telling(robot, body, settings)
    chosen += [each for each in others if own is None or tuple(each) != tuple(own)]
    if cables is not None:
        chosen = chosen[:1]
    found: list[CableSet] = []
    for i, each in enumerate(chosen):
        tell(f"swings: what they tell on {len(each)} cables", 0.1 + 0.4 * i / len(chosen))
        on = _hung(experiment, each)
        at_once = [
            swing
            for modes in places_of_rest(on.robot, body, settings)
            for swing in swings_at(modes, duration, settings, alone=False)
        ]
        if at_once:
            found.append(_best_of(on, _counted(each), at_once, len(at_once), settings))
        elif each is own:
            break
    if not found:
        which = "these cables," if own is not None else "any of its cables, fewer than six,"
        raise InputError(
            f"robot '{robot.name}': expected a place where {body.mass:.4g} kg hang upright on"
            f" {which} all taut, found none; choose others with --cables, or see what stands under"
            " 'limits' and 'platform' of the robot file"
        )
    ranked = tuple(sorted(found, key=_value, reverse=True))
    cables_of_best = found[0].cables if own is not None else ranked[0].cables
    on = _hung(experiment, np.array(cables_of_best, dtype=np.intp) - 1)
    tell("swings: which of them tell most", 0.5)
    candidates = [
        swing
        for modes in places_of_rest(on.robot, body, settings)
        for swing in swings_at(modes, duration, settings)
    ]
    best = _best_of(on, cables_of_best, candidates, swings, settings)
    tell("swings: what they tell together", 0.85)
    predicted = MaximumLikelihood().of(_recorded(on, best.swings, settings))
    assumed = sensors == SWING_SENSORS and not _is_experiment(subject)
    return SwingDesign(on, best, ranked, predicted, duration, len(candidates), assumed)


def _described(subject: Experiment | Robot | str | Path, sensors: Sensors | str) -> Experiment:
    """Robot and instruments of swings that are to be recorded.

    Raises:
        InputError: Nothing tells how the platform moves.
    """
    if isinstance(subject, str | Path) and is_experiment(subject):
        experiment = read_plan(subject, weighed=False)
    else:
        experiment = planned(subject, sensors)
        if not isinstance(subject, Experiment):
            experiment = replace(experiment, uncertainty={**experiment.uncertainty, **_GEOMETRY})
    source = experiment.source or experiment.name
    if not experiment.robot.m:
        raise InputError(
            f"robot '{experiment.robot.name}': expected cables on which the platform can hang,"
            " found none"
        )
    instruments = {
        name: each
        for name, each in experiment.instruments.items()
        if each.is_motion and not each.commanded and not each.tabular
    }
    if not instruments:
        raise InputError(
            f"{source}: expected an instrument that tells how the platform moves (kind pose, or"
            " position and attitude), found none; add it"
        )
    return replace(experiment, instruments=instruments, runs=(), loads=())


def _is_experiment(subject: Experiment | Robot | str | Path) -> bool:
    """Whether somebody has named instruments."""
    return isinstance(subject, Experiment) or (
        isinstance(subject, str | Path) and is_experiment(subject)
    )


def _cables(robot: Robot, cables: Sequence[int] | None) -> NDArray[np.intp] | None:
    """Those that stay; None: those that tell most.

    Raises:
        InputError: There are no such cables, or too many or too few of them.
    """
    if cables is None:
        return np.arange(robot.m) if robot.m < DIRECTIONS else None
    own = sorted(set(cables))
    if not own or own[0] < 1 or own[-1] > robot.m or len(own) >= DIRECTIONS:
        raise InputError(
            f"--cables: expected numbers of one to five of the {robot.m} cables, counted from 1,"
            f" found {', '.join(map(str, cables)) or 'none'}; correct them"
        )
    return np.array(own) - 1


def _counted(cables: NDArray[np.intp]) -> tuple[int, ...]:
    """Numbers from 1."""
    return tuple(int(i) + 1 for i in cables)


def _most_telling(robot: Robot, body: Inertia, settings: DesignSettings) -> list[NDArray[np.intp]]:
    """Of every number of cables the set whose natural frequencies tell most."""
    best: dict[int, tuple[float, NDArray[np.intp]]] = {}
    one_place = replace(settings, swing_places=1)
    for each in cable_sets(robot, settings):
        for modes in places_of_rest(hung_on(robot, each), body, one_place):
            try:
                value = frequency_value(modes, settings)
            except InputError:
                continue
            if len(each) not in best or value > best[len(each)][0]:
                best[len(each)] = value, each
    return [each for _, each in sorted(best.values(), key=lambda pair: -pair[0])]


def _hung(experiment: Experiment, cables: NDArray[np.intp]) -> Experiment:
    """The experiment with the platform on some of the cables."""
    if len(cables) == experiment.robot.m:
        return experiment
    return replace(experiment, robot=hung_on(experiment.robot, cables))


def _best_of(
    experiment: Experiment,
    cables: tuple[int, ...],
    candidates: Sequence[Swing],
    count: int,
    settings: DesignSettings,
) -> CableSet:
    """The most telling of all swings, and what they tell one after the other."""
    fastest = max(each.rate or settings.swing_rate for each in experiment.instruments.values())
    share = min(1.0, settings.swing_rate / fastest)
    choice, scale, body = _choice(_recorded(experiment, candidates, settings, share), share)
    chosen = choice.best(min(count, len(candidates)), settings)
    jacobian = body_jacobian(body.parameters)[1:, 1:] * scale
    steps = []
    for i in range(1, len(chosen) + 1):
        total = choice.prior + choice.each[chosen[:i]].sum(axis=0)
        own = np.linalg.inv(total)[: TEN - 1, : TEN - 1]
        covariance = np.zeros((TEN, TEN))
        covariance[1:, 1:] = jacobian @ own @ jacobian.T
        steps.append(PerMass.of(body.body_parameters, covariance))
    return CableSet(cables, tuple(candidates[i] for i in chosen), tuple(steps))


def _choice(found: Posterior, share: float) -> tuple[PoseChoice, Array, Inertia]:
    """What each swing tells of the body, its mass known, and of the systematic errors, in units of
    plausible sizes and of what is known beforehand; the units of the nine, shape (9,); the body.

    Args:
        found: Of noise-free recordings, a run for each swing.
        share: Of the samples that there will be, those that were looked at.
    """
    body = Inertia.from_parameters(found.parameters)
    estimated = found.solution.estimated.copy()
    estimated[0] = False
    places = np.flatnonzero(estimated)
    prior = found.prior.precision[np.ix_(places, places)]
    sizes = plausible(found.parameters, found.size)[1:]
    scale = np.concatenate([sizes, np.ones(len(places) - len(sizes))])
    known = np.diag(prior)[len(sizes) :]
    scale[len(sizes) :] = 1 / np.sqrt(np.where(known > 0, known, 1.0))
    units = np.outer(scale, scale)
    each = np.array(
        [own.normal[np.ix_(places, places)] * units / share for own in found.equations.values()]
    )
    of_body = np.arange(len(places)) < len(sizes)
    # No body is much larger than what carries it.
    return PoseChoice(prior * units + np.diag(of_body.astype(float)), each, of_body), sizes, body


def _recorded(
    experiment: Experiment,
    swings: Sequence[Swing],
    settings: DesignSettings,
    share: float = 1.0,
) -> Posterior:
    """The fit of `identify` to noise-free recordings of swings.

    Args:
        experiment: Robot and instruments.
        swings: A run for each.
        settings: Of the design.
        share: Of the samples to look at.
    """
    instruments = {
        name: each if each.rate is None else each.model_copy(update={"rate": share * each.rate})
        for name, each in experiment.instruments.items()
    }
    robot = replace(experiment.robot, platform=swings[0].modes.body)
    planned_runs = {f"swing {i + 1}": each.trajectory for i, each in enumerate(swings)}
    recorded = with_noise_free_runs(
        replace(experiment, robot=robot, instruments=instruments), planned_runs, 0.0, settings
    )
    runs = tuple(replace(run, locked=True) for run in recorded.runs)
    return fit_recorded(with_unread_cables(replace(recorded, runs=runs)))


def _value(found: CableSet) -> float:
    """Minus the logarithm of the volume of the uncertainty of the nine."""
    return -float(np.linalg.slogdet(found.steps[-1].covariance)[1])
