"""A part of one run as all instruments saw it: every quantity smooth, on one time base, as its log
has it.

This is what descriptions are compared with: it is quick to change a sign or an axis in it and
look again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from steelyard.arrays import Array, binned_means
from steelyard.experiment.equivalent.platform_frame import near
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.identification.model.calibration_parameters import clock_of
from steelyard.identification.model.sources import Source
from steelyard.inspection.agreements.settings import AGREEMENT, AgreementSettings, ExcerptSettings
from steelyard.instruments import Instrument
from steelyard.robot.model import Robot
from steelyard.smoothing import Samples1D, fit, segments

_FEWEST = 4
"""Complete samples of a quantity that is looked at."""


@dataclass(frozen=True, eq=False)
class Observation:
    """One quantity at n instants, in the axes and units that the log is said to have."""

    value: Array
    """Shape (n, k), or (n, 3, 3) of rotations."""
    rate: Array
    """Its derivative [1/s]."""
    bend: Array
    """The second one [1/s^2]."""
    noise: tuple[float, float, float]
    """1-sigma of the noise left in each of the three, of one number."""
    spline: BSpline | None = None
    """None of poses at rest."""
    span: tuple[float, float] = (-np.inf, np.inf)
    """Of the spline, on common time [s]."""

    def mapped(self, matrix: Array) -> Observation:
        """Vectors in other axes or units: ``matrix`` times them."""
        # One channel in another unit says nothing of the noise of the others.
        size = float(np.median(np.sqrt(np.sum(matrix**2, axis=1))))
        value, rate, bend = self.noise
        noise = (size * value, size * rate, size * bend)
        return replace(self.through(lambda vectors: vectors @ matrix.T), noise=noise)

    def through(self, linear: Callable[[Array], Array]) -> Observation:
        """A linear function of it, which its derivatives follow alike."""
        value, rate, bend = linear(self.value), linear(self.rate), linear(self.bend)
        return replace(self, value=value, rate=rate, bend=bend)

    def later(self, times: Array, delay: float) -> Observation:
        """At instants of common time, of a stream that is late; beyond its ends it stays as it was
        there: see :meth:`.Excerpt.delayed`.
        """
        if self.spline is None:
            return self
        at, columns = np.clip(times + delay, *self.span), self.value[0].size
        shape = self.value.shape
        value, rate, bend = (
            self.spline(at, nu=order)[:, :columns].reshape(shape) for order in range(3)
        )
        return replace(self, value=value, rate=rate, bend=bend)


@dataclass(frozen=True, eq=False)
class Excerpt:
    """A part of one run, as it is described."""

    experiment: Experiment
    run: Run
    time: Array
    """Common time [s], shape (n,); of poses at rest their numbers."""
    robot: Robot
    instruments: Mapping[str, Instrument]
    observations: Mapping[Source, Observation]
    spacing: float
    """Of the knots [s]; 0 of poses at rest."""
    unread: frozenset[int] = frozenset()
    """Cables whose sensors are not believed."""
    settings: AgreementSettings = AGREEMENT
    """What accounts of the motion may differ by."""

    @property
    def static(self) -> bool:
        """Whether these are poses at rest."""
        return self.run.static

    def with_observations(self, changed: Mapping[Source, Observation]) -> Excerpt:
        """With other readings."""
        return replace(self, observations={**self.observations, **changed})

    def with_instrument(self, name: str, **keys: object) -> Excerpt:
        """With another description of one instrument."""
        changed = self.instruments[name].model_copy(update=keys)
        return replace(self, instruments={**self.instruments, name: changed})

    def delayed(self, delays: Mapping[str, float]) -> Excerpt:
        """With instruments at times that are later [s], as long as they read then."""
        moved = {s: each for s, each in self.observations.items() if s[0] in delays}
        later = self.with_observations(
            {source: each.later(self.time, delays[source[0]]) for source, each in moved.items()}
        )
        if self.static:
            return later
        first = max((each.span[0] - delays[s[0]] for s, each in moved.items()), default=-np.inf)
        last = min((each.span[1] - delays[s[0]] for s, each in moved.items()), default=np.inf)
        return later.within(first - self.spacing, last + self.spacing)

    def within(self, first: float, last: float) -> Excerpt:
        """The part of it from one instant of common time to another [s]; the very same where that
        is all.
        """
        use = (self.time >= first) & (self.time <= last)
        if use.all():
            return self
        return replace(
            self,
            time=self.time[use],
            observations={
                source: replace(
                    each, value=each.value[use], rate=each.rate[use], bend=each.bend[use]
                )
                for source, each in self.observations.items()
            },
        )

    @property
    def window(self) -> tuple[float, float]:
        """Part of a run in motion that is looked at, within the run's own [s]."""
        first, last = self.run.window or (-np.inf, np.inf)
        start, end = float(self.time[0]) - self.spacing, float(self.time[-1]) + self.spacing
        return max(start, first), min(end, last)

    def quantity(self, quantity: str) -> list[Source]:
        """All readings of one quantity, measured ones before commanded ones."""
        found = [source for source in self.observations if source[1] == quantity]
        return sorted(found, key=lambda source: self.instruments[source[0]].commanded)

    def refitted(self, source: Source, values: Array) -> Observation:
        """Other samples of a quantity, smoothed like those that are there.

        Args:
            source: Instrument and quantity.
            values: At the samples of its stream, shape (n, …).
        """
        if self.static:
            return _at_rest(values)
        common = self.experiment.common_time(self.run, source[0])
        found = _smoothed(common, values, self.time, self.spacing, self.settings.excerpt)
        return self.observations[source] if found is None else found


