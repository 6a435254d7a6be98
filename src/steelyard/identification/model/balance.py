r"""The balance of wrenches over samples, linear in all that is unknown.

What carries the platform must equal what moves it: ``wrench(readings, errors) = Y phi``. About the
present values of the systematic errors that is one linear equation per sample, ``wrench_0 = Y phi -
D d + noise``, with D the derivative of ``wrench - Y phi`` by the errors d. Every classical method
solves these rows; every directed test looks at one column of D.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.dynamics import platform_regressor, platform_wrench
from steelyard.experiment.model import Experiment, Run
from steelyard.identification.model.calibration_parameters import ROBOT, Calibration, clock_of
from steelyard.identification.model.preparation import Samples, prepare
from steelyard.identification.model.sources import choose_sources
from steelyard.instruments import Quantity
from steelyard.instruments.equations import sensitivity, sensitivity_to
from steelyard.robot.cable_inertia import cable_inertia_wrench
from steelyard.robot.geometry import WrenchByGeometry, wrench_by_geometry

_MOST_DRAWS = 4
_DRAWN_SAMPLES = 20_000
_TYPICAL_SIZE = 1e-12
_LEAST_NOISE = 1e-3
"""Of force readings whose noise is not stated, as a part of the largest: no sensor is described
better."""
_NOISE_AT_REST = 10.0
"""First guess of the noise of readings of which each stands alone, in units of the least."""


@dataclass(frozen=True, eq=False)
class Balance:
    """The equations of one run, n samples."""

    samples: Samples
    sigma: Array
    """1-sigma of single readings of the force instrument, shape (r,)."""
    by_reading: Array
    """How the wrench follows those readings, shape (n, 6, r)."""
    by_errors: Array
    """Derivative of the wrench by the errors of the force instrument, shape (n, 6, e)."""
    places: NDArray[np.intp]
    """Where these errors stand in the vector of all systematic errors, shape (e,)."""
    turnaround: Array | None = None
    """Variance that the noise left in velocities brings into tensions read behind rollers [N^2],
    shape (n, m); None without rollers."""


def force_sigma(experiment: Experiment, run: Run, samples: Samples) -> tuple[Array, bool]:
    """1-sigma of single force readings, shape (r,), and whether it was stated."""
    quantities = _force_quantities(experiment, run)
    least = least_sigma(experiment, run)
    if all(q.noise for q in quantities):
        return np.concatenate([np.full(q.size, q.noise) for q in quantities]), True
    seen = np.concatenate([np.full(q.size, samples.noise.get(q.name, np.nan)) for q in quantities])
    return np.maximum(np.where(np.isfinite(seen), seen, _NOISE_AT_REST * least), least), False


def least_sigma(experiment: Experiment, run: Run) -> Array:
    """Least 1-sigma of single force readings, shape (r,)."""
    name = experiment.force_instrument(run)
    assert name is not None
    values = run.streams[name].values
    return np.concatenate(
        [
            np.full(
                q.size,
                _LEAST_NOISE * float(np.nanmax(np.abs(values[q.name]), initial=_TYPICAL_SIZE)),
            )
            for q in _force_quantities(experiment, run)
        ]
    )


def _force_quantities(experiment: Experiment, run: Run) -> tuple[Quantity, ...]:
    name = experiment.force_instrument(run)
    assert name is not None
    return experiment.instruments[name].quantities(experiment.robot.m)


def balance(
    experiment: Experiment, run: Run, samples: Samples, calibration: Calibration, sigma: Array
) -> Balance:
    """Equations of one run.

    Args:
        experiment: With robot and instruments.
        run: One of its runs.
        samples: Of it, made with the same systematic errors.
        calibration: Present values of all systematic errors.
        sigma: 1-sigma of single force readings, shape (r,).
    """
    name = experiment.force_instrument(run)
    assert name is not None
    instrument = experiment.instruments[name]
    quantities = tuple(q.name for q in instrument.quantities(experiment.robot.m))
    unknown = "tension" if samples.structure is not None else "wrench"
    state = {
        key: value
        for key in ("tension", "wrench", "position", "rotation", "velocity", "omega")
        if (value := getattr(samples, key)) is not None
    }
    errors = calibration.of(name, instrument, run.name)
    by_reading, by_errors = sensitivity(
        unknown, instrument, experiment.robot, quantities, state, errors
    )
    turnaround = None
    for rate in ("velocity", "omega"):
        follows = sensitivity_to(
            rate, unknown, instrument, experiment.robot, quantities, state, errors
        )
        if follows is not None:
            own = np.sum((follows * samples.noise.get(rate, 0.0)) ** 2, axis=2)
            turnaround = own if turnaround is None else turnaround + own
    by_reading = np.broadcast_to(by_reading, (len(samples), *by_reading.shape[1:]))
    by_errors = np.broadcast_to(by_errors, (len(samples), *by_errors.shape[1:]))
    if samples.structure is not None:
        by_reading, by_errors = samples.structure @ by_reading, samples.structure @ by_errors
    places = [
        calibration.calibration_parameters.place(name, term.key, run.name)
        for term in instrument.terms(experiment.robot.m)
    ]
    numbers = np.arange(len(calibration.calibration_parameters))
    where = np.concatenate([numbers[place] for place in places])
    return Balance(samples, sigma, by_reading, by_errors, where, turnaround)


def shared_noise(equations: Balance, calibration: Calibration, white: Array) -> Array:
    """Product of the noise in the columns of :attr:`Balance.by_errors` with that of the wrench,
    summed over the samples, shape (e,).

    A gain multiplies a reading, so that the noise of the reading is in its column; all other
    columns are free of it, or have it with the changing sign of a cable's direction.

    Args:
        equations: Of one run.
        calibration: Present values.
        white: Matrices that whiten the rows, shape (n, 6, 6).
    """
    samples = equations.samples
    by_reading = np.sum((white @ equations.by_reading) ** 2, axis=(0, 1)) * equations.sigma**2
    # The filter has taken the rest of the noise out of both.
    by_reading = by_reading * (freedom(samples) / (len(samples) * samples.share))
    values = calibration.values[equations.places]
    keys = [unknown.key for _, unknown, _ in calibration.calibration_parameters.components()]
    found = np.zeros(len(values))
    gains = [i for i, place in enumerate(equations.places) if keys[place] == "gain"]
    common = [i for i, place in enumerate(equations.places) if keys[place] == "common_gain"]
    if equations.turnaround is not None and samples.structure is not None:
        # The filter has let it through. Where a roller turns around, the column of its friction
        # errs with it.
        turned = np.sum(
            np.sum((white @ samples.structure) ** 2, axis=1) * equations.turnaround, axis=0
        )
        by_reading = by_reading + turned
        rubbing = [i for i, place in enumerate(equations.places) if keys[place] == "friction"]
        found[rubbing] = np.divide(
            turned, values[rubbing], out=np.zeros_like(turned), where=values[rubbing] != 0
        )
    found[gains] = -by_reading[: len(gains)] / values[gains]
    found[common] = -np.sum(by_reading) / values[common]
    return found


def freedom(samples: Samples) -> float:
    """Samples of a run that are independent: the filter lets no more through."""
    if samples.plan is None:
        return float(len(samples))
    length = sum(float(times[-1] - times[0]) + samples.spacing for *_, times in samples.plan.parts)
    return min(len(samples) * samples.share, length / samples.spacing)


def wrench_noise(
    experiment: Experiment, run: Run, samples: Samples, calibration: Calibration, sigma: Array
) -> Array:
    """What the noise of the force sensors alone leaves in the filtered wrench, rms [N], [N m],
    shape (6,).

    Args: as of :func:`balance`.
    """
    equations = balance(experiment, run, samples, calibration, sigma)
    variance = np.einsum("nkr,r->nk", equations.by_reading**2, equations.sigma**2).mean(axis=0)
    let_through = min(1.0, freedom(samples) / (len(samples) * samples.share))
    return np.asarray(np.sqrt(variance * let_through))


def passed(samples: Samples) -> float:
    """Part of the noise of single readings that the filter lets through."""
    if samples.plan is None:
        return 1.0
    # Those of the whole run, where they are a part of it.
    count = sum(len(times) for *_, times in samples.plan.parts) * samples.share
    length = sum(float(times[-1] - times[0]) + samples.spacing for *_, times in samples.plan.parts)
    return min(1.0, length / samples.spacing / count)


def motion_errors(experiment: Experiment, run: Run, calibration: Calibration) -> NDArray[np.intp]:
    """Places of the systematic errors that the motion of a run depends on, those that are known
    exactly too.
    """
    calibration_parameters = calibration.calibration_parameters
    sources = choose_sources(experiment, run, None)
    numbers = np.arange(len(calibration_parameters))
    places = [numbers[calibration_parameters.places[ROBOT, "gravity", None]]]
    for name in dict.fromkeys(source[0] for source in sources.used()):
        places += [
            numbers[calibration_parameters.place(name, t.key, run.name)]
            for t in experiment.instruments[name].terms(calibration_parameters.m)
        ]
        clock = clock_of(experiment, name)
        if not run.static and clock != clock_of(experiment, sources.force):
            places.append(numbers[calibration_parameters.place(clock, "delay", run.name)])
    return np.unique(np.concatenate(places))


_STEPS = {"rad": 1e-5, "m": 1e-5, "s": 2e-5, "rad/s": 1e-5, "m/s^2": 1e-4}
"""Step of the differences by which the samples' dependence on a systematic error is found, by its
unit."""


def by_motion_errors(
    experiment: Experiment,
    run: Run,
    samples: Samples,
    calibration: Calibration,
    parameters: Array,
    places: NDArray[np.intp],
) -> Array:
    """Derivative of wrench minus ``Y phi`` by systematic errors of the motion instruments.

    The whole preparation is differentiated by differences, on the same cuts and knots: it is smooth
    in every one of them.

    Args:
        experiment: With robot and instruments.
        run: One of its runs.
        samples: Of it, made with the same systematic errors.
        calibration: Present values of all systematic errors.
        parameters: The ten of :data:`steelyard.inertia.LINEAR_PARAMETERS`, shape (10,).
        places: Of the errors in the vector of all of them, shape (k,).

    Returns:
        Shape (n, 6, k).
    """
    # Few samples between two knots show how a spline follows an error as well as many do.
    run = _few(run, samples.spacing)

    def unbalanced(values: Array) -> Array:
        # Spikes are the same on both sides of a difference, and go.
        moved = prepare(
            experiment,
            run,
            straight=True,
            calibration=replace(calibration, values=values),
            plan=samples.plan,
        )
        return moved.wrench - platform_wrench(
            parameters, moved.specific_force, moved.omega, moved.alpha
        )

    # How a cable's sag changes with an error of milliradians is of no account.
    base = unbalanced(calibration.values)
    columns = np.empty((len(samples), 6, len(places)))
    units = [unknown.unit for _, unknown, _ in calibration.calibration_parameters.components()]
    for j, place in enumerate(places):
        step = _STEPS[units[place]]
        values = calibration.values.copy()
        values[place] += step
        columns[:, :, j] = (unbalanced(values) - base) / step
    return columns


_ENOUGH = 8
"""Samples of a stream between two knots that show how the spline follows an error of its
instrument."""


def _few(run: Run, spacing: float) -> Run:
    """The run with no more samples than that."""
    if not spacing:
        return run
    streams = {}
    for name, stream in run.streams.items():
        length = float(stream.time[-1] - stream.time[0])
        stride = max(1, int(len(stream) * spacing / max(length, spacing) / _ENOUGH))
        thinned = {quantity: values[::stride] for quantity, values in stream.values.items()}
        streams[name] = replace(stream, time=stream.time[::stride], values=thinned)
    return replace(run, streams=streams)


def by_geometry(experiment: Experiment, samples: Samples) -> WrenchByGeometry | None:
    """Derivative of the wrench by where the cables are fixed and where the platform is; None
    without cables.
    """
    if samples.tension is None or samples.position is None or samples.rotation is None:
        return None
    return wrench_by_geometry(experiment.robot, samples.position, samples.rotation, samples.tension)


def by_drag(experiment: Experiment, samples: Samples, gravity: Array) -> Array | None:
    """Derivative of the wrench by how far the inertia of the cables is felt, shape (n, 6); None
    where they have none.
    """
    robot = experiment.robot
    if (
        samples.static
        or samples.position is None
        or samples.rotation is None
        or not robot.m
        or not robot.cable.linear_density
    ):
        return None
    return cable_inertia_wrench(
        robot,
        position=samples.position,
        rotation=samples.rotation,
        specific_force=samples.specific_force,
        omega=samples.omega,
        alpha=samples.alpha,
        gravity=gravity,
    )


def by_lag(samples: Samples) -> Array:
    """Derivative of the wrench by how far the forces lag behind the motion [N/s], [N m/s], shape
    (n, 6).
    """
    # The forces alone are late: the cables' directions, which the motion tells, are those of the
    # instant.
    force_samples = samples.wrench if samples.tension is None else samples.tension
    slopes = np.zeros_like(force_samples)
    ends = (
        np.cumsum([len(times) for *_, times in samples.plan.parts])
        if samples.plan
        else np.zeros(0, dtype=int)
    )
    for start, end in pairwise([0, *ends]):
        if end - start > 1:
            slopes[start:end] = np.gradient(
                force_samples[start:end], samples.time[start:end], axis=0
            )
    # A reading that comes late belongs to an earlier instant: at its own time the forces are those
    # of later readings.
    return (
        slopes
        if samples.structure is None
        else np.asarray(np.einsum("nkm,nm->nk", samples.structure, slopes))
    )


_LOOKED_AT = 1000
"""Samples that show how much noise the motion brings into the balance."""


def motion_noise(experiment: Experiment, samples: Samples, parameters: Array) -> Array:
    """Covariance of what the noise of the motion brings into the balance, as a single force reading
    would have it, shape (6, 6).

    The filter lets the motion's noise through as it lets that of the forces: what is left of both
    is compared as raw.
    """
    few = samples.part(slice(None, None, -(-len(samples) // _LOOKED_AT)))
    force_samples = regressor_noise(few, np.random.default_rng(0)) @ parameters
    covariance = np.einsum("dnk,dnl->kl", force_samples, force_samples) / (
        force_samples.shape[0] * force_samples.shape[1]
    )
    geometry = by_geometry(experiment, few)
    if geometry is not None:
        sigma = np.repeat(
            [samples.noise.get("position", 0.0), samples.noise.get("rotation", 0.0)], 3
        )
        moved = geometry.pose * sigma
        covariance += np.einsum("nki,nli->kl", moved, moved) / len(few)
    return np.asarray(covariance * (len(samples) * samples.share / freedom(samples)))


def regressor_noise(samples: Samples, rng: np.random.Generator) -> Array:
    """Draws of the noise in the regressor that the filter has left, shape (k, n, 6, 10).

    Half the difference of two regressors whose motion is moved to either side, so that only noise
    is left.
    """
    noise = samples.noise
    draws = []
    for _ in range(int(np.clip(_DRAWN_SAMPLES / len(samples), 1, _MOST_DRAWS))):
        moved = {
            key: rng.standard_normal((len(samples), 3)) * noise.get(key, 0.0)
            for key in ("specific_force", "omega", "alpha")
        }
        there, back = (
            platform_regressor(*(getattr(samples, key) + sign * moved[key] for key in moved))
            for sign in (1, -1)
        )
        draws.append((there - back) / 2)
    return np.array(draws)


def whitener(equations: Balance, extra: Array) -> Array:
    """Matrices that make the noise of the rows white with unit variance, shape (n, 6, 6).

    Args:
        equations: Of one run.
        extra: Covariance of further noise of a row, as a single reading would have it, shape (6,
            6).
    """
    covariance = (
        np.einsum("nkr,r,nlr->nkl", equations.by_reading, equations.sigma**2, equations.by_reading)
        + extra
    )
    samples = equations.samples
    if equations.turnaround is not None and samples.structure is not None:
        as_read = equations.turnaround / passed(samples)
        covariance = covariance + np.einsum(
            "nkm,nm,nlm->nkl", samples.structure, as_read, samples.structure
        )
    # Rows are scaled first: forces and torques have different units and sizes.
    scale = np.sqrt(np.einsum("nkk->nk", covariance))
    normal = covariance / scale[:, :, None] / scale[:, None, :]
    root = np.linalg.cholesky(normal + 1e-12 * np.eye(6))
    return np.asarray(np.linalg.inv(root) / scale[:, None, :] * np.sqrt(samples.share))
