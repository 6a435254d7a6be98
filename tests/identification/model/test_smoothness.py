"""How smooth a motion is, against a marginal likelihood of the readings computed densely and
against the truth."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import BSpline
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation
from scipy.stats import Covariance, chi2, multivariate_normal, norm

from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run, Stream
from steelyard.identification.model.accumulation import accumulate
from steelyard.identification.model.calibration_parameters import CalibrationValues, gather
from steelyard.identification.model.motion_residuals import motion_residuals
from steelyard.identification.model.motion_segment import (
    Reading,
    Segment,
    jerk_matrices,
)
from steelyard.identification.model.segment import POSE
from steelyard.identification.model.settings import MOTION, MotionSettings
from steelyard.identification.model.smoothness import smoothness
from steelyard.identification.tally import Tally
from steelyard.instruments import Attitude, Position
from steelyard.robot.model import Robot
from steelyard.smoothing import DEGREE, knots

LENGTH, RATE, SPACING = 6.0, 20.0, 0.2  # [s], [Hz], [s]
TIMES = (np.arange(LENGTH * RATE) + 0.5) / RATE
GRID = knots(0.0, LENGTH, SPACING)
SETTLED = 0.45  # of a logarithm: the search ends within .3 of a ratio that falls somewhat slower than the intensity rises
RARE = 1e-4  # of sound data that would fail; seeds are fixed, so that none of them does by chance
SEEDS = 12

BARE = Robot("body", np.zeros((0, 3)), np.zeros((0, 3)))
NOTHING = {"position": 0.0, "rotation": 0.0}
SUITE = {
    "tracker": Position.model_validate(
        {"kind": "position", "calibration": {"target": 0.0, "frame": NOTHING, "delay": 0.0}}
    ),
    "attitude": Attitude.model_validate(
        {"kind": "attitude", "calibration": {"misalignment": 0.0, "reference": 0.0, "delay": 0.0}}
    ),
}
RUN = Run("run", {name: Stream(TIMES, {}, name) for name in SUITE}, dict.fromkeys(SUITE, 0.0))
EXPERIMENT = Experiment("body", BARE, SUITE, (RUN,), uncertainty={"gravity": 0.0})
UNKNOWNS = gather(EXPERIMENT)


def wandering(intensity, rng):
    """Three coordinates whose third derivative is white noise, from rest, step by step without
    error."""
    state, last, found = np.zeros((3, 3)), 0.0, []
    for time in TIMES:
        h, last = time - last, time
        step = np.array([[1, h, h**2 / 2], [0, 1, h], [0, 0, 1]])
        noise = np.array(
            [
                [h**5 / 20, h**4 / 8, h**3 / 6],
                [h**4 / 8, h**3 / 3, h**2 / 2],
                [h**3 / 6, h**2 / 2, h],
            ]
        )
        state = step @ state + np.linalg.cholesky(intensity * noise) @ rng.normal(size=(3, 3))
        found.append(state[0])
    return np.array(found)


def recording(intensity, sigma, seed):
    """Readings of a position that wanders."""
    rng = np.random.default_rng(seed)
    return wandering(intensity, rng) + sigma * rng.normal(size=(len(TIMES), 3))


def arc_of(read, sigma, *, attitude=None, turning=1e-3, parts=("position",)):
    """The arc of a position that is read; its attitude is known to be at rest, if it is not read
    otherwise."""
    rotation = np.tile(np.eye(3), (len(TIMES), 1, 1)) if attitude is None else attitude
    readings = (
        Reading(("tracker", "position"), TIMES, read, sigma),
        Reading(("attitude", "orientation"), TIMES, rotation, turning),
    )
    # To begin with, the spline that goes nearest to the readings, as freely as it likes.
    design = BSpline.design_matrix(TIMES, GRID, DEGREE).toarray()
    quaternion = Rotation.from_matrix(rotation).as_quat(scalar_first=True)
    coefficients = np.linalg.lstsq(design, np.hstack([read, quaternion]), rcond=1e-6)[0]
    looser = dict.fromkeys(parts, MOTION.looser)
    jerks = {part: jerk_matrices(GRID)[part] for part in parts}
    segment = Segment("run", GRID, readings, coefficients, looser=looser, jerks=jerks)
    return replace(
        segment,
        smoothness={part: value / LENGTH * SPACING for part, value in segment.roughness.items()},
    )


def read(segment):
    """Normal equations of an arc's readings alone."""
    nowhere, calibration = np.full(len(UNKNOWNS), -1), CalibrationValues(UNKNOWNS, UNKNOWNS.mean)
    return accumulate(
        len(segment.coefficients),
        0,
        motion_residuals(EXPERIMENT, segment, calibration, nowhere, {}, Tally()),
    )


