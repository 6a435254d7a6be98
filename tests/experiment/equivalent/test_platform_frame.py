"""What is estimated does not depend on where somebody has put the frames."""

from dataclasses import replace

import numpy as np
import pytest
from other_frames import ANY_WAY, FAR, Z_DOWN, body_in_other_frame, in_other_frames
from places import DATA
from scipy.spatial.transform import Rotation
from simulated import RECORDER

from steelyard.experiment.equivalent.platform_frame import about, centred
from steelyard.experiment.model import Load
from steelyard.experiment.observations import SeenFrequencies
from steelyard.experiment.read import read_experiment
from steelyard.experiment.recording import Stream
from steelyard.experiment.surroundings import Surroundings
from steelyard.identification.identify import identify
from steelyard.inertia import Inertia
from steelyard.instruments import Command

NAMES = "points-00", "rough-robots/four-cables-00"
FRAMES = {
    "z down": (Z_DOWN, Rotation.identity(), np.zeros(3)),
    "platform frame far away": (Rotation.identity(), Rotation.identity(), FAR),
    "all turned": (ANY_WAY, ANY_WAY.inv(), FAR),
}
POSE = np.array([0.3, -0.2, 1.4, 0.2, -0.3, 0.5])


@pytest.fixture(scope="module", params=NAMES)
def told(request):
    experiment = read_experiment(DATA / request.param / "experiment.yaml")
    return experiment, identify(experiment, "maximum-likelihood").estimate


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize("frames", FRAMES.values(), ids=FRAMES)
def test_the_body_is_the_same_in_any_frame(told, frames):
    experiment, estimate = told
    world, platform, at = frames
    found = identify(in_other_frames(experiment, world, platform, at), "maximum-likelihood")
    expected = body_in_other_frame(estimate.value, platform, at)
    off = (found.estimate.value - expected) / found.estimate.standard_deviation
    assert np.abs(off).max() < 1e-3
    assert found.estimate.verdict.accepted == estimate.verdict.accepted


@pytest.mark.integration
def test_the_motion_is_that_of_the_origin_as_it_was_stated():
    experiment = read_experiment(DATA / "points-00" / "experiment.yaml")
    (at_origin,) = identify(experiment, "maximum-likelihood").motion
    elsewhere = in_other_frames(experiment, Rotation.identity(), Rotation.identity(), FAR)
    (moved,) = identify(elsewhere, "maximum-likelihood").motion
    lever = Rotation.from_quat(moved.rotation, scalar_first=True).apply(FAR)
    np.testing.assert_allclose(
        moved.values["position"] + lever, at_origin.values["position"], atol=1e-6
    )
    for what, rate in (("position", "velocity"), ("velocity", "acceleration")):
        by_steps = np.gradient(moved.values[what], moved.time, axis=0)[2:-2]
        np.testing.assert_allclose(by_steps, moved.values[rate][2:-2], atol=0.02)
    # A place far away is as much less certain as the platform may be turned.
    assert (moved.sigma["position"] > at_origin.sigma["position"].min()).all()


@pytest.mark.slow
@pytest.mark.integration
def test_what_is_known_of_bodies_is_told_in_the_frame_as_it_is_stated():
    whole = read_experiment(DATA / "rough-robots" / "four-cables-00" / "experiment.yaml")
    (run,) = whole.runs
    place = whole.robot.attachments.mean(axis=0) + 0.05
    loads = (
        Load("bare", {"cx": (0.012, 0.001)}),
        Load("more", added={"mass": (0.02, 0.05), "cz": (place[2], 0.01)}),
    )
    runs = replace(run, load="bare"), replace(run, name="again", load="more")
    experiment = replace(whole, runs=runs, loads=loads, known=loads[0].known)
    estimate = identify(experiment, "maximum-likelihood").estimate
    bare, more = (estimate.loads.estimates[each.name].details["known"] for each in loads)
    assert bare["cx"]["stated"] == pytest.approx(0.012)
    assert bare["cx"]["found"] == pytest.approx(estimate.value[1], abs=0.01)
    told = more["added first moment z"]
    assert told["stated"] == pytest.approx(0.02 * place[2])
    assert abs(told["z"]) < 4


