"""Least squares over the bodies that can exist: the same data, and an answer that a simulator
takes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.bodies.consistent_body import BodyProblem, ConsistentBody, covariance, solve
from steelyard.bodies.mass_region import Box, Ellipsoid
from steelyard.errors import InputError
from steelyard.estimates.estimate import Estimate
from steelyard.estimates.quantiles import chi2_tail
from steelyard.identification.known_body import plausible
from steelyard.identification.methods.from_posterior.finished import finished
from steelyard.identification.methods.method import PosteriorMethod
from steelyard.identification.solve.border.normal_equations import BorderEquations
from steelyard.identification.solve.border.normal_equations import solve as solve_linear
from steelyard.identification.solve.posterior import Posterior
from steelyard.identification.verdict.settings import VerdictSettings
from steelyard.inertia import TEN, Inertia, body_jacobian

_FOLDS = 5
"""Of the cross-validation that chooses the weight; the usual number."""
_WEIGHTS = np.concatenate([[0.0], np.geomspace(0.01, 1000.0, 16)])
"""Candidate weights of the pull towards the nominal body, in the unit of the objective."""
_TOO_MUCH = 1e-3
"""Probability below which what the constraints cost is no chance."""


@dataclass(frozen=True)
class Consistent(PosteriorMethod):
    """Least squares under the condition that the pseudo-inertia matrix is positive definite."""

    regions: Sequence[Box | Ellipsoid] = ()
    """Where the mass lies: in all of them."""
    towards_nominal: bool = False
    """Whether to pull towards the nominal body, as far as that predicts the runs left out
    better."""

    name: ClassVar[str] = "consistent"

    def of(self, found: Posterior, name: str = name) -> Estimate:
        """Estimate from a posterior that is there already.

        Args:
            found: The posterior.
            name: Of the method that it is the estimate of.

        Raises:
            InputError: No body has its mass in the regions, or there is no nominal body to pull
                towards.
        """
        nominal = found.experiment.robot.platform
        if self.towards_nominal and nominal is None:
            raise InputError(
                f"{found.experiment.source or found.experiment.name}: expected a nominal body to"
                " pull towards, found none; add 'platform' to the robot file"
            )
        if found.parameters[0] <= 0 or not np.isfinite(found.parameters).all():
            return finished(found, name, settings=self.verdict)
        regions = [each.about(-found.experiment.origin) for each in self.regions]
        weight = (
            _weight(found, regions, nominal)
            if self.towards_nominal and nominal is not None
            else None
        )
        spread = found.solution.covariance[:TEN, :TEN]
        problem = body_problem(
            found.parameters, spread, found.size, regions, nominal, weight or 0.0
        )
        return _finished(found, problem, solve(problem), weight, name, self.verdict)


def body_problem(
    parameters: Array,
    covariance: Array,
    size: float,
    regions: Sequence[Box | Ellipsoid] = (),
    nominal: Inertia | None = None,
    weight: float = 0.0,
) -> BodyProblem:
    """The nearest body that can exist, in the metric of what is uncertain about an estimate.

    Args:
        parameters: The ten of :data:`steelyard.inertia.LINEAR_PARAMETERS`, shape (10,).
        covariance: Theirs, shape (10, 10).
        size: Plausible radius of the body [m].
        regions: Where the mass lies.
        nominal: The body to pull towards.
        weight: Of the pull.
    """
    mass = float(parameters[0])
    # A ball at the estimate sets the scale where no nominal body does.
    reference = nominal or Inertia(
        mass, np.clip(parameters[1:4] / mass, -size, size), 0.4 * mass * size**2 * np.eye(3)
    )
    scale = 1 / np.sqrt(np.diag(covariance))
    information = np.linalg.inv(covariance * np.outer(scale, scale)) * np.outer(scale, scale)
    return BodyProblem(
        estimate=parameters,
        information=(information + information.T) / 2,
        reference=reference,
        regions=regions,
        nominal=nominal if weight else None,
        prior_weight=weight,
    )


def _finished(
    found: Posterior,
    problem: BodyProblem,
    body: ConsistentBody,
    weight: float | None,
    name: str,
    verdict: VerdictSettings,
) -> Estimate:
    """The estimate of a consistent body, with what the constraints cost."""
    J = body_jacobian(body.parameters)
    binding = [str(each.about(found.experiment.origin)) for each in body.binding]
    spread = found.solution.covariance[:TEN, :TEN]
    if problem.prior_weight:
        spread = covariance(problem, body)
    details: dict[str, Any] = {
        "constraints": {
            "status": body.status,
            "misfit": body.misfit,
            "binding": binding,
            "disagreement_of_two_solvers": body.disagreement,
        }
    }
    notes = [body.remark] if body.remark else []
    further: list[str] = []
    if body.binding:
        freedom = max(1, len(body.binding))
        chance = float(chi2_tail(body.misfit, freedom))
        words = f"{'; '.join(binding)}; that costs a chi-square of {body.misfit:.1f}"
        said = (
            "what the data say alone is no body, and the nearest one is on the edge of what can"
            f" exist: {words}"
        )
        if chance < _TOO_MUCH and not problem.prior_weight:
            further.append(said)
        elif found.identifiable.all():
            # Of moments that are null nobody sees where they are.
            notes.append(said)
    if weight is not None:
        details["pull_towards_nominal"] = {"weight": weight, "divergence": body.prior}
        notes.append(
            f"pulled towards the nominal body with weight {weight:.3g}, which predicts what is left"
            " out best"
            if weight
            else "not pulled towards the nominal body: what is left out is predicted best without"
        )
    return finished(
        found,
        name,
        value=body.body.body_parameters,
        covariance=np.asarray(J @ spread @ J.T),
        further=further,
        details=details,
        notes=notes,
        settings=verdict,
    )


def _weight(found: Posterior, regions: Sequence[Box | Ellipsoid], nominal: Inertia) -> float:
    """Weight of the pull that predicts best what the estimate has not seen: run by run, or
    stretches of the only run.
    """
    folds = list(_folds(found))
    costs = np.zeros(len(_WEIGHTS))
    for rest, normal, right in folds:
        solution = solve_linear(
            rest,
            found.prior,
            found.solution.estimated,
            plausible(found.parameters, found.size),
        )
        spread = solution.covariance[:TEN, :TEN] * found.noise_factor
        if solution.value[0] <= 0:
            continue
        for i, weight in enumerate(_WEIGHTS):
            body = solve(
                body_problem(
                    solution.value[:TEN], spread, found.size, regions, nominal, float(weight)
                )
            )
            at = solution.value.copy()
            # The other unknowns follow the body.
            others = np.flatnonzero(solution.estimated)[TEN:].astype(np.intp)
            follow = _following(solution.covariance, others)
            at[others] += follow @ (body.parameters - at[:TEN])
            at[:TEN] = body.parameters
            costs[i] += at @ normal @ at - 2 * at @ right
    return float(_WEIGHTS[int(np.argmin(costs))])


def _following(covariance: Array, others: NDArray[np.intp]) -> Array:
    """How unknowns follow the ten in the mean, shape (k, 10)."""
    return np.asarray(
        covariance[others, :TEN] @ np.linalg.pinv(covariance[:TEN, :TEN], hermitian=True)
    )


def _folds(found: Posterior) -> list[tuple[BorderEquations, Array, Array]]:
    """What is left when a run (or a stretch of the only run) is left out, and its own normal matrix
    and right-hand side.
    """
    blocks, total = found.blocks, found.total
    runs = np.unique(blocks.run)
    if len(runs) > 1:
        groups = [np.flatnonzero(blocks.run == run) for run in runs]
    else:
        every = np.arange(len(blocks.right))
        groups = [g for g in np.array_split(every, min(_FOLDS, len(every))) if len(g)]
    folds = []
    for group in groups:
        normal, right = blocks.normal[group].sum(axis=0), blocks.right[group].sum(axis=0)
        share = len(group) / len(blocks.right)
        left = BorderEquations(
            total.normal - normal,
            total.right - right,
            total.noise * (1 - share),
            total.freedom * (1 - share),
        )
        folds.append((left, normal, right))
    return folds
