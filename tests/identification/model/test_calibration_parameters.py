"""The vector of all systematic errors against the tables of the contract."""

import numpy as np
import pytest

from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run, Stream
from steelyard.identification.model.calibration_parameters import (
    AIR,
    ATTACHED,
    BENDING,
    DRAG,
    ROBOT,
    CalibrationValues,
    as_tree,
    element_of,
    gather,
)
from steelyard.identification.verdict.directed_tests import _may_be_alone
from steelyard.instruments import Attitude, Command, Imu, Length, Pose, Position, Tension, Wrench
from steelyard.instruments.base import LATENCY
from steelyard.robot.model import Robot

M = 4
GRAVITY = np.array([0.4, -0.3, -9.7])
ROUNDING = 1e-12

SQUARE = Robot(
    name="square",
    anchors=[[-4, -3, 5], [4, -3, 5.5], [4, 3, 5], [-4, 3, 6]],
    attachments=[[-0.3, -0.2, 0.1], [0.3, -0.2, 0], [0.3, 0.25, 0], [-0.3, 0.2, 0.1]],
    gravity=GRAVITY,
)
TENSIONS = np.array(
    [[100.0, 200.0, np.nan, 400.0], [500.0, -600.0, 700.0, 800.0], [900.0, 1000.0, 1100.0, 1200.0]]
)
KINDS = {
    "cables": Tension,
    "sensor": Wrench,
    "imu": Imu,
    "compass": Attitude,
    "tracker": Position,
    "camera": Pose,
    "winches": Length,
    "command": Command,
}


def stream(name, values=None):
    """A recording whose values matter only where a default is taken from them."""
    forces = {
        "force": np.array([[1.0, -7.0, 3.0], [2.0, 2.0, np.nan]]),
        "torque": np.array([[0.1, 0.2, -0.3]] * 2),
    }
    own = (
        {"tension": TENSIONS} if name in {"cables", "spare"} else forces if name == "sensor" else {}
    )
    values = own if values is None else values
    return Stream(np.arange(3.0), values, f"{name}.csv")


def experiment(instruments, runs=None, robot=SQUARE, **keys):
    """Instruments as name -> keys of the file, or what is read from them; a run uses all of them
    unless stated."""
    made = {
        name: (
            KINDS[k.get("is", name)].model_validate(
                {"kind": KINDS[k.get("is", name)].model_fields["kind"].annotation.__args__[0]}
                | {key: value for key, value in k.items() if key != "is"}
            )
        )
        for name, k in instruments.items()
    }
    runs = runs or (Run("run", {name: stream(name) for name in made}),)
    return Experiment("some", robot, made, tuple(runs), **keys)


def entry(calibration_parameters, owner, key, run=None):
    return next(
        u for u in calibration_parameters.entries if (u.owner, u.key, u.run) == (owner, key, run)
    )


# Default 1-sigma by the table of the contract, per component.
TABLE = {
    ("cables", "offset"): (M, 0.01 * 700.0),  # 1 % of the median of |TENSIONS|
    ("cables", "gain"): (M, 0.01),
    ("cables", "common_gain"): (1, 0.005),
    ("cables", "time_constant"): (1, 0.0),
    ("cables", "crosstalk"): (M * (M - 1), 0.0),
    ("sensor", "time_constant"): (1, 0.0),
    ("sensor", "offset.force"): (3, 7.0),  # the largest reading
    ("sensor", "offset.torque"): (3, 0.3),
    ("sensor", "position"): (3, 0.0),
    ("sensor", "misalignment"): (3, 0.0),
    ("winches", "offset"): (M, 1.0),
    ("winches", "gain"): (M, 0.0),
    ("imu", "gyro_bias"): (3, 0.02),
    ("imu", "accelerometer_bias"): (3, 0.5),
    ("imu", "position"): (3, 0.005),
    ("imu", "misalignment"): (3, 0.05),
    ("imu", "reference"): (3, 0.02),
    ("imu", "gyro_scale"): (3, 0.0),
    ("imu", "accelerometer_scale"): (3, 0.0),
    ("compass", "misalignment"): (3, 0.05),
    ("compass", "reference"): (3, 0.02),
    ("tracker", "target"): (3, 0.005),
    ("tracker", "frame.position"): (3, 0.002),
    ("tracker", "frame.rotation"): (3, 0.0005),
    ("camera", "misalignment"): (3, 0.05),
    ("camera", "target"): (3, 0.005),
    ("camera", "frame.position"): (3, 0.002),
    ("camera", "frame.rotation"): (3, 0.0005),
}


