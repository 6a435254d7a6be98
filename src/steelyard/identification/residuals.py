"""What every instrument has read beside what the fit says it should have read, and the platform's
wrench likewise.

For people who look at residuals: nothing is estimated here, the fit's own statements are evaluated
once more.
"""

from __future__ import annotations

from collections.abc import Container, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.dynamics import platform_wrench, wrench_about
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.identification.model.balance import Forces, balance_of, parts_of
from steelyard.identification.model.calibration_parameters import CalibrationValues, clock_of
from steelyard.identification.model.looked_at import looked_at
from steelyard.identification.model.motion_residuals import AT_ONCE
from steelyard.identification.model.motion_segment import Reading, Segment
from steelyard.identification.model.reading_times import reference_clocks
from steelyard.identification.model.sources import Source
from steelyard.identification.model.tensions.carried import carried_tensions
from steelyard.identification.model.tensions.followed import Carried, stretching
from steelyard.identification.samples.prepared import Samples
from steelyard.identification.solve.fit_state import FitState
from steelyard.identification.solve.posterior import Posterior
from steelyard.inertia import Inertia
from steelyard.instruments import Instrument

PLATFORM = "platform"
"""Stands for the instrument where the wrench of all that carries the body is meant."""
_WRENCH = {"force": (slice(0, 3), "N"), "torque": (slice(3, 6), "N m")}
_AXES = ("x", "y", "z")
_ANGLES = ("roll", "pitch", "yaw")


@dataclass(frozen=True, eq=False)
class Residuals:
    """One quantity in one run: n samples of k channels."""

    run: str
    instrument: str
    """Its name, or :data:`PLATFORM`."""
    quantity: str
    unit: str
    channels: tuple[str, ...]
    time: Array
    """Common time [s]; of poses at rest their number; shape (n,)."""
    measured: Array
    """Of a rotation roll, pitch, yaw without jumps [rad], shape (n, k)."""
    predicted: Array
    """Shape (n, k)."""
    residual: Array
    """Measured less predicted; of a rotation as a rotation vector on the right of the predicted
    one; NaN where nothing was read; shape (n, k)."""
    sigma: Array | None
    """1-sigma that the fit takes the readings to have, shape (k,); None: not known."""
    left_out: NDArray[np.bool_]
    """Readings that the fit does not look at, shape (n, k)."""
    static: bool


def residuals(
    posterior: Posterior, body: Inertia | None = None, runs: Container[str] | None = None
) -> Iterator[Residuals]:
    """Readings of an experiment beside what a fit says of them: first the wrench on the platform,
    about its origin, then the instruments, run by run.

    Args:
        posterior: The fit.
        body: The estimate, in the platform frame as it was stated; None: not all of it is
            identifiable, so that what the fit has says what the forces should have been.
        runs: Names of those that are to be shown; None: all.
    """
    experiment, state = posterior.experiment, posterior.fit.state
    if body is not None:
        state = replace(state, parameters=body.about(-experiment.origin).parameters)
    for run in experiment.runs:
        if runs is not None and run.name not in runs:
            continue
        own = _parts_of(posterior, run)
        yield from _forces(experiment, run, own, state)
        yield from _motion(experiment, run, own, state)


def of_motion(posterior: Posterior, sources: Container[Source]) -> Iterator[Residuals]:
    """Readings of motion instruments beside what a fit says of them, run by run.

    Args:
        posterior: The fit.
        sources: Which of them.
    """
    experiment, state = posterior.experiment, posterior.fit.state
    for run in experiment.runs:
        own = _parts_of(posterior, run)
        yield from _motion(experiment, run, own, state, sources)


def of_forces(posterior: Posterior) -> Iterator[Residuals]:
    """The wrench on the platform and the readings of the force instruments beside what a fit says
    of them, run by run.

    Args:
        posterior: The fit.
    """
    for run in posterior.experiment.runs:
        own = _parts_of(posterior, run)
        yield from _forces(posterior.experiment, run, own, posterior.fit.state)


def _parts_of(posterior: Posterior, run: Run) -> list[tuple[Segment, Forces]]:
    """Segments of a run with their forces."""
    return [
        (segment, forces)
        for segment, forces in zip(
            posterior.fit.state.segments, posterior.force_samples, strict=True
        )
        if segment.run == run.name
    ]


