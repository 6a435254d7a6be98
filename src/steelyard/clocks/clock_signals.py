"""What the streams of one clock measure of the motion, as smooth functions of its time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.clocks.settings import SMOOTHING, SmoothingSettings
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.motion.state import motion_of_quaternions
from steelyard.rotations import quaternions_of
from steelyard.smoothing import Samples1D, Smoothed, choose_spacing, fit, segments

POSITION, ROTATION, RATE = "position", "rotation", "rate"
FORCE, SPECIFIC_FORCE, LENGTH, POSE = "force", "specific force", "length", "pose"
_KINDS = {
    "position": POSITION,
    "orientation": ROTATION,
    "angular_velocity": RATE,
    "specific_force": SPECIFIC_FORCE,
    "length": LENGTH,
    "tension": FORCE,
    "force": FORCE,
    "torque": FORCE,
}
"""Quantity of an instrument -> what it measures of the motion; any other one is a linear function
of position and rotation."""


@dataclass(frozen=True, eq=False)
class Signal:
    """Samples of one quantity on the clock of its log, finite."""

    time: Array
    """Never decreasing [s], shape (n,)."""
    values: Array
    """Shape (n, k); of rotations quaternions (w, x, y, z) without jumps of sign."""

    def between(self, start: float, end: float) -> Signal:
        """Its samples in an interval."""
        first, last = np.searchsorted(self.time, [start, end])
        return Signal(self.time[first:last], self.values[first:last])

    @cached_property
    def step(self) -> float:
        """Median time between samples [s]."""
        steps = np.diff(self.time)
        return float(np.median(steps[steps > 0])) if np.any(steps > 0) else np.inf


@dataclass(frozen=True, eq=False)
class LogClock:
    """The streams of one clock."""

    instruments: tuple[str, ...]
    signals: Mapping[str, Signal] = field(default_factory=dict)
    """What is measured -> its samples; the densest where several instruments measure the same."""
    forces: bool = False
    """Whether it is the clock of the forces, which defines the time."""

    @property
    def span(self) -> tuple[float, float]:
        """First and last sample that all signals have [s]."""
        signals = self.signals.values()
        return max(each.time[0] for each in signals), min(each.time[-1] for each in signals)


def clocks_of(
    experiment: Experiment, run: Run, settings: SmoothingSettings = SMOOTHING
) -> tuple[LogClock, ...]:
    """The clocks of a run, that of the forces first."""
    groups: dict[tuple[str, str], list[str]] = {}
    for name, stream in run.streams.items():
        # Streams of one file share its clock. Those of one recorder share an error, but each may
        # begin at a time of its own. Names are kept apart from the clocks that are said.
        said = ("clock", stream.clock) if stream.clock is not None else ("own", name)
        groups.setdefault(said, []).append(name)
    reference = experiment.force_instrument(run)
    found = [
        _clock(experiment, run, tuple(names), reference, settings) for names in groups.values()
    ]
    return tuple(sorted((c for c in found if c.signals), key=lambda c: not c.forces))


def _clock(
    experiment: Experiment,
    run: Run,
    names: tuple[str, ...],
    reference: str | None,
    settings: SmoothingSettings,
) -> LogClock:
    """The signals of instruments that share a clock, in platform axes."""
    signals: dict[str, Signal] = {}
    # A command is not where the platform is; what has been measured goes first.
    for name in sorted(names, key=lambda n: experiment.instruments[n].commanded):
        stream = run.streams[name]
        R_platform_instrument = experiment.instruments[name].mounting.rotation
        for quantity, values in stream.values.items():
            flat = values.reshape(len(values), -1)
            use = np.isfinite(flat).all(axis=1) & (np.diff(stream.time, prepend=-np.inf) > 0)
            if use.sum() < settings.fewest:
                continue
            kind, readings = _KINDS.get(quantity, POSE), flat[use]
            if kind == ROTATION:
                readings = quaternions_of(values[use] @ R_platform_instrument.T)
            elif kind in (RATE, SPECIFIC_FORCE):
                # Vectors of the platform's axes; places and tensions have axes of their own.
                readings = readings @ R_platform_instrument.T
            samples, there = Signal(stream.time[use], readings), signals.get(kind)
            if there is not None and kind == FORCE and experiment.is_force(name):
                if len(there.time) == len(samples.time):
                    signals[kind] = Signal(there.time, np.hstack([there.values, samples.values]))
            elif there is None or samples.step < 0.5 * there.step:
                signals[kind] = samples
    return LogClock(names, signals, reference in names)


@dataclass(frozen=True, eq=False)
class Smooth:
    """A signal as a smooth function of time, NaN where it has none."""

    parts: Sequence[tuple[float, float, Smoothed]]
    width: int

    def at(self, time: Array, order: int = 0) -> Array:
        """Value or derivative, shape (n, k)."""
        found = np.full((len(time), self.width), np.nan)
        for start, end, spline in self.parts:
            inside = (time >= start) & (time <= end)
            found[inside] = spline.at(time[inside], order)
        return found


def smooth(
    signal: Signal, start: float, end: float, settings: SmoothingSettings = SMOOTHING
) -> Smooth:
    """Fit a signal over an interval, but for its gaps."""
    own = signal.between(start, end)
    width = signal.values.shape[1]
    if len(own.time) < settings.fewest:
        return Smooth((), width)
    start, end = float(own.time[0]), float(own.time[-1])
    candidates = settings.spacings(2 * own.step)
    finest = candidates[0]
    samples = Samples1D(own.time, own.values)
    # Judged on the longest stretch without a gap; uneven sampling alone makes none.
    stretches = segments([own.time], start, end, max(finest, settings.bridged))
    longest = max(stretches, key=lambda s: s[1] - s[0])
    spacing = choose_spacing([samples], candidates, *longest, robust=True)
    parts = []
    for a, b in segments([own.time], start, end, spacing):
        fitted = fit(samples, a, b, spacing, robust=True)
        if fitted is not None and b - a > 2 * spacing:
            # The ends of a spline are poor where derivatives are asked for.
            parts.append((a + spacing, b - spacing, fitted))
    return Smooth(tuple(parts), width)


class ClockSignals:
    """Signals of a clock as smooth functions over an interval of its time."""

    def __init__(
        self,
        clock: LogClock,
        start: float,
        end: float,
        settings: SmoothingSettings = SMOOTHING,
    ) -> None:
        self.clock, self.start, self.end, self.settings = clock, start, end, settings
        self._smooth: dict[str, Smooth] = {}

    def has(self, *kinds: str) -> bool:
        """Whether the clock has all of these signals."""
        return all(kind in self.clock.signals for kind in kinds)

    def samples(self, kind: str) -> Signal:
        """Raw samples within the interval."""
        return self.clock.signals[kind].between(self.start, self.end)

    def at(self, kind: str, time: Array, order: int = 0) -> Array:
        """Smooth value or derivative, shape (n, k)."""
        if kind not in self._smooth:
            signal = self.clock.signals[kind]
            self._smooth[kind] = smooth(signal, self.start, self.end, self.settings)
        return self._smooth[kind].at(time, order)

    def turning(self, time: Array) -> tuple[Array, Array, Array]:
        """R, shape (n, 3, 3), angular velocity and its derivative in the turning frame, shape (n,
        3).
        """
        derivatives = [self.at(ROTATION, time, order) for order in range(3)]
        valid = np.isfinite(derivatives[0]).all(axis=1)
        R = np.full((len(time), 3, 3), np.nan)
        omega, alpha = np.full((2, len(time), 3), np.nan)
        if valid.any():
            known = [each[valid] for each in derivatives]
            motion = motion_of_quaternions(*known)
            R[valid] = Rotation.from_quat(known[0], scalar_first=True).as_matrix()
            omega[valid], alpha[valid] = motion["omega"], motion["alpha"]
        return R, omega, alpha
