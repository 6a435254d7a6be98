"""How fine knots must be, against dense normal distributions of the readings and against motions
whose frequency is known."""

import numpy as np
import pytest
from scipy.interpolate import BSpline
from scipy.optimize import minimize_scalar
from scipy.stats import Covariance, multivariate_normal

from steelyard.experiment.model import Experiment
from steelyard.identification.model.settings import MOTION, MotionSettings
from steelyard.identification.samples.knot_spacing import (
    Channelled,
    best_spacing,
    chosen_spacing,
    closest_spacing,
    evidence,
    relative_stretch,
)
from steelyard.identification.samples.motion_streams import MotionStream
from steelyard.robot.model import CableProperties, Robot
from steelyard.smoothing import DEGREE, knots

pytestmark = pytest.mark.integration

START, END = 0.0, 4.0  # [s]
ENOUGH = 0.3  # of a log likelihood: where a search within a third of a logarithm ends
CANDIDATES = [float(c) for c in np.geomspace(0.02, 0.45, 10)]  # [s]
SPACINGS = [0.6, 0.3, 0.15]  # [s]
CLOSE = 2.0  # of a log likelihood, by which wider knots may be worse: what the module states
WIDE = 10.0  # prior 1-sigma of what jerk leaves open, in units of how far the readings vary: what the module states


def sine(frequency, noise, *, order=0, stated=True, unit=1.0, seed=0, length=6.0, rate=100.0):
    """Two channels of a sine [Hz] in noise, at even times."""
    rng = np.random.default_rng(seed)
    time = np.arange(0, length, 1 / rate)
    phase = 2 * np.pi * frequency * time
    values = np.column_stack([np.sin(phase), 0.5 * np.cos(phase + 0.3)]) + noise * rng.normal(
        size=(len(time), 2)
    )
    return Channelled(time, unit * values, order, unit * noise if stated else None)


def squared_integral(grid, order):
    """Matrix of the integral of a squared derivative, densely."""
    functions, inner = BSpline(grid, np.eye(len(grid) - DEGREE - 1), DEGREE), np.unique(grid)
    nodes, weights = np.polynomial.legendre.leggauss(DEGREE + 1)
    half = np.diff(inner) / 2
    times = ((inner[1:] + inner[:-1]) / 2)[:, None] + half[:, None] * nodes
    values = functions(times.ravel(), nu=order) * np.sqrt(half[:, None] * weights).reshape(-1, 1)
    return values.T @ values


def log_likelihood(stream, grid):
    """Of a stream: white noise over a spline whose coefficients are normal, by intensity, with the
    likeliest noise, which is what is stated at least."""
    values = stream.values - stream.values.mean(axis=0)
    n = len(values)
    design = BSpline(grid, np.eye(len(grid) - DEGREE - 1), DEGREE)(stream.time)
    wide = WIDE * np.abs(values).max()
    flat = squared_integral(grid, 0) / (wide**2 * (grid[-1] - grid[0]))
    rough = squared_integral(grid, 3 - stream.order)

    def at(log_intensity):
        root = np.linalg.solve(np.linalg.cholesky(rough / np.exp(log_intensity) + flat), design.T)
        least = NOISE[0] if stream.sigma is None else 2 * np.log(stream.sigma)

        def of_noise(log_variance):
            return -density(root.T @ root + np.exp(log_variance) * np.eye(n))

        return -minimize_scalar(
            of_noise, bounds=(least, NOISE[1]), method="bounded", options={"xatol": 1e-3}
        ).fun

    def density(covariance):
        factored = Covariance.from_cholesky(np.linalg.cholesky(covariance))
        return float(np.sum(multivariate_normal.logpdf(values.T, cov=factored)))

    return at


NOISE = (
    2 * np.log(0.005),
    2 * np.log(0.1),
)  # logarithm of the variances among which the likeliest is sought


def largest(stream, grid, around):
    """Over a grid of intensities, and then about the best of them."""
    at = log_likelihood(stream, grid)
    steps = around + np.arange(-7.0, 8.0)
    best = steps[np.argmax([at(s) for s in steps])]
    found = minimize_scalar(
        lambda x: -at(x), bounds=(best - 1, best + 1), method="bounded", options={"xatol": 0.02}
    )
    return -found.fun