def of_samples(
    samples: Samples, parameters: Array, sigma: Array | None = None
) -> Iterator[Residuals]:
    """The wrench of filtered samples beside that of a body.

    Args:
        samples: Of one run.
        parameters: The ten of :data:`steelyard.inertia.LINEAR_PARAMETERS`, shape (10,).
        sigma: 1-sigma of the wrench [N], [N m], shape (6,); None: not known.
    """
    predicted = platform_wrench(parameters, samples.specific_force, samples.omega, samples.alpha)
    nothing = np.zeros(samples.wrench.shape, dtype=bool)
    yield from _wrench(
        samples.run, samples.time, samples.wrench, predicted, sigma, nothing, static=samples.static
    )


def _forces(
    experiment: Experiment, run: Run, own: list[tuple[Segment, Forces]], state: FitState
) -> Iterator[Residuals]:
    """Wrench, then the readings of the force instrument against those nearest to them that balance
    the motion; nothing where nobody reads the forces.
    """
    if all(forces.guessed.all() for _, forces in own):
        return
    assert state.parameters is not None
    segment, force_samples = own[0]
    parts = [
        _looked_at(experiment, segment, part, state)
        for segment, forces in own
        for part in parts_of(experiment, segment, forces, state.calibration)
    ]
    time = np.concatenate([each.time for each in parts])
    wrench = np.concatenate([each.wrench for each in parts])
    over = np.concatenate([each.left_over for each in parts])
    # The noise of the wrench differs from pose to pose; its middle will do for a picture.
    sigma = np.sqrt(np.median(np.concatenate([each.variance for each in parts]), axis=0))
    left_out = np.concatenate([each.left_out for each in parts])
    lost = np.broadcast_to(left_out.any(axis=1, keepdims=True), wrench.shape)
    yield from _wrench(run.name, time, wrench, wrench - over, sigma, lost, static=segment.static)
    corrections = np.concatenate([each.correction for each in parts])
    column = 0
    instrument = experiment.instruments[force_samples.name]
    for quantity, values in force_samples.readings.items():
        place = slice(column, column + values.shape[1])
        column = place.stop
        measured = np.concatenate([forces.readings[quantity] for _, forces in own])
        factor = state.factors.get(segment.label(force_samples.name, quantity), 1.0)
        own_sigma = force_samples.sigma[place] * factor
        correction = corrections[:, place]
        yield Residuals(
            run.name,
            force_samples.name,
            quantity,
            _unit(experiment, instrument, quantity),
            tuple(_channels(experiment, instrument, quantity, values.shape[1])),
            time,
            measured,
            measured - correction,
            correction,
            own_sigma,
            left_out[:, place],
            segment.static,
        )


class _LookedAt(NamedTuple):
    """Of a balance of some samples what is drawn of it: it is much larger itself."""

    time: Array
    """In common time [s], shape (n,)."""
    wrench: Array
    """Shape (n, 6)."""
    left_over: Array
    """Shape (n, 6)."""
    variance: Array
    """Of the noise of the wrench, shape (n, 6)."""
    correction: Array
    """Of the readings, in their units, shape (n, c)."""
    left_out: NDArray[np.bool_]
    """Readings that do not count, shape (n, c)."""


def _looked_at(
    experiment: Experiment, segment: Segment, forces: Forces, state: FitState
) -> _LookedAt:
    """Some samples of a segment."""
    calibration, factors = state.calibration, state.factors
    assert state.parameters is not None
    at = balance_of(experiment, segment, forces, calibration, state.parameters, factors)
    # Of readings only: what the balance itself is off by may come after them.
    sigma, origin = forces.sigmas(segment, factors), experiment.origin
    return _LookedAt(
        _common(experiment, segment, calibration, forces.name, forces.time),
        wrench_about(at.wrench, origin),
        wrench_about(at.left_over, origin),
        np.sum(wrench_about(at.noise.parts, origin) ** 2, axis=2),
        at.correction[:, : sigma.shape[1]] * sigma,
        forces.left_out | forces.guessed,
    )


def _wrench(
    run: str,
    time: Array,
    measured: Array,
    predicted: Array,
    sigma: Array | None,
    left_out: NDArray[np.bool_],
    *,
    static: bool,
) -> Iterator[Residuals]:
    """Force and torque of the wrench on the platform, measured and predicted."""
    for quantity, (place, unit) in _WRENCH.items():
        yield Residuals(
            run,
            PLATFORM,
            quantity,
            unit,
            _AXES,
            time,
            measured[:, place],
            predicted[:, place],
            measured[:, place] - predicted[:, place],
            None if sigma is None else sigma[place],
            left_out[:, place],
            static,
        )


