"""Whether something moves against the platform: a load on a string, a liquid that sloshes, a part
that bends.

Its pull follows the platform's acceleration by a response of its own, so that neither a rigid body
nor a process that is independent of the motion can stand for it, and the body is wrong by it. A score
test [Rao1948]_ asks, at one frequency after the other, whether the balance of forces holds better
with such a pull. What resembles one by chance, or since some error of the description also follows
the acceleration, does so at neighbouring frequencies as well; a resonance does not.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dtbtrs
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.estimates.estimate import plausible_radius
from steelyard.estimates.quantiles import chi2_tail
from steelyard.identification.known_body import known_body
from steelyard.identification.model.balance import Forces, balance_of, regressor_at
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.segment import motion_at
from steelyard.identification.solve.posterior import Posterior
from steelyard.identification.verdict.directed_tests import length_of
from steelyard.identification.verdict.settings import VERDICT, VerdictSettings
from steelyard.inertia import TEN
from steelyard.robot.model import DIRECTIONS

_STEP = 0.01
"""Between the instants at which a response is followed [s]."""
_PERIODS = 2.0
"""Of a resonance that is looked for, within a stretch."""
_LINE = 0.5
"""Of a frequency from the one before, over the width of a line: of what stands between them more than
half is seen, and more than nine tenths where it is looked at more closely."""
_NEAR = 9
"""Frequencies between those about the likeliest, where it is looked at more closely."""
_BESIDE = 1.4
"""Of frequencies beside a resonance."""
_WIDTHS = 4.0
"""Of its line, by which others are beside it where that is less."""
_SHARP = 3.0
"""By how much more the cost falls at a resonance than beside it: seven times and more for loads of a
percent of a platform; 1.3 where a platform that swings freely rubs in a way that its friction is not."""
_CHANCE = 1e-10
"""Probability of it by chance, over all frequencies: errors of the description come first."""
_INDEPENDENT = 1e-9
"""Part of the largest singular value below which columns tell the same."""
_WHOLE = 60.0
"""Stretch of all runs that is looked at [s]: a resonance that matters shows in it."""
_SAMPLES = 60.0
"""Of them a second: four of every period."""


class _Kind(NamedTuple):
    """What moves against the platform."""

    name: Literal["swings", "bends"]
    lowest: float
    highest: float
    """Frequencies that are looked for [Hz]."""
    damping: tuple[float, ...]
    """Ratios, the widest line last."""

    @property
    def is_stiff(self) -> bool:
        """Whether platforms on their cables vibrate at such frequencies themselves."""
        return self.name == "bends"


_KINDS = (
    # On strings of some metres to some centimetres, or a liquid: level, in the world.
    _Kind("swings", 0.25, 3.2, (0.005, 0.02)),
    # On something elastic, along the axes of the platform, whose weight it feels too.
    _Kind("bends", 1.5, 14.0, (0.01, 0.03)),
)


@dataclass(frozen=True)
class Resonance:
    """Something that moves against the platform."""

    name: Literal["swings", "bends"]
    frequency: float
    """[Hz]"""
    mass: float | None
    """[kg]; None: nothing tells it."""
    shift: float
    """How far the estimate moves with it, in its 1-sigma."""

    def __str__(self) -> str:
        moves = f"it moves the estimate by {self.shift:.1f} sigma"
        if self.mass is not None:
            return (
                f"something of about {self.mass:.2g} kg seems to swing at {self.frequency:.2g} Hz below"
                f" the platform ({moves}), which is no part of a rigid body; fix it, or take it off and"
                " add it afterwards"
            )
        return (
            f"a part of the platform seems to move at {self.frequency:.2g} Hz against the rest"
            f" ({moves}), which is no part of a rigid body; stiffen it or fix it, or move more slowly"
            " than it does"
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
    stretches = [] if found.fit.motions else list(_stretches(found))
    if not stretches:
        return None
    duration = max(each.duration for each in stretches)
    best: tuple[float, Resonance] | None = None
    for kind in _KINDS:
        lowest = max(kind.lowest, _PERIODS / duration)
        if lowest >= kind.highest:
            continue
        frequencies = _frequencies(kind, lowest, duration)
        begun = [_Asked.of(each, kind) for each in stretches]
        asked, likeliest, test = _likeliest(begun, frequencies)
        trials = len(frequencies) * len(kind.damping)
        if not _is_resonance(test, asked, likeliest, trials, duration):
            continue
        shift = length_of(found)(_moved_body(found, asked, likeliest, test.pull))
        if shift > settings.matters and (best is None or test.fall > best[0]):
            mass = -float(test.pull[0]) if kind.name == "swings" else None
            if mass is None or mass > 0:
                best = test.fall, Resonance(kind.name, likeliest, mass, shift)
    return None if best is None else best[1]


def _frequencies(kind: _Kind, lowest: float, duration: float) -> Array:
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


class _Test(NamedTuple):
    """A pull that follows the acceleration, in all stretches."""

    fall: float
    """Decrease of the cost, chi-square where there is none."""
    pull: Array
    """Its size, shape (c,): mass, and mass times place, for each direction."""


def _likeliest(
    begun: Sequence[_Asked], frequencies: Array
) -> tuple[Sequence[_Asked], float, _Test]:
    """Where the cost falls most: with which damping, at which frequency, and what is found there.

    Args:
        begun: All stretches, asked with the widest line.
        frequencies: That are asked for [Hz], shape (f,).
    """
    falls = [_tested(begun, float(each)).fall for each in frequencies]
    best = int(np.argmax(falls))
    around = frequencies[max(best - 1, 0)], frequencies[min(best + 1, len(frequencies) - 1)]
    found: tuple[Sequence[_Asked], float, _Test] | None = None
    for damping in begun[0].kind.damping:
        asked = [replace(each, damping=damping) for each in begun]
        for frequency in np.linspace(*around, _NEAR):
            test = _tested(asked, float(frequency))
            if found is None or test.fall > found[2].fall:
                found = asked, float(frequency), test
    assert found is not None  # every kind has a damping
    return found


def _is_resonance(
    test: _Test, asked: Sequence[_Asked], frequency: float, trials: int, duration: float
) -> bool:
    """Whether it is surely there, and at no other frequency."""
    if float(chi2_tail(test.fall, len(test.pull))) * trials > _CHANCE:
        return False
    reach = 1 + _WIDTHS * _width(frequency, asked[0].kind.damping[-1], duration) / frequency
    return all(
        test.fall > _SHARP * _tested(asked, each).fall
        for factor in {_BESIDE, min(reach, _BESIDE)}
        for each in (frequency * factor, frequency / factor)
    )


@dataclass(frozen=True, eq=False)
class _Stretch:
    """The balance of forces along a segment, without processes, whitened, n samples."""

    time: Array
    """Within the segment [s], shape (n,)."""
    duration: float
    """[s]"""
    instants: Array
    """Every .01 s [s], shape (t,)."""
    level: Array
    """Acceleration across gravity, world frame [m/s^2], shape (t, 3)."""
    felt: Array
    """Specific force, platform frame [m/s^2], shape (t, 3)."""
    rotation: Array
    """R_world_platform at the samples, shape (n, 3, 3)."""
    whitener: Array
    """Shape (n, 6, 6)."""
    use: NDArray[np.bool_]
    """Shape (n,)."""
    kept: float
    """Correlation of what is left over from sample to sample."""
    base: Array
    """Orthonormal columns of the body and of offsets, shape (6 n - 6, b)."""
    by_body: Array
    """How the residual follows the body, shape (6 n - 6, 10)."""
    over: Array
    """What is left over, in units of its scatter, shape (6 n - 6,)."""
    scatter: float

    @cached_property
    def _between(self) -> tuple[NDArray[np.intp], Array]:
        """Instant before each sample, and part of the step to the next one, shapes (n,) and
        (n, 1).
        """
        steps = np.clip((self.time - self.instants[0]) / _STEP, 0.0, len(self.instants) - 1)
        before = np.minimum(steps.astype(np.intp), max(len(self.instants) - 2, 0))
        return before, (steps - before)[:, None]

    def response(self, kind: _Kind, frequency: float, damping: float) -> Array:
        """Pull of a kilogramme, platform frame [N], shape (n, 3)."""
        driven = self.level if kind.name == "swings" else self.felt
        # It begins as it would hang at rest.
        followed = _followed(driven - driven[0], 2 * np.pi * frequency, damping) - driven[0]
        before, share = self._between
        after = np.minimum(before + 1, len(followed) - 1)
        pull = followed[before] * (1 - share) + followed[after] * share
        if kind.name == "bends":
            return np.asarray(pull)
        return np.asarray(np.einsum("nji,nj->ni", self.rotation, pull))


@dataclass(frozen=True, eq=False)
class _Asked:
    """A stretch that is asked for one kind: what does not depend on the frequency is there once."""

    stretch: _Stretch
    kind: _Kind
    damping: float
    """Ratio."""
    by_pull: tuple[Array, ...]
    """How the whitened balance follows each component of a pull, shape (n, 6, c) each: of a kilogramme
    and of a kilogramme a metre away."""

    @classmethod
    def of(cls, stretch: _Stretch, kind: _Kind) -> _Asked:
        """Of one kind."""
        wrenches = _wrenches(kind)
        white = (stretch.whitener / stretch.scatter) @ wrenches.reshape(DIRECTIONS, -1)
        whole = white.reshape(*white.shape[:2], *wrenches.shape[1:])
        return cls(
            stretch,
            kind,
            kind.damping[-1],
            tuple(np.ascontiguousarray(whole[..., i]) for i in range(3)),
        )

    def rows(self, frequency: float) -> Array:
        """Columns of the balance as the residual is, shape (6 n - 6, c)."""
        pull = self.stretch.response(self.kind, frequency, self.damping)
        white, *others = (
            own * p[:, None, None] for own, p in zip(self.by_pull, pull.T, strict=True)
        )
        for each in others:
            white += each
        return _innovations(white, self.stretch.use, self.stretch.kept)

    def free(self, frequency: float) -> Array:
        """The same of what goes on moving at a frequency from where it was in the beginning, which
        nobody knows, as a wrench on the platform, shape (6 n - 6, 12).
        """
        stretch, omega = self.stretch, 2 * np.pi * frequency
        since = stretch.time - stretch.time[0]
        size = np.exp(-self.damping * omega * since)
        waves = size * (np.cos(omega * since), np.sin(omega * since))
        white = np.concatenate([stretch.whitener * own[:, None, None] for own in waves], axis=2)
        return _innovations(white, stretch.use, stretch.kept)


def _followed(driven: Array, omega: float, damping: float) -> Array:
    """``omega^2 x`` of ``x'' + 2 damping omega x' + omega^2 x = -driven`` from rest, by the trapezoidal
    rule, shape (t, 3).
    """
    half = omega * _STEP / 2
    first, middle, last = (
        1 + 2 * damping * half + half**2,
        2 * (half**2 - 1),
        1 - 2 * damping * half + half**2,
    )
    band = np.empty((3, len(driven)))
    band[0], band[1], band[2] = first, middle, last
    right = driven.copy()
    right[1:] += 2 * driven[:-1]
    right[2:] += driven[:-2]
    found, _ = dtbtrs(band, -(half**2) * right, uplo="L")
    return np.asarray(found)


def _innovations(rows: Array, use: NDArray[np.bool_], kept: float) -> Array:
    """What is new of each sample, shape (6 n - 6, …), from shape (n, 6, …)."""
    new = -kept * rows[:-1]
    new += rows[1:]
    new[~(use[1:] & use[:-1])] = 0.0
    return np.asarray(new.reshape(-1, *rows.shape[2:]))


def _stretches(found: Posterior) -> Iterator[_Stretch]:
    """Of the segments in motion, a minute in all."""
    left = _WHOLE
    for segment, forces in zip(found.fit.state.segments, found.force_samples, strict=True):
        if segment.static or forces is None or forces.guessed.all() or left <= 0:
            continue
        stretch = _stretch(found, segment, forces, left)
        if stretch is not None:
            left -= stretch.duration
            yield stretch


def _stretch(found: Posterior, segment: Segment, forces: Forces, longest: float) -> _Stretch | None:
    """The beginning of a segment; None: there is too little of it."""
    state = found.fit.state
    assert state.parameters is not None
    fewest = 2 * (TEN + found.calibration.calibration_parameters.m)
    if len(forces.time) < fewest:
        return None
    start, end = segment.span
    step = max(float(np.median(np.diff(forces.time))), 1e-9)
    every = max(1, round(1 / (_SAMPLES * step)))
    # Means, since what is faster would show at another frequency if single samples were taken.
    part = forces.part(slice(0, int(longest / step))).means(every)
    at = balance_of(
        found.experiment, segment, part, state.calibration, state.parameters, state.factors
    )
    use = segment.holds(at.time) & ~part.touched
    if np.sum(use) < fewest:
        return None
    end = min(end, float(at.time[-1]))
    instants = np.arange(start, end, _STEP)
    pose, _, acceleration, _ = motion_at(segment.basis(instants), segment.coefficients)
    turned = Rotation.from_quat(pose[:, 3:], scalar_first=True).as_matrix()
    gravity = state.calibration.gravity
    down = gravity / np.linalg.norm(gravity)
    level = acceleration[:, :3] - np.outer(acceleration[:, :3] @ down, down)
    felt = np.einsum("nji,nj->ni", turned, acceleration[:, :3] - gravity)
    white = np.einsum("nij,nj->ni", at.whitener, at.left_over + at.by_processes)
    body = -regressor_at(found.experiment, segment, at.time, state.calibration)
    columns = at.whitener @ np.concatenate([body, at.by_reading], axis=2)
    columns = columns / np.maximum(np.sqrt(np.mean(columns**2, axis=(0, 1))), 1e-300)
    # First as if it were white, then as it is correlated.
    own = _beside(_orthonormal(_innovations(columns, use, 0.0)), _innovations(white, use, 0.0))
    own = own.reshape(-1, DIRECTIONS)
    kept = float(np.sum(own[1:] * own[:-1]) / max(float(np.sum(own**2)), 1e-300))
    base = _orthonormal(_innovations(columns, use, kept))
    residual = _beside(base, _innovations(white, use, kept))
    square = float(residual @ residual) / (DIRECTIONS * int(np.sum(use)))
    scatter = max(np.sqrt(square), 1e-300)
    by_body = _innovations(at.whitener @ body, use, kept) / scatter
    return _Stretch(
        at.time,
        end - start,
        instants,
        level,
        felt,
        np.asarray(at.motion["rotation"]),
        at.whitener,
        use,
        kept,
        base,
        by_body,
        np.asarray(residual / scatter),
        float(scatter),
    )


def _orthonormal(columns: Array) -> Array:
    """A basis of what columns span, shape (n, b)."""
    left, size, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(left[:, size > _INDEPENDENT * size[0]])


def _beside(base: Array, rows: Array) -> Array:
    """Rows less what is in a basis."""
    within = base @ (base.T @ rows)
    return np.asarray(np.subtract(rows, within, out=within))


def _tested(asked: Sequence[_Asked], frequency: float) -> _Test:
    """A pull at one point of the platform, which is as unknown as its mass."""
    own = [_beside(each.stretch.base, each.rows(frequency)) for each in asked]
    if asked[0].kind.is_stiff:
        # Only what the motion makes of it tells: it vibrates freely as a whole, too, on its cables.
        free = [_orthonormal(_beside(a.stretch.base, a.free(frequency))) for a in asked]
        own = [_beside(base, rows) for base, rows in zip(free, own, strict=True)]
    normal = np.sum([rows.T @ rows for rows in own], axis=0)
    right = np.sum(
        [rows.T @ each.stretch.over for each, rows in zip(asked, own, strict=True)], axis=0
    )
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    size, direction = np.linalg.eigh(normal / np.outer(scale, scale))
    told = np.abs(size) > _INDEPENDENT * np.abs(size).max()
    along = direction[:, told].T @ (right / scale) / size[told]
    pull = direction[:, told] @ along / scale
    return _Test(float(right @ pull), pull)


def _moved_body(found: Posterior, asked: Sequence[_Asked], frequency: float, pull: Array) -> Array:
    """By how much the ten parameters of the body change with a pull, shape (10,), as far as what is
    known of them beforehand lets them.
    """
    state = found.fit.state
    assert state.parameters is not None
    size = plausible_radius(found.experiment.robot)
    information, _ = known_body(found.of_its_runs, state.parameters, size)
    gradient = np.zeros(TEN)
    for each in asked:
        B = each.stretch.by_body
        information = information + B.T @ B
        gradient -= B.T @ (each.rows(frequency) @ pull)
    scale = 1 / np.sqrt(np.diag(information))
    scaled = np.linalg.pinv(information * np.outer(scale, scale), hermitian=True)
    return np.asarray(scale * (scaled @ (scale * gradient)))


def _wrenches(kind: _Kind) -> Array:
    """Wrenches that a pull of a kilogramme and of a kilogramme a metre away makes, as linear functions
    of it, platform frame, shape (6, c, 3).
    """
    axes = np.eye(3)
    along = [axes] if kind.name == "swings" else [np.outer(axis, axis) for axis in axes]
    found = []
    for each in along:
        found.append(np.vstack([each, np.zeros((3, 3))]))
        for axis in axes:
            moment = np.cross(axis, each, axisb=0, axisc=0)
            if moment.any():
                found.append(np.vstack([np.zeros((3, 3)), moment]))
    return np.stack(found, axis=1)
