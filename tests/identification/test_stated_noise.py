"""Noise that is stated far below what readings can hold: rejected in words."""

import sys

import numpy as np
import pytest
from places import ROOT

from steelyard.identification.identify import identify

pytestmark = pytest.mark.slow


@pytest.mark.long
@pytest.mark.parametrize("method", ["least-squares", "instrumental-variables", "consistent"])
def test_impossible_noise_is_rejected_and_nothing_overflows(method, monkeypatch):
    """Squares of what is stated are lost in the rounding of the normal equations."""
    monkeypatch.setattr(sys, "path", [*sys.path, str(ROOT / "benchmarks")])
    import abuse

    experiment, _ = abuse.recorded(**{**abuse.BASE, "stated": 1e-9}, seed=0)
    estimate = identify(experiment, method).estimates[method]
    assert estimate.verdict.accepted is False
    assert "stated noise" in str(estimate.verdict)
    covariance = estimate.covariance[np.isfinite(estimate.covariance)]
    assert (np.abs(covariance) < 1e12).all()
