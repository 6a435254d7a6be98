"""Every mistake changes what it says and nothing else, by the numbers."""

import numpy as np
import pytest
from recordings import simulated

from steelyard.robot.kinematics import cables_at
from steelyard.simulation.mistakes import MISTAKES, possible_mistakes

FORCES = "cables"


def states(experiment):
    """All that an experiment says, by name."""
    (run,) = experiment.runs
    for name, stream in run.streams.items():
        yield f"{name} time", stream.time
        yield from ((f"{name} {q}", values) for q, values in stream.values.items())
    yield "sync", np.array(list(run.sync.values()))
    robot = experiment.robot
    yield from (("anchors", robot.anchors), ("attachments", robot.attachments))
    yield "gravity", robot.gravity
    for name, each in experiment.instruments.items():
        mounting = each.mounting
        yield f"{name} mounting", np.array([*(mounting.rpy_deg or ()), *(mounting.point or ())])


def changed(first, second):
    other = dict(states(second))
    return {
        name
        for name, values in states(first)
        if values.shape != other[name].shape or not np.array_equal(values, other[name])
    }


WHERE = {
    "forces": {"cables tension"},
    "one force": {"cables tension"},
    "two cables": {"cables tension"},
    "positions": {"tracker position"},
    "gyro": {"imu angular_velocity"},
    "one axis of the gyro": {"imu angular_velocity"},
    "accelerometer": {"imu specific_force"},
    "one axis of the acc": {"imu specific_force"},
    "orientation": {"imu orientation"},
    "quaternion": {"imu orientation"},
    "IMU": {"imu mounting"},
    "target": {"tracker mounting"},
    "gravity": {"gravity"},
    "robot file": {"anchors", "attachments"},
    "an attachment": {"attachments"},
    "clocks": {"sync"},
    "forces late": {"cables time"},
    "a hand": {"cables tension"},
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_changes_what_it_says_and_the_sound_one_stays(name):
    sound = simulated()
    before = {key: values.copy() for key, values in states(sound)}
    made = MISTAKES[name](sound, np.random.default_rng(1))
    longest = max((key for key in WHERE if name.startswith(key)), key=len)
    assert changed(sound, made) == WHERE[longest]
    assert all(np.array_equal(before[key], values) for key, values in states(sound))
    again = MISTAKES[name](sound, np.random.default_rng(1))
    assert not changed(made, again)


def test_units_are_those_of_their_definition():
    sound = simulated().runs[0].streams
    for name, stream, quantity, factor in (
        ("forces in lbf", FORCES, "tension", 4.4482216152605),
        ("accelerometer in g", "imu", "specific_force", 9.80665),
        ("gyro in deg/s", "imu", "angular_velocity", np.pi / 180),
        ("positions in mm", "tracker", "position", 1e-3),
    ):
        made = MISTAKES[name](simulated(), np.random.default_rng(0)).runs[0].streams
        np.testing.assert_allclose(
            made[stream].values[quantity] * factor, sound[stream].values[quantity], rtol=1e-12
        )


def test_a_hand_pushes_with_a_part_of_the_weight_for_its_time():
    sound = simulated()
    made = MISTAKES["a hand on the platform"](sound, np.random.default_rng(2))
    streams = [each.runs[0].streams for each in (sound, made)]
    before, after = (each[FORCES].values["tension"] for each in streams)
    pushed = np.any(before != after, axis=1)
    time = streams[0][FORCES].time
    assert np.ptp(time[pushed]) == pytest.approx(2.0, abs=0.05)
    where = streams[0]["tracker"].values["position"]
    W = cables_at(
        sound.robot, where[len(where) // 2][None], np.eye(3)[None], before.mean(axis=0)[None]
    ).structure[0]
    wrench = W @ (before - after)[pushed].mean(axis=0)
    weight = sound.robot.platform.mass * 9.81
    assert np.linalg.norm(wrench[:3]) == pytest.approx(0.025 * weight, rel=1e-3)
    assert wrench[2] == pytest.approx(0.0, abs=1e-6 * weight)


def test_only_what_instruments_can_have_is_possible():
    experiment = simulated()
    m = experiment.robot.m
    assert [each.name for each in possible_mistakes(experiment.instruments, m)] == list(MISTAKES)
    forces = {FORCES: experiment.instruments[FORCES]}
    names = {each.name for each in possible_mistakes(forces, m)}
    assert "forces in kN" in names
    assert not names & {"accelerometer in g", "a hand on the platform", "positions in mm"}
    assert "robot file in mm" not in {each.name for each in possible_mistakes({}, 0)}
