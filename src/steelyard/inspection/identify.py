"""`identify`, which looks at the description first: what cannot be right is not estimated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from steelyard.errors import InputError
from steelyard.estimates.estimate import Estimate, no_estimate
from steelyard.experiment.given import GivenExperiment, experiment_of
from steelyard.experiment.model import Experiment
from steelyard.identification.chosen_methods import chosen_methods, default_methods
from steelyard.identification.identification import Identification
from steelyard.identification.identify import identify as estimate_all
from steelyard.identification.methods.method import Method
from steelyard.identification.solve.posterior import Progress
from steelyard.identification.synchronisation import Synchronised, synchronise
from steelyard.inspection.description import DescriptionCheck, check_description, merged
from steelyard.inspection.misplaced import misplaced
from steelyard.inspection.mistakes.sizes import size_mistakes
from steelyard.inspection.settings import INSPECTION, InspectionSettings


def identify(
    experiment: GivenExperiment,
    methods: str | Method | Sequence[Method | str] = (),
    progress: Progress = None,
    *,
    holdout: Sequence[str] = (),
    ready: Mapping[str, Method] | None = None,
    anyway: bool = False,
    jobs: int = 1,
    settings: InspectionSettings = INSPECTION,
) -> Identification:
    """Estimate the inertial parameters of the platform, unless the recordings give away that the
    description is wrong: in units, signs, axes, orders, places or clocks.

    A result that cannot be right for such a reason is rejected, with what to change in
    :attr:`.Identification.amendment`. Methods that fit a model are not begun then, unless the noise
    alone says so, which may be stated wrongly itself; baselines run.

    Args:
        experiment: With at least one run, or the path of its file.
        methods: Estimators or names of them (``two-step``, ``force-free``, ``least-squares``,
            ``instrumental-variables``, ``consistent``, ``recursive``, ``maximum-likelihood``,
            ``all``); none: the best there is, with the two steps of the paper beside it, or
            ``force-free`` where no force is read.
        progress: Is told what is being done and the fraction that is done.
        holdout: Names of runs to leave out, whose forces are predicted.
        ready: Name -> estimator to take in place of the one with default settings.
        anyway: Whether all methods run though a mistake was found; the result is rejected all the
            same.
        jobs: Processes that work at a time: fits of several methods, and the one without the runs
            left out, do not wait for each other. Scripts that ask for more than one keep what they
            do under ``if __name__ == "__main__":``.
        settings: What is named as a mistake.

    Raises:
        InputError: A run lacks what a method needs, or there is no run or no method of a name.
    """
    experiment = experiment_of(experiment)
    names = [methods] if isinstance(methods, str) or callable(methods) else methods
    chosen = chosen_methods(names or default_methods(experiment), ready)
    clocks, check = _checked(experiment, progress, settings)
    if check.is_certain and not anyway:
        found = _not_begun(clocks.experiment, chosen, check, progress)
    else:
        found = estimate_all(
            clocks.experiment, names, progress, holdout=holdout, ready=ready, jobs=jobs
        )
        if check.mistakes:
            estimates = {k: _rejected(v, check.reasons) for k, v in found.estimates.items()}
            found = replace(found, estimates=estimates)
    amendment = check.amendment
    if not check.mistakes and found.is_rejected:
        tests = found.estimate.details.get("directed_tests", {}).get("largest", ())
        place = misplaced(clocks.experiment, tests)
        amendment = "" if place is None else place.amendment
    return replace(found, clocks=clocks.offsets or found.clocks, amendment=amendment)


def _checked(
    experiment: Experiment, progress: Progress, settings: InspectionSettings
) -> tuple[Synchronised, DescriptionCheck]:
    """The experiment on one clock, and the mistakes of its description."""
    by_size = size_mistakes(experiment, settings.sizes)
    if by_size and any(run.unsynchronised for run in experiment.runs):
        # No clock is found with these; without it nothing else can be looked at.
        return Synchronised(experiment, {}), merged(by_size)
    clocks = synchronise(experiment, progress, settings=settings.synchronisation)
    if not experiment.runs:
        return clocks, merged([])
    return clocks, check_description(clocks.experiment, progress, settings=settings)


def _not_begun(
    experiment: Experiment, chosen: Sequence[Method], check: DescriptionCheck, progress: Progress
) -> Identification:
    """What baselines say, beside methods that were not begun."""
    estimates: dict[str, Estimate] = {}
    baselines = [method for method in chosen if method.fit is None and not method.lack(experiment)]
    if baselines and not any(run.unsynchronised for run in experiment.runs):
        try:
            estimates = dict(estimate_all(experiment, baselines, progress).estimates)
        except InputError:
            # It lacks what a baseline needs; the description has to be corrected in any case.
            estimates = {}
    ordered = {
        method.name: _rejected(
            estimates.get(method.name, no_estimate(method.name, _NOT_BEGUN)), check.reasons
        )
        for method in chosen
    }
    return Identification(experiment.name, experiment.robot.platform, ordered, recorded=experiment)


_NOT_BEGUN = "not begun, since the description cannot be right"


def _rejected(estimate: Estimate, reasons: Sequence[str]) -> Estimate:
    """With further reasons against it and its loads; a baseline is assessed by them, too."""
    verdict = estimate.verdict
    own = () if verdict.accepted is None else verdict.reasons
    rejected = replace(verdict, accepted=False, reasons=(*reasons, *own))
    loads = estimate.loads
    if loads is not None:
        each = {name: _rejected(one, reasons) for name, one in loads.estimates.items()}
        loads = replace(loads, estimates=each)
    return replace(estimate, verdict=rejected, loads=loads)
