"""Total least squares on Pinocchio's regressor: motion and wrench are both taken to have errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from recording import Array, read_platform

from peers.filtered import filtered, weighted_rows, with_covariance

NAME = "total least squares (pinocchio)"
DATA = "platform"


def estimate(folder: Path) -> tuple[Array, Array]:
    """The ten by the singular value decomposition of [A b], columns scaled to unit length, and the
    covariance that goes with it to first order."""
    A, b = weighted_rows(filtered(read_platform(folder)))
    A, b = A.reshape(-1, A.shape[2]), b.ravel()
    # The constant wrench has no error: it is projected out before.
    fixed = A[:, 10:]
    project = lambda each: each - fixed @ np.linalg.lstsq(fixed, each, rcond=None)[0]  # noqa: E731
    A, b = project(A[:, :10]), project(b)
    scale = np.concatenate([np.linalg.norm(A, axis=0), [np.linalg.norm(b)]])
    # Of the wrench as much as of the most certain column: the classic choice without a noise model.
    _, singular, vectors = np.linalg.svd(np.column_stack([A, b]) / scale, full_matrices=False)
    last = vectors[-1]
    found = -last[:10] / last[10] * scale[10] / scale[:10]
    scaled = A / scale[:10]
    information = scaled.T @ scaled - singular[-1] ** 2 * np.eye(10)
    x = found * scale[:10] / scale[10]
    variance = singular[-1] ** 2 / (len(b) - 16) * (1 + x @ x)
    covariance = variance * np.linalg.inv(information)
    back = scale[10] / scale[:10]
    return with_covariance(found, covariance * np.outer(back, back))
