"""Least squares over bodies that can exist, as tools for payloads of robot arms do it: the
pseudo-inertia is positive semidefinite (CVXPY, Clarabel)."""

from __future__ import annotations

from pathlib import Path

import cvxpy as cp
import numpy as np
from recording import Array, read_platform

from peers.filtered import filtered, weighted_rows, with_covariance

NAME = "semidefinite fit (cvxpy, clarabel)"
DATA = "platform"


def estimate(folder: Path) -> tuple[Array, Array]:
    """The ten; covariance of the fit without the constraint."""
    A, b = weighted_rows(filtered(read_platform(folder)))
    A, b = A.reshape(-1, A.shape[2]), b.ravel()
    size = np.linalg.norm(A, axis=0)
    # By the triangular factor: the same least squares in a few rows.
    Q, R = np.linalg.qr(A / size)
    x = cp.Variable(A.shape[1])
    m, h, (xx, xy, yy, xz, yz, zz) = x[0] / size[0], [], [x[i] / size[i] for i in range(4, 10)]
    h = [x[i] / size[i] for i in range(1, 4)]
    half = (xx + yy + zz) / 2
    pseudo = cp.bmat(
        [
            [half - xx, -xy, -xz, h[0]],
            [-xy, half - yy, -yz, h[1]],
            [-xz, -yz, half - zz, h[2]],
            [h[0], h[1], h[2], m],
        ]
    )
    problem = cp.Problem(cp.Minimize(cp.sum_squares(R @ x - Q.T @ b)), [pseudo >> 0])
    problem.solve(solver=cp.CLARABEL)
    found = np.asarray(x.value) / size
    residual = b - A @ found
    covariance = np.linalg.inv(A.T @ A) * (residual @ residual / (len(b) - len(found)))
    return with_covariance(found[:10], covariance[:10, :10])