def recorded(frequency, order, sigma=0.02, *, stated=True):
    """Two channels of a sine in noise, at uneven times, and the logarithm of the mean square of its
    derivative over a second."""
    rng = np.random.default_rng(3)
    time = np.sort(rng.uniform(START, END, 120))
    phase = 2 * np.pi * frequency * time
    values = np.column_stack([np.sin(phase), 0.5 * np.cos(phase + 0.3)]) + sigma * rng.normal(
        size=(120, 2)
    )
    rough = np.log((2 * np.pi * frequency) ** (2 * (3 - order)) / 4)
    return Channelled(time, values, order, sigma if stated else None), rough


@pytest.mark.parametrize("order", range(3))
@pytest.mark.parametrize("frequency", [0.3, 1.2])
def test_evidence_is_the_largest_likelihood_of_a_normal_distribution(frequency, order):
    stream, rough = recorded(frequency, order)
    constant = stream.values.size / 2 * np.log(2 * np.pi)
    for spacing in SPACINGS:
        grid = knots(START, END, spacing)
        if frequency * spacing > 0.5:
            # Knots that cannot follow the motion leave it over as noise.
            assert evidence(stream, grid) < evidence(stream, knots(START, END, spacing / 2)) - 100
            continue
        expected = pytest.approx(largest(stream, grid, rough), abs=ENOUGH, rel=1e-5)
        assert evidence(stream, grid) - constant == expected


@pytest.mark.parametrize("order", range(3))
def test_noise_that_is_not_stated_is_the_likeliest(order):
    # In units in which the motion is large: see test_the_choice_does_not_depend_on_units.
    unit = 1e3
    stream, rough = recorded(0.3, order, stated=False)
    large = Channelled(stream.time, unit * stream.values, order, None)
    grids = [knots(START, END, spacing) for spacing in SPACINGS]
    found = np.array([evidence(large, grid) for grid in grids])
    expected = np.array([largest(stream, grid, rough) for grid in grids])
    np.testing.assert_allclose(np.diff(found), np.diff(expected), atol=2 * ENOUGH)


def test_streams_of_other_constants_are_as_likely():
    stream, _ = recorded(0.3, 0)
    moved = Channelled(stream.time, stream.values + np.array([100.0, -3.0]), 0, stream.sigma)
    grid = knots(START, END, 0.3)
    assert evidence(moved, grid) == pytest.approx(evidence(stream, grid), abs=1e-6)


# The choice


STATED = {"stated": True, "unstated": False}


@pytest.mark.parametrize("stated", STATED.values(), ids=STATED)
@pytest.mark.parametrize("order", range(3))
def test_a_slow_motion_takes_wide_knots(order, stated):
    assert (
        best_spacing([sine(0.2, 0.02, order=order, stated=stated)], CANDIDATES, 0.0, 6.0)
        == CANDIDATES[-1]
    )


@pytest.mark.parametrize("order", range(3))
@pytest.mark.parametrize("noise", [0.1, 0.01])
@pytest.mark.parametrize("frequency", [2.0, 4.0])
def test_a_fast_motion_takes_fine_knots(frequency, noise, order):
    found = best_spacing([sine(frequency, noise, order=order)], CANDIDATES, 0.0, 6.0)
    # More than two knots a period, which a spline needs, and not many.
    assert 0.15 < found * frequency < 0.4


@pytest.mark.parametrize("order", range(3))
@pytest.mark.parametrize("frequency", [2.0, 4.0])
def test_a_fast_motion_takes_fine_knots_where_noise_is_not_stated(frequency, order):
    found = best_spacing([sine(frequency, 0.01, order=order, stated=False)], CANDIDATES, 0.0, 6.0)
    assert 0.15 < found * frequency < 0.4


def test_noise_that_is_larger_than_stated_is_no_motion():
    """Time stamps that scatter make a tracker eight times as noisy; knots had been as fine as they
    could be, and fits took three times as long."""
    sound = sine(0.6, 5e-4)
    jittery = sine(0.6, 4e-3)
    stated = Channelled(jittery.time, jittery.values, 0, 5e-4)
    found = [best_spacing([each], CANDIDATES, 0.0, 6.0) for each in (sound, stated, jittery)]
    assert found[0] <= found[1] == found[2]
    assert found[1] > 0.1


