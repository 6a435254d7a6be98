"""Radii of rollers as results of a calibration, and what is assumed where nobody names sensors."""

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from halls import recorded

from steelyard.calibration.calibrate import calibrate
from steelyard.calibration.robot_text import robot_text
from steelyard.cli import app
from steelyard.instruments import Length
from steelyard.robot.kinematics import cables_at

NOISE = 5e-4  # [m]


def over_rollers(seed, roller, larger):
    """Poses at rest over rollers that are larger than the robot file says."""
    experiment, true = recorded(seed, off=0.02)
    axes = np.tile([0.0, 0.0, 1.0], (8, 1))
    has = {"pulley_radius": np.full(8, 0.06), "pulley_axis": axes}
    drawn, true = replace(experiment.robot, **has), replace(true, **has)
    built = replace(true, pulley_radius=true.pulley_radius + larger)
    (run,) = experiment.runs
    R = run.streams["attitude"].values["orientation"]
    # The tracker's target was put where the platform was: no noise in how it stood.
    place = run.streams["tracker"].values["position"] - R @ np.array([0.1, 0.2, 1.1])
    rng = np.random.default_rng([seed, 2])
    own = cables_at(built, place, R, np.ones(8)).length
    read = own + rng.normal(0, 0.5, 8) + rng.normal(0, NOISE, own.shape)
    streams = {**run.streams, "lengths": replace(run.streams["lengths"], values={"length": read})}
    lengths = Length.model_validate(
        {"kind": "length", "noise": NOISE, "calibration": {"roller": roller}}
    )
    return replace(
        experiment,
        robot=drawn,
        instruments={**experiment.instruments, "lengths": lengths},
        runs=(replace(run, streams=streams),),
    )


def test_radii_of_rollers_are_found_where_the_poses_tell_them():
    larger = np.array([10, -8, 0, 5, 15, -3, 7, -12]) * 1e-3
    found = calibrate(over_rollers(1, 0.02, larger))
    assert not found.reasons
    value, sigma = found.rollers
    np.testing.assert_array_less(np.abs(value - 0.06 - larger), 4.5 * sigma)
    assert robot_text(found).count("radius:") == 8
    np.testing.assert_allclose(found.robot.pulley_radius, value)


def test_radii_that_no_pose_tells_are_null_and_named():
    found = calibrate(over_rollers(1, 1e-5, 0.0))
    assert found.rollers is None
    values = found.to_dict()
    assert values["pulley_radius"] is None
    assert values["calibration"]["lengths"]["roller"]["value"] == [None] * 8
    assert "lengths.roller of cable 1" in values["unobservable"]
    assert robot_text(found).count("# not told") == 8


@pytest.mark.integration
def test_a_robot_alone_gets_sensors_that_tell_its_geometry(tmp_path):
    arguments = ["cogiro", "--calibration", "--poses", "8", "--out", str(tmp_path / "plan")]
    result = CliRunner().invoke(app, ["design", *arguments, "--quiet"], catch_exceptions=False)
    assert result.exit_code == 0
    assert "Sensors were not named: a tracker" in " ".join(result.output.split())
    plan = json.loads((tmp_path / "plan" / "poses.json").read_text())
    assert set(plan["calibration"]) == {"lengths", "tracker"}
