"""What the linear methods share: from an experiment to normal equations over the body and every systematic error.

The motion instruments are compared first (kinematics alone), then forces and motion are balanced over samples that are filtered alike,
with the body, the errors of the force instrument and what kinematics left open as unknowns. Anchors and attachments are not estimated;
their uncertainty is passed on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.dynamics import platform_regressor, platform_wrench
from steelyard.experiment.model import Experiment, Run
from steelyard.identification.balance import (
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
from steelyard.identification.estimate import plausible_sizes, told_by
from steelyard.identification.kinematic_fit import KinematicFit, fit_kinematics
from steelyard.identification.preparation import Samples, prepare
from steelyard.identification.regression import (
    TEN,
    Blocks,
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
from steelyard.identification.sources import choose_sources
from steelyard.identification.unknowns import DRAG, LAG, ROBOT, Systematic, Unknowns, gather
from steelyard.inertia import BODY_PARAMETERS, Inertia, body_jacobian

_PART = 40.0
"""Length of recording that tells the systematic errors of the motion instruments [s]; constants need no more."""
_ROUNDS = 10
_FEW_ROUNDS = 4
"""After so many an unstated noise need not have settled: it is on its floor."""
_SETTLED = 0.05
"""Largest change of the last round, in 1-sigma."""
_UNSETTLED = 0.5
"""Change of the last round, in 1-sigma, with which there is no saying where it would have ended."""
_FAR = 2.0
"""A change beyond so many 1-sigma asks for new derivatives."""
_ROWS = 20_000
"""Samples whose rows are held at once."""
_EXACT = 1e-6
"""1-sigma of what is known exactly, as a part of its plausible size."""
_BODY_SIZE_ON_SENSOR = 0.3
"""Plausible radius of a body on a wrench sensor [m]; a platform on cables shows its own."""

Progress = Callable[[str, float], None] | None
Instruments = Callable[[Experiment, Run, Samples, Systematic], Samples | None]


@dataclass(frozen=True, eq=False)
class Study:
    """An experiment, balanced: everything that estimate, verdict and prediction are drawn from."""

    experiment: Experiment
    systematic: Systematic
    """After estimation."""
    kinematics: KinematicFit
    samples: tuple[Samples, ...]
    """Of all runs, with these systematic errors."""
    sigma: Mapping[str, Array]
    """Run -> 1-sigma of single force readings as used."""
    stated: bool
    """Whether the noise of the forces was stated."""
    sums: Mapping[str, Sums]
    """Run -> normal equations."""
    prior: Prior
    solution: Solution
    blocks: Blocks
    parameters: Array
    """The ten of :data:`steelyard.inertia.LINEAR_PARAMETERS`, shape (10,)."""
    weights: Mapping[str, Array]
    """Run -> weight of each sample."""
    residuals: Mapping[str, Array]
    """Run -> whitened residual of each sample, shape (n, 6)."""
    settled: bool
    """Whether the last round changed little."""
    held_out: frozenset[str] = frozenset()
    """Runs whose forces were not looked at."""
    part: Study | None = None
    """The part of a long recording that has told the errors of the motion instruments; None: all of it."""
    notes: tuple[str, ...] = ()

    @property
    def total(self) -> Sums:
        """Normal equations of all runs whose forces were looked at."""
        return sum_up([each for name, each in self.sums.items() if name not in self.held_out])

    def left_over(self, samples: Samples) -> Array:
        """Wrench that the body does not explain [N], [N m], shape (n, 6)."""
        moves = platform_wrench(self.parameters, samples.specific_force, samples.omega, samples.alpha)
        return np.asarray(samples.wrench - moves)

    @property
    def noise_factor(self) -> float:
        """By how much the variance of the residual exceeds that of the noise; 1 where it does not."""
        return max([1.0, *self.solution.inflation.values()])

    @property
    def size(self) -> float:
        """Plausible radius of the body [m]."""
        return self.experiment.robot.size if self.experiment.robot.m else _BODY_SIZE_ON_SENSOR

    @property
    def told(self) -> NDArray[np.bool_]:
        """Which of the ten body parameters the data tell, shape (10,)."""
        return told_by(float(self.parameters[0]), self.body_covariance, self.size)

    @property
    def body_covariance(self) -> Array:
        """Of the ten of :data:`steelyard.inertia.BODY_PARAMETERS`, shape (10, 10)."""
        J = body_jacobian(self.parameters)
        return np.asarray(J @ self.solution.covariance[:TEN, :TEN] @ J.T)


def plausible(parameters: Array, size: float) -> Array:
    """Plausible size of the ten linear parameters, shape (10,)."""
    mass = max(abs(float(parameters[0])), 1e-9)
    return np.array([mass, *[mass * size] * 3, *[mass * size**2] * 6])


class NoBalanceError(ArithmeticError):
    """Forces and motion have nothing to do with each other, so that there is no estimate to speak of."""


def study(
    experiment: Experiment,
    progress: Progress = None,
    instruments: Instruments | None = None,
    held_out: frozenset[str] = frozenset(),
) -> Study:
    """Balance an experiment.

    Args:
        experiment: With at least one run.
        progress: Is told what is being done and the fraction that is done.
        instruments: Gives the samples whose regressor stands in for the own one in the products (instrumental variables).
        held_out: Runs whose forces are not looked at; their motion is.

    Raises:
        InputError: A run lacks what the methods need.
        NoBalanceError: The numbers end in nothing.
    """
    try:
        # Numbers that end in nothing are looked at in the end, once.
        with np.errstate(all="ignore"):
            found = _study(experiment, progress or (lambda what, fraction: None), instruments, held_out)
            sound = bool(found.parameters[0]) and np.isfinite(found.body_covariance).all()
    except np.linalg.LinAlgError:
        sound = False
    if not sound:
        raise NoBalanceError(
            "forces and motion cannot be balanced at all; check the force columns, their units and signs, and the geometry of the robot"
        )
    return found


def _study(
    experiment: Experiment,
    tell: Callable[[str, float], None],
    instruments: Instruments | None,
    held_out: frozenset[str],
) -> Study:
    unknowns = gather(experiment)
    known = Systematic(unknowns, unknowns.mean)
    runs = _part(experiment)
    samples = []
    for i, run in enumerate(runs):
        tell(f"preparing {run.name}", 0.3 * i / len(runs))
        samples.append(prepare(experiment, run, thin=True, systematic=known))
    tell("comparing the motion instruments", 0.3)
    kinematics = fit_kinematics(experiment, unknowns, [s for s in samples if not s.static])
    tell("balancing forces and motion", 0.5)
    part = _balanced(experiment, runs, samples, unknowns, kinematics, instruments, held_out)
    if all(run is whole for run, whole in zip(runs, experiment.runs, strict=True)):
        return part
    tell("balancing the whole recording", 0.7)
    return _extended(part, experiment, held_out)


def _part(experiment: Experiment) -> list[Run]:
    """The stretch of every run that tells the systematic errors: all of it, or where most happens."""
    longest = max(3.0, _PART / max(1, sum(not run.static for run in experiment.runs)))
    return [run if run.static else _stretch(experiment, run, longest) for run in experiment.runs]


def _stretch(experiment: Experiment, run: Run, longest: float) -> Run:
    """The most lively stretch of a run, as its first turning instrument shows it."""
    sources = choose_sources(experiment, run, None)
    name, quantity = sources.omega or sources.rotation or sources.used()[0]
    time, values = experiment.common_time(run, name), run.streams[name].values[quantity]
    start, end = run.window or (float(time[0]), float(time[-1]))
    start, end = max(start, float(time[0])), min(end, float(time[-1]))
    if end - start <= 1.5 * longest:
        return run
    # Means over tenths of the stretch: what is lively scatters about them.
    edges = np.arange(start, end, longest / 10)
    flat = np.nan_to_num(values.reshape(len(values), -1))
    square = np.concatenate([[0.0], np.cumsum(np.sum((flat - flat.mean(axis=0)) ** 2, axis=1))])
    at = np.searchsorted(time, np.stack([edges, edges + longest]))
    inside = edges + longest <= end
    best = edges[inside][int(np.argmax((square[at[1]] - square[at[0]])[inside]))]
    return replace(run, window=(float(best), float(best) + longest))


def _balanced(
    experiment: Experiment,
    runs: Sequence[Run],
    samples: Sequence[Samples],
    unknowns: Unknowns,
    kinematics: KinematicFit,
    instruments: Instruments | None,
    held_out: frozenset[str],
) -> Study:
    """Estimate the body with all systematic errors but those of the geometry, round after round about the last result."""
    systematic = kinematics.systematic
    found = [force_sigma(experiment, run, s) for run, s in zip(runs, samples, strict=True)]
    sigma = {run.name: s for run, (s, _) in zip(runs, found, strict=True)}
    stated = all(s for _, s in found)
    least = {run.name: least_sigma(experiment, run) for run in runs}
    plans = [s.plan for s in samples]
    parameters = np.zeros(TEN)
    weights: dict[str, Array] = {}
    estimated = np.concatenate([np.ones(TEN, dtype=bool), unknowns.deviation > 0])
    for key in ("anchor", "attachment"):
        place = unknowns.places[ROBOT, key, None]
        estimated[TEN + place.start : TEN + place.stop] = False
    size = experiment.robot.size if experiment.robot.m else _BODY_SIZE_ON_SENSOR
    derivatives: dict[str, Array] = {}
    motion = np.unique(np.concatenate([motion_errors(experiment, run, systematic) for run in runs]))
    far = True
    for turn in range(_ROUNDS + 1):
        current = [
            prepare(experiment, run, thin=True, systematic=systematic, plan=plan)
            for run, plan in zip(runs, plans, strict=True)
        ]
        if turn and far:
            derivatives = {
                run.name: _derivatives(experiment, run, s, systematic, parameters)
                for run, s in zip(runs, current, strict=True)
            }
        rows = {
            run.name: _rows(
                experiment, run, s, systematic, sigma[run.name], parameters, instruments, derivatives.get(run.name)
            )
            for run, s in zip(runs, current, strict=True)
        }
        for name, each in rows.items():
            weights.setdefault(name, np.ones(len(each.target)))
        summed = {s.run: sums_of(rows[s.run], weights[s.run], freedom(s), i) for i, s in enumerate(current)}
        sums = {name: each for name, (each, _) in summed.items()}
        total = sum_up([each for name, each in sums.items() if name not in held_out])
        prior = _prior(experiment, unknowns, systematic, kinematics, parameters, size)
        if turn == 0:
            # The columns of the motion's errors need a body to begin with.
            start = _start(total, size)
            solution = solve(total, prior, estimated, start, correct=False)
            parameters = solution.value[:TEN]
            continue
        # Errors that do not act here are unknowns too: kinematics has tied others to them.
        solution = solve(total, prior, estimated, plausible(parameters, size), correct=instruments is None)
        parameters = solution.value[:TEN]
        step = np.where(estimated, solution.value, 0.0)[TEN:]
        systematic = replace(systematic, values=systematic.values + step)
        if not stated:
            sigma = {
                name: np.maximum(s * _scatter(sums[name], solution, total), least[name]) for name, s in sigma.items()
            }
        deviation = np.sqrt(np.maximum(np.diag(solution.covariance)[TEN:], 1e-300))
        change = float((np.abs(step) / deviation).max(initial=0.0))
        # Derivatives change little within the uncertainty of what they are by.
        far = bool(np.any((np.abs(step) > _FAR * deviation)[motion]))
        residuals = {name: each.target - each.columns @ solution.value for name, each in rows.items()}
        weights = {name: robust_weights(r / np.sqrt(_middle(r))) for name, r in residuals.items()}
        steady = stated or abs(np.log(max(solution.ratio, 1e-12))) < _SETTLED or turn > _FEW_ROUNDS
        if change <= _SETTLED and steady and turn > 1:
            break
    blocks = together([each for name, (_, each) in summed.items() if name not in held_out])
    result = Study(
        experiment=experiment,
        systematic=systematic,
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


def _middle(residual: Array) -> float:
    """Mean square of whitened residuals as most samples have it; at least that of the noise."""
    return max(1.0, float(np.median(np.sum(residual**2, axis=1))) / 5.348)


def _start(total: Sums, size: float) -> Array:
    """Plausible sizes before anything is known: the mass of a body that hangs still."""
    mass = max(abs(float(total.plain_right[0] / max(total.normal[0, 0], 1e-300))), 1e-9)
    return np.array([mass, *[mass * size] * 3, *[mass * size**2] * 6])


def sum_up(sums: Sequence[Sums]) -> Sums:
    """Normal equations of several runs."""
    first, *others = sums
    for other in others:
        first = first + other
    return first


def _derivatives(
    experiment: Experiment, run: Run, samples: Samples, systematic: Systematic, parameters: Array
) -> Array:
    """Of the balance by the errors of the motion instruments and of the geometry, shape (n, 6, u)."""
    unknowns = systematic.unknowns
    found = np.zeros((len(samples), 6, len(unknowns)))
    places = motion_errors(experiment, run, systematic)
    found[:, :, places] = by_motion_errors(experiment, run, samples, systematic, parameters, places)
    force = experiment.force_instrument(run)
    if force is not None and not run.static:
        found[:, :, unknowns.place(force, LAG, run.name)] = by_lag(samples)[:, :, None]
    drag = by_drag(experiment, samples, systematic.gravity)
    if drag is not None:
        found[:, :, unknowns.places[ROBOT, DRAG, None]] = drag[:, :, None]
    geometry = by_geometry(experiment, samples)
    if geometry is not None:
        for key, part in (("anchor", geometry.anchor), ("attachment", geometry.attachment)):
            found[:, :, unknowns.places[ROBOT, key, None]] = part
    return found


def _rows(
    experiment: Experiment,
    run: Run,
    samples: Samples,
    systematic: Systematic,
    sigma: Array,
    parameters: Array,
    instruments: Instruments | None,
    derivatives: Array | None,
) -> Rows:
    """Whitened rows of a run over the body and all systematic errors; without ``derivatives`` those of the force instrument only."""
    unknowns = systematic.unknowns
    equations = balance(experiment, run, samples, systematic, sigma)
    Y = platform_regressor(samples.specific_force, samples.omega, samples.alpha)
    noise = regressor_noise(samples, np.random.default_rng(0))
    columns = np.zeros((len(samples), 6, TEN + len(unknowns)))
    columns[:, :, :TEN] = Y
    columns[:, :, TEN + equations.places] -= equations.by_errors
    if derivatives is not None:
        columns[:, :, TEN:] -= derivatives
    L = whitener(equations, motion_noise(experiment, samples, parameters))
    columns = L @ columns
    substitute = instruments(experiment, run, samples, systematic) if instruments else None
    own = substitute is None
    Z = columns if substitute is None else L @ platform_regressor(
        substitute.specific_force, substitute.omega, substitute.alpha
    )  # fmt: skip
    noisy = np.einsum("dnki,dnkj->ij", white := L @ noise, white) / len(noise) if own else np.zeros((TEN, TEN))
    shared = np.zeros(columns.shape[2])
    shared[TEN + equations.places] = -shared_noise(equations, systematic, L)
    return Rows(
        columns=columns,
        instruments=Z,
        target=np.einsum("nij,nj->ni", L, samples.wrench),
        noise=noisy,
        shared=shared,
        block=block_numbers(samples.time, samples.spacing),
    )


def _prior(
    experiment: Experiment,
    unknowns: Unknowns,
    systematic: Systematic,
    kinematics: KinematicFit,
    parameters: Array,
    size: float,
) -> Prior:
    """What is known beforehand: kinematics about the errors, and what the user knows about the body."""
    k = TEN + len(unknowns)
    mean = np.concatenate([np.zeros(TEN), kinematics.systematic.values - systematic.values])
    covariance = np.zeros((k, k))
    covariance[TEN:, TEN:] = kinematics.covariance
    precision = np.zeros((k, k))
    free = np.flatnonzero(unknowns.deviation > 0)
    if len(free):
        scale = 1 / unknowns.deviation[free]
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
            pull[:TEN] += row * ((value - body[i]) / max(sigma, _EXACT * sizes[i]) + row @ parameters)
    return Prior(mean, precision, pull, covariance)


def _extended(part: Study, experiment: Experiment, held_out: frozenset[str]) -> Study:
    """The whole of a long recording, with the errors of the motion instruments as a part of it has told them.

    Only the body and the errors of the force instrument are estimated from the whole; what the part has left uncertain about the
    others is passed on, as the part shows.
    """
    unknowns = part.systematic.unknowns
    k = TEN + len(unknowns)
    part_total = sum_up([each for name, each in part.sums.items() if name not in held_out])
    samples, sums, weights, residuals, blocks = [], {}, {}, {}, []
    own = np.zeros(k, dtype=bool)
    for i, run in enumerate(experiment.runs):
        whole = prepare(experiment, run, thin=True, systematic=part.systematic)
        extra = motion_noise(experiment, whole, part.parameters)
        numbers = block_numbers(whole.time, whole.spacing)
        residual, weight = np.empty((len(whole), 6)), np.empty(len(whole))
        pieces: list[tuple[Sums, Blocks]] = []
        for start in range(0, len(whole), _ROWS):
            rows = slice(start, min(start + _ROWS, len(whole)))
            each, columns = _force_rows(experiment, run, whole.part(rows), part, extra, numbers[rows])
            residual[rows] = each.target - each.columns[:, :, :TEN] @ part.parameters
            weight[rows] = robust_weights(residual[rows] / np.sqrt(_middle(residual[rows])))
            pieces.append(sums_of(each, weight[rows], freedom(whole) * (rows.stop - start) / len(whole), i))
        own[columns] = True
        sums[run.name] = _embedded(sum_up([s for s, _ in pieces]), columns, part_total, own)
        if run.name not in held_out:
            joined = together([b for _, b in pieces])
            blocks.append(Blocks(_wide(joined.crossed, columns, k), _wide(joined.right, columns, k), joined.run))
        samples.append(whole)
        weights[run.name], residuals[run.name] = weight, residual
    total = sum_up([each for name, each in sums.items() if name not in held_out])
    size = part.size
    known = _prior(experiment, unknowns, part.systematic, part.kinematics, part.parameters, size)
    prior = Prior(
        mean=np.where(own, known.mean, 0.0),
        precision=np.where(np.outer(own, own), known.precision, 0.0),
        pull=np.where(own, known.pull, 0.0),
        covariance=part.solution.covariance,
    )
    solution = solve(total, prior, own & part.solution.estimated, plausible(part.parameters, size), correct=True)
    scored = together(blocks)
    result = replace(
        part,
        part=part,
        systematic=replace(
            part.systematic, values=part.systematic.values + np.where(solution.estimated, solution.value, 0.0)[TEN:]
        ),
        samples=tuple(samples),
        sums=sums,
        prior=prior,
        solution=solution,
        blocks=scored,
        parameters=solution.value[:TEN],
        weights=weights,
        residuals=residuals,
        notes=tuple(dict.fromkeys(note for s in samples for note in s.notes)),
    )
    return replace(result, solution=enlarged(solution, scored, result.told, total.freedom))


def _force_rows(
    experiment: Experiment, run: Run, samples: Samples, part: Study, extra: Array, block: NDArray[np.intp]
) -> tuple[Rows, NDArray[np.intp]]:
    """Whitened rows over the body and the errors of the force instrument alone, and the places of these columns."""
    equations = balance(experiment, run, samples, part.systematic, part.sigma[run.name])
    L = whitener(equations, extra)
    Y = platform_regressor(samples.specific_force, samples.omega, samples.alpha)
    white = L @ regressor_noise(samples, np.random.default_rng(0))
    columns = L @ np.concatenate([Y, -equations.by_errors], axis=2)
    rows = Rows(
        columns=columns,
        instruments=columns,
        target=np.einsum("nij,nj->ni", L, samples.wrench),
        noise=np.einsum("dnki,dnkj->ij", white, white) / len(white),
        shared=np.concatenate([np.zeros(TEN), -shared_noise(equations, part.systematic, L)]),
        block=block,
    )
    return rows, np.concatenate([np.arange(TEN), TEN + equations.places])


def _wide(values: Array, columns: NDArray[np.intp], k: int) -> Array:
    """Vectors or matrices over some of k columns as such over all."""
    wide = np.zeros((len(values), *[k] * (values.ndim - 1)))
    if values.ndim == 2:
        wide[:, columns] = values
    else:
        wide[:, columns[:, None], columns] = values
    return wide


def _embedded(own: Sums, columns: NDArray[np.intp], part: Sums, mask: NDArray[np.bool_]) -> Sums:
    """Normal equations over some columns, with their products with all others as a part of the data shows these."""
    k = len(mask)
    share = own.freedom / part.freedom
    crossed = np.where(np.outer(mask, mask), 0.0, part.crossed * share)
    crossed[np.ix_(columns, columns)] = own.crossed
    right, shared = np.zeros(k), np.zeros(k)
    right[columns], shared[columns] = own.right, own.shared
    return Sums(crossed, crossed, crossed, right, right, own.square, own.noise, shared, own.freedom)
