"""Rows of the motion instruments against differences of their own residuals, and what counts how
much among them."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.interpolate import BSpline
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, norm
from simulated import EXACT, ROBOT

from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run, Stream
from steelyard.identification.banded import banded_product
from steelyard.identification.model.border import Border
from steelyard.identification.model.calibration_parameters import CalibrationValues, gather
from steelyard.identification.model.motion_residuals import _lateness_whitener, motion_residuals
from steelyard.identification.model.motion_segment import (
    PARTS,
    CarriedTensions,
    Reading,
    Segment,
    jerk_matrices,
)
from steelyard.identification.model.processes import Process, integrals_of
from steelyard.identification.model.segment import POSE, WIDTH, NormalEquations
from steelyard.identification.tally import (
    Tally,
    limit,
    median,
    robust_weight,
)
from steelyard.instruments import Attitude, Command, Imu, Length, Pose, Position, Tension
from steelyard.instruments.base import LATENCY
from steelyard.smoothing import DEGREE, knots

pytestmark = pytest.mark.integration

START, END, SPACING = 0.2, 3.0, 0.4  # [s]
DIFFERENCES = 2e-6  # relative to the largest; central differences of what curves over a metre, a second, a radian
STEP = 1e-5  # of them
ROUNDING = 1e-9  # relative to the largest; sums of a few hundred products
FAR = (
    1e-4  # probability of a number that counts no more than noise may reach: what the module states
)

UNEVEN = np.concatenate(
    [[START] * 6, START + np.cumsum([0.05, 0.4, 0.11, 0.3, 0.02, 0.7]), [END] * 6]
)
EVEN = knots(START, END, SPACING)
GRIDS = {"even": EVEN, "uneven": UNEVEN}


# How smooth a motion is


def integral_of_squared_jerk(grid, coefficients, place):
    """By adaptive quadrature of SciPy's third derivative, knot by knot."""
    jerk = BSpline(grid, coefficients[:, place], DEGREE).derivative(3)
    inner = np.unique(grid)
    return sum(quad(lambda t: float(jerk(t) @ jerk(t)), a, b)[0] for a, b in pairwise(inner))


def motion_of(grid, rng):
    """Coefficients of a motion of about a metre and a radian; the quaternion has any length near
    one."""
    count = len(grid) - DEGREE - 1
    position = np.array([0.3, -0.2, 2.0]) + 0.3 * rng.normal(size=(count, 3))
    quaternion = np.array([1.05, 0.1, -0.05, 0.1]) + 0.1 * rng.normal(size=(count, 4))
    return np.hstack([position, quaternion])


@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("grid", GRIDS.values(), ids=GRIDS)
def test_the_matrix_of_a_jerk_gives_its_integral(grid, part, rng):
    band = jerk_matrices(grid)[part]
    size = (len(grid) - DEGREE - 1) * POSE
    assert band.shape == (WIDTH, size)
    for _ in range(3):
        coefficients = motion_of(grid, rng)
        found = coefficients.ravel() @ banded_product(band, coefficients.ravel())
        assert found == pytest.approx(
            integral_of_squared_jerk(grid, coefficients, PARTS[part]), rel=1e-7
        )


@pytest.mark.parametrize("grid", GRIDS.values(), ids=GRIDS)
def test_roughness_is_the_integral_of_the_squared_jerk(grid, rng):
    segment = Segment("run", grid, (), motion_of(grid, rng), jerks=jerk_matrices(grid))
    assert set(segment.roughness) == {"position", "rotation"}
    for part, found in segment.roughness.items():
        assert found == pytest.approx(
            integral_of_squared_jerk(grid, segment.coefficients, PARTS[part]), rel=1e-7
        )


def test_a_motion_of_constant_acceleration_is_smooth():
    # The coefficients of t^2 are symmetric means of the knots (blossoms).
    count = len(UNEVEN) - DEGREE - 1
    pairs = [(i, j) for j in range(DEGREE) for i in range(j)]
    inner = [UNEVEN[j + 1 : j + DEGREE + 1] for j in range(count)]
    square = np.array([np.mean([k[i] * k[j] for i, j in pairs]) for k in inner])
    segment = Segment(
        "run", UNEVEN, (), np.tile(square[:, None], POSE), jerks=jerk_matrices(UNEVEN)
    )
    np.testing.assert_allclose(BSpline(UNEVEN, square, DEGREE)(1.3), 1.3**2, rtol=1e-12)
    scale = max(np.abs(each).max() for each in segment.jerks.values())
    assert all(abs(value) < 1e-12 * scale for value in segment.roughness.values())


