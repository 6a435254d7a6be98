"""Which natural modes a push has excited: damped sinusoids fitted to the motion of a platform on
locked winches; and which of its cables may have hung slack.

A mode is a frequency and a decay that all components of the pose share, each with its amplitude and
phase: these follow linearly, and are eliminated (variable projection [Golub1973]_).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.estimates.quantiles import chi2_exceeded
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.experiment.unread import is_unread
from steelyard.identification.methods.swing_regression import swing_regression
from steelyard.identification.solve.misfits.slack_cables import SlackCables
from steelyard.identification.solve.posterior import Posterior
from steelyard.robot.model import DIRECTIONS

_RATE = 25.0
"""Of the samples that are looked at [Hz]: platforms swing with a few Hz."""
_HIGHEST = 8.0
"""Frequency that is looked for [Hz]."""
_SHORTEST = 3.0
"""Run in which a swing can be told from a drift [s]."""
_PADDED = 8
"""Finer grid of the spectrum than that of the run."""
_CHANCE = 1e-6
"""Probability that noise explains as much as a mode."""
_LARGEST_DECAY = 2.0
"""[1/s]"""
_WEAK = 0.3
"""Of a combination of two modes, over the geometric mean of their amplitudes."""


@dataclass(frozen=True)
class ExcitedMode:
    """A natural mode that a run shows."""

    run: str
    frequency: float
    """[Hz]"""
    sigma: float
    """Its 1-sigma [Hz], of noise; the larger the swing, the more the frequency depends on it."""
    damping_ratio: float
    """Of the critical damping."""
    amplitude: float
    """At the beginning of the run, of the point at the platform's radius [m]."""

    def __str__(self) -> str:
        return (
            f"run '{self.run}': swings at {self.frequency:.4f} ± {self.sigma:.4f} Hz, by"
            f" {1e3 * self.amplitude:.0f} mm, damping ratio {self.damping_ratio:.4f}"
        )


def excited_modes(experiment: Experiment, run: Run) -> Iterator[ExcitedMode]:
    """Modes of a run with locked winches, ascending; none where it is too short or no instrument
    tells position or orientation.

    Args:
        experiment: With the run.
        run: Whose winches are locked.
    """
    seen = _motion(experiment, run)
    if seen is None or not 0 < experiment.robot.m < DIRECTIONS:
        return
    time, motion = seen
    most = DIRECTIONS - experiment.robot.m
    rates = np.zeros((0, 2))
    fitted = _projected(time, motion, rates)
    own_modes = np.zeros(0, dtype=bool)
    for _ in range(2 * most):
        start = _strongest(time, fitted.residual)
        wider, own = _refined(time, motion, np.vstack([rates, [start, 0.05]]))
        gained = np.sum(fitted.residual**2) - np.sum(own.residual**2)
        level = np.sum(own.residual**2) / max(own.residual.size - 20, 1)
        if gained / max(level, 1e-300) < chi2_exceeded(_CHANCE, 2 + 2 * motion.shape[1]):
            break
        rates, fitted = wider, own
        own_modes = ~_combined(rates[:, 0], fitted.amplitude, 1 / (time[-1] - time[0]))
        if own_modes.sum() >= most:
            break
    sigma = _deviations(time, motion, rates, fitted)
    for i in np.flatnonzero(own_modes)[np.argsort(rates[own_modes, 0])]:
        frequency, decay = rates[i]
        yield ExcitedMode(
            run.name,
            float(frequency),
            float(sigma[i]),
            float(max(decay, 0.0) / np.hypot(decay, 2 * np.pi * frequency)),
            float(fitted.amplitude[i]),
        )


def _combined(frequency: Array, amplitude: Array, resolution: float) -> NDArray[np.bool_]:
    """Which are sums, differences or doubles of others: what large swings add to the natural modes,
    shape (k,).
    """
    found = np.zeros(len(frequency), dtype=bool)
    for k, i, j in product(range(len(frequency)), repeat=3):
        if k in (i, j) or amplitude[k] > _WEAK * np.sqrt(amplitude[i] * amplitude[j]):
            continue
        sums = np.array([frequency[i] + frequency[j], abs(frequency[i] - frequency[j])])
        found[k] |= bool(np.min(np.abs(sums - frequency[k])) < resolution / 2)
    return found


