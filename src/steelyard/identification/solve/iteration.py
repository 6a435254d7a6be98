"""Estimation in rounds: rows about the present values, a solution, new values, until nothing
changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from steelyard.arrays import Array
from steelyard.dynamics import platform_regressor
from steelyard.estimates.estimate import plausible_radius, plausible_sizes
from steelyard.experiment.model import Experiment, Run
from steelyard.identification.model.balance import (
    balance,
    by_drag,
    by_geometry,
    by_lag,
    by_motion_errors,
    force_sigma,
    freedom,
    least_sigma,
    motion_errors,
    motion_noise,
    regressor_noise,
    shared_noise,
    whitener,
)
from steelyard.identification.model.calibration_parameters import (
    DRAG,
    LAG,
    ROBOT,
    Calibration,
    CalibrationParameters,
)
from steelyard.identification.model.preparation import Samples, prepare
from steelyard.identification.solve.kinematic_fit import KinematicFit
from steelyard.identification.solve.normal_equations import (
    TEN,
    Prior,
    Rows,
    Solution,
    Sums,
    block_numbers,
    enlarged,
    robust_weights,
    solve,
    sums_of,
    together,
)
from steelyard.identification.solve.study import Instruments, Study, plausible, sum_up
from steelyard.inertia import BODY_PARAMETERS, Inertia, body_jacobian

_ROUNDS = 10
_FEW_ROUNDS = 4
"""After so many an unstated noise need not have settled: it is on its floor."""
_SETTLED = 0.05
"""Largest change of the last round, in 1-sigma."""
_UNSETTLED = 0.5
"""Change of the last round, in 1-sigma, with which there is no saying where it would have ended."""
_FAR = 2.0
"""A change beyond so many 1-sigma asks for new derivatives."""
_EXACT = 1e-6
"""1-sigma of what is known exactly, as a part of its plausible size."""


def balanced(
    experiment: Experiment,
    runs: Sequence[Run],
    samples: Sequence[Samples],
    calibration_parameters: CalibrationParameters,
    kinematics: KinematicFit,
    instruments: Instruments | None,
    held_out: frozenset[str],
) -> Study:
    """Estimate the body with all systematic errors but those of the geometry, round after round
    about the last result.
    """
    calibration = kinematics.calibration
    found = [force_sigma(experiment, run, s) for run, s in zip(runs, samples, strict=True)]
    sigma = {run.name: s for run, (s, _) in zip(runs, found, strict=True)}
    stated = all(s for _, s in found)
    least = {run.name: least_sigma(experiment, run) for run in runs}
    plans = [s.plan for s in samples]
    parameters = np.zeros(TEN)
    weights: dict[str, Array] = {}
    estimated = np.concatenate([np.ones(TEN, dtype=bool), calibration_parameters.deviation > 0])
    for key in ("anchor", "attachment"):
        place = calibration_parameters.places[ROBOT, key, None]
        estimated[TEN + place.start : TEN + place.stop] = False
    size = plausible_radius(experiment.robot)
    derivatives: dict[str, Array] = {}
    motion = np.unique(
        np.concatenate([motion_errors(experiment, run, calibration) for run in runs])
    )
    far = True
    for turn in range(_ROUNDS + 1):
        current = [
            prepare(experiment, run, thin=True, calibration=calibration, plan=plan)
            for run, plan in zip(runs, plans, strict=True)
        ]
        if turn and far:
            derivatives = {
                run.name: _derivatives(experiment, run, s, calibration, parameters)
                for run, s in zip(runs, current, strict=True)
            }
        rows = {
            run.name: _rows(
                experiment,
                run,
                s,
                calibration,
                sigma[run.name],
                parameters,
                instruments,
                derivatives.get(run.name),
            )
            for run, s in zip(runs, current, strict=True)
        }
        for name, each in rows.items():
            weights.setdefault(name, np.ones(len(each.target)))
        summed = {
            s.run: sums_of(rows[s.run], weights[s.run], freedom(s), i)
            for i, s in enumerate(current)
        }
        sums = {name: each for name, (each, _) in summed.items()}
        total = sum_up([each for name, each in sums.items() if name not in held_out])
        prior = prior_of(
            experiment, calibration_parameters, calibration, kinematics, parameters, size
        )
        if turn == 0:
            # The columns of the motion's errors need a body to begin with.
            start = _start(total, size)
            solution = solve(total, prior, estimated, start, correct=False)
            parameters = solution.value[:TEN]
            continue
        # Errors that do not act here are unknowns too: kinematics has tied others to them.
        solution = solve(
            total, prior, estimated, plausible(parameters, size), correct=instruments is None
        )
        parameters = solution.value[:TEN]
        step = np.where(estimated, solution.value, 0.0)[TEN:]
        calibration = replace(calibration, values=calibration.values + step)
        if not stated:
            sigma = {
                name: np.maximum(s * _scatter(sums[name], solution, total), least[name])
                for name, s in sigma.items()
            }
        deviation = np.sqrt(np.maximum(np.diag(solution.covariance)[TEN:], 1e-300))
        change = float((np.abs(step) / deviation).max(initial=0.0))
        # Derivatives change little within the uncertainty of what they are by.
        far = bool(np.any((np.abs(step) > _FAR * deviation)[motion]))
        residuals = {
            name: each.target - each.columns @ solution.value for name, each in rows.items()
        }
        weights = {
            name: robust_weights(r / np.sqrt(typical_square(r))) for name, r in residuals.items()
        }
        steady = stated or abs(np.log(max(solution.ratio, 1e-12))) < _SETTLED or turn > _FEW_ROUNDS
        if change <= _SETTLED and steady and turn > 1:
            break
    blocks = together([each for name, (_, each) in summed.items() if name not in held_out])
    result = Study(
        experiment=experiment,
        calibration=calibration,
        kinematics=kinematics,
        samples=tuple(current),
        sigma=sigma,
        stated=stated,
        sums=sums,
        prior=prior,
        solution=solution,
        blocks=blocks,
        parameters=parameters,
        weights=weights,
        residuals=residuals,
        settled=change <= _UNSETTLED,
        held_out=held_out,
        notes=tuple(dict.fromkeys(note for s in current for note in s.notes)),
    )
    return replace(result, solution=enlarged(solution, blocks, result.told, total.freedom))


def _scatter(own: Sums, solution: Solution, total: Sums) -> float:
    """Residual of one run in units of the noise that it was whitened with, root mean square."""
    value = solution.value
    square = own.square - 2 * value @ own.plain_right + value @ own.normal @ value
    freedom = 6 * own.freedom * max(0.1, 1 - solution.spent / (6 * total.freedom))
    return float(max(float(square) / freedom, 1e-12) ** 0.5)


def typical_square(residual: Array) -> float:
    """Mean square of whitened residuals as most samples have it; at least that of the noise."""
    return max(1.0, float(np.median(np.sum(residual**2, axis=1))) / 5.348)


def _start(total: Sums, size: float) -> Array:
    """Plausible sizes before anything is known: the mass of a body that hangs still."""
    return plausible(total.plain_right[:1] / max(total.normal[0, 0], 1e-300), size)


def _derivatives(
    experiment: Experiment, run: Run, samples: Samples, calibration: Calibration, parameters: Array
) -> Array:
    """Of the balance by the errors of the motion instruments and of the geometry, shape (n, 6,
    u).
    """
    calibration_parameters = calibration.calibration_parameters
    found = np.zeros((len(samples), 6, len(calibration_parameters)))
    places = motion_errors(experiment, run, calibration)
    found[:, :, places] = by_motion_errors(
        experiment, run, samples, calibration, parameters, places
    )
    force = experiment.force_instrument(run)
    if force is not None and not run.static:
        found[:, :, calibration_parameters.place(force, LAG, run.name)] = by_lag(samples)[
            :, :, None
        ]
    drag = by_drag(experiment, samples, calibration.gravity)
    if drag is not None:
        found[:, :, calibration_parameters.places[ROBOT, DRAG, None]] = drag[:, :, None]
    geometry = by_geometry(experiment, samples)
    if geometry is not None:
        for key, part in (("anchor", geometry.anchor), ("attachment", geometry.attachment)):
            found[:, :, calibration_parameters.places[ROBOT, key, None]] = part
    return found


def _rows(
    experiment: Experiment,
    run: Run,
    samples: Samples,
    calibration: Calibration,
    sigma: Array,
    parameters: Array,
    instruments: Instruments | None,
    derivatives: Array | None,
) -> Rows:
    """Whitened rows of a run over the body and all systematic errors; without ``derivatives`` those
    of the force instrument only.
    """
    calibration_parameters = calibration.calibration_parameters
    equations = balance(experiment, run, samples, calibration, sigma)
    Y = platform_regressor(samples.specific_force, samples.omega, samples.alpha)
    noise = regressor_noise(samples, np.random.default_rng(0))
    columns = np.zeros((len(samples), 6, TEN + len(calibration_parameters)))
    columns[:, :, :TEN] = Y
    columns[:, :, TEN + equations.places] -= equations.by_errors
    if derivatives is not None:
        columns[:, :, TEN:] -= derivatives
    L = whitener(equations, motion_noise(experiment, samples, parameters))
    columns = L @ columns
    substitute = instruments(experiment, run, samples, calibration) if instruments else None
    own = substitute is None
    Z = (
        columns
        if substitute is None
        else L @ platform_regressor(substitute.specific_force, substitute.omega, substitute.alpha)
    )
    noisy = (
        np.einsum("dnki,dnkj->ij", white := L @ noise, white) / len(noise)
        if own
        else np.zeros((TEN, TEN))
    )
    shared = np.zeros(columns.shape[2])
    shared[TEN + equations.places] = -shared_noise(equations, calibration, L)
    return Rows(
        columns=columns,
        instruments=Z,
        target=np.einsum("nij,nj->ni", L, samples.wrench),
        noise=noisy,
        shared=shared,
        block=block_numbers(samples.time, samples.spacing),
    )


def prior_of(
    experiment: Experiment,
    calibration_parameters: CalibrationParameters,
    calibration: Calibration,
    kinematics: KinematicFit,
    parameters: Array,
    size: float,
) -> Prior:
    """What is known beforehand: kinematics about the errors, and what the user knows about the
    body.
    """
    k = TEN + len(calibration_parameters)
    mean = np.concatenate([np.zeros(TEN), kinematics.calibration.values - calibration.values])
    covariance = np.zeros((k, k))
    covariance[TEN:, TEN:] = kinematics.covariance
    precision = np.zeros((k, k))
    free = np.flatnonzero(calibration_parameters.deviation > 0)
    if len(free):
        scale = 1 / calibration_parameters.deviation[free]
        scaled = kinematics.covariance[np.ix_(free, free)] * np.outer(scale, scale)
        precision[np.ix_(TEN + free, TEN + free)] = np.linalg.inv(scaled) * np.outer(scale, scale)
    pull = precision @ mean
    if experiment.known and parameters.any():
        body, J = Inertia.from_parameters(parameters).body_parameters, body_jacobian(parameters)
        sizes = plausible_sizes(float(parameters[0]), size)
        for name, (value, sigma) in experiment.known.items():
            i = BODY_PARAMETERS.index(name)
            row = J[i] / max(sigma, _EXACT * sizes[i])
            precision[:TEN, :TEN] += np.outer(row, row)
            pull[:TEN] += row * (
                (value - body[i]) / max(sigma, _EXACT * sizes[i]) + row @ parameters
            )
    return Prior(mean, precision, pull, covariance)
