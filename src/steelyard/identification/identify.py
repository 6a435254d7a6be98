"""All methods over one experiment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from steelyard.errors import InputError
from steelyard.estimates.estimate import Estimate, no_estimate
from steelyard.experiment.equivalent.platform_frame import centred
from steelyard.experiment.faults.words import left_out_in_words
from steelyard.experiment.given import GivenExperiment, experiment_of
from steelyard.experiment.model import Experiment, Load
from steelyard.identification.by_frequencies import by_frequencies
from steelyard.identification.chosen_methods import ALL, chosen_methods, default_methods
from steelyard.identification.identification import Identification, best_of
from steelyard.identification.methods.consistent import Consistent
from steelyard.identification.methods.loads import each_alone
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.methods.method import Fit, Method, by_processes
from steelyard.identification.methods.recursive import Recursive
from steelyard.identification.side_by_side import elsewhere
from steelyard.identification.solve.beginning.begin import NoBalanceError
from steelyard.identification.solve.posterior import Posterior, Progress
from steelyard.identification.synchronisation import synchronise
from steelyard.identification.verdict.disagreement import with_disagreement
from steelyard.identification.verdict.prediction import Prediction, predict_held_out

_QUICK = 0.1
"""How long clocks, a baseline or what is drawn from a fit that is there take, in units of a fit."""


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
    if jobs > 1:
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
    best = best_of(by_name)
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
        told = centred(experiment)
        return by_frequencies(told, method.name).about(told.origin)
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
