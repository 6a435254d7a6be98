"""From an experiment to everything at once, and to the value that estimate and verdict are drawn
from.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.dynamics import platform_regressor
from steelyard.estimates.estimate import plausible_radius
from steelyard.experiment.model import Experiment
from steelyard.identification.model.calibration_parameters import (
    Calibration,
    CalibrationParameters,
    clock_of,
    gather,
)
from steelyard.identification.model.fitted_motion import FittedMotion, fitted_motion
from steelyard.identification.model.force_residuals import (
    Balance,
    Forces,
    balance_of,
    force_residuals,
    sample_weight,
)
from steelyard.identification.model.motion_residuals import (
    AT_REST,
    Segment,
    Tally,
    motion_residuals,
    reference_clocks,
    time_of,
)
from steelyard.identification.model.preparation import Samples, prepare
from steelyard.identification.model.segment import NormalEquations, Rows, accumulate
from steelyard.identification.model.sources import Source
from steelyard.identification.solve.bound import Bound
from steelyard.identification.solve.classical import NoBalanceError
from steelyard.identification.solve.coherence import coherence
from steelyard.identification.solve.iteration import prior_of
from steelyard.identification.solve.joint_fit import Fit, State, Task, fit
from steelyard.identification.solve.kinematic_fit import KinematicFit, told_about
from steelyard.identification.solve.lost_readings import STUCK_FAR, without_lost
from steelyard.identification.solve.normal_equations import (
    TEN,
    Blocks,
    Prior,
    Sums,
    enlarged,
    solve,
    together,
)
from steelyard.identification.solve.outliers import look
from steelyard.identification.solve.segmentation import Recorded, recorded, resampled
from steelyard.identification.solve.study import Progress, Study, plausible, sum_up
from steelyard.inertia import body_jacobian
from steelyard.smoothing import DEGREE

_FAR_OFF = 10.0
"""Prior 1-sigma beyond which an error, in a fit that did not arrive, is no beginning for
another."""
_COHERENT = 0.3
"""Correlation of what is left of forces and accelerometer that is a motion which the knots do not
follow."""
_MUCH_FINER = 0.7
_ROUNDS = 4
"""Rounds in which readings that stand out are left out."""
_BODY_ROUNDS = 3
_BLOCK = 1.0
"""Least length of the stretches that are held against each other [s]."""
_BLOCK_SPACINGS = 5.0
_MOST_BLOCKS = 60


@dataclass(frozen=True, eq=False)
class Joint:
    """An experiment, fitted as a whole."""

    study: Study
    fit: Fit
    force_samples: tuple[Forces, ...]
    contacts: Mapping[str, tuple[tuple[float, float], ...]]
    """Run -> stretches in which something touched the platform [s]."""
    spikes: Mapping[str, int]
    """Run -> force readings that stood alone."""
    bound: Bound
    """What can be known at best, if all noise is as it was taken."""
    motion: tuple[FittedMotion, ...]
    """Of each stretch of the runs in motion."""


def joint_study(
    experiment: Experiment, progress: Progress = None, start: Calibration | None = None
) -> Joint:
    """Fit an experiment as a whole.

    Args:
        experiment: With at least one run.
        progress: Is told what is being done and the fraction that is done.
        start: Values of the systematic errors to begin with; None: as known beforehand.

    Raises:
        InputError: A run lacks what the method needs.
        NoBalanceError: The numbers end in nothing.
    """
    try:
        # Numbers that end in nothing are looked at in the end, once.
        with np.errstate(all="ignore"):
            found = _joint(experiment, progress or (lambda what, fraction: None), start)
            sound = bool(np.isfinite(found.study.body_covariance).all())
    except np.linalg.LinAlgError:
        sound = False
    if not sound:
        raise NoBalanceError(
            "forces and motion cannot be fitted at all; check the force columns, their units and"
            " signs, and the geometry of the robot"
        )
    return found


def _joint(
    experiment: Experiment, tell: Callable[[str, float], None], start: Calibration | None
) -> Joint:
    calibration_parameters = gather(experiment)
    begin = start or Calibration(calibration_parameters, calibration_parameters.mean)
    samples: list[Samples] = []
    for i, run in enumerate(experiment.runs):
        tell(f"maximum-likelihood: reading {run.name}", 0.2 * i / len(experiment.runs))
        samples.append(prepare(experiment, run, thin=True, calibration=begin, commanded=True))
    records = [
        recorded(experiment, run, each, begin)
        for run, each in zip(experiment.runs, samples, strict=True)
    ]
    fitted = _fitted(experiment, begin, records, tell)
    if finer := _finer(experiment, records, fitted):
        tell("maximum-likelihood: following a vibration", 0.4)
        records = [
            (
                recorded(experiment, run, each, begin, finer[run.name].spacing)
                if run.name in finer
                else record
            )
            for run, each, record in zip(experiment.runs, samples, records, strict=True)
        ]
        fitted = _fitted(experiment, begin, records, tell, (fitted, finer))
    tell("maximum-likelihood: how well it is known", 0.85)
    return _concluded(experiment, fitted, samples, records)


@dataclass(frozen=True, eq=False)
class _Fitted:
    """A fit and what was left out of it."""

    task: Task
    fit: Fit
    motion: Fit
    """Without forces."""
    force_samples: tuple[Forces, ...]
    contacts: Mapping[str, Sequence[tuple[float, float]]]
    spikes: Mapping[str, int]
    lost: Sequence[str]
    """Notes of instruments that have lost the motion."""

    @property
    def balances(self) -> tuple[Balance, ...]:
        """Of every segment."""
        state = self.fit.state
        return tuple(
            balance_of(
                self.task.experiment, segment, forces, state.calibration, _ten(state), state.factors
            )
            for segment, forces in zip(state.segments, self.force_samples, strict=True)
        )


@dataclass(frozen=True)
class _Finer:
    """How a run is to be followed more closely."""

    spacing: float
    """Of the knots [s]."""
    clock: str
    lag: float
    """By how much that clock is later than thought [s]."""


def _finer(
    experiment: Experiment, records: Sequence[Recorded], fitted: _Fitted
) -> dict[str, _Finer]:
    """Runs in which forces and accelerometer both feel what the knots do not follow."""
    finest = {segment.run: each.finest for each in records for segment in each.segments}
    state = fitted.fit.state
    found = {}
    for segment, at in zip(state.segments, fitted.balances, strict=True):
        spacing = (
            0.0 if segment.static else float(segment.knots[DEGREE + 1] - segment.knots[DEGREE])
        )
        if finest[segment.run] < _MUCH_FINER * spacing:
            own = coherence(experiment, segment, at, state.calibration, float(_ten(state)[0]))
            if own.correlation > _COHERENT:
                found[segment.run] = _Finer(
                    finest[segment.run], clock_of(experiment, own.instrument), own.lag
                )
    return found


def _fitted(
    experiment: Experiment,
    begin: Calibration,
    records: Sequence[Recorded],
    tell: Callable[[str, float], None],
    before: tuple[_Fitted, Mapping[str, _Finer]] | None = None,
) -> _Fitted:
    """Motion first (or as it was before, on other knots), then motion and forces, leaving out what
    stands alone.
    """
    calibration_parameters = begin.calibration_parameters
    segments = tuple(segment for each in records for segment in each.segments)
    force_samples = tuple(forces for each in records for forces in each.force_samples)
    if not segments:
        raise NoBalanceError("; ".join(note for each in records for note in each.notes))
    size = plausible_radius(experiment.robot)
    task = Task(
        experiment,
        calibration_parameters,
        (None,) * len(segments),
        told_about(experiment, calibration_parameters, segments),
        _stated(experiment),
        plausible(np.ones(TEN), size),
        least={
            (name, quantity + rest): value
            for each in records
            for (name, quantity), value in each.least.items()
            for rest in ("", AT_REST)
        },
    )
    motion, state, lost = (
        _begun(experiment, task, State(segments, begin, None), tell)
        if before is None
        else _again(*before, segments)
    )
    tell("maximum-likelihood: motion and forces", 0.5)
    parameters = (
        _first_body(experiment, state, force_samples)
        if state.parameters is None
        else state.parameters
    )
    if not parameters[0] or not np.isfinite(parameters).all():
        raise np.linalg.LinAlgError
    task = replace(
        task,
        active=calibration_parameters.deviation > 0,
        sizes=plausible(parameters, size),
        known=_Known(experiment, calibration_parameters, size) if experiment.known else None,
    )
    state = replace(
        state,
        parameters=parameters,
        segments=tuple(
            _by_force_clock(experiment, segment, state.calibration) for segment in state.segments
        ),
    )
    if before is not None:
        # The vibration first, by these clocks: before it is there, nothing holds them.
        held = task.active.copy()
        for run, vibrating in before[1].items():
            held[calibration_parameters.place(vibrating.clock, "delay", run)] = False
        state = fit(replace(task, force_samples=force_samples, active=held), state).state
    contacts: dict[str, list[tuple[float, float]]] = {}
    spikes: dict[str, int] = {}
    for turn in range(_ROUNDS):
        task = replace(task, force_samples=force_samples)
        found = fit(
            task,
            state,
            lambda part: tell("maximum-likelihood: motion and forces", 0.5 + 0.3 * part),
        )
        state = found.state
        fitted = _Fitted(task, found, motion, force_samples, contacts, spikes, lost)
        if turn == _ROUNDS - 1 or (before is None and _finer(experiment, records, fitted)):
            # What is to be followed more closely need not be looked at for what stands out of it.
            break
        looked = [
            look(at, forces, forces.sigmas(segment, state.factors))
            for segment, at, forces in zip(
                state.segments, fitted.balances, force_samples, strict=True
            )
        ]
        if not any(each.changed for each in looked):
            break
        for segment, each in zip(state.segments, looked, strict=True):
            contacts.setdefault(segment.run, []).extend(each.contacts)
            spikes[segment.run] = spikes.get(segment.run, 0) + len(each.spikes)
        force_samples = tuple(each.force_samples for each in looked)
    return fitted


def _begun(
    experiment: Experiment, task: Task, state: State, tell: Callable[[str, float], None]
) -> tuple[Fit, State, Sequence[str]]:
    """Motion alone; where its instruments do not agree on one, the errors are begun with as known
    beforehand.
    """
    tell("maximum-likelihood: motion", 0.25)
    motion = fit(task, state, lambda part: tell("maximum-likelihood: motion", 0.25 + 0.25 * part))
    found, lost = motion.state, list[str]()
    if any(far >= STUCK_FAR for far in motion.tally.far.values()):
        found, lost = without_lost(experiment, found, arrived=motion.converged)
    if lost:
        motion = fit(task, found)
        found = motion.state
    off = np.abs(found.calibration.values - task.calibration_parameters.mean)[task.active]
    if not motion.converged and not np.all(
        off < _FAR_OFF * task.calibration_parameters.deviation[task.active]
    ):
        found = replace(
            state,
            segments=tuple(
                replace(a, readings=b.readings)
                for a, b in zip(state.segments, found.segments, strict=True)
            ),
        )
    return motion, found, lost


def _again(
    before: _Fitted, finer: Mapping[str, _Finer], segments: Sequence[Segment]
) -> tuple[Fit, State, Sequence[str]]:
    """What was found, on other knots; clocks where forces and accelerometers go together best,
    since what vibrates fits at many lags.
    """
    state, calibration_parameters = before.fit.state, before.task.calibration_parameters
    values = state.calibration.values.copy()
    for run, each in finer.items():
        place = calibration_parameters.place(each.clock, "delay", run)
        values[place] += np.where(calibration_parameters.deviation[place] > 0, each.lag, 0.0)
    state = replace(state, calibration=replace(state.calibration, values=values))
    moved = []
    for old, new in zip(state.segments, segments, strict=True):
        if old.knots is new.knots or len(old.knots) == len(new.knots):
            moved.append(old)
            continue
        onto = replace(new, reference=old.reference, knots=new.knots, readings=old.readings)
        moved.append(resampled(old, onto))
    return before.motion, replace(state, segments=tuple(moved)), before.lost


def _ten(state: State) -> Array:
    assert state.parameters is not None
    return state.parameters


def _stated(experiment: Experiment) -> frozenset[Source]:
    """Quantities whose noise is stated; that of a command that stands in for a measurement is no
    noise, and is not asked for either.
    """
    return frozenset(
        (name, quantity.name + rest)
        for rest in ("", AT_REST)
        for name, instrument in experiment.instruments.items()
        for quantity in instrument.quantities(experiment.robot.m)
        if quantity.noise or instrument.commanded
    )


class _Known:
    """What is known about the body beforehand, about present parameters."""

    def __init__(
        self, experiment: Experiment, calibration_parameters: CalibrationParameters, size: float
    ) -> None:
        self._experiment, self._calibration_parameters, self._size = (
            experiment,
            calibration_parameters,
            size,
        )

    def __call__(self, parameters: Array) -> tuple[Array, Array]:
        """Precision and pull, shapes (10, 10) and (10,)."""
        prior = _prior(
            self._experiment,
            self._calibration_parameters,
            self._calibration_parameters.mean,
            parameters,
            self._size,
        )
        return prior.precision[:TEN, :TEN], prior.pull[:TEN]


def _prior(
    experiment: Experiment,
    calibration_parameters: CalibrationParameters,
    values: Array,
    parameters: Array,
    size: float,
) -> Prior:
    alone = KinematicFit(
        Calibration(calibration_parameters, calibration_parameters.mean),
        np.diag(calibration_parameters.deviation**2),
        {},
        True,
    )
    return prior_of(
        experiment,
        calibration_parameters,
        Calibration(calibration_parameters, values),
        alone,
        parameters,
        size,
    )


def _first_body(experiment: Experiment, state: State, force_samples: Sequence[Forces]) -> Array:
    """The ten linear parameters that balance forces and a given motion, samples that stand far
    counting less.
    """
    parameters = np.zeros(TEN)
    for _ in range(_BODY_ROUNDS):
        normal, right = np.zeros((TEN, TEN)), np.zeros(TEN)
        for segment, forces in zip(state.segments, force_samples, strict=True):
            at = balance_of(
                experiment, segment, forces, state.calibration, parameters, state.factors
            )
            regressor = platform_regressor(
                at.motion["specific_force"], at.motion["omega"], at.motion["alpha"]
            )
            residual = at.residual
            weight = sample_weight(residual)
            A = -at.whitener @ regressor
            normal += np.einsum("nki,n,nkj->ij", A, weight, A, optimize=True)
            right += np.einsum(
                "nki,n,nk->i",
                A,
                weight,
                np.einsum("nki,i->nk", A, parameters) - residual,
                optimize=True,
            )
        scale = 1 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
        solution, *_ = np.linalg.lstsq(normal * np.outer(scale, scale), scale * right, rcond=1e-9)
        parameters = scale * solution
    return np.asarray(parameters)


def _concluded(
    experiment: Experiment, fitted: _Fitted, samples: Sequence[Samples], records: Sequence[Recorded]
) -> Joint:
    """Normal equations over every systematic error, estimated or not, and all that follows from
    them.
    """
    task, found, motion, force_samples = (
        fitted.task,
        fitted.fit,
        fitted.motion,
        fitted.force_samples,
    )
    notes = [*(note for each in records for note in each.notes), *fitted.lost]
    state, calibration_parameters = found.state, task.calibration_parameters
    parameters = _ten(state)
    border = TEN + len(calibration_parameters)
    column_of = TEN + np.arange(len(calibration_parameters), dtype=np.intp)
    sums: dict[str, Sums] = {}
    blocks: list[Blocks] = []
    solved: list[tuple[Segment, Array, Array]] = []
    names = [run.name for run in experiment.runs]
    for segment, forces in zip(state.segments, force_samples, strict=True):
        rows = list(_rows(experiment, segment, forces, state, column_of))
        equations = segment.smooth(
            accumulate(len(segment.coefficients), border, rows, width=segment.width)
        )
        normal, gradient = equations.reduced()
        own = _sums(normal, gradient, parameters, float(np.sum(~forces.left_out.all(axis=1))))
        sums[segment.run] = own if segment.run not in sums else sums[segment.run] + own
        blocks.append(_blocks(segment, rows, equations, parameters, names.index(segment.run)))
        if not segment.static:
            solved.append((segment, equations.inverse, equations.followed))
    balances = fitted.balances
    noise = {run.name: np.zeros((TEN, TEN)) for run in experiment.runs}
    for segment, inverse, followed in solved:
        at = balances[state.segments.index(segment)]
        noise[segment.run] = noise[segment.run] + _regressor_noise(
            segment, at, inverse, followed, state.calibration.gravity
        )
    sums = {name: replace(each, noise=noise[name]) for name, each in sums.items()}
    total = sum_up(list(sums.values()))
    prior = _prior(
        experiment,
        calibration_parameters,
        state.calibration.values,
        parameters,
        plausible_radius(experiment.robot),
    )
    estimated = np.concatenate([np.ones(TEN, dtype=bool), task.active])
    size = plausible(parameters, plausible_radius(experiment.robot))
    solution = solve(total, prior, estimated, size, correct=False, loud=_LOUD)
    force_labels = {
        segment.label(f.name, q)
        for segment, f in zip(state.segments, force_samples, strict=True)
        for q in f.readings
    }
    solution = replace(solution, ratio=_force_ratio(found, force_labels, frozenset()), spent=0.0)
    by_run = {
        run.name: _of_run(run.name, state.segments, balances, force_samples)
        for run in experiment.runs
    }
    # A stated noise that did not hold counts as it is, but the verdict asks how it compares with
    # what was stated.
    level = {
        label: state.factors.get(label, 1.0) if label in task.stated else 1.0
        for label in found.ratios
    }
    kinematic = {
        label: float(np.sqrt(value)) * level[label]
        for label, value in found.ratios.items()
        if label not in force_labels
    }
    used = tuple(
        _samples(each, by_run[each.run], records[i]) if by_run[each.run] else each
        for i, each in enumerate(samples)
    )
    scored = together(blocks)
    # A gap is left out by a filter; here the motion goes on across it, and what is left out has a
    # note of its own.
    prepared = [note for s in samples for note in s.notes if "gap" not in note]
    result = Study(
        experiment=experiment,
        calibration=state.calibration,
        kinematics=KinematicFit(
            state.calibration,
            np.diag(calibration_parameters.deviation**2),
            kinematic,
            found.converged or motion.converged,
            state.segments,
        ),
        samples=used,
        sigma={
            segment.run: forces.sigma
            for segment, forces in zip(state.segments, force_samples, strict=True)
        },
        stated=force_labels <= task.stated,
        sums=sums,
        prior=prior,
        solution=solution,
        blocks=scored,
        parameters=solution.value[:TEN],
        weights={
            name: np.concatenate([_weights(b, f) for b, f in each])
            for name, each in by_run.items()
            if each
        },
        residuals={
            name: np.concatenate([b.residual for b, _ in each])
            for name, each in by_run.items()
            if each
        },
        settled=found.converged,
        notes=tuple(dict.fromkeys([*prepared, *notes])),
    )
    J = body_jacobian(solution.value[:TEN])
    bound = Bound(
        np.asarray(J @ solution.covariance[:TEN, :TEN] @ J.T), solution.covariance[TEN:, TEN:]
    )
    solution = enlarged(solution, scored, result.told, max(total.freedom, 1.0))
    # What the verdict asks is how the forces compare with what was stated of them.
    result = replace(
        result, solution=replace(solution, ratio=_force_ratio(found, force_labels, task.stated))
    )
    border_covariance = np.where(np.outer(estimated, estimated), solution.covariance, 0.0)
    return Joint(
        result,
        found,
        force_samples,
        {name: tuple(each) for name, each in fitted.contacts.items() if each},
        {name: n for name, n in fitted.spikes.items() if n},
        bound,
        tuple(
            _on_common_time(
                state.calibration,
                segment,
                fitted_motion(segment, inverse, followed, border_covariance),
            )
            for segment, inverse, followed in solved
        ),
    )


_LOUD = 1.0
"""A direction is told where its information exceeds what the noise of the fitted motion alone would
give. (Where nothing turns it has a third of that, for what the motion takes of it; in a single move
from rest to rest, which tells the moments to a quarter, twice as much.)"""
_LOOKED_AT = 500
"""Samples that show how much noise the fitted motion has in the regressor."""


def _regressor_noise(
    segment: Segment, at: Balance, inverse: Array, followed: Array, gravity: Array
) -> Array:
    """Mean product of the noise in the regressor with itself, summed over the samples: what a
    motion of nothing but noise would tell.
    """
    few = slice(None, None, -(-len(at.time) // _LOOKED_AT))
    nothing = np.zeros((followed.shape[1], followed.shape[1]))
    sigma = fitted_motion(segment, inverse, followed, nothing, at.time[few]).sigma
    level = {name: float(np.sqrt(np.mean(each**2))) for name, each in sigma.items()}
    noisy = {
        "omega": level["angular_velocity"],
        "alpha": level["angular_acceleration"],
        "specific_force": float(
            np.hypot(level["acceleration"], np.linalg.norm(gravity) * level["rotation"])
        ),
    }
    rng = np.random.default_rng(0)
    motion = {key: at.motion[key][few] for key in ("specific_force", "omega", "alpha")}
    moved = {key: rng.standard_normal(each.shape) * noisy[key] for key, each in motion.items()}
    there, back = (
        platform_regressor(*(motion[key] + sign * each for key, each in moved.items()))
        for sign in (1, -1)
    )
    white = at.whitener[few] @ (there - back) / 2
    return np.asarray(np.einsum("nki,nkj->ij", white, white) * len(at.time) / len(white))


def _by_force_clock(experiment: Experiment, segment: Segment, calibration: Calibration) -> Segment:
    """The same motion, told in the time of the forces."""
    if segment.static:
        return segment
    calibration_parameters = calibration.calibration_parameters
    name = experiment.force_instrument(
        next(run for run in experiment.runs if run.name == segment.run)
    )
    assert name is not None
    nothing = np.zeros(1)
    (there,), *_ = time_of(
        experiment,
        segment,
        calibration,
        reference_clocks(experiment, calibration_parameters, segment),
        name,
        nothing,
    )
    told = replace(segment, reference=clock_of(experiment, name))
    (here,), *_ = time_of(experiment, told, calibration, {}, name, nothing)
    return replace(told, knots=segment.knots + (here - there))


def _on_common_time(
    calibration: Calibration, segment: Segment, motion: FittedMotion
) -> FittedMotion:
    """Motion in common time: the clock that tells it may have a delay of its own."""
    assert segment.reference is not None
    calibration_parameters = calibration.calibration_parameters
    own = calibration_parameters.place(segment.reference, "delay", segment.run)
    return replace(
        motion,
        time=motion.time - float((calibration.values[own] - calibration_parameters.mean[own])[0]),
    )


def _rows(
    experiment: Experiment,
    segment: Segment,
    forces: Forces,
    state: State,
    column_of: NDArray[np.intp],
) -> Iterator[Rows]:
    tally = Tally()
    yield from motion_residuals(
        experiment, segment, state.calibration, column_of, state.factors, tally
    )
    for part in forces.parts():
        yield force_residuals(
            experiment,
            segment,
            part,
            state.calibration,
            column_of,
            _ten(state),
            state.factors,
            tally,
        )


def _sums(normal: Array, gradient: Array, parameters: Array, freedom: float) -> Sums:
    """About the present values: the ten absolute, the errors by how far they are off."""
    at = np.concatenate([parameters, np.zeros(len(gradient) - TEN)])
    right = gradient + normal @ at
    square = float(at @ normal @ at + 2 * at @ gradient)
    return Sums(
        normal,
        normal,
        normal,
        right,
        right,
        square,
        np.zeros((TEN, TEN)),
        np.zeros(len(gradient)),
        freedom,
    )


def _blocks(
    segment: Segment, rows: Iterable[Rows], equations: NormalEquations, parameters: Array, run: int
) -> Blocks:
    """Stretches of a segment, each with what it says about the border once the motion has followed."""
    instants = (
        len(segment.coefficients)
        if segment.static
        else len(segment.coefficients) - segment.width // 7 + 1
    )
    length = float(segment.knots[-1] - segment.knots[0])
    spacing = length / max(instants, 1)
    if segment.static:
        count = min(instants, _MOST_BLOCKS)
    else:
        count = int(np.clip(length / max(_BLOCK, _BLOCK_SPACINGS * spacing), 1, _MOST_BLOCKS))
    number = np.arange(instants) * count // instants
    border = equations.side.shape[1]
    crossed, right = np.zeros((count, border, border)), np.zeros((count, border))
    for part in rows:
        if part.label is None:
            continue
        columns = np.arange(border) if part.columns is None else part.columns
        order = np.argsort(part.first, kind="stable")
        edges = np.searchsorted(part.first[order], np.arange(instants + 1))
        for i in np.flatnonzero(np.diff(edges)):
            own = order[edges[i] : edges[i + 1]]
            motion = part.by_motion[own].reshape(-1, segment.width)
            E = -motion @ equations.followed[i * 7 : i * 7 + segment.width]
            E[:, columns] += part.by_errors[own].reshape(-1, len(columns))
            crossed[number[i]] += E.T @ E
            right[number[i]] -= E.T @ part.residual[own].ravel()
    at = np.concatenate([parameters, np.zeros(border - TEN)])
    return Blocks(crossed, right + crossed @ at, np.full(count, run, dtype=np.intp))


def _force_ratio(found: Fit, labels: set[Source], stated: frozenset[Source]) -> float:
    """Variance of what is left of the forces over what their noise explains, that of some
    quantities as it was stated.
    """
    square = freedom = 0.0
    for label in labels:
        count = found.tally.count.get(label, 0.0)
        level = found.state.factors.get(label, 1.0) if label in stated else 1.0
        square += found.ratios.get(label, 1.0) * level**2 * count
        freedom += count
    return square / max(freedom, 1.0)


def _of_run(
    name: str,
    segments: Sequence[Segment],
    balances: Sequence[Balance],
    force_samples: Sequence[Forces],
) -> list[tuple[Balance, Forces]]:
    return [
        (b, f)
        for segment, b, f in zip(segments, balances, force_samples, strict=True)
        if segment.run == name
    ]


def _weights(at: Balance, force_samples: Forces) -> Array:
    """Weight of every sample; those that have been left out and named are none that stand out."""
    weight = sample_weight(at.residual)
    return np.where(force_samples.left_out.any(axis=1), 1.0, weight)


def _samples(prepared: Samples, own: Sequence[tuple[Balance, Forces]], record: Recorded) -> Samples:
    """Samples at the times of the force readings, with the fitted motion and the forces as they
    were read.
    """

    def joined(parts: Iterable[Array]) -> Array:
        return np.concatenate(list(parts))

    structures = [at.structure for at, _ in own if at.structure is not None]
    grid = record.segments[0].knots
    return replace(
        prepared,
        time=joined(at.time for at, _ in own),
        wrench=joined(at.wrench for at, _ in own),
        tension=joined(at.carried for at, _ in own) if structures else None,
        structure=joined(structures) if structures else None,
        spacing=0.0 if prepared.static else float(grid[DEGREE + 1] - grid[DEGREE]),
        share=1.0,
        omega=joined(at.motion["omega"] for at, _ in own),
        alpha=joined(at.motion["alpha"] for at, _ in own),
        specific_force=joined(at.motion["specific_force"] for at, _ in own),
        position=joined(at.motion["position"] for at, _ in own),
        rotation=joined(at.motion["rotation"] for at, _ in own),
        velocity=joined(at.motion["velocity"] for at, _ in own),
    )
