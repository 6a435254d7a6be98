"""Numbers that decide how the best body is found, with the reason of each."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class BodySettings:
    """Of the two solvers for the best body that can exist, and of their comparison.

    Values without unit are in the coordinates of ``WhitenedProblem``.
    """

    agreement: float = 1e-6
    """Difference of the two solutions up to which they count as one, in sigmas per (1 + distance
    of the solution in sigmas): a millionth of what the data can distinguish, and 30 times what the
    last step of Newton's method may still change."""
    feasibility: float = 1e-9
    """By how much a solution may violate a constraint, in parts of its norm: what the semidefinite
    programme leaves at its tightest tolerances."""

    far_away: float = 0.9
    """Misfit, in parts of that of no body at all, beyond which the regions are nowhere near the
    body: what fits in them explains next to nothing of what the data show."""

    # Where the data are silent

    information_rounding: float = 1e-13
    """Relative eigenvalue of an information matrix with a unit diagonal below which it is zero:
    rounding of ten by ten products."""
    reference_sigma: float = 1e3
    """What the reference body is worth where data are silent: a standard deviation of a thousand
    such bodies; it only decides between bodies that fit equally well."""
    reference_share: float = 1e-5
    """The same, at most, in parts of what the data know best, so that rounding of these does not
    drown it."""

    # Newton's method

    last_barrier: float = 1e-14
    """Last weight of the barrier, in parts of the objective: a distance of 1e-7 sigma at worst."""
    barrier_shrink: float = 0.1
    """Of the weight of the barrier from one stage to the next."""
    least_curvature: float = 0.5
    """Lowest multiplier that counts, in parts of the central one, so that steps descend."""
    to_edge: float = 0.95
    """Part of the way to the boundary that a straight step may go."""
    converged: float = 1e-15
    """Squared decrement, in parts of the squared distance, at which it ends: 3e-8 sigma."""
    patience: int = 20
    """Steps of a stage: a longer one has met rounding, and the comparison shows whether the end is
    near enough."""
    objective_rounding: float = 1e-14
    """Of the objective, in parts of it: a step that changes it by less is taken on trust."""
    longest_step: float = 2.0
    """Longest step of a logarithm: a pivot changes by at most e^2."""
    iterations: int = 500
    """Of Newton's method at most; random problems need 30 to 60."""
    halvings: int = 40
    """Of a step at most: below it is rounding."""

    # The semidefinite programme

    rescalings: int = 5
    """Solutions at most, each in units of the distance that the one before has found."""
    polish_steps: int = 12
    """Newton steps on the prior at most, for the digits that exponential cones do not give."""
    polish_end: float = 1e-9
    """Step, in parts of the distance, at which they end."""


DEFAULT = BodySettings()
"""What is used where nothing is given."""
