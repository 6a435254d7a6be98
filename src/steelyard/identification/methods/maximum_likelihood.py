"""Everything at once, in continuous time: motion, body and every systematic error from the raw
readings of all instruments.

No resampling, no filter, no derivative of noise: the pose is a spline in time that all readings
look at, each at its own time by its own clock. Forces enter through the structure matrix, with the
internal tension free.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from steelyard.bodies.mass_region import Box, Ellipsoid
from steelyard.estimates.estimate import Estimate, nothing_told
from steelyard.experiment.model import Experiment
from steelyard.identification.methods.consistent import Consistent
from steelyard.identification.solve.classical import NoBalanceError
from steelyard.identification.solve.joint_study import Joint, joint_study
from steelyard.identification.solve.study import Progress
from steelyard.inertia import BODY_PARAMETERS


@dataclass(frozen=True)
class MaximumLikelihood:
    """The joint estimator, over bodies that can exist."""

    regions: Sequence[Box | Ellipsoid] = ()
    """Where the mass lies: in all of them."""
    towards_nominal: bool = False
    """Whether to pull towards the nominal body, as far as that predicts the runs left out
    better."""

    name: ClassVar[str] = "maximum-likelihood"

    def __call__(self, experiment: Experiment, progress: Progress = None) -> Estimate:
        """Estimate.

        Raises:
            InputError: A run lacks what the method needs, no body has its mass in the regions, or
                there is no nominal body to pull towards.
        """
        try:
            return self.of(joint_study(experiment, progress))
        except NoBalanceError as error:
            return nothing_told(self.name, str(error))

    def of(self, joint: Joint) -> Estimate:
        """Estimate from a fit that is there already; raises as a call does."""
        estimate = Consistent(self.regions, self.towards_nominal).of(joint.study, self.name)
        return replace(
            estimate,
            details={**estimate.details, **_details(joint)},
            notes=(*estimate.notes, *_notes(joint)),
        )


def _details(joint: Joint) -> dict[str, Any]:
    fit = joint.fit
    motion = {
        segment.run: {
            "knot_spacing": float(segment.knots[6] - segment.knots[5]),
            "smoothness": dict(segment.smoothness or {}),
        }
        for segment in fit.state.segments
        if not segment.static
    }
    first = fit.first_sigmas
    noise: dict[str, dict[str, Any]] = {}
    for (name, quantity), count in fit.tally.count.items():
        factor = fit.state.factors.get((name, quantity), 1.0)
        noise.setdefault(name, {})[quantity] = {
            "stated": first[name, quantity] if (name, quantity) in fit.stated else None,
            "used": first[name, quantity] * factor,
            "found": (
                first[name, quantity]
                * factor
                * float(np.sqrt(fit.ratios.get((name, quantity), 1.0)))
            ),
            "numbers": count,
            "far": fit.tally.far.get((name, quantity), 0),
        }
    return {
        "motion": motion,
        "noise": noise,
        "solver": {"converged": fit.converged, "steps": fit.turns},
        "left_out": {
            "contacts": {
                run: [list(each) for each in contacts] for run, contacts in joint.contacts.items()
            },
            "single_readings": dict(joint.spikes),
        },
        "over_attainable": {
            name: float(ours / best)
            for name, ours, best in zip(
                BODY_PARAMETERS,
                np.sqrt(np.diag(joint.study.body_covariance)),
                joint.bound.standard_deviation,
                strict=True,
            )
        },
    }


def _notes(joint: Joint) -> list[str]:
    notes = []
    for run, contacts in joint.contacts.items():
        when = ", ".join(f"{start:.2f} to {end:.2f} s" for start, end in contacts)
        notes.append(
            f"run '{run}': something else than the body pulled or pushed from {when}: left out"
        )
    for run, count in joint.spikes.items():
        notes.append(
            f"run '{run}': {count} force readings stand alone against all others: left out"
        )
    return notes
