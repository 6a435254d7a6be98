"""The geometry of a robot from recordings in motion: lengths, places and forces of plain vector
algebra."""

from dataclasses import replace

import numpy as np
import pytest
from halls import EXACT_PLACE, NOISE, TARGET, errors, hall, recorded
from scipy.spatial.transform import Rotation

from steelyard.calibration.calibrate import calibrate
from steelyard.calibration.robot_text import robot_text
from steelyard.cli.verbs.calibrate import calibrate as calibrate_verb
from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run, Stream
from steelyard.experiment.write import write_experiment
from steelyard.instruments import Imu, Length, Position, Tension

pytestmark = pytest.mark.integration

DURATION, G = 12.0, np.array([0.0, 0.0, -9.81])
MASS, CENTRE = 100.0, np.array([0.05, -0.03, -0.1])
INERTIA = np.diag([12.0, 15.0, 9.0])
SPEED = 2 * np.pi * np.array([0.11, 0.17, 0.23, 0.13, 0.19, 0.29])
SIZE = np.array([2.0, 1.6, 0.8, 0.25, 0.25, 0.3])
PHASE = np.array([0.0, 1.0, 2.0, 0.5, 1.5, 2.5])


def poses(time):
    """Position and its second derivative, and rotation."""
    angle = np.multiply.outer(time, SPEED) + PHASE
    wave = SIZE * np.sin(angle)
    place = wave[:, :3] + [0, 0, 2]
    return place, -(SPEED[:3] ** 2) * wave[:, :3], Rotation.from_euler("xyz", wave[:, 3:])


def turning(time):
    """Angular velocity and acceleration in the platform, by differences."""
    h = 1e-4

    def rate(t):
        before, after = poses(t - h)[2], poses(t + h)[2]
        return (before.inv() * after).as_rotvec() / (2 * h)

    return rate(time), (rate(time + h) - rate(time - h)) / (2 * h)


def pulled(true, time, *, static=False):
    """Tensions that move the body, as even as they can be."""
    place, along, turned = poses(7.3 * time if static else time)
    R, (omega, alpha) = turned.as_matrix(), turning(time)
    if static:
        along, omega, alpha = 0 * along, 0 * omega, 0 * alpha
    pull = true.anchors - place[:, None] - (R @ true.attachments.T).transpose(0, 2, 1)
    pull /= np.linalg.norm(pull, axis=2)[:, :, None]
    felt = np.einsum("nji,nj->ni", R, along - G)
    at_centre = felt + np.cross(alpha, CENTRE) + np.cross(omega, np.cross(omega, CENTRE))
    torque = alpha @ INERTIA + np.cross(omega, omega @ INERTIA)
    wrench = MASS * np.hstack([at_centre, np.cross(CENTRE, at_centre)])
    wrench[:, 3:] += torque
    own = np.einsum("nji,nmj->nmi", R, pull)
    W = np.concatenate([own, np.cross(true.attachments, own)], axis=2).transpose(0, 2, 1)
    even = np.full(true.m, 400.0)
    return even + np.einsum("nmk,nk->nm", np.linalg.pinv(W), wrench - W @ even)


