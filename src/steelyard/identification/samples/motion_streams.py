"""What is read of the motion along a run: streams one by one, and the stretches in which they tell
it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.identification.model.calibration_parameters import CalibrationValues, clock_of
from steelyard.identification.model.settings import MotionSettings
from steelyard.identification.samples.prepared import Samples
from steelyard.instruments.base import Part
from steelyard.instruments.equations import order_of
from steelyard.instruments.noise import Disturbance


@dataclass(frozen=True, eq=False)
class MotionStream:
    """One quantity of one instrument over a run."""

    source: tuple[str, str]
    time: Array
    """By its clock, moved to the common event [s]."""
    common: Array
    """Common time [s]."""
    values: Array
    sigma: float | None
    unit: str
    order: int
    """Highest derivative of the motion that it reads."""
    determines: tuple[Part, ...]
    """Parts of the motion that follow from it."""
    needs_tension: bool = False
    disturbed: tuple[Disturbance, ...] = ()
    """Errors that go on for a while, as stated."""
    mean_of: int = 1
    """Samples that each of these is the mean of."""

    @property
    def step(self) -> float:
        """Between samples [s]."""
        return float(np.median(np.diff(self.common))) if len(self.common) > 1 else 1.0


def motion_streams(
    experiment: Experiment,
    run: Run,
    calibration: CalibrationValues,
    samples: Samples,
    settings: MotionSettings,
) -> Iterator[MotionStream]:
    """What is read of the motion; a command stands in for a place that nothing measures."""
    told = {
        quantity
        for name, stream in run.streams.items()
        if experiment.instruments[name].is_motion or experiment.instruments[name].is_cable_motion
        for quantity in stream.values
    }
    missing = {"position"} if not told & {"position", "length"} else set[str]()
    missing |= {"orientation"} if "orientation" not in told else set[str]()
    for name, stream in run.streams.items():
        instrument = experiment.instruments[name]
        stands_in = (
            instrument.commanded
            and not instrument.is_measurement
            and bool(missing)
            and experiment.robot.m > 0
        )
        looks_at_cables = instrument.is_cable_motion and samples.tension is not None
        if not (instrument.is_motion or stands_in or looks_at_cables):
            continue
        time = experiment.common_time(run, name, 0.0)
        common = time - calibration.delay(clock_of(experiment, name), run.name)
        for quantity in instrument.quantities(experiment.robot.m):
            values = stream.values.get(quantity.name)
            if values is None or (stands_in and quantity.name not in missing):
                continue
            flat = np.isfinite(values.reshape(len(values), -1))
            use = flat.all(axis=1) if values.ndim == 3 else flat.any(axis=1)
            if run.window is not None:
                use &= (common >= run.window[0] - 1.0) & (common <= run.window[1] + 1.0)
            sigma = quantity.noise / stream.mean_of**0.5 if quantity.noise else None
            if stands_in:
                # It is wrong for a while where it is wrong: as much is known as few independent
                # readings tell.
                step = float(np.median(np.diff(common))) if len(common) > 1 else 1.0
                sigma = (
                    _commanded(quantity.name, settings)
                    * max(1.0, 1 / (settings.commanded_rate * max(step, 1e-6))) ** 0.5
                )
            yield MotionStream(
                (name, quantity.name),
                time[use],
                common[use],
                values[use],
                sigma,
                quantity.unit,
                order_of(instrument, quantity.name, experiment.robot),
                # What nobody reads bridges no gap.
                () if instrument.stands_in(experiment.robot.m) else quantity.determines,
                looks_at_cables,
                quantity.disturbed,
                stream.mean_of,
            )


def _commanded(quantity: str, settings: MotionSettings) -> float:
    """1-sigma of a command that stands in for a measurement [m] or [rad]."""
    place = quantity == "position"
    return settings.commanded_position if place else settings.commanded_orientation


def steps_of(streams: Sequence[MotionStream]) -> dict[str, float]:
    """Part of the pose -> time between samples of the fastest instrument that tells it [s]."""
    steps = {}
    for part in ("rotation", "position"):
        own = [
            float(np.median(np.diff(s.common)))
            for s in streams
            if part in s.determines and len(s.common) > 1
        ]
        steps[part] = min(own, default=0.0)
    return steps


def stretches_of(
    run: Run, streams: Sequence[MotionStream], forces: Array, settings: MotionSettings
) -> tuple[list[tuple[float, float]], list[str]]:
    """Stretches of common time [s] in which rotation and translation are told all along, and notes
    of what is not.
    """
    start, end = float(forces[0]), float(forces[-1])
    if run.window is not None:
        start, end = max(start, run.window[0]), min(end, run.window[1])
    notes = []
    groups = [
        [s for s in streams if "rotation" in s.determines],
        [s for s in streams if "position" in s.determines],
    ]
    parts = [(start, end)]
    for group in groups:
        if not group:
            continue
        times = np.unique(np.concatenate([s.common for s in group]))
        step = min(float(np.median(np.diff(s.common))) for s in group if len(s.common) > 1)
        own = unbroken(times, max(settings.gap, 5 * step))
        parts = [(max(a, c), min(b, d)) for a, b in parts for c, d in own if min(b, d) > max(a, c)]
    for stream in streams:
        for a, b in _holes(stream.common, start, end, settings.gap):
            notes.append(
                f"run '{run.name}': {stream.source[0]} has no {stream.source[1].replace('_', ' ')}"
                f" from {a:.2f} to {b:.2f} s"
            )
    return [(a, b) for a, b in parts if b - a >= settings.shortest], notes


def unbroken(times: Array, gap: float) -> list[tuple[float, float]]:
    """Where times follow each other without a longer gap.

    Args:
        times: Never decreasing [s], shape (n,), at least one.
        gap: Longest that is none [s].
    """
    breaks = np.flatnonzero(np.diff(times) > gap)
    edges = [times[0], *(t for i in breaks for t in (times[i], times[i + 1])), times[-1]]
    return [(float(a), float(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _holes(times: Array, start: float, end: float, gap: float) -> list[tuple[float, float]]:
    inside = times[(times >= start) & (times <= end)]
    if len(inside) < 2:
        return []
    steps = np.diff(inside)
    return [
        (float(inside[i]), float(inside[i + 1]))
        for i in np.flatnonzero(steps > max(gap, 5 * float(np.median(steps))))
    ]