def retold(point):
    """An experiment with all that has a place, about a point of its platform."""
    experiment = RECORDER(1)
    (run,) = experiment.runs
    n = 5
    commanded = Stream(
        np.arange(n) / 10,
        {
            "position": np.tile(POSE[:3], (n, 1)),
            "orientation": Rotation.from_rotvec(
                np.outer(np.arange(n), [0.1, 0.2, 0.3])
            ).as_matrix(),
        },
        "command",
    )
    attached = {"at": (0.1, {"value": 0.2, "sigma": 0.1}, 0.3), "to": (1, 2, 3)}
    body = Inertia(5.0, np.array([0.1, 0.2, 0.3]), np.eye(3))
    load = Load("fork", {"cx": (0.1, 0.01), "mass": (7.0, 0.1)}, body, added={"cy": (0.5, 0.1)})
    seen = SeenFrequencies("r", "table", 1, POSE, None, np.array([1.0]), np.array([0.1]), None)
    whole = replace(
        experiment,
        instruments={
            **experiment.instruments,
            "command": Command.model_validate({"kind": "command"}),
        },
        runs=(replace(run, streams={**run.streams, "command": commanded}),),
        known={"cz": (0.4, 0.02), "Jxx": (3.0, 0.1)},
        surroundings=Surroundings.model_validate({"attached": (attached,)}),
        frequencies=(seen,),
        loads=(load,),
    )
    return whole, about(whole, point)


def test_all_that_has_a_place_is_told_about_the_other_origin():
    point = np.array([0.5, -1.0, 2.0])
    before, after = retold(point)
    np.testing.assert_allclose(after.robot.attachments, before.robot.attachments - point)
    np.testing.assert_array_equal(after.robot.anchors, before.robot.anchors)
    for name, own in before.instruments.items():
        place = after.instruments[name].mounting.point
        if own.mounting.point is None:
            assert place is None
        else:
            np.testing.assert_allclose(place, np.array(own.mounting.point) - point)
    assert after.known == {"cz": (pytest.approx(-1.6), 0.02), "Jxx": (3.0, 0.1)}
    (load,) = after.loads
    assert load.known == {"cx": (pytest.approx(-0.4), 0.01), "mass": (7.0, 0.1)}
    assert load.added == {"cy": (1.5, 0.1)}
    np.testing.assert_allclose(load.nominal.center_of_gravity, [-0.4, 1.2, -1.7])
    at = after.surroundings.attached[0].at
    assert [(each.value, each.sigma) for each in at] == [
        (pytest.approx(-0.4), 0),
        (pytest.approx(1.2), 0.1),
        (pytest.approx(-1.7), 0),
    ]
    (seen,) = after.frequencies
    roll, pitch, yaw = POSE[3:]
    turned = Rotation.from_euler("xyz", [roll, pitch, yaw])
    np.testing.assert_allclose(seen.pose, [*(POSE[:3] + turned.apply(point)), *POSE[3:]])
    commands = [each.runs[0].streams["command"].values for each in (before, after)]
    moved = commands[1]["position"] - commands[0]["position"]
    np.testing.assert_allclose(moved, commands[0]["orientation"] @ point)
    np.testing.assert_allclose(after.origin, -point)


def test_told_about_a_point_and_back_is_as_before():
    point = np.array([0.5, -1.0, 2.0])
    before, there = retold(point)
    again = about(there, -point)
    np.testing.assert_allclose(again.robot.attachments, before.robot.attachments, atol=1e-15)
    np.testing.assert_allclose(again.origin, 0)
    assert about(before, np.zeros(3)) is before


def test_the_middle_of_the_attachments_is_the_origin():
    found = centred(RECORDER(1))
    np.testing.assert_allclose(found.robot.attachments.mean(axis=0), 0, atol=1e-15)
    assert np.linalg.norm(found.origin) > 0.1