@pytest.mark.parametrize("stated", STATED.values(), ids=STATED)
@pytest.mark.parametrize("order", [0, 2])
def test_a_platform_that_rings_while_it_moves_takes_fine_knots(order, stated):
    slow, fast = sine(0.2, 0.01, order=order, stated=stated), sine(6.0, 0.0)
    both = Channelled(slow.time, slow.values + 0.05 * fast.values, order, slow.sigma)
    # The ringing is five times the noise: no knots that are too wide for it are anywhere near as
    # likely.
    likely = {spacing: evidence(both, knots(0.0, 6.0, spacing)) for spacing in CANDIDATES}
    assert (
        max(likely.values())
        > max(value for spacing, value in likely.items() if spacing > 0.1) + 100
    )
    assert best_spacing([both], CANDIDATES, 0.0, 6.0) < 0.1


@pytest.mark.parametrize(
    "streams",
    [
        *([sine(f, 0.05, seed=1), sine(f, 0.2, order=2, seed=2)] for f in (0.2, 1.0, 2.0)),
        [sine(1.2, 0.5, seed=1)],
        [sine(1.8, 0.5, seed=1)],
    ],
    ids=["slow", "not so slow", "fast", "not so slow in much noise", "fast in much noise"],
)
def test_the_widest_that_is_about_as_likely_as_the_best_is_taken(streams):
    found = best_spacing(streams, CANDIDATES, 0.0, 6.0)
    likely = np.array([sum(evidence(s, knots(0.0, 6.0, c)) for s in streams) for c in CANDIDATES])
    assert found == CANDIDATES[np.flatnonzero(likely >= likely.max() - CLOSE)[-1]]


def test_the_stream_that_moves_fastest_decides():
    slow, fast = sine(0.2, 0.01), sine(2.0, 0.01, order=2)
    assert best_spacing([slow, fast], CANDIDATES, 0.0, 6.0) == best_spacing(
        [fast], CANDIDATES, 0.0, 6.0
    )


@pytest.mark.integration
@pytest.mark.parametrize("unit", [1e-4, 1e-2, 1e2, 1e4])
@pytest.mark.parametrize("order", [0, 2])
@pytest.mark.parametrize("frequency", [0.2, 1.0, 4.0])
def test_the_choice_does_not_depend_on_units_where_noise_is_stated(frequency, order, unit):
    one, other = (
        best_spacing([sine(frequency, 0.01, order=order, unit=u)], CANDIDATES, 0.0, 6.0)
        for u in (1.0, unit)
    )
    assert one == other


@pytest.mark.parametrize("order", [0, 2])
@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_the_choice_does_not_depend_on_units(unit, order):
    streams = [sine(1.0, 0.001, order=order, unit=u, stated=False) for u in (10.0, 10.0 * unit)]
    one, other = (best_spacing([stream], CANDIDATES, 0.0, 6.0) for stream in streams)
    assert one == other


def test_only_what_is_within_the_interval_is_looked_at():
    calm = sine(0.2, 0.01)
    values = np.where(calm.time[:, None] < 3.0, calm.values, sine(3.0, 0.01).values)
    mixed = Channelled(calm.time, values, 0, 0.01)
    assert best_spacing([mixed], CANDIDATES, 0.0, 2.99) == CANDIDATES[-1]
    assert best_spacing([mixed], CANDIDATES, 3.0, 6.0) < 0.15


# Little to go by


@pytest.mark.parametrize("stated", STATED.values(), ids=STATED)
@pytest.mark.parametrize("count", [0, 1, 2, 10, 11, 12, 20])
def test_few_samples_do_not_break_it(count, stated):
    few = sine(0.5, 0.05, stated=stated)
    use = np.linspace(0, len(few.time) - 1, count).astype(int)
    stream = Channelled(few.time[use], few.values[use], 0, few.sigma)
    assert best_spacing([stream], CANDIDATES, 0.0, 6.0) in CANDIDATES
    # Beside another one they take nothing away.
    assert best_spacing([stream, sine(2.0, 0.01)], CANDIDATES, 0.0, 6.0) < 0.2


def test_nothing_to_go_by_takes_the_finest_knots():
    assert best_spacing([], CANDIDATES, 0.0, 6.0) == CANDIDATES[0]
    assert best_spacing([sine(0.2, 0.01)], CANDIDATES, 10.0, 16.0) == CANDIDATES[0]


