"""Instruments that read later than the clock says that they share with others."""

import shutil

import numpy as np
import polars as pl
import pytest
from places import DATA

from steelyard.experiment.read import read_experiment
from steelyard.identification.identify import identify

pytestmark = pytest.mark.integration

SOUND = DATA / "rough-robots" / "four-cables-00"
LATE = 0.03


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("name", ["imu", "cables"])
def test_what_is_late_is_found_and_the_body_is_that_of_a_sound_recording(tmp_path, name):
    sound = identify(read_experiment(SOUND / "experiment.yaml"), ["maximum-likelihood"]).estimate
    folder = tmp_path / "late"
    shutil.copytree(SOUND, folder)
    (log,) = folder.glob(f"*/{name}.csv")
    pl.read_csv(log).with_columns(pl.col("t") + LATE).write_csv(log)
    found = identify(read_experiment(folder / "experiment.yaml"), ["maximum-likelihood"]).estimate
    assert found.verdict.accepted, found.verdict.reasons
    assert any(f"{name} reads" in note for note in found.notes), found.notes
    error = (found.value - sound.value) / sound.standard_deviation
    assert np.abs(error).max() < 0.3