def _motion(
    experiment: Experiment,
    run: Run,
    segments: list[tuple[Segment, Forces]],
    state: FitState,
    sources: Container[Source] | None = None,
) -> Iterator[Residuals]:
    """Readings of the motion instruments, each quantity over all segments of the run; of all
    sources where none are named.
    """
    calibration, levels = state.calibration, state.factors
    nowhere = np.full(len(calibration.calibration_parameters), -1)
    found: dict[Source, list[tuple[Segment, Reading, Carried | None]]] = {}
    for segment, forces in segments:
        carried = carried_tensions(
            experiment, segment, forces, calibration, nowhere, state.parameters, levels
        )
        for reading in segment.readings:
            if sources is not None and reading.source not in sources:
                continue
            pulling = None
            if carried is not None and reading.follows:
                name = reading.source[0]
                pulling = stretching(carried, calibration, name, segment.run, nowhere)
            found.setdefault(reading.source, []).append((segment, reading, pulling))
    for (name, quantity), own in found.items():
        instrument = experiment.instruments[name]
        time = np.concatenate(
            [_common(experiment, a, calibration, name, r.time) for a, r, _ in own]
        )
        residual = np.concatenate([_residual(experiment, a, r, calibration, t) for a, r, t in own])
        values = np.concatenate([r.values for _, r, _ in own])
        segment, reading, _ = own[0]
        k = residual.shape[1]
        sigma = np.full(k, reading.sigma * levels.get(segment.label(name, quantity), 1.0))
        if values.ndim == 3:
            measured, predicted = _angles(values, residual)
            channels: tuple[str, ...] = _ANGLES
        else:
            measured, predicted = values, values - residual
            channels = tuple(_channels(experiment, instrument, quantity, k))
        yield Residuals(
            run.name,
            name,
            quantity,
            _unit(experiment, instrument, quantity),
            channels,
            time,
            measured,
            predicted,
            residual,
            sigma,
            np.zeros(residual.shape, dtype=bool),
            segment.static,
        )


def _residual(
    experiment: Experiment,
    segment: Segment,
    reading: Reading,
    calibration: CalibrationValues,
    pulling: Carried | None,
) -> Array:
    """Measured less predicted, NaN where nothing was read or the segment has no motion, shape (n,
    k).
    """
    references = reference_clocks(experiment, calibration.calibration_parameters, segment)
    parts = []
    for start in range(0, len(reading.time), AT_ONCE):
        times, _, _, linear = looked_at(
            experiment,
            segment,
            reading,
            slice(start, start + AT_ONCE),
            calibration,
            references,
            pulling,
        )
        inside = np.ones(len(times), dtype=bool) if segment.static else segment.holds(times)
        parts.append(np.where(inside[:, None], linear["residual"], np.nan))
    return np.concatenate(parts) if parts else np.zeros((0, 3))


def _angles(rotations: Array, residual: Array) -> tuple[Array, Array]:
    """Roll, pitch, yaw as measured and as predicted [rad], without jumps, shape (n, 3) each."""
    whole = np.isfinite(rotations).all(axis=(1, 2)) & np.isfinite(residual).all(axis=1)
    found = np.full((2, len(rotations), 3), np.nan)
    measured = Rotation.from_matrix(rotations[whole])
    predicted = measured * Rotation.from_rotvec(-residual[whole])
    for i, each in enumerate((measured, predicted)):
        found[i, whole] = np.unwrap(each.as_euler("ZYX")[:, ::-1], axis=0)
    # Either may have jumped alone.
    found[1] += 2 * np.pi * np.round((found[0] - found[1]) / (2 * np.pi))
    return found[0], found[1]


def _common(
    experiment: Experiment, segment: Segment, calibration: CalibrationValues, name: str, time: Array
) -> Array:
    """Common time of samples of an instrument [s]."""
    return (
        time
        if segment.static
        else time - calibration.delay(clock_of(experiment, name), segment.run)
    )


def _unit(experiment: Experiment, instrument: Instrument, quantity: str) -> str:
    found = next(q for q in instrument.quantities(experiment.robot.m) if q.name == quantity)
    return "rad" if found.rotation else found.unit


def _channels(experiment: Experiment, instrument: Instrument, quantity: str, k: int) -> list[str]:
    found = next(q for q in instrument.quantities(experiment.robot.m) if q.name == quantity)
    return list(_ANGLES) if found.rotation else [f"{name}" for name in found.forms[0]][:k]
