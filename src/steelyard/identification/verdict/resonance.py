"""Whether something moves against the platform: a load on a string, a liquid that sloshes, a part
that bends.

Its pull follows the platform's acceleration by a response of its own, so that neither a rigid body
nor a process that is independent of the motion can stand for it, and the body is wrong by it. A
score test [Rao1948]_ asks, at one frequency after the other, whether the balance of forces holds
better with such a pull. What resembles one by chance, or since some error of the description also
follows the acceleration, does so at neighbouring frequencies as well; a resonance does not.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal

import numpy as np

from steelyard.arrays import Array
from steelyard.dynamics import AT_A_POINT, FLEXIBILITY
from steelyard.estimates.estimate import plausible_radius
from steelyard.estimates.quantiles import chi2_tail
from steelyard.identification.known_body import known_body
from steelyard.identification.model.calibration_parameters import BENDING, BENDING_KEYS, ROBOT
from steelyard.identification.solve.posterior import Posterior
from steelyard.identification.verdict.directed_tests import length_of
from steelyard.identification.verdict.force_stretch import (
    ForceStretch,
    beside,
    force_stretches,
    orthonormal,
)
from steelyard.identification.verdict.responses import (
    KINDS,
    AskedStretch,
    Bent,
    Kind,
    ScoreTest,
    normal_equations,
    solution,
)
from steelyard.identification.verdict.settings import VERDICT, VerdictSettings
from steelyard.inertia import TEN

_PERIODS = 2.0
"""Of a resonance that is looked for, within a stretch."""
_LINE = 0.5
"""Of a frequency from the one before, over the width of a line: of what stands between them more
than half is seen, and more than nine tenths where it is looked at more closely."""
_NEAR = 9
"""Frequencies between those about the likeliest, where it is looked at more closely."""
_BESIDE = 1.4
"""Of frequencies beside a resonance."""
_WIDTHS = 4.0
"""Of its line, by which others are beside it where that is less."""
_SHARP = 3.0
"""By how much more the cost falls at a resonance than beside it: seven times and more for loads of
a percent of a platform; 1.3 where a platform that swings freely rubs in a way that its friction is
not."""
_LINES, _HUMS = 2.0, 17
"""Lines of a stretch on either side of a resonance at which something may hum, and how many are
tried."""
_BENDS = 1e-6
"""Probability by chance of what looks like residual flexibility and is not in the estimate, from
which on it is asked at which frequency: the least of 25 given recordings is .01."""
_CHANCE = 1e-10
"""Probability of it by chance, over all frequencies: errors of the description come first."""


_ALONG = tuple(
    [place for place, column in enumerate(AT_A_POINT) if FLEXIBILITY[column][0] == axis]
    for axis in range(3)
)
"""Of what bends, the elements that tell how it follows the force along each axis, its own first."""
_OF_AXES = tuple(axes for count in (1, 2, 3) for axes in combinations(range(3), count))
"""Axes along which it may bend."""


@dataclass(frozen=True)
class Resonance:
    """Something that moves against the platform."""

    name: Literal["swings", "bends"]
    frequency: float | None
    """[Hz]; None: nothing tells it."""
    mass: float | None
    """[kg]; None: nothing tells it."""
    shift: float
    """How far the estimate moves with it, in its 1-sigma."""

    def __str__(self) -> str:
        moves = f"it moves the estimate by {self.shift:.1f} sigma"
        if self.mass is not None:
            return (
                f"something of about {self.mass:.2g} kg seems to swing at {self.frequency:.2g} Hz"
                f" below the platform ({moves}), which is no part of a rigid body; fix it, or take"
                " it off and add it afterwards"
            )
        if self.frequency is None:
            return (
                "parts of the platform seem to bend in a way that flexibility above the motion"
                f" does not explain ({moves}); stiffen them, or move more slowly"
            )
        return (
            f"a part of the platform seems to move at {self.frequency:.2g} Hz against the rest"
            f" ({moves}), which is no part of a rigid body; stiffen it or fix it, or move more"
            " slowly than it does"
        )


def resonance(found: Posterior, settings: VerdictSettings = VERDICT) -> Resonance | None:
    """What moves against the platform most; None: nothing that matters does.

    Args:
        found: What the estimate stands on.
        settings: How much matters.
    """
    return found.once("resonance", settings, lambda: _resonance(found, settings))


def _resonance(found: Posterior, settings: VerdictSettings) -> Resonance | None:
    """See :func:`resonance`."""
    # The noise of a held motion is in what is left over and in the response alike.
    stretches = [] if found.fit.motions else list(force_stretches(found))
    if not stretches:
        return None
    assert found.fit.state.parameters is not None
    whole = float(found.fit.state.parameters[0])
    duration = max(each.duration for each in stretches)
    best: tuple[float, Resonance] | None = None
    for kind in KINDS:
        lowest = max(kind.lowest, _PERIODS / duration)
        if lowest >= kind.highest:
            continue
        if kind.at_any_angle and not any(each.is_disturbed for each in stretches):
            # What pulls so far has left an unmodelled wrench.
            continue
        frequencies = _frequencies(kind, lowest, duration)
        begun = [AskedStretch.of(each, kind, whole) for each in stretches]
        asked, likeliest, test = _likeliest(begun, frequencies)
        trials = len(frequencies) * len(kind.damping)
        if not _is_resonance(test, asked, likeliest, trials, duration):
            continue
        pulls = [rows @ test.pull for rows in _rows_at(asked, likeliest)]
        shift = length_of(found)(_moved_body(found, stretches, pulls))
        if shift > settings.matters and (best is None or test.fall > best[0]):
            mass = -float(test.pull[0]) if kind.name == "swings" else None
            if mass is None or mass > 0:
                best = test.fall, Resonance(kind.name, likeliest, mass, shift)
    return (
        _bends_otherwise(found, settings, stretches, whole, duration) if best is None else best[1]
    )


def _bends_otherwise(
    found: Posterior,
    settings: VerdictSettings,
    stretches: Sequence[ForceStretch],
    whole: float,
    duration: float,
) -> Resonance | None:
    """What bends and is no residual flexibility: where the motion comes near its own frequency, it
    answers more than that, and the matrix that the readings ask for is none that can be.

    Args:
        found: What the estimate stands on.
        settings: How much matters.
        stretches: Of its runs.
        whole: Mass of platform and load [kg].
        duration: Of the longest stretch [s].
    """
    kind = next(each for each in KINDS if each.is_stiff)
    lowest = max(kind.lowest, _PERIODS / duration)
    places = found.calibration.calibration_parameters.places
    if lowest >= kind.highest or not places.keys() >= set(BENDING_KEYS):
        return None
    asked = [AskedStretch.of(each, kind, whole) for each in stretches]
    estimated = found.calibration.of_robot(*BENDING)
    bent = Bent.of(asked, estimated)
    if not estimated.any() and (bent.chance > _BENDS or not _is_felt(found, bent.further)):
        return None
    frequencies = _frequencies(kind, lowest, duration)
    tests = [bent.tested(float(each)) for each in frequencies]
    best = int(np.argmax([each.fall for each in tests]))
    frequency, most = float(frequencies[best]), tests[best]
    neighbours = (bent.tested(frequency * each).fall for each in (_BESIDE, 1 / _BESIDE))
    is_sure = float(chi2_tail(most.fall, 1)) * len(frequencies) <= _CHANCE
    if is_sure and all(most.fall > _SHARP * each for each in neighbours):
        pulls = [rows @ most.pull for rows in bent.more(frequency)]
        moved = _moved_body(found, stretches, pulls, bent.columns)
        resonance = Resonance(kind.name, frequency, None, length_of(found)(moved))
    elif estimated.any() or bent.chance > _CHANCE or any(each.is_disturbed for each in stretches):
        # What an unmodelled wrench stands for is in what is left over.
        return None
    else:
        pulls = [own @ bent.further for own in bent.columns]
        moved = _moved_body(found, stretches, pulls)
        resonance = Resonance(kind.name, None, None, length_of(found)(moved))
    return resonance if resonance.shift > settings.matters else None


def _is_felt(found: Posterior, further: Array) -> bool:
    """Whether anything bends by more than that of a stiff platform: exact sensors show by how
    little a motion of splines is not the true one.

    Args:
        found: What the estimate stands on.
        further: Elements of the matrix, shape (21,).
    """
    entries = {each.full_key: each for each in found.calibration.calibration_parameters.entries}
    sizes = [np.full(count, entries[ROBOT, key, None].negligible) for key, count in BENDING]
    diagonal = [place for place, (i, j) in enumerate(FLEXIBILITY) if i == j]
    return bool(np.any(further[diagonal] > np.concatenate(sizes)[diagonal]))


def _frequencies(kind: Kind, lowest: float, duration: float) -> Array:
    """Those that are asked for [Hz], shape (f,): a line is as wide as the damping makes it, and no
    narrower than the stretch resolves.

    Args:
        kind: What moves.
        lowest: The first of them [Hz].
        duration: Of the longest stretch [s].
    """
    found = [lowest]
    while found[-1] < kind.highest:
        width = _width(found[-1], kind.damping[-1], duration)
        found.append(min(found[-1] + _LINE * width, kind.highest))
    return np.array(found)


def _width(frequency: float, damping: float, duration: float) -> float:
    """Of a line [Hz], as its damping makes it and as a stretch resolves it."""
    return float(np.hypot(1 / duration, 2 * damping * frequency))


def _likeliest(
    begun: Sequence[AskedStretch], frequencies: Array
) -> tuple[Sequence[AskedStretch], float, ScoreTest]:
    """Where the cost falls most: with which damping, at which frequency, and what is found there.

    Args:
        begun: All stretches, asked with the widest line.
        frequencies: That are asked for [Hz], shape (f,).
    """
    best = int(np.argmax([test.fall for test in _tested(begun, frequencies)]))
    around = np.linspace(
        frequencies[max(best - 1, 0)], frequencies[min(best + 1, len(frequencies) - 1)], _NEAR
    )
    found: tuple[Sequence[AskedStretch], float, ScoreTest] | None = None
    for damping in begun[0].kind.damping:
        asked = [replace(each, damping=damping) for each in begun]
        for frequency, test in zip(around, _tested(asked, around), strict=True):
            if found is None or test.fall > found[2].fall:
                found = asked, float(frequency), test
    assert found is not None  # every kind has a damping
    return found


def _is_resonance(
    test: ScoreTest, asked: Sequence[AskedStretch], frequency: float, trials: int, duration: float
) -> bool:
    """Whether it is surely there, and at no other frequency."""
    if float(chi2_tail(test.fall, len(test.pull))) * trials > _CHANCE:
        return False
    reach = 1 + _WIDTHS * _width(frequency, asked[0].kind.damping[-1], duration) / frequency
    factors = {_BESIDE, min(reach, _BESIDE)}
    neighbours = np.array([frequency * own for each in factors for own in (each, 1 / each)])
    if not all(test.fall > _SHARP * each.fall for each in _tested(asked, neighbours)):
        return False
    return not (asked[0].kind.is_stiff and _hums(asked, frequency, test, duration))


def _rows_at(asked: Sequence[AskedStretch], frequency: float) -> tuple[Array, ...]:
    """Columns of every stretch at one frequency [Hz]."""
    (rows,) = zip(*(each.rows(np.array([frequency])) for each in asked), strict=True)
    return tuple(rows)


def _hums(
    asked: Sequence[AskedStretch], frequency: float, test: ScoreTest, duration: float
) -> bool:
    """Whether what keeps on vibrating, whatever the motion is, explains more than what follows it:
    forces that hum are no part that moves.
    """
    pulls = [rows @ test.pull[:, None] for rows in _rows_at(asked, frequency)]
    follows = _explained(asked, pulls)
    reach = np.linspace(-_LINES, _LINES, _HUMS) / duration
    return any(
        # In every stretch from where it is in its beginning.
        sum(_explained([each], [each.by_itself(own, 0.0)]) for each in asked) > follows
        for own in frequency + reach
    )


def _explained(asked: Sequence[AskedStretch], rows: Sequence[Array]) -> float:
    """By how much the cost falls with columns beside the body."""
    own = [beside(each.stretch.base, one) for each, one in zip(asked, rows, strict=True)]
    normal, right = normal_equations(asked, own)
    return float(right @ solution(normal, right))


def _tested(asked: Sequence[AskedStretch], frequencies: Array) -> Iterator[ScoreTest]:
    """A pull at one point of the platform, which is as unknown as its mass, at each frequency
    [Hz].
    """
    together = zip(frequencies, *(each.rows(frequencies) for each in asked), strict=True)
    for frequency, *rows in together:
        yield _fall(asked, float(frequency), rows)


def _fall(asked: Sequence[AskedStretch], frequency: float, rows: Sequence[Array]) -> ScoreTest:
    """See :func:`_tested`, of the rows of every stretch at one frequency."""
    own = [beside(each.stretch.base, one) for each, one in zip(asked, rows, strict=True)]
    if asked[0].kind.is_stiff:
        # Only what the motion makes of it tells: it vibrates as a whole, too, on its cables.
        free = [
            orthonormal(beside(a.stretch.base, a.by_itself(frequency, a.damping))) for a in asked
        ]
        own = [beside(base, one) for base, one in zip(free, own, strict=True)]
    normal, right = normal_equations(asked, own)
    if not asked[0].kind.is_stiff:
        pull = solution(normal, right)
        return ScoreTest(float(right @ pull), pull)
    # What pulls it along, as much as a part of the platform may: else it is no part of one.
    most = asked[0].whole / (2 * np.pi * frequency) ** 2
    best = ScoreTest(0.0, np.zeros(len(right)))
    for axes in _OF_AXES:
        places = [place for axis in axes for place in _ALONG[axis]]
        pull = np.zeros(len(right))
        pull[places] = solution(normal[np.ix_(places, places)], right[places])
        if all(0 < pull[_ALONG[axis][0]] < most for axis in axes) and right @ pull > best.fall:
            best = ScoreTest(float(right @ pull), pull)
    return best


def _moved_body(
    found: Posterior,
    stretches: Sequence[ForceStretch],
    pulls: Sequence[Array],
    estimated: Sequence[Array] = (),
) -> Array:
    """By how much the ten parameters of the body change with a pull, shape (10,), as far as what is
    known of them beforehand lets them.

    Args:
        found: What the estimate stands on.
        stretches: Of its runs.
        pulls: What it makes of the balance in each, as the residual is, shape (6 n - 6,).
        estimated: Columns of what is estimated beside the body and moves with it, in each, shape
            (6 n - 6, c); empty: nothing is.
    """
    state = found.fit.state
    assert state.parameters is not None
    size = plausible_radius(found.experiment.robot)
    columns = [each.by_body for each in stretches]
    if estimated:
        columns = [np.hstack(each) for each in zip(columns, estimated, strict=True)]
    information = np.sum([each.T @ each for each in columns], axis=0)
    information[:TEN, :TEN] += known_body(found.of_its_runs, state.parameters, size)[0]
    gradient = -np.sum([own.T @ pull for own, pull in zip(columns, pulls, strict=True)], axis=0)
    scale = 1 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    scaled = np.linalg.pinv(information * np.outer(scale, scale), hermitian=True)
    return np.asarray(scale * (scaled @ (scale * gradient)))[:TEN]
