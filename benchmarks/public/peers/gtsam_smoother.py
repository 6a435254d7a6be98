"""A factor graph (GTSAM): motion, body, biases and a constant wrench at once, with factors in Python."""

from __future__ import annotations

from pathlib import Path

import gtsam
import numpy as np
from recording import Array, read_platform

from peers.filtered import filtered, pinocchio_regressor, weighted_rows, with_covariance

NAME = "factor graph (gtsam)"
DATA = "platform"
BODY, OFFSET, FIRST = 0, 1, 2
"""Keys; one key for each instant from FIRST on: omega, alpha, specific force, 9 numbers."""


def estimate(folder: Path) -> tuple[Array, Array]:
    """The ten of the most likely motion and body, and their marginal covariance."""
    data = read_platform(folder)
    smooth = filtered(data)
    motion = smooth.motion
    n, h = len(motion.t), motion.step
    states = np.hstack([motion.omega, smooth.alpha, motion.specific_force])
    A, b = weighted_rows(smooth)
    start = np.linalg.lstsq(A.reshape(-1, 16), b.ravel(), rcond=None)[0]
    scale = np.maximum(np.abs(start[:10]), 1e-3 * np.abs(start[:10]).max())
    # What is left of white noise behind the filter, whose samples are thinned to be independent.
    passed = np.sqrt(min(1.0, data.step / h))
    noise = lambda each: passed * np.diff(each, n=3, axis=0).std(axis=0) / np.sqrt(20)  # noqa: E731
    wrench_sigma = noise(data.wrench)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    values.insert(BODY, start[:10] / scale)
    values.insert(OFFSET, start[10:])
    walk = np.diff(smooth.alpha, axis=0).std(axis=0)
    change = np.hstack([np.maximum(walk * h / np.sqrt(12), 1e-9), walk])
    transition = gtsam.noiseModel.Diagonal.Sigmas(change)
    measured = gtsam.noiseModel.Diagonal.Sigmas(
        np.concatenate([noise(data.omega), noise(data.specific_force)])
    )
    balance = gtsam.noiseModel.Diagonal.Sigmas(wrench_sigma)

    def reading(value: Array):
        def error(_, own, jacobians):
            H = np.zeros((6, 9))
            H[:3, :3], H[3:, 6:] = np.eye(3), np.eye(3)
            if jacobians is not None:
                jacobians[0] = H
            return H @ own.atVector(_.keys()[0]) - value

        return error

    def follows(_, own, jacobians):
        H = np.zeros((6, 9))
        H[:3, :3], H[:3, 3:6], H[3:, 3:6] = np.eye(3), h / 2 * np.eye(3), np.eye(3)
        after = np.zeros((6, 9))
        after[:3, :3], after[:3, 3:6], after[3:, 3:6] = np.eye(3), -h / 2 * np.eye(3), np.eye(3)
        one, two = (own.atVector(key) for key in list(_.keys()))
        if jacobians is not None:
            jacobians[0], jacobians[1] = -H, after
        return after @ two - H @ one

    def carried(wrench: Array):
        def error(_, own, jacobians):
            first, body, offset = (own.atVector(key) for key in list(_.keys()))
            body = body * scale
            near = np.vstack([np.zeros(9), 1e-3 * np.eye(9), -1e-3 * np.eye(9)]) + first
            Y = pinocchio_regressor(near[:, :3], near[:, 3:6], near[:, 6:])
            if jacobians is not None:
                jacobians[0] = (((Y[1:10] - Y[10:]) @ body) / 2e-3).T.copy(order="F")
                jacobians[1], jacobians[2] = Y[0] * scale, np.eye(6)
            return Y[0] @ body + offset - wrench

        return error

    for i in range(n):
        key = FIRST + i
        values.insert(key, states[i])
        value = np.concatenate([motion.omega[i], motion.specific_force[i]])
        graph.add(gtsam.CustomFactor(measured, [key], reading(value)))
        graph.add(gtsam.CustomFactor(balance, [key, BODY, OFFSET], carried(motion.wrench[i])))
        if i:
            graph.add(gtsam.CustomFactor(transition, [key - 1, key], follows))
    found = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    freedom = max(1, 6 * n - 16)
    marginal = gtsam.Marginals(graph, found).marginalCovariance(BODY)
    # As for least squares: by the residuals where these are larger than stated.
    factor = max(1.0, 2 * graph.error(found) / freedom)
    covariance = factor * marginal * np.outer(scale, scale)
    return with_covariance(found.atVector(BODY) * scale, covariance)
