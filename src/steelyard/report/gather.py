"""From an identification to what a report shows of it: readings are thinned here, and nowhere
else.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.clocks.offsets import Offset
from steelyard.errors import InputError
from steelyard.estimates.estimate import Estimate
from steelyard.experiment.model import Experiment
from steelyard.identification.identify import Identification
from steelyard.identification.model.calibration_parameters import LAG, ROBOT, clock_of
from steelyard.identification.model.preparation import Samples, prepare
from steelyard.identification.residuals import Explained, explained, of_samples
from steelyard.identification.solve.joint_study import Joint
from steelyard.identification.solve.normal_equations import TEN
from steelyard.identification.solve.study import Study
from steelyard.inertia import BODY_PARAMETERS
from steelyard.report.evidence import (
    Body,
    Clock,
    Error,
    Evidence,
    Motion,
    Noise,
    Number,
    Shape,
    Spectrum,
    Test,
    Trace,
)
from steelyard.robot.model import Robot

MOST_RUNS = 8
"""Of which readings and motion are kept."""
_MOST_NUMBERS = 200_000
"""In all traces together."""
_FEWEST_POINTS, _MOST_POINTS = 60, 2000
"""Of a trace."""
_MOST_INSTANTS = 600
"""Of a motion."""
_INSTANTS_A_SECOND = 20.0
_OUTLYING = 5.0
"""1-sigma."""
_SEGMENTS, _LEAST_SEGMENT, _SEGMENT = 8, 64, 512
"""Stretches that a spectrum is the mean of, and least and largest number of samples of one."""
_MOST_MISSING = 0.1
_JITTER = 0.5
"""Part of the sampling interval by which intervals may differ where a spectrum is to mean
something."""


def body_of(name: str, estimate: Estimate) -> Body:
    """An estimate as plain values.

    Args:
        name: Heading of its column.
        estimate: With NaN where the data cannot tell.
    """
    verdict = estimate.verdict
    return Body(
        name,
        estimate.method,
        numbers(estimate.value),
        tuple(numbers(row) for row in estimate.covariance),
        tuple(verdict.parameters.get(each, "data") for each in BODY_PARAMETERS),
        verdict.accepted,
        verdict.reasons,
    )


def evidence_of(identification: Identification) -> Evidence:
    """What the estimate rests on, thinned for display.

    Args:
        identification: As :func:`steelyard.identification.identify.identify` gives it; one that
            does not know what it was made of has nothing to show.
    """
    experiment = identification.recorded
    if experiment is None:
        return Evidence()
    shown = replace(experiment, runs=experiment.runs[:MOST_RUNS])
    estimate = identification.estimate
    study = _study_of(identification)
    samples = study.samples if study else _prepared(shown)
    names = {run.name for run in shown.runs}
    return Evidence(
        shape=shape_of(experiment.robot),
        motions=tuple(m for s in samples if s.run in names for m in _motion(s)),
        traces=tuple(_traces(_explained(identification, shown, estimate, samples))),
        noise=tuple(_noise(experiment, estimate)),
        errors=tuple(_errors(study)) if study else (),
        tests=tuple(
            Test(t["name"], t["z"], t["size"], t["unit"])
            for t in estimate.details.get("directed_tests", {}).get("largest", ())
        ),
        clocks=tuple(_clocks(identification, study)) if study else (),
        contacts=tuple(
            (run, float(start), float(end))
            for run, found in estimate.details.get("left_out", {}).get("contacts", {}).items()
            for start, end in found
        ),
        not_drawn=len(experiment.runs) - len(shown.runs),
    )


def numbers(values: Array | Sequence[float], digits: int = 17) -> tuple[Number, ...]:
    """Values as plain numbers of so many digits, None where there is none."""
    return tuple(float(f"{v:.{digits}g}") if np.isfinite(v) else None for v in values)


def _study_of(identification: Identification) -> Study | None:
    fitted = identification.fitted
    return fitted.study if isinstance(fitted, Joint) else fitted


def _prepared(experiment: Experiment) -> list[Samples]:
    """Samples as the two steps take them, of the runs that have what they need."""
    found = []
    for run in experiment.runs:
        try:
            found.append(prepare(experiment, run, straight=True))
        except InputError:
            continue
    return found


def _explained(
    identification: Identification,
    shown: Experiment,
    estimate: Estimate,
    samples: Sequence[Samples],
) -> Iterator[Explained]:
    parameters = estimate.body.parameters if estimate.body else np.full(TEN, np.nan)
    if identification.fitted is not None:
        yield from explained(shown, identification.fitted, parameters)
    elif estimate.body:
        for each in samples:
            yield from of_samples(each, parameters)


def shape_of(robot: Robot) -> Shape | None:
    """A robot as it is drawn; None without cables."""
    if not robot.m:
        return None
    return Shape(robot.name, _vectors(robot.anchors), _vectors(robot.attachments))


def _vectors(rows: Array) -> tuple[tuple[float, float, float], ...]:
    return tuple((float(x), float(y), float(z)) for x, y, z in rows)


def _motion(samples: Samples) -> Iterator[Motion]:
    """Where the platform was; nothing where no instrument tells it."""
    if samples.position is None or samples.rotation is None or not len(samples):
        return
    length = float(samples.time[-1] - samples.time[0])
    most = len(samples) if samples.static else max(2, int(length * _INSTANTS_A_SECOND))
    few = np.unique(
        np.linspace(0, len(samples) - 1, min(len(samples), most, _MOST_INSTANTS)).astype(int)
    )
    turned = Rotation.from_matrix(samples.rotation[few]).as_quat(scalar_first=True, canonical=True)
    yield Motion(
        samples.run,
        samples.static,
        tuple(_round(samples.time[few], 7)),
        tuple(
            (x, y, z)
            for x, y, z in zip(*(_round(c, 6) for c in samples.position[few].T), strict=True)
        ),
        tuple((w, x, y, z) for w, x, y, z in zip(*(_round(c, 6) for c in turned.T), strict=True)),
    )


def _round(values: Array, digits: int) -> list[float]:
    return [float(f"{v:.{digits}g}") for v in values]


def _traces(found: Iterator[Explained]) -> list[Trace]:
    every = [each for each in found if len(each.time)]
    width = sum(2 * each.measured.shape[1] + 1 for each in every)
    most = int(np.clip(_MOST_NUMBERS / max(width, 1), _FEWEST_POINTS, _MOST_POINTS))
    return [_trace(each, most) for each in every]


def _trace(each: Explained, most: int) -> Trace:
    used = np.isfinite(each.residual) & ~each.left_out
    scaled = np.where(used, each.residual, 0.0) / _scale(each)
    beyond = (np.abs(scaled) > _OUTLYING) if each.sigma is not None else np.zeros_like(used)
    few = thinned(
        np.where(np.isfinite(each.residual), np.abs(each.residual) / _scale(each), 0.0), most
    )
    left_out = each.left_out[few]
    return Trace(
        each.run,
        each.instrument,
        each.quantity,
        each.unit,
        each.channels,
        each.static,
        len(each.time),
        tuple(_round(each.time[few], 8)),
        tuple(numbers(column, 6) for column in each.measured[few].T),
        tuple(numbers(column, 4) for column in each.residual[few].T),
        None if each.sigma is None else tuple(_round(each.sigma, 5)),
        tuple(_rms(column[rows]) for column, rows in zip(each.residual.T, used.T, strict=True)),
        float(f"{np.abs(scaled).max(initial=0.0):.4g}") if each.sigma is not None else None,
        int(np.sum(beyond | each.left_out)),
        tuple((int(channel), int(sample)) for sample, channel in np.argwhere(left_out)),
        _spectrum(each, used, scaled),
    )


def _scale(each: Explained) -> Array | float:
    return 1.0 if each.sigma is None else np.maximum(each.sigma, 1e-300)


def _rms(values: Array) -> Number:
    return float(f"{np.sqrt(np.mean(values**2)):.4g}") if len(values) else None


def thinned(size: Array, most: int) -> NDArray[np.intp]:
    """Places to keep of n samples: of each stretch its first one and the one that stands out most,
    in order.

    Args:
        size: How far each channel stands out, shape (n, k).
        most: How many to keep about.
    """
    n = len(size)
    if n <= most:
        return np.arange(n)
    edges = np.linspace(0, n, max(1, most // 2) + 1).astype(int)
    largest = size.max(axis=1)
    out = [first + int(np.argmax(largest[first:last])) for first, last in pairwise(edges)]
    return np.unique(np.concatenate([edges[:-1], out, [n - 1]]))


def _spectrum(each: Explained, used: NDArray[np.bool_], scaled: Array) -> Spectrum | None:
    """Of residuals that came at about even times; None where they did not, or are few."""
    step = np.diff(each.time)
    if each.static or len(step) < 32 or used.mean() < 1 - _MOST_MISSING:
        return None
    middle = float(np.median(step))
    if middle <= 0 or np.quantile(np.abs(step - middle), 0.9) > _JITTER * middle:
        return None
    level = 1.0 if each.sigma is not None else np.maximum(np.mean(scaled**2, axis=0), 1e-300)
    frequency, density = welch(
        scaled,
        1 / middle,
        nperseg=min(len(scaled), max(_LEAST_SEGMENT, min(_SEGMENT, len(scaled) // _SEGMENTS))),
        axis=0,
        detrend=False,
    )
    # One-sided: white noise of unit variance has the density two over the rate.
    power = np.mean(density / (2 * middle) / level, axis=1)
    return Spectrum(tuple(_round(frequency[1:], 5)), tuple(_round(np.maximum(power[1:], 1e-12), 4)))


def _noise(experiment: Experiment, estimate: Estimate) -> Iterator[Noise]:
    for name, quantities in estimate.details.get("noise", {}).items():
        units = {
            q.name: "rad" if q.rotation else q.unit
            for q in experiment.instruments[name].quantities(experiment.robot.m)
        }
        for quantity, found in quantities.items():
            unit = next((u for key, u in units.items() if quantity.startswith(key)), "")
            yield Noise(
                name, quantity, unit, *(_number(found[key]) for key in ("stated", "used", "found"))
            )


def _number(value: float | None) -> Number:
    return None if value is None or not np.isfinite(value) else float(value)


def _deviations(study: Study) -> Array:
    """1-sigma of all systematic errors, shape (u,)."""
    return np.asarray(np.sqrt(np.maximum(np.diag(study.solution.covariance)[TEN:], 0.0)))


def _errors(study: Study) -> Iterator[Error]:
    """All that was not known exactly and is no clock, instruments and robot."""
    calibration_parameters, deviations = (
        study.calibration.calibration_parameters,
        _deviations(study),
    )
    for (place, unknown, _), name in zip(
        calibration_parameters.components(), calibration_parameters.names, strict=True
    ):
        prior = float(calibration_parameters.deviation[place])
        if not prior or unknown.key in {"delay", LAG} or unknown.owner == ROBOT:
            continue
        yield Error(
            unknown.owner,
            name.removeprefix(f"{unknown.owner}."),
            unknown.unit,
            float(study.calibration.values[place]),
            float(deviations[place]),
            float(calibration_parameters.mean[place]),
            prior,
        )


def _clocks(identification: Identification, study: Study) -> Iterator[Clock]:
    experiment, calibration_parameters, deviations = (
        study.experiment,
        study.calibration.calibration_parameters,
        _deviations(study),
    )
    runs = {run.name: run for run in experiment.runs}
    for place, unknown, _ in calibration_parameters.components():
        if unknown.key != "delay" or unknown.run is None:
            continue
        own = [
            name
            for name in runs[unknown.run].streams
            if clock_of(experiment, name) == unknown.owner
        ]
        prior = float(calibration_parameters.deviation[place])
        yield Clock(
            unknown.run,
            ", ".join(own),
            float(study.calibration.values[place]),
            float(deviations[place]) if prior else 0.0,
            prior,
            _found(identification.clocks, unknown.run, own),
        )


def _found(clocks: Mapping[str, tuple[Offset, ...]], run: str, instruments: Sequence[str]) -> str:
    """How far a clock was found to be from that of the forces before the fit."""
    offsets = clocks.get(run, ())
    for each in offsets:
        if set(each.instruments) & set(instruments):
            return f"{each.value:+.4f} s ± {each.sigma * 1e3:.1f} ms"
    return ""
