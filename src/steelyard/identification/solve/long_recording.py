"""Long recordings: a lively part tells the systematic errors, the whole tells the body, in bounded
memory.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.dynamics import platform_regressor
from steelyard.experiment.model import Experiment, Run
from steelyard.identification.model.balance import (
    balance,
    freedom,
    motion_noise,
    regressor_noise,
    shared_noise,
    whitener,
)
from steelyard.identification.model.preparation import Samples, prepare
from steelyard.identification.model.sources import choose_sources
from steelyard.identification.solve.iteration import prior_of, typical_square
from steelyard.identification.solve.normal_equations import (
    TEN,
    Blocks,
    Prior,
    Rows,
    Sums,
    block_numbers,
    enlarged,
    robust_weights,
    solve,
    sums_of,
    together,
)
from steelyard.identification.solve.study import Study, plausible, sum_up

_PART = 40.0
"""Length of recording that tells the systematic errors of the motion instruments [s]; constants
need no more."""
_ROWS = 20_000
"""Samples whose rows are held at once."""


def lively_parts(experiment: Experiment) -> list[Run]:
    """The stretch of every run that tells the systematic errors: all of it, or where most
    happens.
    """
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


def extended(part: Study, experiment: Experiment, held_out: frozenset[str]) -> Study:
    """The whole of a long recording, with the errors of the motion instruments as a part of it has
    told them.

    Only the body and the errors of the force instrument are estimated from the whole; what the part
    has left uncertain about the others is passed on, as the part shows.
    """
    calibration_parameters = part.calibration.calibration_parameters
    k = TEN + len(calibration_parameters)
    part_total = sum_up([each for name, each in part.sums.items() if name not in held_out])
    samples, sums, weights, residuals, blocks = [], {}, {}, {}, []
    own = np.zeros(k, dtype=bool)
    for i, run in enumerate(experiment.runs):
        whole = prepare(experiment, run, thin=True, calibration=part.calibration)
        extra = motion_noise(experiment, whole, part.parameters)
        numbers = block_numbers(whole.time, whole.spacing)
        residual, weight = np.empty((len(whole), 6)), np.empty(len(whole))
        pieces: list[tuple[Sums, Blocks]] = []
        for start in range(0, len(whole), _ROWS):
            rows = slice(start, min(start + _ROWS, len(whole)))
            each, columns = _force_rows(
                experiment, run, whole.part(rows), part, extra, numbers[rows]
            )
            residual[rows] = each.target - each.columns[:, :, :TEN] @ part.parameters
            weight[rows] = robust_weights(residual[rows] / np.sqrt(typical_square(residual[rows])))
            pieces.append(
                sums_of(each, weight[rows], freedom(whole) * (rows.stop - start) / len(whole), i)
            )
        own[columns] = True
        sums[run.name] = _embedded(sum_up([s for s, _ in pieces]), columns, part_total, own)
        if run.name not in held_out:
            joined = together([b for _, b in pieces])
            blocks.append(
                Blocks(
                    _wide(joined.crossed, columns, k), _wide(joined.right, columns, k), joined.run
                )
            )
        samples.append(whole)
        weights[run.name], residuals[run.name] = weight, residual
    total = sum_up([each for name, each in sums.items() if name not in held_out])
    size = part.size
    known = prior_of(
        experiment, calibration_parameters, part.calibration, part.kinematics, part.parameters, size
    )
    prior = Prior(
        mean=np.where(own, known.mean, 0.0),
        precision=np.where(np.outer(own, own), known.precision, 0.0),
        pull=np.where(own, known.pull, 0.0),
        covariance=part.solution.covariance,
    )
    solution = solve(
        total, prior, own & part.solution.estimated, plausible(part.parameters, size), correct=True
    )
    scored = together(blocks)
    result = replace(
        part,
        part=part,
        calibration=replace(
            part.calibration,
            values=part.calibration.values
            + np.where(solution.estimated, solution.value, 0.0)[TEN:],
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
    experiment: Experiment,
    run: Run,
    samples: Samples,
    part: Study,
    extra: Array,
    block: NDArray[np.intp],
) -> tuple[Rows, NDArray[np.intp]]:
    """Whitened rows over the body and the errors of the force instrument alone, and the places of
    these columns.
    """
    equations = balance(experiment, run, samples, part.calibration, part.sigma[run.name])
    L = whitener(equations, extra)
    Y = platform_regressor(samples.specific_force, samples.omega, samples.alpha)
    white = L @ regressor_noise(samples, np.random.default_rng(0))
    columns = L @ np.concatenate([Y, -equations.by_errors], axis=2)
    rows = Rows(
        columns=columns,
        instruments=columns,
        target=np.einsum("nij,nj->ni", L, samples.wrench),
        noise=np.einsum("dnki,dnkj->ij", white, white) / len(white),
        shared=np.concatenate([np.zeros(TEN), -shared_noise(equations, part.calibration, L)]),
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
    """Normal equations over some columns, with their products with all others as a part of the data
    shows these.
    """
    k = len(mask)
    share = own.freedom / part.freedom
    crossed = np.where(np.outer(mask, mask), 0.0, part.crossed * share)
    crossed[np.ix_(columns, columns)] = own.crossed
    right, shared = np.zeros(k), np.zeros(k)
    right[columns], shared[columns] = own.right, own.shared
    return Sums(crossed, crossed, crossed, right, right, own.square, own.noise, shared, own.freedom)
