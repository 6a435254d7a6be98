"""What is said of a recording and of its description does not depend on where the frames are."""

from dataclasses import replace

import numpy as np
import pytest
from other_frames import BACK, FAR, body_in_other_frame, in_other_frames
from places import DATA

from steelyard.experiment.read import read_experiment
from steelyard.inspection.identify import identify
from steelyard.inspection.inspect import inspect

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module", params=["points-00", "rough-robots/four-cables-00"])
def experiments(request):
    experiment = read_experiment(DATA / request.param / "experiment.yaml")
    return experiment, in_other_frames(experiment)


@pytest.mark.slow
def test_instruments_agree_as_well_in_any_frame(experiments):
    before, after = (inspect(each) for each in experiments)
    assert not before.mistakes
    assert not after.mistakes
    for (_, one), (_, other) in zip(before.agreements, after.agreements, strict=True):
        assert one.agrees
        assert other.agrees
    sizes = [each.excitation.body for each in (before, after)]
    one, other = (np.array([n.value for n in body]) for body in sizes)
    sigma = np.array([n.sigma for n in sizes[1]])
    assert np.abs((other - body_in_other_frame(one)) / sigma).max() < 0.02


def test_a_place_is_told_in_the_frame_as_it_is_stated():
    experiment = read_experiment(DATA / "rough-robots" / "four-cables-00" / "experiment.yaml")
    imu = experiment.instruments["imu"]
    wrong = tuple(-2.0 * np.array(imu.position) - 0.6)
    said = {**experiment.instruments, "imu": imu.model_copy(update={"position": wrong})}
    found = identify(in_other_frames(replace(experiment, instruments=said)), "least-squares")
    numbers = found.amendment.split("imu:")[1].split("position: [")[1].split("]")[0].split(",")
    true = BACK.as_matrix() @ np.array(imu.position) + FAR
    assert np.linalg.norm(np.array(numbers, dtype=float) - true) < 0.15
