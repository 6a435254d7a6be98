"""Estimates of given numbers in a file, as `identify` would write them."""

import json

import numpy as np

from steelyard.estimates.estimate import FORMAT, Estimate, judge


def covariance(ten):
    rng = np.random.default_rng(3)
    root = rng.normal(size=(10, 10)) * 0.01 * np.abs(ten)[:, None]
    return root @ root.T


def estimate_of(ten, *, method="maximum-likelihood", verdict=None):
    matrix = covariance(np.where(np.isfinite(ten), ten, 1.0))
    unknown = ~np.isfinite(ten)
    matrix[unknown, :] = matrix[:, unknown] = np.nan
    return Estimate(method, np.asarray(ten, dtype=float), matrix, verdict or judge(ten))


def file_of(folder, *estimates, experiment="a recording"):
    entries = {each.method: each.to_dict() for each in estimates}
    values = {
        "format": FORMAT,
        "experiment": experiment,
        "result": estimates[0].method,
        "estimates": entries,
    }
    path = folder / "estimate.json"
    path.write_text(json.dumps(values))
    return path