def nothing_read(size):
    return NormalEquations(
        np.zeros((WIDTH, size)), np.zeros((size, 1)), np.zeros((1, 1)), np.zeros(size), np.zeros(1)
    )


def test_smoothness_costs_what_is_rough_by_its_intensity(rng):
    # Cost of a step x: (c + x)^T J (c + x) / intensity, of which the normal equations know all but
    # a constant.
    level = {"position": 0.3, "rotation": 7.0}
    segment = Segment("run", UNEVEN, (), motion_of(UNEVEN, rng), level, jerks=jerk_matrices(UNEVEN))
    found = segment.smooth(nothing_read(segment.coefficients.size))

    def cost(coefficients):
        return sum(
            integral_of_squared_jerk(UNEVEN, coefficients, place) / level[p]
            for p, place in PARTS.items()
        )

    for _ in range(3):
        step = rng.normal(size=segment.coefficients.shape)
        x = step.ravel()
        promised = x @ banded_product(found.band, x) - 2 * found.motion_gradient @ x
        expected = cost(segment.coefficients + step) - cost(segment.coefficients)
        assert promised == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize(
    "change", [{"smoothness": None}, {"static": True}], ids=["no prior", "poses at rest"]
)
def test_a_motion_without_smoothness_is_as_it_is_read(change, rng):
    level = {"position": 1.0, "rotation": 1.0}
    segment = Segment("run", EVEN, (), motion_of(EVEN, rng), level, jerks=jerk_matrices(EVEN))
    equations = nothing_read(segment.coefficients.size)
    assert replace(segment, **change).smooth(equations) is equations


# Derivatives of every kind of instrument

POINTS = replace(
    ROBOT, name="points", pulley_radius=np.zeros(8)
)  # cables leave from points: quicker, and as general
FRAME = {"position": (0.4, -0.3, 0.2), "rpy_deg": (5.0, -8.0, 20.0)}
SUITE = {
    "cables": Tension.model_validate(
        {"kind": "tension", "clock": "recorder", "calibration": {"offset": 5.0}}
    ),
    "imu": Imu.model_validate(
        {
            "kind": "imu",
            "position": (0.1, -0.2, 0.3),
            "rpy_deg": (10, 20, -30),
            "calibration": {"delay": 0.01},
        }
    ),
    "still imu": Imu.model_validate(
        {"kind": "imu", "gravity": "removed", "calibration": {"delay": 0.02}}
    ),
    "attitude": Attitude.model_validate(
        {"kind": "attitude", "rpy_deg": (3, -4, 25), "clock": "cameras"}
    ),
    "tracker": Position.model_validate(
        {"kind": "position", "target": (0.1, 0.2, 1.1), "frame": FRAME}
    ),
    "camera": Pose.model_validate(
        {
            "kind": "pose",
            "position": (0.2, 0.0, 0.5),
            "rpy_deg": (0, 15, 5),
            "frame": FRAME,
            "clock": "cameras",
        }
    ),
    "controller": Command.model_validate(
        {"kind": "command", "noise": {"position": 0.01, "rotation": 0.01}}
    ),
    "winches": Length.model_validate({"kind": "length"}),
}
READ = {
    ("imu", "angular_velocity"): 3,
    ("imu", "specific_force"): 3,
    ("imu", "orientation"): 9,
    ("still imu", "specific_force"): 3,
    ("attitude", "orientation"): 9,
    ("tracker", "position"): 3,
    ("camera", "position"): 3,
    ("camera", "orientation"): 9,
    ("controller", "position"): 3,
    ("controller", "orientation"): 9,
    ("winches", "length"): 8,
}
LARGE = 30.0  # 1-sigma: readings of anything are then within what noise may reach
SAMPLES = 7