@pytest.fixture(scope="module")
def everything():
    return gather(experiment({name: {} for name in KINDS}))


@pytest.mark.parametrize(("owner", "key"), TABLE)
def test_a_default_is_that_of_the_contract(everything, owner, key):
    size, deviation = TABLE[owner, key]
    found = entry(everything, owner, key)
    np.testing.assert_allclose(found.deviation, np.full(size, deviation), rtol=ROUNDING)
    np.testing.assert_array_equal(found.mean, np.full(size, 1.0 if key.endswith("gain") else 0.0))


def test_there_are_no_other_errors_than_those_of_the_contract(everything):
    found = {(u.owner, u.key) for u in everything.entries}
    delays = {(name, "delay") for name in KINDS}
    assert found == {
        *TABLE,
        *delays,
        # Of cables that lengths are read of, beyond the contract.
        *(("winches", key) for key in ("stretch", "roller", "roller_axis", "damping")),
        *((ROBOT, key) for key in ("anchor", "attachment", "gravity", DRAG)),
        *((ROBOT, key) for key, _ in (*ATTACHED, *AIR, *BENDING)),
    }


def test_a_filter_is_asked_for_where_a_motion_is_read_by_the_same_clock():
    def found(clock):
        keys = {"cables": {"clock": "recorder"}, "imu": {"clock": clock}}
        return entry(gather(experiment(keys)), "cables", "time_constant")

    assert found("recorder").suspected is not None
    assert found("another").suspected is None


def test_who_shares_a_clock_may_be_late():
    def late(**keys):
        keys = {"cables": {"clock": "recorder"}, "imu": {"clock": "recorder", **keys}}
        entries = gather(experiment(keys)).entries
        return {each.owner for each in entries if each.key == LATENCY and each.is_absent}

    assert late() == {"cables", "imu"}
    assert late(calibration={"delay": 0.0}) == {"cables", "imu"}
    assert late(clock="another") == set()


def test_errors_of_poor_devices_are_none_until_they_are_asked_for(everything):
    asked = {("imu", "accelerometer_scale", None), ("imu", "gyro_scale", None)}
    believed = everything.believed(asked)
    for before, after in zip(everything.entries, believed.entries, strict=True):
        if (after.owner, after.key, after.run) in asked:
            assert not before.deviation.any()
            np.testing.assert_array_equal(after.deviation, before.suspected)
        else:
            assert after is before


def test_a_stated_error_is_not_suspected():
    stated = {"calibration": {"time_constant": 0.001}}
    found = entry(gather(experiment({"cables": stated})), "cables", "time_constant")
    assert found.suspected is None
    np.testing.assert_array_equal(found.deviation, 0.001)


@pytest.mark.parametrize("pull", [4.0, 650.0])
def test_rollers_are_suspected_to_resist_as_those_of_such_cables_do(pull):
    runs = [Run("one", {"cables": stream("cables", {"tension": np.full((3, M), pull)})})]
    cables = gather(experiment({"cables": {"end": "winch"}}, runs))
    found = entry(cables, "cables", "viscous")
    assert found.is_absent
    assert found.suspected == pytest.approx(0.03 * pull)


