"""The body that can exist nearest to an estimate that no body has, and in which direction that was
impossible.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array, readonly
from steelyard.bodies.body_problem import BodyProblem, quotient
from steelyard.bodies.consistent_body import ConsistentBody, solve
from steelyard.bodies.mass_region import Region
from steelyard.bodies.settings import DEFAULT, BodySettings
from steelyard.errors import InputError
from steelyard.inertia import Inertia


@dataclass(frozen=True, eq=False)
class NearestBody:
    """An estimate that no body has, and the nearest that one has."""

    solution: ConsistentBody
    distance: float
    """From the value to the body; its unit is :attr:`unit`."""
    unit: Literal["sigma", "reference"]
    """Standard deviations of the value, or the Frobenius norm of the difference of pseudo-inertias
    in coordinates in which that of the reference is the identity: 1 is as much as the reference has
    in one direction."""
    excess: float
    """By how much the largest principal moment of the value exceeds the sum of the others;
    negative: it does not [kg m^2]."""
    axis: Array
    """The principal axis of that moment, platform axes, shape (3,)."""

    def __str__(self) -> str:
        x, y, z = self.axis
        compared = "more" if self.excess > 0 else "less"
        unit = "sigma" if self.unit == "sigma" else "of the reference"
        sentence = (
            f"the moment about the principal axis ({x:.3f}, {y:.3f}, {z:.3f}) is"
            f" {abs(self.excess):.4g} kg m^2 {compared} than the sum of the others; the nearest"
            f" body is {self.distance:.3g} {unit} away"
        )
        remark = self.solution.remark
        return f"{sentence} ({remark})" if remark else sentence


def nearest_body(
    value: Inertia,
    reference: Inertia | None = None,
    *,
    covariance: ArrayLike | None = None,
    regions: Sequence[Region] = (),
    settings: BodySettings = DEFAULT,
) -> NearestBody:
    """The body that can exist nearest to a value.

    Args:
        value: Any; where a body has it, it stays as it is.
        reference: Sets the scale; None: a ball of the value's mass, centre of gravity and mean
            second moment.
        covariance: Of the value's ten linear parameters, regular, shape (10, 10); None: nearest in
            the whitened Frobenius norm.
        regions: Where the mass lies.
        settings: Of the two solvers and of their comparison.

    Raises:
        InputError: The covariance is not positive definite, or no body has its mass in all the
            regions.
    """
    moments, axes = np.linalg.eigh(value.inertia)
    if reference is None:
        second = float(np.abs(moments.sum() / 2 - moments).mean())
        reference = Inertia(abs(value.mass), value.center_of_gravity, 2 * second * np.eye(3))
    problem = BodyProblem(
        value.parameters, np.zeros((10, 10)), reference, regions=regions, settings=settings
    )
    if covariance is None:
        information = problem.to_whitened.T @ problem.to_whitened
    else:
        C = readonly(covariance, (10, 10), "covariance")
        scale = np.sqrt(np.abs(np.diag(C)))
        try:
            root = np.linalg.inv(np.linalg.cholesky(quotient(C, np.outer(scale, scale)))) / scale
        except np.linalg.LinAlgError as error:
            raise InputError(
                "covariance: expected a positive definite matrix, found another"
            ) from error
        information = root.T @ root
    solution = solve(replace(problem, information=information))
    return NearestBody(
        solution=solution,
        distance=float(np.sqrt(solution.misfit)),
        unit="reference" if covariance is None else "sigma",
        excess=-value.triangle_margin,
        axis=readonly(axes[:, 2], (3,), "axis"),
    )