def found_for(*segments):
    """Likeliest intensities, without what they are multiplied by in the end, by turns of smoothness
    and motion."""
    for turn in range(10):
        equations = [read(segment) for segment in segments]
        level, settled = smoothness(segments, equations, anew=turn == 0)
        segments = tuple(replace(segment, smoothness=level) for segment in segments)
        if settled:
            return {part: value / MOTION.looser for part, value in level.items()}
        steps = [
            segment.smooth(each).settled.reshape(-1, POSE)
            for segment, each in zip(segments, equations, strict=True)
        ]
        segments = tuple(
            replace(segment, coefficients=segment.coefficients + s)
            for segment, s in zip(segments, steps, strict=True)
        )
    raise AssertionError("does not settle")


def _dense():
    """What the readings of one coordinate vary by, for an intensity of one, once constants, slopes
    and curvature are taken off."""
    count = len(GRID) - DEGREE - 1
    functions, inner = BSpline(GRID, np.eye(count), DEGREE), np.unique(GRID)
    nodes, weights = np.polynomial.legendre.leggauss(4)
    half = np.diff(inner) / 2
    times = ((inner[1:] + inner[:-1]) / 2)[:, None] + half[:, None] * nodes
    jerk = functions(times.ravel(), nu=3) * np.sqrt(half[:, None] * weights).reshape(-1, 1)
    # A prior of this precision, which leaves three directions open: those of a motion without any
    # jerk.
    told, axes = np.linalg.eigh(jerk.T @ jerk)
    rest = np.linalg.svd(np.vander(TIMES, 3).T)[2][3:]
    free = rest @ functions(TIMES) @ axes[:, 3:] / np.sqrt(told[3:])
    return rest, free @ free.T


REST, WANDERS = _dense()


def log_likelihood(log_intensity, sigma, *recordings):
    """Of readings, the motion integrated out."""
    covariance = np.exp(log_intensity) * WANDERS + sigma**2 * np.eye(len(REST))
    factored = Covariance.from_cholesky(np.linalg.cholesky(covariance))
    return sum(
        float(multivariate_normal.logpdf((REST @ each).T, cov=factored).sum())
        for each in recordings
    )


def likeliest(sigma, *recordings):
    """Logarithm of the likeliest intensity, and the 1-sigma of it as the curvature tells."""
    first = minimize_scalar(
        lambda x: -log_likelihood(x, sigma, *recordings),
        bounds=(-20, 5),
        method="bounded",
        options={"xatol": 1e-4},
    ).x
    h = 0.1
    ahead, at, behind = (log_likelihood(first + s, sigma, *recordings) for s in (h, 0, -h))
    return first, h / np.sqrt(2 * at - ahead - behind)


# Intensity [m^2/s^5] and noise [m]: motions that wander far, a little, and hardly beyond the noise
KINDS = [(1.0, 1e-3), (1.0, 1e-4), (0.1, 1e-2), (1e-3, 1e-2)]


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(("intensity", "sigma"), KINDS)
def test_the_likeliest_intensity_is_found(intensity, sigma, seed):
    values = recording(intensity, sigma, seed)
    expected, _ = likeliest(sigma, values)
    found = found_for(arc_of(values, sigma))["position"]
    assert np.log(found) == pytest.approx(expected, abs=SETTLED)


@pytest.mark.integration
@pytest.mark.parametrize(
    ("intensity", "sigma", "seed"), [(0.1, 1e-2, 5), (1e-3, 1e-2, 0), (1e-3, 1e-2, 2)]
)
@pytest.mark.parametrize("start", [1e-6, 1e-4, 1e-2, 1.0, 1e2, 1e6])
def test_it_does_not_matter_where_the_search_begins(start, intensity, sigma, seed):
    # A motion that is far too stiff is one of the readings' own: rounding must not make it likely.
    values = recording(intensity, sigma, seed)
    expected, _ = likeliest(sigma, values)
    begun = replace(
        arc_of(values, sigma), smoothness={"position": start * intensity * MOTION.looser}
    )
    assert np.log(found_for(begun)["position"]) == pytest.approx(expected, abs=SETTLED)


def test_a_motion_at_rest_may_still_do_something():
    sigma = 1e-2
    still = np.array([0.1, -0.2, 2.0]) + sigma * np.random.default_rng(1).normal(
        size=(len(TIMES), 3)
    )
    level = found_for(arc_of(still, sigma))["position"]
    # A centimetre per second squared within a second, more or less, and no noise.
    assert 1e-5 < level < 1e-3


def test_arcs_share_one_smoothness():
    sigma = 1e-2
    recordings = [recording(intensity, sigma, seed) for seed, intensity in enumerate([0.02, 0.5])]
    expected, _ = likeliest(sigma, *recordings)
    single = [likeliest(sigma, each)[0] for each in recordings]
    found = found_for(*(arc_of(each, sigma) for each in recordings))["position"]
    assert np.log(found) == pytest.approx(expected, abs=SETTLED)
    assert single[0] + SETTLED < np.log(found) < single[1] - SETTLED