def test_places_follow_each_other_without_gap(everything):
    taken = np.concatenate(
        [np.arange(len(everything))[place] for place in everything.places.values()]
    )
    np.testing.assert_array_equal(taken, np.arange(len(everything)))
    assert (
        len(everything.mean)
        == len(everything.deviation)
        == len(everything.names)
        == len(everything)
    )
    for place, unknown, component in everything.components():
        own = everything.places[unknown.owner, unknown.key, unknown.run]
        assert place == own.start + component < own.stop
        assert everything.mean[place] == unknown.mean[component]
        assert everything.deviation[place] == unknown.deviation[component]


def test_every_component_has_a_name_of_its_own(everything):
    names = everything.names
    assert len(set(names)) == len(names)
    assert names[everything.places["imu", "gyro_bias", None]][1] == "imu.gyro_bias y"
    assert names[everything.places["cables", "gain", None]][2] == "cables.gain of cable 3"
    assert names[everything.places["cables", "common_gain", None]] == ("cables.common_gain",)
    assert names[everything.places["tracker", "delay", "run"]] == ("tracker.delay of run 'run'",)
    assert names[everything.places[ROBOT, "attachment", None]][5] == "attachment 2 z"
    assert (
        names[everything.places[ROBOT, "bending.coupling", None]][2] == "robot.bending.coupling xz"
    )


def test_the_forces_of_three_cables_are_no_axes():
    three = Robot(name="three", anchors=SQUARE.anchors[:3], attachments=SQUARE.attachments[:3])
    calibration_parameters = gather(experiment({"cables": {}, "imu": {}}, robot=three))
    assert entry(calibration_parameters, "cables", "gain").names(3)[2] == "cables.gain of cable 3"
    assert (
        entry(calibration_parameters, "cables", "offset").names(3)[0] == "cables.offset of cable 1"
    )
    assert entry(calibration_parameters, "imu", "gyro_bias").names(3)[2] == "imu.gyro_bias z"


def test_a_default_from_the_data_looks_at_all_runs():
    runs = [
        Run("one", {"cables": stream("cables", {"tension": np.full((1, M), 100.0)})}),
        Run("two", {"cables": stream("cables", {"tension": np.full((3, M), -300.0)})}),
    ]
    calibration_parameters = gather(experiment({"cables": {}}, runs))
    np.testing.assert_allclose(entry(calibration_parameters, "cables", "offset").deviation, 3.0)


def test_the_median_is_that_of_all_readings():
    calibration_parameters = gather(experiment({"cables": {}}))
    expected = 0.01 * np.median(np.abs(TENSIONS[np.isfinite(TENSIONS)]))
    np.testing.assert_allclose(
        entry(calibration_parameters, "cables", "offset").deviation, np.full(M, expected)
    )


@pytest.mark.parametrize(
    ("stated", "mean", "deviation"),
    [
        (0.03, [0, 0, 0], [0.03] * 3),
        (0, [0, 0, 0], [0] * 3),
        ((0.01, 0.02, 0.0), [0, 0, 0], [0.01, 0.02, 0.0]),
        ({"value": 0.2, "sigma": 0.01}, [0.2] * 3, [0.01] * 3),
        ({"value": (0.1, 0.2, 0.3), "sigma": 0.01}, [0.1, 0.2, 0.3], [0.01] * 3),
        ({"value": (0.1, 0.2, 0.3), "sigma": (0.0, 0.0, 0.5)}, [0.1, 0.2, 0.3], [0.0, 0.0, 0.5]),
    ],
)
def test_a_prior_is_what_the_file_states(stated, mean, deviation):
    found = entry(
        gather(experiment({"imu": {"calibration": {"gyro_bias": stated}}})), "imu", "gyro_bias"
    )
    np.testing.assert_array_equal(found.mean, mean)
    np.testing.assert_array_equal(found.deviation, deviation)


def test_a_nested_prior_is_what_the_file_states():
    calibration = {"frame": {"position": {"value": (1.0, 2.0, 3.0), "sigma": 0.1}, "rotation": 0.2}}
    calibration_parameters = gather(experiment({"tracker": {"calibration": calibration}}))
    np.testing.assert_array_equal(
        entry(calibration_parameters, "tracker", "frame.position").mean, [1, 2, 3]
    )
    np.testing.assert_array_equal(
        entry(calibration_parameters, "tracker", "frame.rotation").deviation, [0.2] * 3
    )