def slack_cables(experiment: Experiment, joint: Posterior | None) -> tuple[SlackCables, ...]:
    """Cables that may hang slack, of all runs that have such ones.

    Args:
        experiment: With runs on locked winches and without forces; others have none.
        joint: A fit of some of its runs, which knows them better than a regression; None: there is
            none.
    """
    if not experiment.runs or not is_unread(experiment) or not 0 < experiment.robot.m < DIRECTIONS:
        return ()
    fitted = set() if joint is None else set(joint.weights)
    found: dict[str, SlackCables] = {}
    if any(run.name not in fitted for run in experiment.runs):
        try:
            found = {each.run: each for each in swing_regression(experiment).slack}
        except InputError:
            # Lengths and rates tell no pose by themselves.
            found = {}
    if joint is not None:
        found = {name: each for name, each in found.items() if name not in fitted}
        found |= {each.run: each for each in joint.slack}
    return tuple(found[run.name] for run in experiment.runs if run.name in found)


class _Projected(NamedTuple):
    """Sinusoids of given rates, as well as they explain a motion."""

    residual: Array
    """Shape (n, c)."""
    amplitude: Array
    """Of each mode, over all components, shape (k,)."""


def _motion(experiment: Experiment, run: Run) -> tuple[Array, Array] | None:
    """Time [s] from the beginning and components of the pose in metres at the platform's radius,
    shapes (n,) and (n, c); None: there is none.
    """
    size = experiment.robot.size if experiment.robot.size > 0 else 1.0
    names = [n for n in run.streams if experiment.instruments[n].is_motion]
    for wanted in ({"position", "orientation"}, {"position"}, {"orientation"}):
        name = next((n for n in names if wanted <= run.streams[n].values.keys()), None)
        if name is None:
            continue
        stream = run.streams[name]
        parts = []
        for quantity in sorted(wanted):
            values = stream.values[quantity]
            if values.ndim == 3:
                valid: NDArray[np.bool_] = np.asarray(np.isfinite(values).all(axis=(1, 2)))
                if not valid.any():
                    return None
                whole = np.where(valid[:, None, None], values, np.eye(3))
                first = Rotation.from_matrix(whole[np.argmax(valid)])
                turned = (first.inv() * Rotation.from_matrix(whole)).as_rotvec()
                values = np.where(valid[:, None], size * turned, np.nan)
            parts.append(values)
        return _thinned(stream.time, np.hstack(parts))
    return None


def _thinned(time: Array, motion: Array) -> tuple[Array, Array] | None:
    """Means over neighbouring samples, without those that are missing."""
    whole = np.isfinite(motion).all(axis=1)
    time, motion = time[whole], motion[whole]
    if len(time) < 2 or time[-1] - time[0] < _SHORTEST:
        return None
    step = max(1, round((len(time) - 1) / (time[-1] - time[0]) / _RATE))
    count = len(time) // step
    means = motion[: count * step].reshape(count, step, -1).mean(axis=1)
    return time[: count * step].reshape(count, step).mean(axis=1) - time[0], means


def _regressors(time: Array, rates: Array) -> Array:
    """A mean, a drift, and two columns for each mode, shape (n, 2 + 2 k)."""
    decayed = np.exp(-np.outer(time, rates[:, 1]))
    phase = 2 * np.pi * np.outer(time, rates[:, 0])
    waves = np.stack([decayed * np.cos(phase), decayed * np.sin(phase)], axis=2)
    drift = np.column_stack([np.ones(len(time)), time - time.mean()])
    return np.hstack([drift, waves.reshape(len(time), -1)])


