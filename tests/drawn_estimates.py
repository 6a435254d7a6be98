"""Series of estimates of one body, drawn with true covariances."""

import numpy as np

# 1-sigma of the ten, as 20 s of CoGiRo with the sensors of the paper have it, roughly.
SIGMA = np.array([0.7, 0.002, 0.002, 0.0025, 0.8, 0.7, 0.6, 0.35, 0.55, 0.3])


def covariance(rng):
    """A true covariance of one recording: correlated, and not like that of the next one."""
    L = np.tril(rng.normal(0, 0.4, (10, 10)), -1) + np.eye(10)
    C = L @ L.T
    scale = SIGMA * rng.uniform(0.7, 1.4, 10) / np.sqrt(np.diag(C))
    return C * np.outer(scale, scale)


def series(n, seed, added=None):
    """Values and sigmas of n recordings of one body, shape (n, 10); from the recording ``added`` on
    with 5 kg more."""
    rng = np.random.default_rng(seed)
    values, sigmas = np.empty((n, 10)), np.empty((n, 10))
    for i in range(n):
        C = covariance(rng)
        values[i] = rng.multivariate_normal(np.zeros(10), C, method="cholesky")
        sigmas[i] = np.sqrt(np.diag(C))
    if added is not None:
        values[added:, 0] += 5.0
    return values, sigmas