@pytest.mark.parametrize("stated", STATED.values(), ids=STATED)
@pytest.mark.parametrize(
    "values",
    [
        np.zeros((50, 2)),
        np.full((50, 2), 7.3),
        np.linspace(0, 1, 50)[:, None] ** [1, 2],
        np.where(np.arange(50)[:, None] == 25, 1e6, 0.0),
    ],
    ids=["nothing", "a constant", "a polynomial", "one spike"],
)
def test_readings_without_a_motion_do_not_break_it(values, stated):
    stream = Channelled(np.linspace(0, 6, 50), values, 0, 0.01 if stated else None)
    # Numbers that end in nothing are looked at in the end, by whoever asks for the spacing.
    with np.errstate(all="ignore"):
        assert best_spacing([stream], CANDIDATES, 0.0, 6.0) in CANDIDATES
        assert np.isfinite(evidence(stream, knots(0.0, 6.0, 0.2)))


def test_samples_may_repeat_and_leave_gaps():
    stream = sine(1.0, 0.01)
    use = np.sort(np.concatenate([np.arange(0, 200), np.arange(0, 200), np.arange(400, 600)]))
    broken = Channelled(stream.time[use], stream.values[use], 0, 0.01)
    assert 0.1 < best_spacing([broken], CANDIDATES, 0.0, 6.0) < 0.4


def test_how_much_likelier_finer_knots_must_be_can_be_set():
    stream = [sine(1.2, 0.01)]
    found = [
        best_spacing(stream, CANDIDATES, 0.0, 6.0, settings=MotionSettings(as_likely=each))
        for each in (0.0, CLOSE, 1e9)
    ]
    assert found == sorted(found)
    assert found[1] == best_spacing(stream, CANDIDATES, 0.0, 6.0)
    assert found[2] == CANDIDATES[-1] > found[1]


# Cables that stretch


def softened(stiffness):
    """Eight cables of eight metres about the origin, of an axial stiffness [N]."""
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    cable = CableProperties(axial_stiffness=stiffness)
    return Robot("soft", 8.0 / 3**0.5 * corners, 0.1 * corners, cable=cable)


def along(frequency):
    """A place and lengths of .5 mm that follow a sine, and tensions that vary by 100 N [Hz]."""
    time = np.arange(0.0, 20.0, 0.01)
    rng = np.random.default_rng(3)
    sine = np.sin(2 * np.pi * frequency * time)[:, None]
    place, length = (0.1 * sine + 5e-4 * rng.normal(size=(len(time), count)) for count in (3, 8))
    streams = [
        MotionStream(
            (name, name), time, time, values, 5e-4, "m", 0, ("position",), needs_tension=follows
        )
        for name, values, follows in (("tracker", place, False), ("lengths", length, True))
    ]
    return streams, 1000.0 + 100.0 * 2**0.5 * np.tile(sine, 8)


def test_stretch_is_told_in_units_of_the_noise_of_lengths():
    streams, tension = along(0.5)
    for stiffness in (5e4, 5e5):
        own = Experiment("soft", softened(stiffness), {}, ())
        # Eight metres, 100 N and a noise of .5 mm.
        expected = 8.0 * 100.0 / stiffness / 5e-4
        assert relative_stretch(own, streams, tension) == pytest.approx(expected, rel=1e-3)
    assert relative_stretch(own, streams, None) == 0.0
    assert relative_stretch(own, streams[:1], tension) == 0.0
    assert relative_stretch(Experiment("rods", softened(None), {}, ()), streams, tension) == 0.0


def test_knots_are_closer_where_lengths_show_what_tensions_stretch():
    streams, tension = along(0.5)
    found = {
        stiffness: chosen_spacing(
            Experiment("soft", softened(stiffness), {}, ()), streams, [(0.0, 20.0)], MOTION, tension
        )[0]
        for stiffness in (2e4, 5e5)
    }
    assert found[2e4] == pytest.approx(found[5e5] / 2**0.5)
    # The motion is resolved to that spacing at all.
    assert found[2e4] > closest_spacing(Experiment("soft", softened(2e4), {}, ()), streams, MOTION)