def _projected(time: Array, motion: Array, rates: Array) -> _Projected:
    """All amplitudes by least squares."""
    A = _regressors(time, rates)
    found, *_ = np.linalg.lstsq(A, motion, rcond=None)
    pairs = found[2:].reshape(len(rates), 2 * motion.shape[1])
    return _Projected(motion - A @ found, np.linalg.norm(pairs, axis=1))


def swing_spectrum(experiment: Experiment, run: Run) -> tuple[Array, Array] | None:
    """Frequencies [Hz] and amplitudes of the motion of a run [m], all components of the pose
    together at the platform's radius, shape (k,) each; None where it is too short, or nothing tells
    it.

    Args:
        experiment: With the run.
        run: Whose winches are locked.
    """
    seen = _motion(experiment, run)
    if seen is None:
        return None
    time, motion = seen
    hertz, power = _spectrum(time, _projected(time, motion, np.zeros((0, 2))).residual)
    shown = hertz <= _HIGHEST / 2
    return hertz[shown], np.sqrt(power[shown])


def _strongest(time: Array, residual: Array) -> float:
    """Frequency at which a residual has most power [Hz]."""
    hertz, power = _spectrum(time, residual)
    power[(hertz > _HIGHEST) | (hertz < 1 / (time[-1] - time[0]))] = 0.0
    return float(hertz[np.argmax(power)])


def _spectrum(time: Array, motion: Array) -> tuple[Array, Array]:
    """Frequencies [Hz], and squares of the amplitudes over all components, shape (k,) each."""
    even = np.linspace(time[0], time[-1], len(time))
    whole = np.column_stack([np.interp(even, time, column) for column in motion.T])
    window = np.hanning(len(even))[:, None]
    found = np.fft.rfft(whole * window, _PADDED * len(even), axis=0) * 2 / window.sum()
    return np.fft.rfftfreq(_PADDED * len(even), even[1] - even[0]), np.sum(
        np.abs(found) ** 2, axis=1
    )


def _refined(time: Array, motion: Array, rates: Array) -> tuple[Array, _Projected]:
    """Frequencies [Hz] and decays [1/s] of all modes together."""
    narrow = 1 / (time[-1] - time[0])
    low = np.column_stack([rates[:, 0] - narrow, np.full(len(rates), -0.1)])
    high = np.column_stack([rates[:, 0] + narrow, np.full(len(rates), _LARGEST_DECAY)])
    scale = max(float(np.std(motion)), 1e-300)
    found = least_squares(
        lambda x: _projected(time, motion, x.reshape(-1, 2)).residual.ravel() / scale,
        rates.ravel(),
        bounds=(low.ravel(), high.ravel()),
        x_scale=np.tile([narrow, 0.1], len(rates)),
    )
    best = found.x.reshape(-1, 2)
    return best, _projected(time, motion, best)


def _deviations(time: Array, motion: Array, rates: Array, fitted: _Projected) -> Array:
    """1-sigma of the frequencies [Hz], shape (k,), by residuals that are alike for some samples."""
    step = 1e-5
    columns = []
    for place in np.ndindex(rates.shape):
        sides = []
        for sign in (1.0, -1.0):
            moved = rates.copy()
            moved[place] += sign * step
            sides.append(_projected(time, motion, moved).residual.ravel())
        columns.append((sides[0] - sides[1]) / (2 * step))
    if not columns:
        return np.zeros(0)
    J = np.column_stack(columns)
    r = fitted.residual
    alike = float(np.clip(np.sum(r[1:] * r[:-1]) / max(np.sum(r**2), 1e-300), 0.0, 0.99))
    # Components have noise of their own.
    level = np.mean(r**2, axis=0) * len(r) / max(len(r) - 2 - 3 * len(rates), 1)
    each = np.tile(level * (1 + alike) / (1 - alike), len(r))
    inverse = np.linalg.pinv(J.T @ J)
    covariance = inverse @ (J.T @ (each[:, None] * J)) @ inverse
    return np.asarray(np.sqrt(np.diag(covariance))[::2])
