"""Errors that good devices do not have: filters in force amplifiers, scales of IMUs; and what may
pull at a platform beside its cables.

They are taken as none, so that sound recordings lose nothing, until the readings ask for them: a
step of the fit in which they may move shows by how much the cost would fall (a score test
[Rao1948]_). What is asked for most comes first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.dynamics import AT_A_POINT, FLEXIBILITY
from steelyard.estimates.quantiles import chi2_tail, normal_tail
from steelyard.identification.model.calibration_parameters import (
    BENDING_KEYS,
    ROBOT,
    CalibrationParameter,
    CalibrationParameters,
    Key,
)
from steelyard.identification.solve.fit_state import Fit, FitState, Task, linearise, smooth
from steelyard.identification.solve.joint_fit import fit
from steelyard.identification.solve.misfits.late_or_filtered import (
    alternatives,
    join_twins,
    of_twins,
    twins_of,
)
from steelyard.identification.solve.misfits.suspected_errors import (
    is_possible,
    taken_back,
    with_priors_of,
)
from steelyard.identification.solve.newton_step import step_of

_BENT = np.arange(len(FLEXIBILITY)), np.array(AT_A_POINT)
"""Elements of what bends that are asked for together: all, and those of a part at one point."""
_MISPLACED, _MISSCALED = 0.05, 0.1
"""1-sigma of an anchor or an attachment [m] and of a gain that is wrong."""
_LEAST_SHARE = 1e-6
"""Part that the readings have in what is known in a direction, at least: less is rounding."""


def with_suspicions(
    task: Task,
    found: Fit,
    again: Callable[[Task, FitState], Fit] = fit,
    *,
    held: bool = False,
) -> tuple[Task, Fit]:
    """The task with the errors that its residuals ask for, and its fit.

    Args:
        task: What has been fitted.
        found: How.
        again: Fits once more.
        held: Whether the motion is held as its instruments alone give it.

    Raises:
        numpy.linalg.LinAlgError: The motion is not determined.
    """
    if any(task.experiment.moves_within(run.name) for run in task.experiment.runs):
        # What swings goes with the pulls of all cables: it looks like crosstalk.
        return task, found
    # Second derivatives of a held motion have its noise, as has what is left over.
    refused: frozenset[Key] = frozenset(BENDING_KEYS if held else ())
    for _ in range(task.settings.suspicions):
        worst = _worst(task, found.state, refused, held=held)
        if not worst:
            break
        tried = [(each, _with(task, found, each, again)) for each in alternatives(task, worst)]
        possible = [(asked, there) for asked, there in tried if is_possible(*there, asked)]
        refused |= frozenset().union(*(asked for asked, _ in tried))
        if possible:
            asked, (task, found) = of_twins(task, found, possible, again, held=held)
            refused -= asked
        # Else something else imitates it, and is to be named by the verdict.
    return task, found


def _with(
    task: Task, found: Fit, asked: frozenset[Key], again: Callable[[Task, FitState], Fit]
) -> tuple[Task, Fit]:
    """Task and fit with what is asked for and without its twins."""
    believed = {each.full_key for each in task.calibration_parameters.entries if not each.is_absent}
    twins = {
        twin: none
        for twin, none in twins_of(task, asked).items()
        if twin in believed and twin not in asked
    }
    if asked <= believed and not twins:
        return task, found
    tried, state = taken_back(task, found.state, twins)
    tried, state = with_priors_of(tried, state, tried.calibration_parameters.believed(asked))
    return tried, again(tried, state)


def without_needless(
    task: Task,
    found: Fit,
    before: CalibrationParameters,
    again: Callable[[Task, FitState], Fit] = fit,
) -> tuple[Task, Fit]:
    """The task without errors that were asked for as long as nothing else explained the residuals.

    Noise that goes on for a while is white to the test by which they came: beside its process they
    are no longer sure, or the process stands in for what they are.

    Args:
        task: What has been fitted.
        found: How, with its processes.
        before: The calibration parameters before anything was asked for.
        again: Fits once more.

    Raises:
        numpy.linalg.LinAlgError: The motion is not determined.
    """
    limit = 2 * float(normal_tail(task.settings.needless))
    while True:
        groups: dict[Key, list[Key]] = {}
        absent = task.calibration_parameters.believed_since(before)
        for key, each in absent.items():
            groups.setdefault(_name_of(each), []).append(key)
        join_twins(groups)
        chances = {name: _chance_of(task, found, keys, absent) for name, keys in groups.items()}
        least = max(chances, key=lambda name: chances[name], default=None)
        if least is None or chances[least] < limit:
            return task, found
        gone = {key: absent[key] for key in groups[least]}
        task, state = taken_back(task, found.state, gone)
        found = again(task, state)


def _name_of(each: CalibrationParameter) -> Key:
    """What errors that come together are called by: a hose has a force, a stiffness and a place."""
    name = each.key.partition(".")[0] if each.owner == ROBOT else each.key
    return each.owner, name, each.run


def _chance_of(
    task: Task, found: Fit, keys: Sequence[Key], absent: Mapping[Key, CalibrationParameter]
) -> float:
    """Probability that these are as far from none by chance; one of many numbers may be alone.

    Args:
        task: What has been fitted.
        found: How.
        keys: Of what.
        absent: Key -> what it is when it is none.
    """
    parameters = task.calibration_parameters
    own = np.concatenate([np.r_[parameters.places[key]] for key in keys])
    off = found.state.calibration.values[own] - np.concatenate([absent[k].mean for k in keys])
    columns = task.column_of(found.state)[own]
    covariance = found.covariance[np.ix_(columns, columns)]
    sigma = np.sqrt(np.diag(covariance))
    correlation, whole = covariance / np.outer(sigma, sigma), off / sigma
    by_prior = parameters.precision[np.ix_(own, own)] * np.outer(sigma, sigma)
    if keys[0] in BENDING_KEYS:
        return _chance_of_bending(correlation, whole, by_prior)
    far = float(whole @ np.linalg.solve(correlation, whole))
    if keys[0][0] == ROBOT:
        # A load that swings looks like a hose: what is hardly told of one speaks against it.
        return float(chi2_tail(far, len(own)))
    shares = np.clip(1 - np.diag(by_prior), _LEAST_SHARE, 1.0)
    single = min(_tail(z**2, shares[[i]]) for i, z in enumerate(whole))
    return min(_tail(far, _shares(correlation, by_prior)), len(own) * single)


def _chance_of_bending(known: Array, off: Array, by_prior: Array) -> float:
    """The same of what bends: of all of its numbers, or of those of a part at one point if the
    others were none.

    Args:
        known: Covariance, shape (k, k).
        off: How far they are from none, shape (k,).
        by_prior: Precision of the prior, shape (k, k); all in the same units.
    """
    information = np.linalg.inv(known)
    score, chances = information @ off, []
    for own in _BENT:
        alone = np.linalg.inv(information[np.ix_(own, own)])
        shares = _shares(alone, by_prior[np.ix_(own, own)])
        chances.append(_tail(float(score[own] @ alone @ score[own]), shares))
    return len(chances) * min(chances)


def _shares(known: Array, by_prior: Array) -> Array:
    """Part that the readings have in what is known of each direction, shape (k,).

    Args:
        known: Covariance, shape (k, k).
        by_prior: Precision of the prior in the same units, shape (k, k).
    """
    root = np.linalg.cholesky(known + _LEAST_SHARE * np.diag(np.diag(known)))
    return np.asarray(np.clip(1 - np.linalg.eigvalsh(root.T @ by_prior @ root), _LEAST_SHARE, 1.0))


def _tail(far: float, share: Array) -> float:
    """Probability that noise puts numbers so far from their priors.

    It does so by a sum of squares of standard normal numbers, each with the part that the readings
    have in what is then known in one direction: a chi-square of as many degrees of freedom and as
    large as has its mean and variance [Satterthwaite1946]_.

    Args:
        far: Square of the distance, in what is known of them.
        share: See :func:`_shares`.
    """
    size = float(np.sum(share**2) / np.sum(share))
    return float(chi2_tail(max(far, 0.0) / size, float(np.sum(share) / size)))


def _worst(task: Task, state: FitState, refused: frozenset[Key], *, held: bool) -> frozenset[Key]:
    """What the readings ask for most, a hose with force, stiffness and point; empty: nothing, or a
    number of one cable, of the robot file or of its force sensor, which is to be named by the
    verdict.
    """
    suspects: dict[Key, list[CalibrationParameter]] = {}
    for each in task.calibration_parameters.entries:
        if each.full_key in refused:
            continue
        if each.is_absent and not each.instead:
            suspects.setdefault(_name_of(each), []).append(each)
    if not suspects:
        return frozenset()
    places = task.calibration_parameters.places
    rivals = list(_rivals(task))
    wide = task.calibration_parameters.deviation.copy()
    for entries in suspects.values():
        for each in entries:
            wide[places[each.full_key]] = each.suspected
    for own, deviation in rivals:
        wide[own] = np.maximum(wide[own], deviation)
    gains = _Gains.of(task, state, wide, held=held)
    surely, needless = (
        2 * float(normal_tail(each)) for each in (task.settings.suspicious, task.settings.needless)
    )
    worst, least = frozenset[Key](), 1.0
    for entries in suspects.values():
        keys = frozenset(each.full_key for each in entries)
        own = np.concatenate([np.r_[places[e.full_key]] for e in entries])
        if not len(own):
            # Crosstalk of one cable.
            continue
        chance, moved = gains.chance(own)
        limit = surely
        if entries[0].bends:
            # It comes as easily as it stays: where it is not there the body is only less certain.
            at_a_point, _ = gains.chance(own[_BENT[1]])
            chance = len(_BENT) * min(chance, at_a_point)
            limit = needless
        elif entries[0].owner != ROBOT:
            # One of many numbers may be alone: among all of them it would be lost.
            single = min(gains.chance(own[i : i + 1])[0] for i in range(len(own)))
            chance = min(chance, len(own) * single)
        negligible = np.concatenate([np.full(len(e.mean), e.negligible) for e in entries])
        if chance < min(limit, least) and np.any(np.abs(moved) > negligible):
            worst, least = keys, chance
    outside = any(owner == ROBOT for owner, _, _ in worst)
    # As a number for every pair of cables is: those of one cable may explain the same.
    many = sum(len(np.r_[places[key]]) for key in worst) > task.calibration_parameters.m
    if (outside or many) and any(gains.chance(own)[0] < least for own, _ in rivals):
        return frozenset()
    return worst


def _rivals(task: Task) -> Iterator[tuple[NDArray[np.intp], float]]:
    """Places of numbers of one cable that are easily wrong, and by how much: an anchor, an
    attachment, a gain.
    """
    places, m = task.calibration_parameters.places, task.calibration_parameters.m
    for (owner, key, _), place in places.items():
        whole = np.r_[place]
        if owner == ROBOT and key in {"anchor", "attachment"}:
            yield from ((own, _MISPLACED) for own in whole.reshape(m, 3))
        elif key == "gain" and len(whole) == m:
            yield from ((own, _MISSCALED) for own in whole.reshape(m, 1))


@dataclass(frozen=True, eq=False)
class _Gains:
    """By how much the cost would fall where some calibration parameters had wider priors."""

    matrix: Array
    """Of the border with wide priors, columns in units of their 1-sigma, shape (b, b)."""
    right: Array
    scale: Array
    """These 1-sigma, shape (b,)."""
    tighter: Array
    """Precision that the priors as stated have beyond the wide ones, shape (b, b)."""
    off: Array
    """What is known beforehand less the present values, shape (b,)."""
    column_of: NDArray[np.intp]
    """Of every calibration parameter, shape (u,)."""
    wide: Array
    """1-sigma of the wide priors, shape (u,)."""
    base: NDArray[np.intp]
    """Columns of the body and of what is estimated as it is."""

    @classmethod
    def of(cls, task: Task, state: FitState, wide: Array, *, held: bool) -> _Gains:
        """About a state, with these 1-sigma of the calibration parameters, shape (u,)."""
        stated, parameters = task.calibration_parameters.deviation, task.calibration_parameters
        loose, state = with_priors_of(task, state, parameters.widened(wide))
        parts, _ = linearise(loose, state, held=held)
        step = step_of(loose, state, smooth(state, [each.all for each in parts]))
        scale = np.sqrt(np.diag(step.covariance))
        matrix = np.linalg.inv(step.covariance / np.outer(scale, scale))
        tighter, off = np.zeros((len(scale), len(scale))), np.zeros(len(scale))
        known = np.flatnonzero(loose.active & (stated > 0))
        column_of = loose.column_of(state)
        tighter[np.ix_(column_of[known], column_of[known])] = parameters.precision[
            np.ix_(known, known)
        ] - np.diag(wide[known] ** -2)
        off[column_of[loose.active]] = (parameters.mean - state.calibration.values)[loose.active]
        base = np.concatenate([np.arange(state.ten), column_of[task.active]])
        return cls(
            matrix, matrix @ (step.border / scale), scale, tighter, off, column_of, wide, base
        )

    def chance(self, places: NDArray[np.intp]) -> tuple[float, Array]:
        """Probability that noise lets the cost fall so far where these have wide priors, and how
        they move.
        """
        own = self.column_of[places]
        fall, moved, known = self._fall(np.union1d(self.base, own), own)
        unit = self.scale[own] / self.wide[places]
        return _tail(fall - self._usual, _shares(known, np.diag(unit**2))), moved

    @cached_property
    def _usual(self) -> float:
        """Decrease of the cost with the priors as stated."""
        return self._fall(self.base, self.base[:0])[0]

    def _fall(self, columns: NDArray[np.intp], own: NDArray[np.intp]) -> tuple[float, Array, Array]:
        """Decrease of the cost where these columns alone may move, some of them widely; how these
        move, and what is then known of them, in units of 1-sigma.
        """
        inside = np.searchsorted(columns, own)
        # Of all that may be asked for, few columns at a time: crosstalk of 60 cables has 3,540.
        tighter = self.tighter[columns]
        tighter[inside], tighter[:, own] = 0.0, 0.0
        scale = self.scale[columns]
        right = self.right[columns] + (tighter @ self.off) * scale
        matrix = self.matrix[np.ix_(columns, columns)]
        matrix += tighter[:, columns] * np.outer(scale, scale)
        covariance: Array = np.asarray(np.linalg.inv(matrix), np.float64)
        moved = covariance @ right
        known = covariance[np.ix_(inside, inside)]
        return float(right @ moved), np.asarray(moved[inside] * self.scale[own]), known