def test_a_known_gain_replaces_the_one_of_a_perfect_instrument():
    calibration = {
        "gain": {"value": (0.9, 1.0, 1.1, 1.2), "sigma": 0.0},
        "offset": {"value": 3.0, "sigma": 1.0},
    }
    calibration_parameters = gather(experiment({"cables": {"calibration": calibration}}))
    np.testing.assert_array_equal(
        entry(calibration_parameters, "cables", "gain").mean, [0.9, 1.0, 1.1, 1.2]
    )
    np.testing.assert_array_equal(entry(calibration_parameters, "cables", "offset").mean, [3.0] * M)
    np.testing.assert_array_equal(
        entry(calibration_parameters, "cables", "offset").deviation, [1.0] * M
    )


def three_runs(*, static=()):
    """The IMU is in the first and the last of them."""
    return [
        Run(
            name,
            {i: stream(i) for i in ("cables", "imu", "tracker") if i != "imu" or name != "middle"},
            static=name in static,
        )
        for name in ("first", "middle", "last")
    ]


def test_an_error_per_run_is_one_for_every_run_that_has_the_instrument():
    prior = {"gyro_bias": {"value": 0.1, "sigma": 0.02, "per": "run"}}
    calibration_parameters = gather(
        experiment({"cables": {}, "imu": {"calibration": prior}, "tracker": {}}, three_runs())
    )
    found = [u for u in calibration_parameters.entries if u.key == "gyro_bias"]
    assert [u.run for u in found] == ["first", "last"]
    for u in found:
        np.testing.assert_array_equal(u.mean, [0.1] * 3)
        np.testing.assert_array_equal(u.deviation, [0.02] * 3)
    one, other = (
        calibration_parameters.place("imu", "gyro_bias", run) for run in ("first", "last")
    )
    assert one != other
    assert calibration_parameters.place(
        "imu", "misalignment", "first"
    ) == calibration_parameters.place("imu", "misalignment", "last")
    with pytest.raises(KeyError):
        calibration_parameters.place("imu", "gyro_bias", "middle")
    assert calibration_parameters.names[other.start] == "imu.gyro_bias of run 'last' x"


def test_an_instrument_that_no_run_uses_has_no_errors():
    runs = [Run("run", {"cables": stream("cables")})]
    calibration_parameters = gather(experiment({"cables": {}, "imu": {}}, runs))
    assert {u.owner for u in calibration_parameters.entries} == {"cables", ROBOT}


# Clocks


def delays(calibration_parameters, run="run"):
    """Clock -> 1-sigma."""
    return {
        u.owner: float(u.deviation[0])
        for u in calibration_parameters.entries
        if u.key == "delay" and u.run == run
    }


def test_the_clock_of_the_forces_defines_the_time():
    calibration_parameters = gather(experiment({"imu": {}, "cables": {}, "tracker": {}}))
    assert delays(calibration_parameters) == {"imu": 0.05, "cables": 0.0, "tracker": 0.05}


def test_instruments_of_one_clock_have_one_delay():
    calibration_parameters = gather(
        experiment(
            {
                "cables": {"clock": "recorder"},
                "imu": {"clock": "recorder"},
                "tracker": {"clock": "hall"},
                "camera": {"clock": "hall"},
                "compass": {},
            }
        )
    )
    assert delays(calibration_parameters) == {"recorder": 0.0, "hall": 0.05, "compass": 0.05}


def test_the_first_force_instrument_of_a_run_defines_its_time():
    pair = {"cables": {}, "sensor": {}}
    runs = [
        Run("both", {name: stream(name) for name in pair}),
        Run("sensor only", {"sensor": stream("sensor")}),
    ]
    calibration_parameters = gather(experiment(pair, runs))
    assert delays(calibration_parameters, "both") == {"cables": 0.0, "sensor": 0.05}
    assert delays(calibration_parameters, "sensor only") == {"sensor": 0.0}


