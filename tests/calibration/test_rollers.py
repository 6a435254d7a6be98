"""Radii and axes of rollers as results of a calibration, and what is assumed where nobody names sensors."""

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


def over_rollers(seed, roller, larger, *, axis=0.0, leaning=0.0, noise=NOISE):
    """Poses at rest over rollers that are larger than the robot file says, and lean."""
    experiment, true = recorded(seed, off=0.02)
    axes = np.tile([0.0, 0.0, 1.0], (8, 1))
    has = {"pulley_radius": np.full(8, 0.06), "pulley_axis": axes}
    drawn, true = replace(experiment.robot, **has), replace(true, **has)
    lean = np.broadcast_to(leaning, (8, 2))
    built = np.column_stack([lean, np.ones(8)]) / np.sqrt(1 + np.sum(lean**2, axis=1))[:, None]
    built = replace(true, pulley_radius=true.pulley_radius + larger, pulley_axis=built)
    (run,) = experiment.runs
    R = run.streams["attitude"].values["orientation"]
    # The tracker's target was put where the platform was: no noise in how it stood.
    place = run.streams["tracker"].values["position"] - R @ np.array([0.1, 0.2, 1.1])
    rng = np.random.default_rng([seed, 2])
    own = cables_at(built, place, R, np.ones(8)).length
    read = own + rng.normal(0, 0.5, 8) + rng.normal(0, noise, own.shape)
    streams = {**run.streams, "lengths": replace(run.streams["lengths"], values={"length": read})}
    lengths = Length.model_validate(
        {"kind": "length", "noise": noise, "calibration": {"roller": roller, "roller_axis": axis}}
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


def test_axes_of_rollers_are_found_where_the_poses_tell_them():
    leaning = np.random.default_rng(4).normal(0, 0.05, (8, 2))
    found = calibrate(over_rollers(1, 0.002, 0.001, axis=0.05, leaning=leaning, noise=5e-5))
    assert not found.reasons
    axes, sigma = found.roller_axes
    told = np.isfinite(sigma).all(axis=1)
    assert 0 < told.sum() < 8
    off = (axes[:, :2] / axes[:, 2:] - leaning)[told] / sigma[told]
    assert np.abs(off).max() < 4.5
    text = robot_text(found)
    assert text.count(" deg\n") == told.sum()
    np.testing.assert_allclose(found.robot.pulley_axis[told], axes[told])
    values = found.to_dict()
    assert np.shape(values["pulley_axis"]["value"]) == (8, 3)
    assert [None, None, None] in values["pulley_axis"]["value"]
    assert any("roller_axis" in each for each in values["unobservable"])


def test_axes_that_lean_are_in_the_uncertainty_of_the_points():
    """Rollers of 6 cm that lean by three degrees move where cables leave by three millimetres."""
    leaning = np.random.default_rng(5).normal(0, 0.05, (8, 2))
    errors = {}
    for axis in (1e-6, 0.05):
        experiment = over_rollers(1, 0.002, 0.001, axis=axis, leaning=leaning, noise=5e-5)
        found = calibrate(experiment)
        off = found.points["anchor"] - recorded(1, off=0.02)[1].anchors
        errors[axis] = np.sqrt(np.mean((off / found.deviations["anchor"]) ** 2))
    assert errors[0.05] < 1.5
    assert errors[1e-6] > 3 * errors[0.05]


def test_radii_that_no_pose_tells_are_null_and_named():
    found = calibrate(over_rollers(1, 1e-5, 0.0))
    assert found.rollers is None
    values = found.to_dict()
    assert values["pulley_radius"] is None
    assert values["calibration"]["lengths"]["roller"]["value"] == [None] * 8
    assert "lengths.roller of cable 1" in values["unobservable"]
    assert robot_text(found).count("# not told") == 16


@pytest.mark.integration
def test_a_robot_alone_gets_sensors_that_tell_its_geometry(tmp_path):
    arguments = ["cogiro", "--calibration", "--poses", "8", "--out", str(tmp_path / "plan")]
    result = CliRunner().invoke(app, ["design", *arguments, "--quiet"], catch_exceptions=False)
    assert result.exit_code == 0
    assert "Sensors were not named: a tracker" in " ".join(result.output.split())
    plan = json.loads((tmp_path / "plan" / "poses.json").read_text())
    assert set(plan["calibration"]) == {"lengths", "tracker"}
