from dataclasses import replace

import numpy as np
import pytest

from steelyard.errors import InputError
from steelyard.experiment.read import read_experiment
from steelyard.experiment.recording import Stream
from steelyard.identification.methods.least_squares import LeastSquares
from steelyard.identification.methods.settings import TwoStepSettings
from steelyard.identification.methods.two_step import TwoStep
from steelyard.identification.model.settings import MotionSettings, PreparationSettings
from steelyard.identification.samples.preparation import prepare
from steelyard.identification.solve.settings import FitSettings
from steelyard.motion.trajectory import RestToRest
from steelyard.robot.file import read_robot
from steelyard.simulation.forward_dynamics import ForwardDynamicsSettings
from steelyard.simulation.sensors import Sensors, ideal_sensors
from steelyard.simulation.simulate import simulate
from steelyard.simulation.trajectories import feasible_multisine

pytestmark = pytest.mark.integration

MOMENTS = 0.01  # of the moments: what the issue asks of ideal sensors
EQUAL = 1e-4  # relative: two ways to the same body on noise-free data differ by interpolation only


@pytest.fixture(scope="module")
def robot():
    return read_robot("cogiro").with_straight_cables()


@pytest.fixture(scope="module")
def trajectory(robot):
    return feasible_multisine(robot, 8.0)


def changed(sensors, **updates):
    """Sensors with some keys of some instruments changed."""
    instruments = {
        name: (
            type(i).model_validate(
                {**i.model_dump(exclude_unset=True), **updates.get(name, {})}, strict=False
            )
        )
        for name, i in sensors.instruments.items()
    }
    return Sensors(instruments)


def with_streams(experiment, change):
    """The experiment with its streams changed one by one."""
    runs = [
        replace(run, streams={name: change(name, stream) for name, stream in run.streams.items()})
        for run in experiment.runs
    ]
    return replace(experiment, runs=tuple(runs))


def rows(stream, index):
    return Stream(
        stream.time[index], {q: v[index] for q, v in stream.values.items()}, stream.source
    )


def assert_body(estimate, body):
    truth = body.body_parameters
    np.testing.assert_allclose(estimate.value[0], truth[0], rtol=5e-4)
    np.testing.assert_allclose(estimate.value[1:4], truth[1:4], atol=1e-3)
    np.testing.assert_allclose(estimate.value[4:7], truth[4:7], rtol=MOMENTS)


@pytest.mark.parametrize("acceleration", ["imu", "tracker"])
def test_ideal_sensors_give_the_body(robot, trajectory, acceleration):
    virtual = simulate(robot, {"run": trajectory}, ideal_sensors(robot))
    assert_body(TwoStep(acceleration=acceleration)(virtual.experiment), virtual.body)


def test_the_imu_may_sit_anywhere_and_any_way_round(robot, trajectory):
    sensors = changed(
        ideal_sensors(robot), imu={"position": (-0.4, 0.5, 0.9), "rpy_deg": (100.0, -35.0, 170.0)}
    )
    virtual = simulate(robot, {"run": trajectory}, sensors)
    assert_body(TwoStep(acceleration="imu")(virtual.experiment), virtual.body)


def test_an_imu_that_takes_gravity_out_is_understood(robot, trajectory):
    sensors = changed(ideal_sensors(robot), imu={"gravity": "removed"})
    assert_body(TwoStep()(simulate(robot, {"run": trajectory}, sensors).experiment), robot.platform)


def test_tensions_at_the_winch_are_those_at_the_platform_for_straight_cables(robot, trajectory):
    none = {"offset": 0.0, "gain": 0.0, "common_gain": 0.0, "friction": 0.0}
    sensors = changed(ideal_sensors(robot), cables={"end": "winch", "calibration": none})
    assert_body(TwoStep()(simulate(robot, {"run": trajectory}, sensors).experiment), robot.platform)


def test_a_tracker_frame_that_is_turned_and_elsewhere_is_undone(robot, trajectory):
    frame = {"position": (3.0, -2.0, 0.5), "rpy_deg": (5.0, -3.0, 120.0)}
    sensors = changed(ideal_sensors(robot), tracker={"frame": frame})
    assert_body(
        TwoStep(acceleration="tracker")(simulate(robot, {"run": trajectory}, sensors).experiment),
        robot.platform,
    )


