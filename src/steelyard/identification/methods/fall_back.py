"""What is tried where a fit of all instruments does not arrive: the same without the instrument
that contradicts the others.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.identification.solve.beginning.begin import NoBalanceError
from steelyard.identification.solve.joint_motion import fit_jointly
from steelyard.identification.solve.posterior import Posterior, Progress, motion_instruments
from steelyard.identification.solve.settings import FIT, FitSettings


def fit_that_arrives(
    experiment: Experiment,
    progress: Progress = None,
    settings: FitSettings = FIT,
    *,
    vibrating: float = 0.0,
) -> Posterior:
    """Fit an experiment as a whole; where that does not arrive, without one of its motion
    instruments, the one that departs most from the others first.

    Args:
        experiment: With at least one run.
        progress: Is called with what is being done and the fraction that is done.
        settings: How to fit.
        vibrating: See :func:`.fit_jointly`.

    Raises:
        InputError: A run lacks what the method needs.
        NoBalanceError: Forces and motion cannot be fitted, whichever is left out.
    """
    fit = partial(fit_jointly, progress=progress, settings=settings, vibrating=vibrating)
    first: Posterior | None = None
    error: NoBalanceError | None = None
    try:
        first = fit(experiment)
        if first.fit.converged:
            return first
    except NoBalanceError as unbalanced:
        error = unbalanced
    names = motion_instruments(experiment) if first is None else first.by_contradiction
    for name in names[: settings.left_out]:
        try:
            found = fit(experiment.without(name))
        except (InputError, NoBalanceError):
            continue
        if found.fit.converged:
            return replace(found, left_out=(name,))
    if first is None:
        assert error is not None
        raise error
    return first