def moved(seed, *, off=0.3, m=8, forces=True, at_rest=0, stiffness=None, lag=0.0):
    """A hall whose robot file is off, with lengths and a tracker, an IMU, and forces where asked; some
    poses at rest of the same robot beside it. Ropes stretch by what has pulled at them, which they
    forget with a time constant [s]."""
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal
    true = replace(hall(m, rng), gravity=G)
    zero = rng.normal(0, 0.5, m)
    runs = []
    for name, time in (("move", np.arange(0, DURATION, 0.05)), ("poses", np.arange(at_rest * 1.0))):
        if not len(time):
            continue
        static = name == "poses"
        place, along, turned = poses(7.3 * time if static else time)
        R = turned.as_matrix()
        omega, alpha = turning(time)
        if static:
            along, omega, alpha = 0 * along, 0 * omega, 0 * alpha
        arms = R @ true.attachments.T
        length = np.linalg.norm(true.anchors - place[:, None] - arms.transpose(0, 2, 1), axis=2)
        felt = np.einsum("nji,nj->ni", R, along - G)
        streams = {
            "lengths": {"length": length + zero + NOISE * noise(length.shape)},
            "tracker": {"position": place + R @ TARGET + NOISE * noise((len(time), 3))},
            "imu": {
                "angular_velocity": omega + 2e-3 * noise((len(time), 3)),
                "specific_force": felt + 0.02 * noise((len(time), 3)),
                "orientation": R @ Rotation.from_rotvec(2e-3 * noise((len(time), 3))).as_matrix(),
            },
        }
        if forces:
            tension = pulled(true, time, static=static)
            if stiffness is not None:
                ages, parts = np.polynomial.laguerre.laggauss(6)
                past = [pulled(true, time - lag * age, static=static) for age in ages]
                stretching = np.tensordot(parts, past, axes=1)
                streams["lengths"]["length"] -= length * stretching / (stiffness + stretching)
            streams["cables"] = {"tension": tension + 1.0 * noise(tension.shape)}
        runs.append(
            Run(name, {n: Stream(time, each, n) for n, each in streams.items()}, static=static)
        )
    exact = {"delay": 0.0}
    instruments = {
        "lengths": Length.model_validate({"kind": "length", "noise": NOISE, "calibration": exact}),
        "tracker": Position.model_validate(
            {
                "kind": "position",
                "target": tuple(TARGET.tolist()),
                "noise": NOISE,
                "calibration": {**EXACT_PLACE, **exact},
            }
        ),
        "imu": Imu.model_validate(
            {
                "kind": "imu",
                "noise": {"angular_velocity": 2e-3, "specific_force": 0.02, "orientation": 2e-3},
                "calibration": {
                    **dict.fromkeys(("position", "misalignment", "reference"), 0.0),
                    **exact,
                },
            }
        ),
    }
    if forces:
        instruments["cables"] = Tension.model_validate(
            {
                "kind": "tension",
                "noise": 1.0,
                "calibration": {"offset": 1.0, "gain": 0.002, "common_gain": 0.0},
            }
        )
    drawn = replace(
        true,
        anchors=true.anchors + off * noise((m, 3)),
        attachments=true.attachments + 0.01 * noise((m, 3)),
    )
    stated = {"anchor": off, "attachment": 0.01}
    return Experiment("moving", drawn, instruments, tuple(runs), uncertainty=stated), true


def chi_square(found, true):
    off = errors(found, true)
    return off @ np.linalg.solve(found.covariance, off) / len(off)


@pytest.mark.slow
def test_a_recording_in_motion_tells_geometry_and_body():
    experiment, true = moved(0)
    found = calibrate(experiment)
    assert not found.reasons
    assert chi_square(found, true) < 1.7
    assert np.abs(found.points["anchor"] - true.anchors).max() < 0.05
    body, sigma = found.body
    truth = np.concatenate([[MASS], CENTRE, np.diag(INERTIA)])
    assert (np.abs(body[:7] - truth) < 4 * sigma[:7]).all()
    assert np.nanmax(found.leave_one_out) < 1.5 * NOISE


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(("m", "forces"), [(4, False), (8, False), (8, True)])
def test_intervals_cover(m, forces):
    drawn = (moved(seed, m=m, forces=forces) for seed in range(12))
    chi = [chi_square(calibrate(experiment), true) for experiment, true in drawn]
    assert 0.8 < np.mean(chi) < 1.2


@pytest.mark.slow
@pytest.mark.parametrize("forces", [False, True])
def test_poses_at_rest_beside_a_motion_make_it_better(forces):
    both, true = moved(1, forces=forces, at_rest=15)
    found = calibrate(both)
    assert not found.reasons
    assert chi_square(found, true) < 1.7
    for run in both.runs:
        alone = calibrate(replace(both, runs=(run,)))
        assert np.median(found.deviations["anchor"]) < np.median(alone.deviations["anchor"])
    assert [each.static for each in found.found.left_out] == [False, True]


@pytest.mark.slow
def test_leaving_out_a_stretch_is_a_fit_without_it():
    experiment, _ = moved(2, forces=False)
    found = calibrate(experiment)
    (run,) = experiment.runs
    (there,) = found.found.left_out
    # The fourth tenth without its lengths, so that others say what these should be.
    lengths = run.streams["lengths"]
    edges = DURATION * np.array([0.3, 0.4])
    inside = (lengths.time >= edges[0]) & (lengths.time < edges[1])
    values = np.where(inside[:, None], np.nan, lengths.values["length"])
    streams = {**run.streams, "lengths": replace(lengths, values={"length": values})}
    others = calibrate(replace(experiment, runs=(replace(run, streams=streams),)))
    # All of the motion, about the geometry of the others, which is exact now.
    values, places = others.found.calibration.values, others.found.parameters.places
    exact = {
        key: {"value": tuple(values[places["lengths", key, None]].tolist()), "sigma": 0}
        for key in ("offset", "gain")
    }
    held = replace(
        experiment,
        robot=replace(others.robot, covariance=None),
        uncertainty={"anchor": 0.0, "attachment": 0.0},
        instruments={
            **experiment.instruments,
            "lengths": Length.model_validate(
                {"kind": "length", "noise": NOISE, "calibration": {**exact, "delay": 0.0}}
            ),
        },
    )
    (expected,) = calibrate(held).found.left_out
    np.testing.assert_allclose(there.residual[3], expected.residual[3], atol=0.05 * NOISE)
    # It is more than what is left of the readings that were fitted.
    assert there.residual[3].mean() > 0.8 * NOISE