def excerpt_of(
    experiment: Experiment, run: Run, settings: AgreementSettings = AGREEMENT
) -> Excerpt | None:
    """Look at the liveliest part of a run, in the platform frame of :func:`.near`; None where its
    streams have too little in common.

    Args:
        experiment: With its instruments.
        run: One of its runs.
        settings: With the part of a run that is looked at.
    """
    experiment = near(replace(experiment, runs=(run,)))
    (run,) = experiment.runs
    if run.static:
        return _poses(experiment, run, settings)
    times = {name: experiment.common_time(run, name) for name in run.streams}
    part = _part(run, times, settings.excerpt)
    if part is None:
        return None
    start, end, spacing = part
    count = min(settings.excerpt.most, int(2 * (end - start) / spacing))
    inside = np.linspace(start + spacing / 2, end - spacing / 2, count)
    seen = {}
    for name, stream in run.streams.items():
        for quantity, values in stream.values.items():
            found = _smoothed(times[name], values, inside, spacing, settings.excerpt)
            if found is not None:
                seen[name, quantity] = found
    robot, instruments = experiment.robot, experiment.instruments
    return Excerpt(experiment, run, inside, robot, instruments, seen, spacing, settings=settings)


def _part(
    run: Run, times: Mapping[str, Array], settings: ExcerptSettings
) -> tuple[float, float, float] | None:
    """Beginning, end and spacing of the knots of what is looked at [s]."""
    first, last = run.window or (-np.inf, np.inf)
    # Cells of a log that are empty for a while are a gap as missing rows are: no spline is to be
    # looked at across it.
    read = [
        times[name][complete]
        for name, stream in run.streams.items()
        for values in stream.values.values()
        if (complete := _complete(values)).sum() >= _FEWEST
    ]
    if not read:
        return None
    start = max(first, *(float(t[0]) for t in read))
    end = min(last, *(float(t[-1]) for t in read))
    if end - start < settings.shortest:
        return None
    steps = [float(np.median(np.diff(t))) for t in read]
    spacing = max(settings.finest, settings.samples_per_knot * max(steps))
    parts = segments(read, start, end, spacing)
    if not parts:
        return None
    start, end = max(parts, key=lambda part: part[1] - part[0])
    if end - start > settings.longest:
        start = _liveliest(run, times, start, end, settings)
        end = start + settings.longest
    enough = end - start > max(settings.shortest, settings.fewest_knots * spacing)
    return (start, end, spacing) if enough else None