def readings(times, rng):
    """Of every quantity: numbers that have nothing to do with the motion."""
    found = []
    for source, size in READ.items():
        shape = (len(times), size)
        values = (
            Rotation.from_rotvec(0.5 * rng.normal(size=(len(times), 3))).as_matrix()
            if size == 9
            else None
        )
        values = rng.normal(size=shape) if values is None else values
        # Each looks at its own times; poses at rest have their numbers.
        own = (
            times
            if times.dtype == int
            else np.sort(rng.uniform(START + 0.2, END - 0.2, len(times)))
        )
        tension = 500 + 200 * rng.uniform(size=(len(times), 8)) if source[0] == "winches" else None
        found.append(Reading(source, own.astype(float), values, LARGE, tension))
    return tuple(found)


class Case:
    """An arc, all instruments along it, and systematic errors that are not zero."""

    def __init__(self, *, static=False, reference=None, disturbed=False):
        rng = np.random.default_rng(11)
        numbers = np.arange(SAMPLES)
        streams = {name: Stream(numbers.astype(float), {}, name) for name in SUITE}
        self.experiment = Experiment(
            "all",
            POINTS,
            SUITE,
            (Run("run", streams, dict.fromkeys(SUITE, 0.0), static=static),),
            uncertainty=EXACT,
        )
        self.calibration_parameters = gather(self.experiment)
        values = self.calibration_parameters.mean + 0.02 * rng.normal(
            size=len(self.calibration_parameters)
        )
        self.calibration = CalibrationValues(self.calibration_parameters, values)
        if static:
            pose = np.hstack([[0.3, -0.2, 2.0], [1.0, 0.1, -0.05, 0.1]]) + 0.1 * rng.normal(
                size=(SAMPLES, POSE)
            )
            self.segment = Segment(
                "run", numbers.astype(float), readings(numbers, rng), pose, static=True
            )
        else:
            self.segment = Segment(
                "run",
                EVEN,
                readings(numbers.astype(float), rng),
                motion_of(EVEN, rng),
                reference=reference,
            )
        if disturbed:
            quantities = {each.source: each.values[0].shape[-1] for each in self.segment.readings}
            self.segment = self.segment.disturbed(
                tuple(
                    Process(source, 0.1 + np.arange(k), 0.1, 0.5, integrals_of(EVEN))
                    for source, k in quantities.items()
                )
            )
            coefficients = self.segment.coefficients.copy()
            coefficients[:, POSE:] = 0.1 * rng.normal(size=coefficients[:, POSE:].shape)
            self.segment = replace(self.segment, coefficients=coefficients)

    def rows(self, coefficients=None, values=None, **keys):
        """Label -> rows; None is what holds the motion."""
        segment = (
            self.segment
            if coefficients is None
            else replace(self.segment, coefficients=coefficients)
        )
        return self.rows_of(segment, values, **keys)

    def rows_of(self, segment, values=None, *, factors=None, tally=None):
        calibration = (
            self.calibration
            if values is None
            else CalibrationValues(self.calibration_parameters, values)
        )
        columns = np.arange(len(self.calibration_parameters))
        found = motion_residuals(
            self.experiment, segment, calibration, columns, factors or {}, tally or Tally()
        )
        return {each.label: each for each in found}

    def label(self, source):
        return source and self.segment.label(*source)


CASES = {
    "in motion": Case(),
    "at rest": Case(static=True),
    "in the time of the forces": Case(reference="recorder"),
    "disturbed": Case(disturbed=True),
}


DIRECTIONS = 6
"""Random ones that the motion is moved in: a derivative that is wrong anywhere is wrong along each
of them."""


def central_differences(function, x, directions):
    """Label -> derivative of the residuals of ``function`` along directions, shape (n, k,
    directions)."""
    columns = []
    for direction in directions:
        ahead, behind = (function(x + s * STEP * direction) for s in (1, -1))
        columns.append(
            {
                label: (ahead[label].residual - behind[label].residual) / (2 * STEP)
                for label in ahead
            }
        )
    return {label: np.stack([column[label] for column in columns], axis=2) for label in columns[0]}