def test_poses_at_rest_have_no_say():
    sigma = 1e-2
    segment = arc_of(recording(0.1, sigma, 3), sigma)
    still = replace(segment, smoothness=None, static=True)
    alone, _ = smoothness([segment], [read(segment)])
    beside, _ = smoothness([still, segment], [None, read(segment)])
    assert alone == beside


@pytest.fixture(scope="module")
def draws():
    """Logarithm of the found over the true intensity, and its 1-sigma, over the seeds."""
    intensity, sigma = 0.1, 5e-3
    found = []
    for seed in range(100, 100 + SEEDS):
        values = recording(intensity, sigma, seed)
        level = found_for(arc_of(values, sigma))["position"]
        found.append((np.log(level / intensity), likeliest(sigma, values)[1]))
    return np.array(found).T


@pytest.mark.integration
def test_the_true_intensity_is_found_within_chance(draws):
    off, sigma = draws
    # Beside chance, a search that ends somewhere within its tolerance.
    spread = np.hypot(sigma, SETTLED / np.sqrt(3))
    assert abs(np.mean(off)) < norm.isf(RARE / 2) * np.sqrt(np.mean(spread**2) / SEEDS)
    assert np.sum((off / spread) ** 2) < chi2.isf(RARE, SEEDS)
    # And that is little: what passes follows it with a sixth.
    assert sigma.max() < 0.5


def test_it_says_whether_the_arcs_were_as_smooth_already():
    sigma = 1e-2
    segment = arc_of(recording(0.1, sigma, 4), sigma)
    expected = likeliest(sigma, recording(0.1, sigma, 4))[0]
    for factor, had in ((1.0, True), (10.0, False), (0.1, False)):
        level = {"position": factor * np.exp(expected) * MOTION.looser}
        _, settled = smoothness([replace(segment, smoothness=level)], [read(segment)])
        assert settled == had


@pytest.mark.parametrize(
    ("looser", "factor"), [({}, 1.0), ({"position": 30.0}, 30.0), ({"rotation": 7.0}, 1.0)]
)
def test_a_motion_is_let_do_as_much_more_as_its_arc_wants(looser, factor):
    sigma = 1e-2
    values = recording(0.1, sigma, 6)
    segment = replace(arc_of(values, sigma), looser=looser)
    level, _ = smoothness([segment], [read(segment)])
    assert np.log(level["position"]) == pytest.approx(
        likeliest(sigma, values)[0] + np.log(factor), abs=SETTLED
    )
    # With that, and the motion that goes with it, it has settled.
    again, settled = smoothness([replace(segment, smoothness=level)], [read(segment)])
    assert settled
    assert np.log(again["position"]) == pytest.approx(np.log(level["position"]), abs=SETTLED)


def test_the_least_intensity_can_be_set():
    segment = arc_of(recording(0.1, 1e-2, 6), 1e-2)
    loose = MotionSettings(least_position_intensity=1e3)
    level, _ = smoothness([segment], [read(segment)], settings=loose)
    assert level["position"] == pytest.approx(1e3 * segment.looser.get("position", 1.0))


def test_inputs_stay_as_they_are():
    segment = arc_of(recording(0.1, 1e-2, 7), 1e-2)
    equations, before, level = read(segment), segment.coefficients.copy(), dict(segment.smoothness)
    band = equations.band.copy()
    smoothness([segment], [equations], anew=True)
    np.testing.assert_array_equal(segment.coefficients, before)
    np.testing.assert_array_equal(equations.band, band)
    assert segment.smoothness == level


def test_position_and_rotation_have_a_smoothness_each():
    # A quaternion turns half as fast as the rotation vector, and a quarter of it, its length, is no
    # motion.
    turning, sigma = 2e-3, 1e-2
    rng = np.random.default_rng(8)
    angles = wandering(3e-4, rng)
    assert np.abs(angles).max() < 0.5
    attitude = Rotation.from_rotvec(angles) * Rotation.from_rotvec(
        turning * rng.normal(size=angles.shape)
    )
    values = recording(0.1, sigma, 9)
    both = found_for(
        arc_of(
            values,
            sigma,
            attitude=attitude.as_matrix(),
            turning=turning,
            parts=("position", "rotation"),
        )
    )
    assert np.log(both["position"]) == pytest.approx(likeliest(sigma, values)[0], abs=SETTLED)
    read_off = Rotation.as_rotvec(attitude) / 2
    expected, _ = likeliest(turning / 2, read_off)
    assert np.log(both["rotation"]) == pytest.approx(
        expected - np.log(4 / 3) / 2, abs=SETTLED + np.log(4 / 3) / 2
    )