def test_what_is_known_of_one_instrument_is_known_of_its_clock():
    hall = {"clock": "hall"}
    known = {"clock": "hall", "calibration": {"delay": {"value": 0.3, "sigma": 0.001}}}
    for tracker, camera in ((hall, known), (known, hall)):
        calibration_parameters = gather(
            experiment({"cables": {}, "tracker": tracker, "camera": camera})
        )
        assert delays(calibration_parameters)["hall"] == 0.001
        assert entry(calibration_parameters, "hall", "delay", "run").mean == 0.3


def test_even_the_forces_may_have_a_stated_delay():
    calibration = {"delay": {"value": -0.02, "sigma": 0.004}}
    calibration_parameters = gather(experiment({"cables": {"calibration": calibration}}))
    assert delays(calibration_parameters) == {"cables": 0.004}
    assert entry(calibration_parameters, "cables", "delay", "run").mean == -0.02


def test_every_run_in_motion_has_delays_of_its_own_and_poses_at_rest_have_none():
    calibration_parameters = gather(
        experiment({"cables": {}, "imu": {}, "tracker": {}}, three_runs(static=("last",)))
    )
    assert delays(calibration_parameters, "first") == {"cables": 0.0, "imu": 0.05, "tracker": 0.05}
    assert delays(calibration_parameters, "middle") == {"cables": 0.0, "tracker": 0.05}
    assert delays(calibration_parameters, "last") == {}
    assert calibration_parameters.place(
        "tracker", "delay", "first"
    ) != calibration_parameters.place("tracker", "delay", "middle")


# The robot file


def test_the_robot_file_is_uncertain_as_stated():
    calibration_parameters = gather(
        experiment(
            {"cables": {}}, uncertainty={"anchor": 0.003, "attachment": 0.001, "gravity": 0.02}
        )
    )
    for key, value, deviation in (
        ("anchor", SQUARE.anchors, 0.003),
        ("attachment", SQUARE.attachments, 0.001),
        ("gravity", GRAVITY, 0.02),
    ):
        found = entry(calibration_parameters, ROBOT, key)
        np.testing.assert_array_equal(found.mean, np.ravel(value))
        np.testing.assert_array_equal(found.deviation, np.full(np.size(value), deviation))


def test_a_body_on_a_sensor_has_neither_anchors_nor_attachments():
    arm = Robot(name="arm", anchors=np.zeros((0, 3)), attachments=np.zeros((0, 3)))
    calibration_parameters = gather(experiment({"sensor": {}, "imu": {}}, robot=arm))
    assert len(entry(calibration_parameters, ROBOT, "anchor").mean) == 0
    assert len(set(calibration_parameters.names)) == len(calibration_parameters)


# Values


@pytest.fixture
def numbered():
    """Errors that are their own place, over three runs."""
    prior = {"gyro_bias": {"sigma": 0.02, "per": "run"}}
    whole = experiment(
        {
            "cables": {"clock": "recorder"},
            "imu": {"clock": "recorder", "calibration": prior},
            "tracker": {},
        },
        three_runs(),
    )
    calibration_parameters = gather(whole)
    return (
        whole,
        calibration_parameters,
        CalibrationValues(calibration_parameters, np.arange(float(len(calibration_parameters)))),
    )


def test_an_instrument_gets_its_own_errors_in_its_own_order(numbered):
    whole, calibration_parameters, calibration = numbered
    for run in ("first", "last"):
        for name in ("cables", "imu", "tracker"):
            instrument = whole.instruments[name]
            found = calibration.of(name, instrument, run)
            assert list(found) == [term.key for term in instrument.terms(M)]
            for term in instrument.terms(M):
                holds = run if term.key == "gyro_bias" else None
                place = calibration_parameters.places[name, term.key, holds]
                np.testing.assert_array_equal(
                    found[term.key], np.arange(place.start, place.start + term.size)
                )