def test_a_run_that_tells_nothing_is_said():
    experiment, _ = recorded()
    moving, _ = moved(0, forces=False)
    (run,) = moving.runs
    blind = replace(run, streams={k: v for k, v in run.streams.items() if k != "lengths"})
    instruments = {**moving.instruments, **experiment.instruments}
    found = calibrate(replace(experiment, instruments=instruments, runs=(*experiment.runs, blind)))
    (note,) = found.to_dict()["notes"]
    assert "run 'move': not used: nothing in it depends on where the cables are fixed" in note
    with pytest.raises(InputError, match="run 'move': not used"):
        calibrate(replace(moving, runs=(blind,)))
    unturned = replace(run, streams={k: v for k, v in run.streams.items() if k != "imu"})
    with pytest.raises(InputError, match=r"expected an orientation \(kind: imu"):
        calibrate(replace(moving, runs=(unturned,)))


def test_a_robot_file_in_millimetres_is_named():
    experiment, _ = moved(0, forces=False)
    robot = experiment.robot
    large = replace(robot, anchors=1000 * robot.anchors, attachments=1000 * robot.attachments)
    with pytest.raises(InputError, match="robot file seems to be in millimetres; write metres"):
        calibrate(replace(experiment, robot=large))


@pytest.mark.slow
def test_lengths_that_stretch_need_tensions():
    experiment, _ = moved(0, forces=False)
    robot = experiment.robot
    elastic = replace(robot, cable=replace(robot.cable, axial_stiffness=5e5))
    (run,) = experiment.runs
    lengths = run.streams["lengths"]
    stretched = lengths.values["length"] * (1 - 1e-3 * np.sin(lengths.time)[:, None])
    streams = {**run.streams, "lengths": replace(lengths, values={"length": stretched})}
    found = calibrate(replace(experiment, robot=elastic, runs=(replace(run, streams=streams),)))
    assert "how far cables stretch is not known without" in " ".join(found.reasons)


@pytest.mark.slow
def test_the_stiffness_of_soft_ropes_is_found():
    # Ropes that stretch by two per cent, by eight per cent more than the robot file says.
    true_stiffness = 2e4
    experiment, true = moved(3, stiffness=true_stiffness)
    cable = replace(experiment.robot.cable, axial_stiffness=1.08 * true_stiffness)
    robot = replace(experiment.robot, cable=cable)
    found = calibrate(replace(experiment, robot=robot))
    assert not found.reasons
    value, sigma = found.stiffness
    assert sigma < 0.01 * true_stiffness
    assert abs(value - true_stiffness) < 4 * sigma
    off = errors(found, true)
    assert off @ np.linalg.solve(found.covariance, off) < 1.7 * len(off)
    (line,) = (each for each in robot_text(found).splitlines() if "axial_stiffness" in each)
    assert line.endswith(f"  # axial stiffness: 1-sigma {sigma:.2g} N")
    assert found.to_dict()["axial_stiffness"] == {"value": value, "standard_deviation": sigma}


@pytest.mark.slow
def test_ropes_that_damp_say_by_how_much():
    lag = 0.03
    experiment, true = moved(3, off=0.05, stiffness=2e4, lag=lag)
    cable = replace(true.cable, axial_stiffness=2e4)
    experiment = replace(experiment, robot=replace(experiment.robot, cable=cable))
    found = calibrate(experiment)
    assert not found.reasons
    assert chi_square(found, true) < 1.7
    told = found.to_dict()["calibration"]["lengths"]["damping"]
    (own, fed), (sigma, sigma_fed) = told["value"], told["standard_deviation"]
    # A rope that is damped in itself does not feel that it is fed.
    assert abs(own - lag) < 4 * sigma < lag
    assert fed is None or abs(fed) < 4 * sigma_fed


def test_the_verb_takes_a_motion_without_forces(tmp_path, capsys):
    (tmp_path / "in").mkdir()
    write_experiment(moved(3, forces=False)[0], tmp_path / "in")
    arguments = [
        str(tmp_path / "in" / "experiment.yaml"),
        "--out",
        str(tmp_path / "out"),
        "--quiet",
    ]
    calibrate_verb.main(arguments, standalone_mode=False)
    assert "accepted" in capsys.readouterr().out
    assert (
        "each tenth of the motion left out" in (tmp_path / "out" / "calibration.html").read_text()
    )