@pytest.fixture(scope="module", params=CASES)
def compared(request):
    """A case, its rows, and differences along directions of the motion and, one each, of the
    systematic errors."""
    case, rng = CASES[request.param], np.random.default_rng(12)
    ways = rng.normal(size=(DIRECTIONS, *case.segment.coefficients.shape))
    errors = np.zeros((len(case.calibration_parameters.entries), len(case.calibration_parameters)))
    for row, place in zip(errors, case.calibration_parameters.places.values(), strict=True):
        row[place] = rng.normal(size=len(row[place]))
    by_motion = central_differences(case.rows, case.segment.coefficients, ways)
    by_errors = central_differences(lambda v: case.rows(values=v), case.calibration.values, errors)
    return case, case.rows(), (ways, by_motion), (errors, by_errors)


@pytest.mark.parametrize(
    "source", [*READ, None], ids=lambda s: " ".join(s) if s else "what holds the motion"
)
@pytest.mark.integration
def test_derivatives_by_the_motion_are_those_of_differences(compared, source):
    case, rows, (ways, by_motion), _ = compared
    found, expected = rows[case.label(source)], by_motion[case.label(source)]
    own = found.first[:, None] + np.arange(found.by_motion.shape[2] // case.segment.block)
    along = np.einsum(
        "nki,dni->nkd", found.by_motion, ways[:, own].reshape(len(ways), len(own), -1)
    )
    np.testing.assert_allclose(
        along, expected, atol=DIFFERENCES * max(np.abs(expected).max(), 1 / LARGE)
    )


@pytest.mark.parametrize(
    "source", [*READ, None], ids=lambda s: " ".join(s) if s else "what holds the motion"
)
def test_derivatives_by_systematic_errors_and_delays_are_those_of_differences(compared, source):
    case, rows, _, (errors, by_errors) = compared
    found, expected = rows[case.label(source)], by_errors[case.label(source)]
    along = found.by_errors @ errors[:, found.columns].T
    np.testing.assert_allclose(
        along, expected, atol=DIFFERENCES * max(np.abs(expected).max(), 1 / LARGE)
    )


def test_every_error_of_a_motion_instrument_acts_on_its_readings(compared):
    # So that the comparison with differences was not one of zeros.
    case, _, _, (_, by_errors) = compared
    acts = np.any([np.abs(each).max(axis=(0, 1)) > 0 for each in by_errors.values()], axis=0)
    static = case.segment.static
    for (owner, key, _), found in zip(case.calibration_parameters.places, acts, strict=True):
        if owner == "robot":
            # Lengths are read too.
            assert found == (key in {"gravity", "anchor", "attachment"})
            continue
        # Forces are not looked at, unless they tell the time.
        silent = owner == "cables" or (owner == "recorder" and case.segment.reference is None)
        # Some of an IMU is not read, and a body that rests does not tell where the IMU sits.
        silent |= owner == "still imu" and key in {"gyro_bias", "gyro_scale", "reference"}
        silent |= static and key == "gyro_scale"  # nothing turns
        silent |= static and key == "accelerometer_scale" and owner == "still imu"
        silent |= static and key == "position" and "imu" in owner
        silent |= static and key == "misalignment" and owner == "still imu"
        silent |= static and key == LATENCY
        silent |= key in {"roller", "roller_axis"}  # cables leave from points
        silent |= key == "damping"  # tensions are as they are given
        assert found != silent, (owner, key)


def test_lengths_of_ropes_that_damp_follow_tensions_of_a_while_ago(rng):
    case = CASES["in motion"]
    robot = replace(POINTS, cable=replace(POINTS.cable, axial_stiffness=2e4))
    experiment = replace(case.experiment, robot=robot)
    winches = replace(case.segment.readings[-1], follows=True)
    segment = replace(case.segment, readings=(winches,))
    shape = (SAMPLES, 8)
    tension, rate, bend, feed = (
        size * rng.normal(size=shape) for size in (500.0, 300.0, 900.0, 100.0)
    )
    tension = 2000.0 + tension
    none = np.zeros((*shape, POSE))
    carried = CarriedTensions(
        tension,
        *(none, none, none),
        np.zeros((*shape, 0)),
        np.zeros(0, dtype=int),
        np.zeros((*shape, 1)),
        np.broadcast_to(np.eye(8), (*shape, 8)),
        np.zeros((*shape, 0)),
        np.zeros(0, dtype=int),
        rate,
        bend,
        feed,
    )
    place = case.calibration_parameters.places["winches", "damping", None]
    columns = np.arange(len(case.calibration_parameters))

    def rows(own, fed, at=carried):
        values = case.calibration.values.copy()
        values[place] = own, fed
        calibration = CalibrationValues(case.calibration_parameters, values)
        found, *_ = motion_residuals(
            experiment, segment, calibration, columns, {}, Tally(), lambda times: at
        )
        return found

    # As with the tensions that stretch, if all of them did.
    stretching = tension - 0.02 * rate + 0.02**2 * bend - 0.01 * feed
    at_once = rows(0.0, 0.0, replace(carried, values=stretching))
    found = rows(0.02, 0.01)
    np.testing.assert_allclose(found.residual, at_once.residual, rtol=1e-12)
    assert np.abs(found.residual - rows(0.0, 0.0).residual).max() > 1e-3 / LARGE
    own = np.flatnonzero(np.isin(found.columns, np.arange(place.start, place.stop)))
    for i, step in zip(own, 1e-5 * np.eye(2), strict=True):
        ahead, behind = (rows(*(np.array([0.02, 0.01]) + s * step)).residual for s in (1, -1))
        expected = (ahead - behind) / 2e-5
        np.testing.assert_allclose(
            found.by_errors[:, :, i], expected, atol=1e-5 * np.abs(expected).max()
        )


def test_a_larger_noise_makes_smaller_rows():
    case = CASES["in motion"]
    source = ("tracker", "position")
    one, other = case.rows()[source], case.rows(factors={source: 2.0})[source]
    for key in ("residual", "by_motion", "by_errors"):
        np.testing.assert_allclose(getattr(one, key), 2 * getattr(other, key), rtol=ROUNDING)


def test_errors_without_a_column_are_not_there():
    case = CASES["in motion"]
    columns = np.full(len(case.calibration_parameters), -1)
    target = case.calibration_parameters.places["tracker", "target", None]
    columns[target] = [4, 2, 7]
    place = np.arange(len(columns))[target]
    found = {
        r.label: r
        for r in motion_residuals(
            case.experiment, case.segment, case.calibration, columns, {}, Tally()
        )
    }
    own = found["tracker", "position"]
    everything = case.rows()["tracker", "position"]
    np.testing.assert_array_equal(own.columns, [4, 2, 7])
    np.testing.assert_array_equal(
        own.by_errors, everything.by_errors[:, :, np.isin(everything.columns, place)]
    )
    assert found["attitude", "orientation"].by_errors.shape[2] == 0


# What counts how much

SOURCE = ("tracker", "position")
ATTITUDE = ("attitude", "orientation")
ACCELEROMETER = ("imu", "specific_force")


def only(case, source, sigma=LARGE, **keys):
    """The arc with one reading, changed."""
    (reading,) = (each for each in case.segment.readings if each.source == source)
    return replace(case.segment, readings=(replace(reading, sigma=sigma, **keys),))


def of(case, source):
    (reading,) = (each for each in case.segment.readings if each.source == source)
    return reading


@pytest.mark.parametrize(
    "source", [("imu", "specific_force"), SOURCE, ("winches", "length")], ids="-".join
)
def test_a_channel_without_a_number_is_no_sample_of_it(source):
    case = CASES["in motion"]
    values = of(case, source).values.copy()
    k = values.shape[1]
    values[3, 1] = np.nan
    values[5] = np.nan
    whole, holed = Tally(), Tally()
    before = case.rows_of(only(case, source), tally=whole)[source]
    after = case.rows_of(only(case, source, values=values), tally=holed)[source]
    for key in ("residual", "by_motion", "by_errors"):
        expected = getattr(before, key).copy()
        expected[3, 1], expected[5] = 0.0, 0.0
        np.testing.assert_array_equal(getattr(after, key), expected)
    assert whole.count[source] == SAMPLES * k
    assert holed.count[source] == SAMPLES * k - 1 - k
    assert holed.far[source] == 0
    assert holed.square[source] == pytest.approx(np.sum(after.residual**2))


@pytest.mark.parametrize(
    "source", [("imu", "angular_velocity"), SOURCE, ("winches", "length")], ids="-".join
)
def test_a_spike_in_one_channel_pulls_no_more_than_noise_may(source):
    case = CASES["in motion"]
    values = of(case, source).values.copy()
    values[2, 0] += 1e4 * LARGE
    before, after = (
        case.rows_of(only(case, source, values=v))[source]
        for v in (of(case, source).values, values)
    )
    # Pull on the motion: derivative times residual, both under the root of the weight.
    pull = after.by_motion[2, 0] * after.residual[2, 0]
    np.testing.assert_allclose(pull, before.by_motion[2, 0] * norm.isf(FAR / 2), rtol=1e-6)
    for key in ("residual", "by_motion", "by_errors"):
        expected, found = getattr(before, key).copy(), getattr(after, key).copy()
        expected[2, 0], found[2, 0] = 0.0, 0.0
        np.testing.assert_array_equal(found, expected)


def test_a_rotation_that_stands_far_counts_less_as_a_whole():
    case = CASES["in motion"]
    values = of(case, ATTITUDE).values.copy()
    angle = 1.5
    loose = case.rows_of(only(case, ATTITUDE))[ATTITUDE]
    # What is read is what is predicted, but for a turn in one sample.
    predicted = values @ Rotation.from_rotvec(-LARGE * loose.residual).as_matrix()
    values = predicted.copy()
    values[4] = predicted[4] @ Rotation.from_rotvec([0, angle, 0]).as_matrix()
    sigma = 1e-3
    before, after = (
        case.rows_of(only(case, ATTITUDE, sigma, values=v))[ATTITUDE] for v in (predicted, values)
    )
    np.testing.assert_allclose(before.residual, 0, atol=1e-9 / sigma)
    np.testing.assert_array_equal(
        after.residual[[0, 1, 2, 3, 5, 6]], before.residual[[0, 1, 2, 3, 5, 6]]
    )
    # Under the root of its weight, the length is the root of Huber's limit times the length that it
    # had.
    far = np.sqrt(chi2.isf(FAR, 3))
    np.testing.assert_allclose(after.residual[4], [0, np.sqrt(far * angle / sigma), 0], atol=1e-6)


@pytest.mark.parametrize("k", [1, 3, 6])
def test_noise_stands_far_as_rarely_as_stated(k):
    assert chi2.sf(limit(k) ** 2, k) == pytest.approx(FAR)
    size = np.array([0.0, 0.5, 1.0, 2.0, 1e6]) * limit(k)
    np.testing.assert_allclose(robust_weight(size, k) * size, np.minimum(size, limit(k)))


def test_readings_outside_the_arc_count_nothing():
    case = CASES["in motion"]
    for place in [(SOURCE, slice(None)), (ATTITUDE, slice(None))]:
        source = place[0]
        time = of(case, source).time.copy()
        time[0], time[-1] = START - 0.5, END + 0.7
        tally = Tally()
        before = case.rows_of(only(case, source))[source]
        after = case.rows_of(only(case, source, time=time), tally=tally)[source]
        for key in ("residual", "by_motion", "by_errors"):
            found, expected = getattr(after, key), getattr(before, key)
            np.testing.assert_array_equal(found[[0, -1]], 0.0)
            np.testing.assert_array_equal(found[1:-1], expected[1:-1])
        assert tally.count[source] == (SAMPLES - 2) * 3
        assert tally.far[source] == 0
        assert tally.square[source] == pytest.approx(np.sum(after.residual**2))


def test_a_clock_that_moves_carries_samples_out_of_the_arc():
    case = CASES["in motion"]
    segment = replace(
        case.segment, readings=tuple(of(case, source) for source in (ACCELEROMETER, SOURCE))
    )
    values = case.calibration.values.copy()
    values[case.calibration_parameters.places["tracker", "delay", "run"]] += (
        END  # the tracker is late, so it reads what was before
    )
    tally = Tally()
    case.rows_of(segment, values, tally=tally)
    assert tally.count[SOURCE] == 0
    assert tally.count[ACCELEROMETER] == 3 * SAMPLES


@pytest.mark.parametrize("static", [False, True], ids=["in motion", "at rest"])
def test_a_motion_is_held_in_its_hall_and_its_quaternion_near_one(static):
    case = CASES["at rest" if static else "in motion"]
    pose = np.array([30.0, -10.0, 5.0, 1.1, 0.0, 0.2, 0.0])
    coefficients = np.tile(pose, (len(case.segment.coefficients), 1))
    held = case.rows(coefficients)[None]
    length = (1.1**2 + 0.2**2 - 1) / 0.01
    expected = [length, *(pose[:3] / 100.0), 0, 0, 0]
    np.testing.assert_allclose(held.residual, np.tile(expected, (len(held.residual), 1)), atol=1e-9)
    assert len(held.residual) == (SAMPLES if static else 2 * round((END - START) / SPACING) + 1)


# Sums over residuals

GYRO = ("imu", "angular_velocity")


def huber(size, far):
    """Cost of a residual: a parabola, and straight lines from where it stands far."""
    return np.where(size <= far, size**2, 2 * far * size - far**2)


def test_a_tally_counts_what_is_near_and_what_is_far(rng):
    size = np.abs(rng.normal(size=(200, 3)))
    size[[7, 30], [1, 2]] = 9.0, 40.0
    far = norm.isf(FAR / 2)
    tally = Tally()
    tally.add(GYRO, size, robust_weight(size, 1), 1)
    assert tally.count == {GYRO: 598}
    assert tally.far == {GYRO: 2}
    assert tally.square[GYRO] == pytest.approx(np.sum(size[size < far] ** 2))
    assert tally.cost == pytest.approx(np.sum(huber(size, far)))


def test_a_tally_adds_up_and_keeps_quantities_apart(rng):
    parts, other, tally = (
        [np.abs(rng.normal(size=(50, 3))) for _ in range(2)],
        np.abs(rng.normal(size=20)),
        Tally(),
    )
    for size in parts:
        tally.add(GYRO, size, robust_weight(size, 1), 1)
    tally.add(ATTITUDE, other, robust_weight(other, 3), 3)
    assert tally.count == {GYRO: 300, ATTITUDE: 60}
    assert tally.square[GYRO] == pytest.approx(sum(np.sum(size**2) for size in parts))
    assert tally.square[ATTITUDE] == pytest.approx(np.sum(other**2))
    assert tally.cost == pytest.approx(tally.square[GYRO] + tally.square[ATTITUDE])


def test_where_most_stand_far_none_is_the_exception(rng):
    # A noise that is stated ten times too small must show as such.
    size = 10 * np.sqrt(rng.chisquare(3, 500))
    tally = Tally()
    tally.add(ATTITUDE, size, robust_weight(size, 3), 3)
    assert tally.far[ATTITUDE] <= 1
    assert tally.square[ATTITUDE] / tally.count[ATTITUDE] == pytest.approx(100, rel=0.1)


@pytest.mark.parametrize("n", [1, 2, 7, 12])
def test_a_median_of_few_is_that_of_many_axes(n, rng):
    values = rng.normal(size=(n, 3))
    assert median(values) == np.median(values)
    assert median(values[:, :1]) == np.median(values[:, 0])


def test_numbers_without_weight_are_not_counted():
    tally = Tally()
    tally.add(GYRO, np.array([1.0, 2.0, 50.0]), np.array([1.0, 0.0, 0.0]), 1)
    assert (tally.count[GYRO], tally.far[GYRO], tally.square[GYRO], tally.cost) == (1, 0, 1.0, 1.0)


def test_rows_and_tally_tell_the_same_cost():
    case = CASES["in motion"]
    tally = Tally()
    rows = case.rows(tally=tally)
    assert tally.cost == pytest.approx(sum(np.sum(each.residual**2) for each in rows.values()))
    assert tally.count == {s: SAMPLES * (3 if size == 9 else size) for s, size in READ.items()}


def test_roughness_counts_in_the_cost(rng):
    case = CASES["in motion"]
    level = {"position": 0.2, "rotation": 3.0}
    smooth = replace(case.segment, smoothness=level, jerks=jerk_matrices(EVEN))
    with_it, without = Tally(), Tally()
    case.rows_of(smooth, tally=with_it)
    case.rows_of(case.segment, tally=without)
    rough = {
        part: integral_of_squared_jerk(EVEN, smooth.coefficients, place)
        for part, place in PARTS.items()
    }
    assert with_it.cost - without.cost == pytest.approx(
        sum(rough[p] / level[p] for p in PARTS), rel=1e-7
    )


# Columns of the border


def test_columns_that_come_twice_are_added(rng):
    first, second, third = (
        rng.normal(size=(2, 3, 2)),
        rng.normal(size=(2, 3, 1)),
        rng.normal(size=(2, 3, 2)),
    )
    border = Border(np.array([5, 1, -1, 3]), 2, 3)
    border.put(slice(0, 2), first)  # columns 5 and 1
    border.put(np.array([1]), second)  # column 1 once more
    border.put(slice(2, 4), third)  # one without a column, and 3
    border.extend(np.array([0, 5]), np.ones((2, 3, 2)))
    derivative, columns = border.collected()
    full = np.zeros((2, 3, 6))
    full[:, :, columns] = derivative
    expected = np.zeros((2, 3, 6))
    expected[:, :, 5], expected[:, :, 1] = first[:, :, 0] + 1, first[:, :, 1] + second[:, :, 0]
    expected[:, :, 3], expected[:, :, 0] = third[:, :, 1], 1
    np.testing.assert_allclose(full, expected, rtol=ROUNDING)
    assert sorted(columns) == [0, 1, 3, 5]


def test_one_derivative_may_hold_for_all_samples(rng):
    border = Border(np.arange(4), 5, 2)
    border.put(slice(1, 3), np.broadcast_to(0.5, (5, 2, 2)))
    derivative, columns = border.collected()
    np.testing.assert_array_equal(columns, [1, 2])
    np.testing.assert_array_equal(derivative, np.full((5, 2, 2), 0.5))


def test_a_border_without_columns_is_empty():
    border = Border(np.full(3, -1), 5, 2)
    border.put(slice(0, 3), np.ones((5, 2, 3)))
    derivative, columns = border.collected()
    assert derivative.shape == (5, 2, 0)
    assert columns.shape == (0,)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("k", [1, 3])
def test_the_end_of_the_noise_is_not_said_to_be_beyond_it(k, seed):
    size = np.sqrt(np.random.default_rng(seed).chisquare(k, 40_000))
    tally = Tally()
    tally.add(("tracker", "position"), size, robust_weight(size, k), k)
    assert tally.far["tracker", "position"] > 0
    assert not tally.is_beyond_noise(("tracker", "position"))
    assert not tally.is_beyond_noise(("imu", "orientation"))
    size[7] = 8.0
    flipped = Tally()
    flipped.add(("tracker", "position"), size, robust_weight(size, k), k)
    tally.include(flipped)
    assert tally.is_beyond_noise(("tracker", "position"))


def test_many_that_stand_a_little_too_far_are_beyond_noise():
    size = np.abs(np.random.default_rng(0).standard_normal(40_000))
    size[:30] = 4.0
    tally = Tally()
    tally.add(("tracker", "position"), size, robust_weight(size, 1), 1)
    assert tally.is_beyond_noise(("tracker", "position"))


def test_a_late_stamp_is_late_for_all_channels(rng):
    late = rng.normal(scale=2.0, size=(5, 3))
    late[0] = 0.0
    late[1, 2] = 0.0
    found = _lateness_whitener(late)
    for whitener, each in zip(found, late, strict=True):
        covariance = np.eye(3) + np.outer(each, each)
        np.testing.assert_allclose(whitener @ covariance @ whitener, np.eye(3), atol=1e-12)
    # What is across the motion is known as well as without it, and a missing channel stays alone.
    np.testing.assert_array_equal(found[0], np.eye(3))
    np.testing.assert_allclose(found[1][2], [0.0, 0.0, 1.0])