def test_delay_and_gravity_stand_where_they_are_named(numbered):
    _, calibration_parameters, calibration = numbered
    assert calibration.delay("tracker", "middle") == calibration_parameters.names.index(
        "tracker.delay of run 'middle'"
    )
    assert calibration.delay("recorder", "last") == calibration_parameters.names.index(
        "recorder.delay of run 'last'"
    )
    np.testing.assert_array_equal(
        calibration.gravity,
        [calibration_parameters.names.index(f"robot.gravity {axis}") for axis in ("x", "y", "z")],
    )


def test_at_the_values_known_beforehand_gravity_is_that_of_the_robot(everything):
    np.testing.assert_array_equal(CalibrationValues(everything, everything.mean).gravity, GRAVITY)


def test_the_tree_has_the_shape_of_the_contract(numbered):
    numbered_experiment, calibration_parameters, calibration = numbered
    deviations = calibration.values + 0.5
    tree = as_tree(numbered_experiment, calibration_parameters, calibration.values, deviations)

    def pair(owner, key, run=None):
        value = calibration.values[calibration_parameters.places[owner, key, run]]
        return {"value": value.tolist(), "standard_deviation": (value + 0.5).tolist()}

    def single(owner, key, run=None):
        return {name: value[0] for name, value in pair(owner, key, run).items()}

    def plain(node):
        return (
            {k: plain(v) for k, v in node.items()}
            if isinstance(node, dict)
            else np.asarray(node).tolist()
        )

    assert plain(tree) == {
        "cables": {
            "offset": pair("cables", "offset"),
            "gain": pair("cables", "gain"),
            "common_gain": single("cables", "common_gain"),
        },
        "imu": {
            "gyro_bias": {run: pair("imu", "gyro_bias", run) for run in ("first", "last")},
            **{
                key: pair("imu", key)
                for key in ("accelerometer_bias", "position", "misalignment", "reference")
            },
        },
        "tracker": {
            "target": pair("tracker", "target"),
            "frame": {key: pair("tracker", f"frame.{key}") for key in ("position", "rotation")},
            "delay": {run: single("tracker", "delay", run) for run in ("first", "middle", "last")},
        },
    }


def test_errors_that_are_known_exactly_are_not_reported():
    described = experiment(
        {"cables": {"calibration": {"gain": 0, "common_gain": 0, "offset": (0, 0, 0, 2.0)}}}
    )
    calibration_parameters = gather(described)
    tree = as_tree(
        described,
        calibration_parameters,
        calibration_parameters.mean,
        calibration_parameters.deviation,
    )
    assert set(tree) == {"cables"}
    assert set(tree["cables"]) == {"offset"}
    np.testing.assert_array_equal(tree["cables"]["offset"]["standard_deviation"], [0, 0, 0, 2.0])


def test_elements_of_what_bends_fill_one_symmetric_matrix(everything):
    places = {element_of(key, i) for key, size in BENDING for i in range(size)}
    assert places | {(j, i) for i, j in places} == {(i, j) for i in range(6) for j in range(6)}
    for key, size in BENDING:
        assert len(entry(everything, ROBOT, key).mean) == size


@pytest.mark.parametrize(
    ("key", "component", "size", "alone"),
    [
        ("bending.force", 0, 0.01, True),
        ("bending.force", 0, -0.01, False),
        ("bending.force", 3, 0.01, False),
        ("bending.coupling", 0, 0.01, False),
        ("bending.torque", 2, 0.01, True),
        ("bending.torque", 2, -0.01, False),
        ("gravity", 2, -0.01, True),
    ],
)
def test_of_a_positive_matrix_only_the_diagonal_may_be_off_alone(
    everything, key, component, size, alone
):
    # A clipped gyro seems to make a platform stiffer than a rigid one.
    assert _may_be_alone(entry(everything, ROBOT, key), component, size) == alone
