"""Ordinary least squares on Pinocchio's regressor, with a constant wrench as offset."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from recording import Array, read_platform

from peers.filtered import filtered, weighted_rows, with_covariance

NAME = "ordinary least squares (pinocchio)"
DATA = "platform"


def estimate(folder: Path) -> tuple[Array, Array]:
    """The ten and their textbook covariance: residual variance times (A^T A)^-1."""
    A, b = weighted_rows(filtered(read_platform(folder)))
    A, b = A.reshape(-1, A.shape[2]), b.ravel()
    found = np.linalg.lstsq(A, b, rcond=None)[0]
    residual = b - A @ found
    covariance = np.linalg.inv(A.T @ A) * (residual @ residual / (len(b) - len(found)))
    return with_covariance(found[:10], covariance[:10, :10])
