"""Platforms on fewer than six cables, recorded by another simulator."""

import json

import numpy as np
import pytest
from places import DATA

from steelyard.experiment.read import read_experiment
from steelyard.identification.identify import identify
from steelyard.inertia import Inertia

pytestmark = pytest.mark.integration

FOLDER = DATA / "rough-robots"


def truth_of(name):
    stored = json.loads((FOLDER / "truth.json").read_text())[name]
    return np.array(
        Inertia.from_dict(stored).body_parameters if isinstance(stored, dict) else stored
    )


@pytest.mark.parametrize("name", ["three-cables-00", "four-cables-00"])
@pytest.mark.parametrize(
    "method", ["maximum-likelihood", pytest.param("least-squares", marks=pytest.mark.slow)]
)
def test_all_ten_come_out_with_true_intervals(name, method):
    experiment = read_experiment(FOLDER / name / "experiment.yaml")
    found = identify(experiment, [method]).estimate
    assert found.verdict.accepted, found.verdict.reasons
    error = found.value - truth_of(name)
    chi = error @ np.linalg.solve(found.covariance, error)
    assert chi < 20.0  # .97 of chi-square of ten
    assert found.standard_deviation[0] < 0.01 * found.value[0]
