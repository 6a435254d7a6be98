"""Mistakes that were made on purpose are named, with what to change."""

from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from mistaken import MISTAKES, vector
from simulated import sound

from steelyard.inspection.agreements.excerpt import excerpts
from steelyard.inspection.mistakes.search import mistakes
from steelyard.inspection.mistakes.settings import MistakeSettings, PlaceSettings

pytestmark = pytest.mark.integration

# Others of the list are tried by `make bench` on more recordings; these take a second each.
TRIED = (
    "accelerometer in g", "gravity removed", "accelerometer upside down", "ax with the wrong sign", "ay and az exchanged", "gyro in deg/s",
    "gyro y with the wrong sign", "wx and wz exchanged", "orientation transposed", "quaternion x y z w",
    "angles of the orientation in degrees", "roll and yaw exchanged", "IMU turned by 90 degrees", "left-handed tracker", "tracker in mm",
    "target elsewhere", "cables 2 and 5 exchanged", "cables in reverse", "negative tensions", "tensions in daN", "tensions in kN",
    "one sensor in kgf", "one sensor with the wrong sign", "one sensor dead", "gravity with the wrong sign", "IMU late by half a second",
    "events of IMU and tracker exchanged", "command in degrees", "command in mm",
)  # fmt: skip


def found_in(experiment):
    (excerpt,) = excerpts(experiment, 1)
    return mistakes(excerpt)


@pytest.mark.slow
@pytest.mark.parametrize("name", TRIED)
def test_a_mistake_is_named_with_what_to_change(name):
    mistake = MISTAKES[name]
    found, after = found_in(mistake.make(sound(1)))
    assert found, "nothing was named"
    amendment = found[0].amendment
    text = f"{amendment.what}; {amendment.proposal}"
    assert any(word in text for word in mistake.words), text
    assert amendment.subject == mistake.subject or not mistake.subject
    assert not after.bad


def test_the_gyro_is_blamed_for_its_own_mistake_alone():
    found, _ = found_in(vector("imu", "angular_velocity", [1, 1, -1])(sound(2)))
    (mistake,) = found
    assert (mistake.amendment.subject, mistake.amendment.channel) == ("imu", "angular_velocity")
    assert "angular velocity of imu" in mistake.evidence


@pytest.mark.slow
def test_two_mistakes_are_both_named():
    twice = MISTAKES["tensions in daN"].make(
        vector("imu", "angular_velocity", 180 / np.pi)(sound(1))
    )
    found, after = found_in(twice)
    assert {m.amendment.channel for m in found} == {"tension", "angular_velocity"}
    assert not after.bad


def test_what_is_named_can_be_set():
    twice = MISTAKES["gyro in deg/s"].make(sound(1))
    (excerpt,) = excerpts(twice, 1)
    assert mistakes(excerpt)[0]
    assert not mistakes(excerpt, settings=MistakeSettings(most=0))[0]
    assert not mistakes(excerpt, settings=MistakeSettings(least_gain=1e3))[0]
    with pytest.raises(FrozenInstanceError):
        MistakeSettings().most = 3


@pytest.mark.slow
def test_how_far_off_a_place_must_be_can_be_set():
    (excerpt,) = excerpts(MISTAKES["target elsewhere"].make(sound(1)), 1)
    assert mistakes(excerpt)[0][0].amendment.kind == "place on the platform"
    far = MistakeSettings(places=PlaceSettings(least=1e3))
    found, _ = mistakes(excerpt, settings=far)
    assert all(each.amendment.kind != "place on the platform" for each in found)
