"""Several loads by one method: each load's estimate from the same fit, and what one is more than
another.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from steelyard.arrays import Array
from steelyard.estimates.estimate import Estimate, LoadEstimates
from steelyard.estimates.joint_covariance import JointCovariance
from steelyard.estimates.named_estimate import NamedEstimate
from steelyard.estimates.payload import payload
from steelyard.experiment.model import Experiment, Load
from steelyard.identification.solve.posterior import Posterior
from steelyard.identification.verdict.known_values import against_readings
from steelyard.inertia import TEN, Inertia, body_jacobian


def drawn(of: Callable[[Posterior], Estimate], posterior: Posterior) -> Estimate:
    """The estimate of a posterior in the platform frame as it was stated, with those of all loads
    where there are several.

    Args:
        of: From the posterior of a load to its estimate.
        posterior: Of the experiment.

    Raises:
        InputError: As ``of`` does.
    """
    loads, origin = posterior.experiment.loads, posterior.experiment.origin
    if not loads:
        return of(posterior).about(origin)
    seen = {load.name: posterior.of_load(load) for load in loads}
    estimates = {name: of(each) for name, each in seen.items()}
    # Gains that one load contradicts are in the others too.
    against = {name: list(against_readings(each)) for name, each in seen.items()}
    estimates = {
        name: _with_reasons(
            each,
            [
                f"load '{other}': {text}"
                for other, texts in against.items()
                for text in texts
                if other != name
            ],
        )
        for name, each in estimates.items()
    }
    jacobian = np.zeros((TEN * len(loads),) * 2)
    for i, (name, each) in enumerate(seen.items()):
        own = slice(TEN * i, TEN * (i + 1))
        value = estimates[name].value
        told = np.isfinite(value).all()
        at = Inertia.from_body_parameters(value).parameters if told else each.parameters
        jacobian[own, own] = body_jacobian(at)
    change = jacobian @ np.vstack(list(posterior.joint_change))
    estimates = {name: each.about(origin) for name, each in estimates.items()}
    return _together(estimates, change @ posterior.solution.covariance @ change.T)


def _with_reasons(estimate: Estimate, reasons: Sequence[str]) -> Estimate:
    """With further reasons against it."""
    if not reasons:
        return estimate
    verdict = estimate.verdict
    verdict = replace(verdict, accepted=False, reasons=(*verdict.reasons, *reasons))
    return replace(estimate, verdict=verdict)


def each_alone(of: Callable[[Load], Estimate], experiment: Experiment) -> Estimate:
    """Estimates of loads that a method looks at one by one; errors that they share are not known.

    Args:
        of: From a load to its estimate.
        experiment: With several.

    Raises:
        InputError: As ``of`` does.
    """
    estimates = {load.name: of(load) for load in experiment.loads}
    covariance = np.zeros((TEN * len(estimates),) * 2)
    for i, each in enumerate(estimates.values()):
        own = slice(TEN * i, TEN * (i + 1))
        covariance[own, own] = np.nan_to_num(each.covariance)
    return _together(estimates, covariance)


def _together(estimates: Mapping[str, Estimate], covariance: Array) -> Estimate:
    """The estimate of the first load, with those of all and their differences."""
    known = np.concatenate([np.isfinite(np.diag(each.covariance)) for each in estimates.values()])
    matrix = np.where(np.outer(known, known), (covariance + covariance.T) / 2, np.nan)
    joint = JointCovariance(tuple(estimates), matrix)
    named = [
        NamedEstimate(name, each, source="one fit", load=name, joint=joint)
        for name, each in estimates.items()
    ]
    differences = {
        f"{after.name} - {before.name}": payload(before, after).estimate
        for before, after in combinations(named, 2)
        if np.isfinite([before.estimate.value[0], after.estimate.value[0]]).all()
    }
    first = next(iter(estimates.values()))
    return replace(first, loads=LoadEstimates(estimates, joint, differences))
