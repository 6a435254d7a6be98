"""Whether a clock was set while it ran: its delay is then another after that time than before.

What else changes in a recording (a sensor that slips, an offset that jumps) departs from the motion
by as much throughout, and coloured noise carries it. A clock that was set departs by the speed of
the platform times its step, and fits settle on a motion between both, or coloured noise carries
that, too. What noise cannot follow at the very moment is left out before a clock is blamed: of a
sensor that slips nothing remains then.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.estimates.quantiles import normal_exceeded
from steelyard.identification.model.balance import UNMODELLED_PARTS
from steelyard.identification.model.calibration_parameters import (
    CalibrationParameter,
    clock_of,
    instruments_of,
    shares_clock,
)
from steelyard.identification.solve.border.normal_equations import Blocks
from steelyard.identification.solve.misfits.along_segments import disturbed_readings, unstated_along
from steelyard.identification.solve.posterior import Posterior
from steelyard.identification.verdict.directed_tests import length_of, pulled_by_priors
from steelyard.identification.verdict.settings import VERDICT, VerdictSettings
from steelyard.inertia import TEN
from steelyard.instruments.base import LATENCY

_STEP = 0.25
"""Between times at which coloured noise may begin to be a delay [s]."""
_RATE = 0.05
"""Before and after an instant, whose difference is a rate [s]."""
_MOSTLY = 0.8
"""Part of coloured noise that a change of a delay explains where it stands for one: .04 and .01
where a tracker was reacquired and a gyro walked."""
_MOMENTS = 5
"""Moments of a run that are left out, at most, as those at which a sensor slips."""
_FEWEST = 6.0
"""Independent numbers of coloured noise, of which two explain so much by chance only."""


@dataclass(frozen=True)
class ClockChange:
    """A delay that another value would suit from some time on."""

    run: str
    owners: tuple[str, ...]
    """Instruments whose time stamps it shifts."""
    time: float
    """From when on [s]."""
    z: float
    """Standard normal where the delay is the same throughout."""
    size: float
    """Change of the delay [s]; of other size and sign than it is where the fit has settled between
    both."""
    sigma: float
    """Its 1-sigma [s]."""
    shift: float
    """How far the estimate moves with it, in its 1-sigma."""
    within_clock: bool
    """Whether they share a clock with others, which do not shift."""

    def __str__(self) -> str:
        names = " and ".join(self.owners)
        own = f"give {names} a 'clock' of its own, and " if self.within_clock else ""
        return (
            f"run '{self.run}': time stamps of {names} seem to shift against those of other"
            f" instruments by some {round(1e3 * abs(self.size), 1):g} ms, at about {self.time:.1f}"
            f" s (z = {abs(self.z):.1f}), as if a clock was set while it ran; {own}give the parts"
            " before and after as two runs, each with its 'window'"
        )


def set_clocks(posterior: Posterior, settings: VerdictSettings = VERDICT) -> Iterator[ClockChange]:
    """The likeliest change of a delay in each run, where one is seen."""
    tests = delay_changes(posterior, settings)
    limit = float(normal_exceeded(settings.family / max(1, len(tests)) / 2))
    surely = [test for test in tests if abs(test.z) > limit]
    for run in dict.fromkeys(test.run for test in surely):
        if not _lasts(posterior, run, limit, settings):
            surely = [test for test in surely if test.run != run]
    seen: dict[str, list[ClockChange]] = {}
    for test in (*surely, *disturbing_changes(posterior, settings)):
        least = settings.slipped_by if test.within_clock else settings.set_by
        if test.shift > settings.matters or abs(test.size) > least:
            seen.setdefault(test.run, []).append(test)
    for changes in seen.values():
        # Two clocks tell each other's change: it is more likely that of the one that fewer read.
        yield max(changes, key=lambda each: (round(abs(each.z), 1), -len(each.owners)))


def delay_changes(posterior: Posterior, settings: VerdictSettings = VERDICT) -> list[ClockChange]:
    """A score test [Rao1948]_ for every delay and every bound between two stretches of a run,
    whether another delay suits what follows.

    Args:
        posterior: With the stretches.
        settings: Levels.
    """
    delays = [
        (TEN + place, parameter)
        for place, parameter, _ in posterior.calibration.calibration_parameters.components()
        if parameter.key in ("delay", LATENCY)
    ]
    return [
        change
        for number, run in enumerate(posterior.experiment.runs)
        for change in _changes(
            posterior,
            number,
            [each for each in delays if each[1].run in (None, run.name)],
            settings,
        )
    ]


def _lasts(posterior: Posterior, run: str, limit: float, settings: VerdictSettings) -> bool:
    """Whether what follows a change of a delay says so without the stretches that meet there.

    Args:
        posterior: With the stretches.
        run: Name of a run in which a change is seen.
        limit: Of its score.
        settings: Levels.
    """
    anywhere = replace(settings, on_both_sides=0.0)
    number = [each.name for each in posterior.experiment.runs].index(run)
    for _ in range(_MOMENTS):
        found = [test for test in delay_changes(posterior, settings) if test.run == run]
        best = max(found, key=lambda test: abs(test.z), default=None)
        if best is None or abs(best.z) <= limit:
            return False
        mine = np.flatnonzero(posterior.blocks.run == number)
        mine = mine[np.argsort(posterior.blocks.since[mine], kind="stable")]
        after = int(np.searchsorted(posterior.blocks.since[mine], best.time))
        if not 1 < after < len(mine) - 1:
            # What remains of one side would be nothing.
            return True
        posterior = _without(posterior, mine[after - 1 : after + 1])
        again = [
            test
            for test in delay_changes(posterior, anywhere)
            if (test.run, test.owners, test.within_clock) == (run, best.owners, best.within_clock)
            and test.time > best.time
        ]
        if again and abs(again[0].z) > limit and again[0].z * best.z > 0:
            return True
    return False


def _without(posterior: Posterior, left_out: NDArray[np.intp]) -> Posterior:
    """The same without some stretches, to first order where these are few.

    Args:
        posterior: With the stretches.
        left_out: Their numbers.
    """
    blocks, solution = posterior.blocks, posterior.solution
    use = np.flatnonzero(solution.estimated)
    own = np.ix_(use, use)
    normal = blocks.normal[left_out].sum(axis=0)
    scores = blocks.scores(solution.value)[left_out].sum(axis=0)
    projection = np.zeros_like(solution.projection)
    known = solution.projection[own]
    projection[own] = np.linalg.solve(np.eye(len(use)) - known @ normal[own], known)
    step = -projection @ np.where(solution.estimated, scores, 0.0)
    kept = np.delete(np.arange(len(blocks.since)), left_out)
    rest = Blocks(blocks.normal[kept], blocks.right[kept], blocks.run[kept], blocks.since[kept])
    told = solution.scores - scores - rest.normal.sum(axis=0) @ step
    value = solution.value + step
    solution = replace(solution, value=value, projection=projection, scores=told)
    return replace(posterior, blocks=rest, solution=solution)


def _changes(
    posterior: Posterior,
    number: int,
    delays: Sequence[tuple[int, CalibrationParameter]],
    settings: VerdictSettings,
) -> Iterator[ClockChange]:
    """Those of a run.

    Args:
        posterior: With the stretches.
        number: Of the run.
        delays: Their columns in the border, and what they are.
        settings: Levels.
    """
    blocks, solution = posterior.blocks, posterior.solution
    mine = np.flatnonzero(blocks.run == number)
    mine = mine[np.argsort(blocks.since[mine], kind="stable")]
    if len(mine) < 2 or not delays:
        return
    run, since = posterior.experiment.runs[number].name, blocks.since[mine]
    until = since[-1] + np.median(np.diff(since))
    asked = np.minimum(since - since[0], until - since) >= settings.on_both_sides
    use = np.flatnonzero(solution.estimated)
    projection = solution.projection[np.ix_(use, use)]
    pulled = pulled_by_priors(posterior, use)
    moves = -solution.gain[:TEN][:, use]
    scores = _from_each_on(blocks.scores(solution.value)[mine])
    length = length_of(posterior)
    for column, parameter in delays:
        # Of a delay from each bound on; from the first on it is the same throughout the run.
        normal = _from_each_on(blocks.normal[mine, column])
        own, across = normal[:, column], normal[:, use]
        follow = across @ projection
        information = own - np.sum(across * follow, axis=1)
        score = scores[:, column] - follow @ pulled
        if information[0] > settings.its_own * own[0]:
            # That is no change, also where it is not estimated.
            share = (own - follow @ across[0]) / information[0]
            information = information - share**2 * information[0]
            score = score - share * score[0]
            across = across - share[:, None] * across[0]
        for k in np.flatnonzero(asked & (information > settings.its_own * own)):
            size = float(score[k] / information[k])
            sigma = float(np.sqrt(posterior.noise_factor / information[k]))
            yield ClockChange(
                run,
                tuple(instruments_of(posterior.experiment, parameter)),
                float(since[k]),
                size / sigma,
                size,
                sigma,
                length(moves @ across[k] * size),
                parameter.key == LATENCY,
            )


def disturbing_changes(
    posterior: Posterior, settings: VerdictSettings = VERDICT
) -> Iterator[ClockChange]:
    """Changes of delays that coloured noise of a motion instrument stands for: it departs by the
    rate of what is read times a step. With such noise a delay is hardly told, and its score is
    small.

    Args:
        posterior: With the motion.
        settings: Levels.
    """
    experiment = posterior.experiment
    for segment in posterior.fit.state.segments:
        for process, _ in unstated_along(segment):
            name = process.disturbs[0]
            if process.source in UNMODELLED_PARTS or experiment.instruments[name].is_force:
                continue
            delay = posterior.calibration.delay(clock_of(experiment, name), segment.run)
            shared = shares_clock(experiment, name)
            for _, time, read, departs in disturbed_readings(segment, process):
                found = _step_of_delay(time, read - departs, departs, process.time, settings)
                if found is not None:
                    at, size, z = found
                    sigma = abs(size) / z
                    yield ClockChange(segment.run, (name,), at - delay, z, size, sigma, 0.0, shared)


def _step_of_delay(
    time: Array, moved: Array, departs: Array, correlated: float, settings: VerdictSettings
) -> tuple[float, float, float] | None:
    """When a delay would change for readings to depart like this [s], by how much [s], and how
    surely, in sigma of a normal number; None: no such change explains most of it.

    Args:
        time: Of n readings [s].
        moved: What the motion has there, shape (n, k).
        departs: By how much they depart from it, shape (n, k).
        correlated: Time over which they do so alike [s].
        settings: Levels.
    """
    margin = settings.on_both_sides
    if not len(time) or np.ptp(time) < 2 * margin:
        return None
    asked = np.arange(time[0] + margin, time[-1] - margin, _STEP)
    independent = moved.shape[1] * (np.ptp(time) / correlated - 1)
    if independent < _FEWEST:
        return None
    later, before = (
        np.column_stack([np.interp(time + step, time, each) for each in moved.T])
        for step in (_RATE, -_RATE)
    )
    # Of what is late by more, less of the motion has come: of a delay throughout, and of one from
    # each instant on, beside a constant.
    rate = (before - later) / (2 * _RATE)
    rate -= rate.mean(axis=0)
    whole = departs - departs.mean(axis=0)
    since = np.searchsorted(time, asked)
    own, follows, square = (_from_each_on(each)[since] for each in (rate, rate * whole, rate**2))
    both = np.sum(square, axis=1)
    normal = np.empty((len(asked), 2, 2))
    normal[:, 0, 0] = np.sum(rate**2)
    normal[:, 0, 1] = normal[:, 1, 0] = both
    normal[:, 1, 1] = both - np.sum(own**2, axis=1) / len(time)
    right = np.stack([np.full(len(asked), np.sum(rate * whole)), np.sum(follows, axis=1)], axis=1)
    sizes = np.einsum("nij,nj->ni", np.linalg.pinv(normal, hermitian=True), right)
    shares = np.sum(sizes * right, axis=1) / max(float(np.sum(whole**2)), 1e-300)
    best = int(np.argmax(shares))
    share, at, size = float(shares[best]), float(asked[best]), float(sizes[best, 1])
    # Two numbers explain so much of independent ones by chance: Fisher's F, in closed form.
    chance = (1 - share) ** ((independent - 2) / 2) * len(asked)
    if share < _MOSTLY or chance > settings.family:
        return None
    return at, size, float(normal_exceeded(chance / 2))


def _from_each_on(values: Array) -> Array:
    """Sums from each stretch to the last, shape as given."""
    return np.asarray(np.cumsum(values[::-1], axis=0)[::-1])