def _complete(values: Array) -> NDArray[np.bool_]:
    """Samples of a quantity of which nothing is missing, shape (n,)."""
    return np.asarray(np.isfinite(values.reshape(len(values), -1)).all(axis=1))


def _liveliest(
    run: Run, times: Mapping[str, Array], start: float, end: float, settings: ExcerptSettings
) -> float:
    """Where most happens within a long interval [s]."""
    edges = np.arange(start, end, settings.bin)
    happens = np.zeros(len(edges))
    for name, stream in run.streams.items():
        for values in stream.values.values():
            flat = np.nan_to_num(values.reshape(len(values), -1))
            bins = np.searchsorted(edges, times[name], side="right") - 1
            use = (bins >= 0) & (times[name] <= end)
            scale = float(flat[use].std()) or 1.0
            mean, _ = binned_means(bins[use], flat[use] / scale, len(edges))
            happens[1:] += np.sum(np.diff(mean, axis=0) ** 2, axis=1)
    width = int(settings.longest / settings.bin)
    total = np.concatenate([[0.0], np.cumsum(np.minimum(happens, 25 * np.median(happens) + 1e-12))])
    if len(total) <= width:
        return start
    return float(edges[int(np.argmax(total[width:] - total[:-width]))])


def _smoothed(
    time: Array, values: Array, inside: Array, spacing: float, settings: ExcerptSettings
) -> Observation | None:
    """One quantity at instants; None where its samples do not determine it."""
    complete = _complete(values)
    if complete.sum() < _FEWEST:
        return None
    time, flat = time[complete], values.reshape(len(values), -1)[complete]
    for margin in (settings.margin, spacing):
        start, end = max(time[0], inside[0] - margin), min(time[-1], inside[-1] + margin)
        if end <= start:
            continue
        found = fit(Samples1D(time, flat), start, end, spacing, robust=True)
        if found is None:
            continue
        shape = (len(inside), *values.shape[1:])
        at = np.clip(inside, start, end)
        value, rate, bend = (found.at(at, order).reshape(shape) for order in range(3))
        noise = found.noise(at, 0), found.noise(at, 1), found.noise(at, 2)
        return Observation(value, rate, bend, noise, found.spline, (start, end))
    return None


def _poses(experiment: Experiment, run: Run, settings: AgreementSettings) -> Excerpt | None:
    """Poses at rest that all instruments have read; None of too few."""
    everything = [
        v.reshape(len(v), -1) for stream in run.streams.values() for v in stream.values.values()
    ]
    rows = np.all([np.isfinite(v).all(axis=1) for v in everything], axis=0)
    if rows.sum() < 3:
        return None
    seen = {
        (name, quantity): _at_rest(values[rows])
        for name, stream in run.streams.items()
        for quantity, values in stream.values.items()
    }
    numbers = np.flatnonzero(rows).astype(np.float64)
    robot, instruments = experiment.robot, experiment.instruments
    return Excerpt(experiment, run, numbers, robot, instruments, seen, 0.0, settings=settings)


def _at_rest(values: Array) -> Observation:
    nothing = np.zeros_like(values)
    return Observation(values, nothing, nothing, (0.0, 0.0, 0.0))


def instruments_by_clock(experiment: Experiment, run: Run) -> list[tuple[str, ...]]:
    """Instruments of a run that share a clock."""
    shared: dict[str, list[str]] = {}
    for name in run.streams:
        shared.setdefault(clock_of(experiment, name), []).append(name)
    return [tuple(names) for names in shared.values()]


def excerpts(
    experiment: Experiment, most: int, settings: AgreementSettings = AGREEMENT
) -> Sequence[Excerpt]:
    """Of a few runs: those in motion first, spread over the experiment."""
    moving = [run for run in experiment.runs if not run.static]
    places = np.linspace(0, len(moving) - 1, min(most, len(moving))).round().astype(np.int64)
    still = [run for run in experiment.runs if run.static][:1]
    chosen = [*(moving[i] for i in places), *still]
    found = (excerpt_of(experiment, run, settings) for run in chosen)
    return [each for each in found if each is not None]
