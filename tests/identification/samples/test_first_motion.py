"""Poses to begin with, against those of the motion that was recorded."""

from dataclasses import replace

import numpy as np
import pytest
from other_frames import ANY_WAY, in_other_frames
from scipy.spatial.transform import Rotation
from simulated import PAPER, RECORDER, changed

from steelyard.experiment.equivalent.platform_frame import centred
from steelyard.identification.samples.first_poses.first_motion import (
    FIRST_MOTION,
    first_motion,
    lacks_pose,
    turns_are_told,
    with_first_motion,
)
from steelyard.identification.samples.preparation import prepare
from steelyard.instruments import Length

LENGTHS = Length.model_validate({"kind": "length", "rate": 50, "noise": 0.0005})
WITHOUT_ATTITUDE = ("angular_velocity", "specific_force")
# Instruments -> what is kept of them, and how near the poses come [m], [rad]: a beginning.
SETS = {
    "lengths alone": ({"lengths": ("length",)}, 0.2, 0.03),
    "lengths and tracker": ({"lengths": ("length",), "tracker": ("position",)}, 0.01, 0.03),
    "tracker and gyro": ({"tracker": ("position",), "imu": WITHOUT_ATTITUDE}, 0.1, 0.35),
    "tracker alone": ({"tracker": ("position",)}, 0.2, 0.35),
    "lengths and attitude": ({"lengths": ("length",), "imu": ("orientation",)}, 0.1, 0.05),
    "an attitude alone": ({"imu": ("orientation",)}, 0.4, 0.05),
}


def recording(seed, **instruments):
    """An experiment with the forces and some quantities of some instruments."""
    whole = RECORDER(seed, instruments={**PAPER, "lengths": LENGTHS})
    (run,) = whole.runs
    kept = {"cables": ("tension",), **instruments}
    streams = {
        name: replace(
            run.streams[name], values={q: run.streams[name].values[q] for q in quantities}
        )
        for name, quantities in kept.items()
    }
    return replace(whole, runs=(replace(run, streams=streams),))


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.integration
@pytest.mark.parametrize("name", sorted(SETS.keys() - {"tracker alone"}))
def test_poses_are_found_in_any_frame(name):
    # A place and forces alone are not identified: several poses go with them.
    instruments, distance, angle = SETS[name]
    experiment = centred(in_other_frames(recording(2, **instruments)))
    found = first_motion(experiment, experiment.runs[0])
    true = RECORDER.response.at(found.time)
    place = true.position + true.rotation @ RECORDER(2).robot.attachments.mean(axis=0)
    R_world_platform = ANY_WAY.as_matrix() @ true.rotation @ ANY_WAY.as_matrix()
    apart = np.swapaxes(R_world_platform, 1, 2) @ found.rotation
    turned = Rotation.from_matrix(apart).magnitude()
    far = found.position - place @ ANY_WAY.as_matrix().T
    assert np.sqrt(np.mean(far**2)) < distance
    assert np.sqrt(np.mean(turned**2)) < angle


@pytest.mark.integration
@pytest.mark.parametrize(("instruments", "distance", "angle"), SETS.values(), ids=SETS)
def test_poses_are_near_those_of_the_motion(instruments, distance, angle):
    experiment = recording(2, **instruments)
    found = first_motion(experiment, experiment.runs[0])
    true = RECORDER.response.at(found.time)
    turned = Rotation.from_matrix(np.swapaxes(true.rotation, 1, 2) @ found.rotation).magnitude()
    assert np.sqrt(np.mean((found.position - true.position) ** 2)) < distance
    assert np.sqrt(np.mean(turned**2)) < angle
    for name, offset in found.offsets.items():
        drawn = RECORDER.drawn["run"][name].calibration["offset"]
        assert np.ptp(drawn) > 1.0
        np.testing.assert_allclose(offset, drawn, atol=0.25)


def test_only_what_has_no_pose_lacks_it():
    def lacking(**instruments):
        experiment = recording(0, **instruments)
        return lacks_pose(experiment, experiment.runs[0])

    assert all(lacking(**instruments) for instruments, *_ in SETS.values())
    assert not lacking(imu=("orientation",), tracker=("position",))


@pytest.mark.parametrize(
    ("instruments", "told"),
    [
        ({"tracker": ("position",)}, False),
        ({"tracker": ("position",), "imu": ("specific_force",)}, True),
        ({"tracker": ("position",), "imu": ("angular_velocity",)}, True),
        ({"lengths": ("length",)}, True),
    ],
)
def test_forces_alone_do_not_tell_how_a_platform_turns(instruments, told):
    experiment = recording(0, **instruments)
    assert turns_are_told(experiment, experiment.runs[0]) == told


def test_nothing_in_common_is_no_motion():
    experiment = recording(0, lengths=("length",))
    (run,) = experiment.runs
    later = replace(run, sync={**run.sync, "lengths": run.sync["lengths"] - 1000.0})
    assert first_motion(experiment, later) is None


def test_poses_stand_in_by_the_clock_of_the_forces():
    experiment = recording(1, tracker=("position",))
    (run,) = experiment.runs
    found = first_motion(experiment, run)
    widened, with_poses = with_first_motion(experiment, run, found)
    np.testing.assert_allclose(widened.common_time(with_poses, FIRST_MOTION), found.time, atol=1e-9)
    assert not widened.instruments[FIRST_MOTION].is_measurement
    assert FIRST_MOTION not in experiment.instruments


def test_sensors_that_are_turned_say_the_same():
    turned = changed(PAPER["imu"], rpy_deg=(0.0, 90.0, 20.0))
    whole = RECORDER(3, instruments={**PAPER, "imu": turned})
    (run,) = whole.runs
    kept = {name: run.streams[name] for name in ("cables", "tracker")}
    values = {q: run.streams["imu"].values[q] for q in WITHOUT_ATTITUDE}
    kept["imu"] = replace(run.streams["imu"], values=values)
    found = first_motion(whole, replace(run, streams=kept))
    true = RECORDER.response.at(found.time)
    relative = np.swapaxes(true.rotation, 1, 2) @ found.rotation
    turned = Rotation.from_matrix(relative).magnitude()
    assert np.sqrt(np.mean(turned**2)) < SETS["tracker and gyro"][2]


def test_a_beginning_contradicts_no_gyro():
    # A third of a radian off, and smooth: it turns otherwise than the platform.
    experiment = recording(2, tracker=("position",), imu=WITHOUT_ATTITUDE)
    samples = prepare(experiment, experiment.runs[0], thin=True, commanded=True)
    assert any("no instrument measures the orientation" in note for note in samples.notes)
    assert not any("times as fast" in note for note in samples.notes)