def test_uneven_repeated_and_missing_samples_do_little_harm(recordings, recorded_truth):
    rng = np.random.default_rng(5)
    whole = read_experiment(recordings / "points-02" / "experiment.yaml")

    def spoil(name, stream):
        n = len(stream)
        kept = np.sort(
            np.concatenate([np.flatnonzero(rng.uniform(size=n) > 0.1), rng.integers(0, n, n // 20)])
        )
        spoilt = rows(stream, kept)
        if name == "tracker":
            outside = (spoilt.time < spoilt.time[0] + 8) | (spoilt.time > spoilt.time[0] + 9.5)
            spoilt = rows(spoilt, outside)
        values = {q: v.copy() for q, v in spoilt.values.items()}
        for value in values.values():
            value[rng.uniform(size=len(value)) < 0.03] = np.nan
        return replace(spoilt, values=values)

    spoilt = with_streams(whole, spoil)
    clean, rough = TwoStep()(whole), TwoStep()(spoilt)
    truth = recorded_truth["points-02"].body_parameters
    assert any("gap" in note for note in rough.notes)
    assert abs(rough.value[0] - clean.value[0]) < 0.5
    assert np.all(np.abs(rough.value[4:7] - truth[4:7]) < 0.1 * truth[4:7])


def test_a_window_is_kept_to(recordings):
    whole = read_experiment(recordings / "points-00" / "experiment.yaml")
    run = replace(whole.runs[0], window=(5.0, 12.0))
    samples = prepare(whole, run)
    assert samples.time[0] >= 5.0
    assert samples.time[-1] <= 12.0
    assert len(samples) > 100


def test_knot_spacing_can_tell_noise_from_motion(recordings):
    spacing = {
        name: prepare(e, e.runs[0]).spacing
        for name in ("ideal-points", "points-00")
        for e in [read_experiment(recordings / name / "experiment.yaml")]
    }
    assert spacing["ideal-points"] < 0.05 < 0.1 < spacing["points-00"]


def test_the_command_stands_in_for_a_position_that_was_not_measured(robot, trajectory):
    experiment = simulate(robot, {"run": trajectory}, ideal_sensors(robot)).experiment
    untracked = replace(
        experiment,
        runs=tuple(
            replace(r, streams={k: v for k, v in r.streams.items() if k != "tracker"})
            for r in experiment.runs
        ),
    )
    estimate = TwoStep()(untracked)
    assert any("commanded" in note for note in estimate.notes)
    assert abs(estimate.value[0] / robot.platform.mass - 1) < 0.02


@pytest.mark.parametrize(
    ("dropped", "acceleration", "message"),
    [
        (("imu",), None, "an orientation"),
        (("tracker", "command"), None, "a position"),
        (("tracker",), "tracker", "a position or pose to take the acceleration from"),
    ],
)
def test_what_is_missing_is_named(robot, trajectory, dropped, acceleration, message):
    experiment = simulate(robot, {"run": trajectory}, ideal_sensors(robot)).experiment
    run = experiment.runs[0]
    lacking = replace(run, streams={k: v for k, v in run.streams.items() if k not in dropped})
    with pytest.raises(InputError, match=f"run 'run': expected {message}"):
        prepare(experiment, lacking, acceleration=acceleration)


def test_a_platform_at_rest_is_refused_as_a_motion(robot):
    pose = np.array([0, 0, 2.0, 0, 0, 0])
    # So exact that no rounding, which differs between processors, makes the platform ring.
    exact = ForwardDynamicsSettings(tolerance=1e-11)
    still = {"still": RestToRest(pose, pose, 4.0)}
    virtual = simulate(robot, still, ideal_sensors(robot), settings=exact)
    with pytest.raises(InputError, match=r"run 'still': expected a motion.*static: true"):
        TwoStep()(virtual.experiment)


def test_every_method_prepares_samples_with_its_own_settings(robot, trajectory):
    experiment = simulate(robot, {"run": trajectory}, ideal_sensors(robot)).experiment
    many = PreparationSettings(fewest=10**6)
    methods = (
        TwoStep(settings=TwoStepSettings(preparation=many)),
        LeastSquares(settings=FitSettings(motion=MotionSettings(preparation=many))),
    )
    for method in methods:
        with pytest.raises(InputError, match="expected at least 1000000 force samples"):
            method(experiment)


def test_a_body_on_a_wrench_sensor_needs_no_position(robot, trajectory):
    arm = replace(
        robot,
        anchors=np.zeros((0, 3)),
        attachments=np.zeros((0, 3)),
        pulley_radius=[],
        pulley_axis=[],
        name="arm",
    )
    virtual = simulate(arm, {"run": trajectory}, ideal_sensors(arm))
    experiment = virtual.experiment
    lone = replace(
        experiment,
        runs=tuple(
            replace(r, streams={k: r.streams[k] for k in ("sensor", "imu")})
            for r in experiment.runs
        ),
    )
    np.testing.assert_allclose(
        TwoStep()(lone).value, virtual.body.body_parameters, rtol=EQUAL, atol=1e-3
    )


def static_experiment(folder, columns, extra=""):
    """24 real poses at rest, with some of their columns."""
    (folder / "robot.yaml").write_text("name: tool\ngravity: 9.82085\ncables: []\n")
    (folder / "experiment.yaml").write_text(
        "format: steelyard/1\nrobot: robot.yaml\ninstruments:\n"
        "  wrench: {kind: wrench, acts_on: sensor}\n"
        + columns
        + "runs:\n  - {name: poses, static: true, wrench: poses.csv, "
        + extra
        + "}\n"
    )
    return read_experiment(folder / "experiment.yaml")


def test_poses_with_an_accelerometer_alone_need_no_attitude(tmp_path, examples):
    poses = (examples / "kuka-tool" / "0-calibration_fts-accel.csv").read_text()
    (tmp_path / "poses.csv").write_text(poses)
    # Without the columns of the attitude an accelerometer has to say where gravity pulls, bias and
    # misalignment included.
    experiment = static_experiment(
        tmp_path,
        "  imu: {kind: imu, rpy_deg: [0, 90, 90]}\n",
        "imu: {file: poses.csv, units: {ax: g, ay: g, az: g}}",
    )
    run = experiment.runs[0]
    accelerometer = replace(
        run.streams["imu"], values={"specific_force": run.streams["imu"].values["specific_force"]}
    )
    lone = replace(experiment, runs=(replace(run, streams={**run.streams, "imu": accelerometer}),))
    for acceleration in (None, "imu", "tracker"):
        estimate = TwoStep(acceleration=acceleration)(lone)
        assert estimate.value[0] == pytest.approx(0.932, rel=0.01)
        np.testing.assert_allclose(estimate.value[1:4], [0.0003, 0, 0.0439], atol=2e-3)


def test_an_imu_that_takes_gravity_out_needs_an_attitude(robot, trajectory):
    sensors = changed(ideal_sensors(robot), imu={"gravity": "removed"})
    arm = replace(
        robot,
        anchors=np.zeros((0, 3)),
        attachments=np.zeros((0, 3)),
        pulley_radius=[],
        pulley_axis=[],
        name="arm",
    )
    run = simulate(
        arm,
        {"run": trajectory},
        Sensors({**ideal_sensors(arm).instruments, "imu": sensors.instruments["imu"]}),
    )
    experiment = run.experiment
    stream = experiment.runs[0].streams["imu"]
    blind = replace(stream, values={q: v for q, v in stream.values.items() if q != "orientation"})
    lone = replace(
        experiment.runs[0], streams={"sensor": experiment.runs[0].streams["sensor"], "imu": blind}
    )
    with pytest.raises(InputError, match="the platform's rotation"):
        prepare(experiment, lone)


@pytest.mark.parametrize(
    ("column", "factor", "said"), [(0, 1 / 3, "about x"), (2, -1.0, "about z")]
)
def test_a_gyro_that_contradicts_the_attitude_is_named(recordings, column, factor, said):
    whole = read_experiment(recordings / "points-00" / "experiment.yaml")
    assert not any("gyro" in note for note in prepare(whole, whole.runs[0]).notes)

    def spoil(name, stream):
        if name != "imu":
            return stream
        gyro = stream.values["angular_velocity"].copy()
        gyro[:, column] *= factor
        return replace(stream, values={**stream.values, "angular_velocity": gyro})

    spoilt = with_streams(whole, spoil)
    notes = [note for note in prepare(spoilt, spoilt.runs[0]).notes if "gyro" in note]
    assert len(notes) == 1
    assert said in notes[0]
