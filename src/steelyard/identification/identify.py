"""All methods over one experiment, and what `identify` writes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.clocks.offsets import Offset
from steelyard.digits import LABELS, number, ten_numbers
from steelyard.display import Display
from steelyard.errors import InputError
from steelyard.estimates.estimate import (
    BEST_FIRST,
    FORMAT,
    Estimate,
    named,
    no_estimate,
    per_mass_rows,
)
from steelyard.experiment.faults.words import left_out_in_words
from steelyard.experiment.given import GivenExperiment, experiment_of
from steelyard.experiment.model import Experiment, Load
from steelyard.experiment.unread import is_unread
from steelyard.identification.by_frequencies import by_frequencies
from steelyard.identification.methods.consistent import Consistent
from steelyard.identification.methods.force_free import ForceFree
from steelyard.identification.methods.instrumental_variables import InstrumentalVariables
from steelyard.identification.methods.least_squares import LeastSquares
from steelyard.identification.methods.loads import each_alone
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.methods.method import Fit, Method, by_processes
from steelyard.identification.methods.recursive import Recursive
from steelyard.identification.methods.two_step import TwoStep
from steelyard.identification.model.fitted_motion import FittedMotion
from steelyard.identification.side_by_side import elsewhere
from steelyard.identification.solve.beginning.begin import NoBalanceError
from steelyard.identification.solve.bound import Bound
from steelyard.identification.solve.posterior import Posterior, Progress
from steelyard.identification.synchronisation import synchronise
from steelyard.identification.verdict.disagreement import with_disagreement
from steelyard.identification.verdict.prediction import Prediction, predict_held_out
from steelyard.inertia import BODY_PARAMETERS, Inertia
from steelyard.tables import Tabular

AVAILABLE: dict[str, Callable[[], Method]] = {
    "two-step": TwoStep,
    "force-free": ForceFree,
    "least-squares": LeastSquares,
    "instrumental-variables": InstrumentalVariables,
    "consistent": Consistent,
    "recursive": Recursive,
    "maximum-likelihood": MaximumLikelihood,
}
"""Methods of this version by name, with their default settings."""
_QUICK = 0.1
"""How long clocks, a baseline or what is drawn from a fit that is there take, in units of a fit."""
ALL = "all"
"""Stands for every one of them."""


@dataclass(frozen=True, eq=False)
class Identification(Tabular):
    """Estimates of one experiment; it shows itself as a table of them."""

    experiment: str
    nominal: Inertia | None
    estimates: Mapping[str, Estimate]
    predictions: tuple[Prediction, ...] = ()
    """Of runs that were held out."""
    clocks: Mapping[str, tuple[Offset, ...]] = field(default_factory=dict)
    """Run -> its clocks, where they were found from the data."""
    left_out: tuple[str, ...] = ()
    """Readings that were taken out when the recording was read, in words."""
    recorded: Experiment | None = None
    """What was looked at: without the runs held out, on one clock."""
    posterior: Posterior | None = None
    """What the best of the estimates was drawn from; None: it is a method of its own."""
    amendment: str = ""
    """YAML to merge into the experiment file, where that takes back what makes the result wrong;
    empty: nothing is known that would."""

    @property
    def bound(self) -> Bound | None:
        """What could be known at best; None where no method tells it."""
        return None if self.posterior is None else self.posterior.bound

    @property
    def motion(self) -> tuple[FittedMotion, ...]:
        """Of each stretch of the runs, as the best method has it."""
        return () if self.posterior is None else self.posterior.motion

    @property
    def result(self) -> str:
        """Name of the best method that ran, of those that have numbers where any has."""
        return _best(self.estimates)

    @property
    def estimate(self) -> Estimate:
        """Of the best method that ran."""
        return self.estimates[self.result]

    @property
    def is_rejected(self) -> bool:
        """Whether the methods that were assessed reject the result; a baseline alone is neither
        accepted nor rejected.
        """
        if self.estimate.verdict.accepted is not None:
            return not self.estimate.verdict.accepted
        return any(each.verdict.accepted is False for each in self.estimates.values())

    def to_dict(self) -> dict[str, Any]:
        """Plain values in the shape of ``estimate.json``."""
        return {
            "format": FORMAT,
            "experiment": self.experiment,
            "nominal": self.nominal.to_dict() if self.nominal else None,
            "result": self.result,
            "estimates": {name: estimate.to_dict() for name, estimate in self.estimates.items()},
            **({"recordings": self.recorded.digests()} if self.recorded else {}),
            **(
                {"attainable": {"standard_deviation": named(self.bound.standard_deviation)}}
                if self.bound
                else {}
            ),
            **(
                {
                    "clocks": {
                        run: [o.to_dict() for o in found] for run, found in self.clocks.items()
                    }
                }
                if self.clocks
                else {}
            ),
            **({"left_out": list(self.left_out)} if self.left_out else {}),
            **({"amendment": self.amendment} if self.amendment else {}),
            **(
                {"holdout": {p.run: p.to_dict() for p in self.predictions}}
                if self.predictions
                else {}
            ),
        }

    def columns(self) -> dict[str, Array | Sequence[str]]:
        """Ten rows for each method: ``method``, then those of :meth:`.Estimate.columns`."""
        each = [estimate.columns() for estimate in self.estimates.values()]
        methods = [name for name in self.estimates for _ in BODY_PARAMETERS]
        return {
            "method": methods,
            **{key: np.concatenate([np.asarray(c[key]) for c in each]) for key in each[0]},
        }

    def __repr__(self) -> str:
        return self._display().text()

    def _repr_html_(self) -> str:
        return self._display().html()

    def _display(self) -> Display:
        """A table of the ten by all methods, with their verdicts."""
        columns = [
            ten_numbers(each.value, each.standard_deviation) for each in self.estimates.values()
        ]
        return Display(
            self.experiment,
            tuple(
                (name, unit, *cells)
                for (name, unit, _), *cells in zip(LABELS, *columns, strict=True)
            )
            + self._per_mass(),
            head=("", "", *self.estimates),
            sentences=(
                *(f"{name}: {each.verdict}" for name, each in self.estimates.items()),
                *(
                    [f"to merge into the experiment file: {self._in_one_line}"]
                    if self.amendment
                    else []
                ),
            ),
        )

    @property
    def _in_one_line(self) -> str:
        """What to merge, as a sentence has it."""
        return " ".join(self.amendment.split())

    def _per_mass(self) -> tuple[tuple[str, ...], ...]:
        """Rows of the inertia over mass by all methods; none where every one has the mass."""
        each = [estimate.per_mass for estimate in self.estimates.values()]
        rows = [None if found is None else per_mass_rows(found) for found in each]
        some = next((own for own in rows if own is not None), None)
        if some is None:
            return ()
        return tuple(
            (name, unit, *(number(None) if own is None else own[i][2] for own in rows))
            for i, (name, unit, _) in enumerate(some)
        )


def identify(
    experiment: GivenExperiment,
    methods: str | Method | Sequence[Method | str] = (),
    progress: Progress = None,
    *,
    holdout: Sequence[str] = (),
    ready: Mapping[str, Method] | None = None,
    jobs: int = 1,
) -> Identification:
    """Estimate the inertial parameters of the platform.

    Args:
        experiment: With at least one run, or the path of its file.
        methods: Estimators or names of them (``two-step``, ``force-free``, ``least-squares``,
            ``instrumental-variables``, ``consistent``, ``recursive``, ``maximum-likelihood``,
            ``all``); none: the
            best there is, with the two steps of the paper beside it, or ``force-free`` where no
            force is read.
        progress: Is told what is being done and the fraction that is done.
        holdout: Names of runs to leave out, whose forces are predicted.
        ready: Name -> estimator to take in place of the one with default settings.
        jobs: Processes that work at a time: fits of several methods, the one without the runs left
            out, and windows of a long recording do not wait for each other.

    Raises:
        InputError: A run lacks what a method needs, or there is no run or no method of a name.
    """
    if jobs < 1:
        raise InputError(f"--jobs: expected 1 or more, found {jobs}; choose another number")
    experiment = experiment_of(experiment)
    methods = [methods] if isinstance(methods, str) or callable(methods) else methods
    holdout = [holdout] if isinstance(holdout, str) else holdout
    chosen = chosen_methods(methods or default_methods(experiment), ready)
    if ALL in methods and experiment.mass_walk:
        chosen = [each for each in chosen if each.name == Recursive.name]
    elif ALL in methods:
        chosen = [each for each in chosen if not (each.is_baseline and each.lack(experiment))]
        if not experiment.runs:
            chosen = [each for each in chosen if each.name == MaximumLikelihood.name]
    _check_walk(experiment, chosen)
    chosen = [by_processes(each, jobs) for each in chosen]
    names = [run.name for run in experiment.runs]
    if holdout and not names:
        raise InputError(
            "--holdout: expected runs in motion, found natural frequencies alone; leave it out"
        )
    for name in holdout:
        if name not in names:
            raise InputError(
                f"--holdout: expected one of {', '.join(names)}, found '{name}'; choose one of"
                " these"
            )
    clocks, held_out, *each = _shares(progress, chosen, holdout=bool(holdout))
    found = synchronise(experiment, clocks)
    experiment = found.experiment
    used = replace(
        experiment, runs=tuple(run for run in experiment.runs if run.name not in holdout)
    )
    estimates: list[Estimate] = []
    posteriors: dict[Fit, Posterior] = {}
    baseline: InputError | None = None
    with elsewhere(chosen, used, _estimate, jobs=jobs, further=bool(holdout)) as others:
        predicted = (
            others.call(predict_held_out, experiment, frozenset(holdout), progress=held_out)
            if holdout
            else tuple
        )
        for i, (method, share) in enumerate(zip(chosen, each, strict=True)):
            try:
                if i in others.methods:
                    estimates.append(others.estimate(i))
                else:
                    estimates.append(_estimate(method, used, posteriors, share))
            except NoBalanceError as error:
                estimates.append(no_estimate(method.name, str(error)))
            except InputError as error:
                if not method.is_baseline or len(chosen) == 1:
                    raise
                # The baseline needs more instruments than better methods do.
                baseline = error
                estimates.append(no_estimate(method.name, str(error)))
        predictions: tuple[Prediction, ...] = predicted()
    if not methods and not np.isfinite(estimates[-1].value).any():
        # The best there is has not arrived: the motion held, as its instruments tell it.
        fallen_back = by_processes(Consistent(), jobs)
        try:
            estimates.append(_estimate(fallen_back, used, posteriors, progress))
            chosen.append(fallen_back)
        except (NoBalanceError, InputError):
            pass
    if baseline is not None and not any(np.isfinite(each.value).any() for each in estimates):
        raise baseline
    by_name = {each.method: each for each in estimates}
    best = _best(by_name)
    by_name = with_disagreement(by_name, best)
    fits = (method.fit for method in chosen if method.name == best)
    posterior = next((posteriors.get(fit) for fit in fits if fit is not None), None)
    return Identification(
        experiment.name,
        experiment.robot.platform,
        by_name,
        predictions,
        found.offsets,
        tuple(left_out_in_words(run.name, fault) for run in used.runs for fault in run.excluded),
        used,
        posterior,
    )


def _check_walk(experiment: Experiment, methods: Sequence[Method]) -> None:
    """Refuse methods for which a mass that walks stays as it is.

    Raises:
        InputError: One is among them.
    """
    others = [each.name for each in methods if each.name != Recursive.name]
    if experiment.mass_walk and others:
        raise InputError(
            f"--method: expected {Recursive.name}, which alone follows the mass that walks as"
            f" 'known: mass: walk' says, found {others[0]}; choose it, or leave 'walk' out"
        )


def _shares(progress: Progress, methods: Sequence[Method], *, holdout: bool) -> list[Progress]:
    """Progress of the clocks, of runs left out and of each method, as fractions of the whole: fits
    take about as long as each other, all else little.
    """
    fitted: list[Fit | None] = []
    weights = [_QUICK, 1.0 if holdout else 0.0]
    for method in methods:
        known = method.fit is not None and method.fit in fitted
        weights.append(_QUICK if known or method.is_baseline else 1.0)
        fitted.append(method.fit)
    whole, shares = sum(weights), []
    for i, weight in enumerate(weights):
        shares.append(_share(progress, sum(weights[:i]) / whole, weight / whole))
    return shares


def _share(progress: Progress, before: float, share: float) -> Progress:
    """Progress of a part of the whole."""
    if progress is None:
        return None
    return lambda what, done: progress(what, before + share * min(1.0, done))


def _best(estimates: Mapping[str, Estimate]) -> str:
    """Name of the best method, of those that have numbers where any has."""
    ran = [name for name in BEST_FIRST if name in estimates]
    told = [name for name in ran if np.isfinite(estimates[name].value).any()]
    return (told or ran)[0]


def _estimate(
    method: Method,
    experiment: Experiment,
    posteriors: dict[Fit, Posterior],
    progress: Progress = None,
) -> Estimate:
    """By one method; a posterior that several draw from is fitted once, and not in vain."""
    fit = method.fit
    if not experiment.runs:
        if method.name != MaximumLikelihood.name:
            return no_estimate(
                method.name, "it needs a run in motion, found natural frequencies alone"
            )
        return by_frequencies(experiment, method.name)
    if fit is None and experiment.loads and not method.lack(experiment):
        return each_alone(lambda load: _alone(method, experiment, load, progress), experiment)
    if fit is None or method.lack(experiment):
        return method(experiment, progress)
    if fit not in posteriors:
        posteriors[fit] = fit(experiment, progress)
    return method.drawn(posteriors[fit])


def _alone(method: Method, experiment: Experiment, load: Load, progress: Progress) -> Estimate:
    """Of one of several loads; where its runs lack what the method needs, the others have it."""
    alone = experiment.alone(load)
    lack = method.lack(alone)
    if any(experiment.moves_within(run.name) for run in alone.runs):
        lack = (
            f"it knows rigid bodies alone, found something that moves in load '{load.name}'; use"
            f" {MaximumLikelihood.name}"
        )
    return no_estimate(method.name, lack) if lack else method(alone, progress)


def default_methods(experiment: Experiment) -> tuple[str, ...]:
    """The best there is, with the usual regression beside it: the two steps of the paper, or without
    forces that on what the cables cannot carry.
    """
    if not experiment.runs:
        return (MaximumLikelihood.name,)
    if experiment.mass_walk:
        return (Recursive.name,)
    baseline = ForceFree.name if is_unread(experiment) else TwoStep.name
    return (baseline, MaximumLikelihood.name)


def chosen_methods(
    methods: Sequence[Method | str], ready: Mapping[str, Method] | None = None
) -> list[Method]:
    """Estimators, each once where it is named.

    Args:
        methods: Estimators or their names; ``all`` stands for every one; none: the best there is,
            with the two steps of the paper beside it.
        ready: Name -> estimator to take in place of the one with default settings.

    Raises:
        InputError: There is none of a name.
    """
    own = ready or {}
    if not isinstance(methods, Sequence):
        raise InputError(
            "--method: expected names of methods or estimators, found"
            f" {type(methods).__name__}; give a list of them"
        )
    chosen: dict[str | int, Method] = {}
    for i, method in enumerate(methods or (TwoStep.name, MaximumLikelihood.name)):
        if callable(method):
            chosen[i] = method
            continue
        if method != ALL and method not in AVAILABLE:
            raise InputError(
                f"--method: expected one of {', '.join(AVAILABLE)}, or all, found '{method}';"
                " choose one of these"
            )
        for name in AVAILABLE if method == ALL else (method,):
            chosen[name] = own[name] if name in own else AVAILABLE[name]()
    return list(chosen.values())
