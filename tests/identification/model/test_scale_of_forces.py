"""Gains that grow and a body that shrinks by as much leave the balance as it is: forces of few cables
tell no scale but by the priors of their gains."""

import numpy as np
import pytest
from places import DATA

from steelyard.experiment.read import read_experiment
from steelyard.identification.model.force_residuals import whitened_balance
from steelyard.identification.solve.beginning.begin import begin
from steelyard.identification.solve.beginning.readings import read
from steelyard.identification.tally import Tally

pytestmark = pytest.mark.integration


@pytest.mark.parametrize("name", ["three-cables-00", "four-cables-00"])
def test_scale_of_body_and_gains_is_told_by_no_residual(name):
    experiment = read_experiment(DATA / "rough-robots" / name / "experiment.yaml")
    readings = read(experiment, None, lambda what, part: None)
    begun = begin(readings, lambda what, part: None, thorough=False)
    state, (forces,) = begun.state, readings.force_samples
    found = whitened_balance(
        experiment,
        state.segments[0],
        forces,
        state.calibration,
        begun.task.column_of(state),
        state.parameters,
        state.factors,
        Tally(),
    )
    gains = state.calibration.calibration_parameters.place("cables", "gain", "run")
    columns = np.zeros(begun.task.border(state))
    columns[begun.task.column_of(state)[gains]] = state.calibration.values[gains]
    columns[: state.ten] = -state.parameters
    assert np.abs(found.at.uncarried).max() > 0.1  # something is left that no cable carries
    for rows in found.rows:
        by_scale = rows.by_errors @ columns[rows.columns]
        by_body = rows.by_errors[:, :, : state.ten] @ state.parameters
        assert np.abs(by_scale).max() < 1e-6 * np.abs(by_body).max()
