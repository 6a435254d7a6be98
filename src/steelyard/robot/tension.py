"""Tension distribution: which tensions within their limits give a wrench."""

from __future__ import annotations

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InfeasibleError

RESIDUAL = 1e-6
"""Of the wrench, relative to 1 N and its largest number, up to which tensions give it: with more
cables than six the closed form is exact to rounding, with a singular structure matrix far off."""


def distribute(
    structure: Array,
    wrench: Array,
    limits: tuple[float, float],
    reference: float | None = None,
    *,
    tolerance: float = RESIDUAL,
) -> Array:
    r"""Tensions within limits that give a wrench, nearest to a reference level.

    Minimises :math:`|t - t_{ref}|^2` subject to :math:`W t = w` and the limits: in closed form
    where that stays within them [Pott2009]_, as a quadratic programme elsewhere.

    Args:
        structure: Structure matrices W, shape (n, 6, m).
        wrench: Of the cables on the platform, in the frame of W [N], [N m], shape (n, 6).
        limits: Lowest and highest tension [N].
        reference: Level to stay near to [N]; None: the smallest tensions that do.
        tolerance: See :data:`RESIDUAL`.

    Returns:
        Tensions [N], shape (n, m).

    Raises:
        InfeasibleError: At some sample (its attribute ``sample``) no tensions within the limits
            give the wrench.
    """
    low, high = limits
    level = 0.0 if reference is None else reference
    missing = wrench - level * structure.sum(axis=2)
    tensions: Array = level + np.einsum("nmk,nk->nm", np.linalg.pinv(structure), missing)
    error = np.abs(np.einsum("nkm,nm->nk", structure, tensions) - wrench).max(axis=1)
    scale = 1.0 + np.abs(wrench).max(axis=1)
    outside = (tensions < low).any(axis=1) | (tensions > high).any(axis=1)
    outside |= error > tolerance * scale
    for i in np.flatnonzero(outside):
        solution = _quadratic_programme(structure[i], wrench[i], low, high, level)
        if solution is None:
            raise InfeasibleError(
                f"expected tensions within {low:g} to {high:g} N that carry the platform, found"
                " none; it cannot hold this pose or this acceleration here: move nearer to the"
                " middle, more slowly, or tilt less",
                sample=int(i),
            )
        tensions[i] = solution
    return tensions


def _quadratic_programme(W: Array, w: Array, low: float, high: float, level: float) -> Array | None:
    """Solve one sample with Clarabel; None where it is infeasible."""
    import clarabel
    from scipy import sparse

    m = W.shape[1]
    # In units of the wrench, so that the solver's absolute tolerances mean something.
    unit = max(1.0, float(np.abs(w).max()))
    rows = [sparse.csc_matrix(W), -sparse.eye(m, format="csc")]
    right = [w / unit, np.full(m, -low / unit)]
    cones = [clarabel.ZeroConeT(6), clarabel.NonnegativeConeT(m)]
    if np.isfinite(high):
        rows.append(sparse.eye(m, format="csc"))
        right.append(np.full(m, high / unit))
        cones.append(clarabel.NonnegativeConeT(m))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    solution = clarabel.DefaultSolver(
        sparse.eye(m, format="csc"),
        np.full(m, -level / unit),
        sparse.vstack(rows, format="csc"),
        np.concatenate(right),
        cones,
        settings,
    ).solve()
    if str(solution.status) not in {"Solved", "AlmostSolved"}:
        return None
    return np.clip(np.array(solution.x) * unit, low, high)
