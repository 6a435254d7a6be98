"""The recursion against the same readings taken as a whole."""

from dataclasses import replace

import numpy as np
import pytest
from places import DATA
from scipy.interpolate import BSpline
from simulated import rested, vibrating

from steelyard.errors import InputError
from steelyard.experiment.equivalent.platform_frame import centred
from steelyard.experiment.read import read_experiment
from steelyard.identification.identify import identify
from steelyard.identification.model.accumulation import accumulate
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.processes import integrals_of
from steelyard.identification.model.segment import (
    POSE,
    WIDTH,
    NormalEquations,
    Rows,
    values_at,
)
from steelyard.identification.recursive.concluding import posterior_of
from steelyard.identification.recursive.events import advanced, followed_on
from steelyard.identification.recursive.follow import begin, follow
from steelyard.identification.recursive.following import Instant
from steelyard.identification.recursive.parts import with_further
from steelyard.identification.recursive.settings import RECURSIVE
from steelyard.identification.recursive.window.finer import on_finer_knots
from steelyard.identification.recursive.window.grid import KnotGrid
from steelyard.identification.recursive.window.past import (
    Linear,
    Point,
    eliminated,
    in_one,
    together,
)
from steelyard.identification.recursive.window.window import Window
from steelyard.identification.solve.border.segment_equations import segment_equations
from steelyard.identification.solve.joint_motion import fit_jointly
from steelyard.smoothing import DEGREE


def drawn(rng, functions, block, border):
    """Equations of random rows, and the same as a dense matrix and a vector."""
    size, width = functions * block, (DEGREE + 1) * block
    normal, gradient = np.zeros((size + border,) * 2), np.zeros(size + border)
    for first in range(functions - DEGREE):
        rows = np.zeros((width + border + 3, size + border))
        rows[:, first * block : first * block + width] = rng.normal(size=(len(rows), width))
        rows[:, size:] = rng.normal(size=(len(rows), border))
        normal += rows.T @ rows
        gradient += rows.T @ rng.normal(size=len(rows))
    band = np.zeros((width, size))
    for d in range(width):
        band[d, : size - d] = np.diagonal(normal[:size, :size], -d)
    equations = NormalEquations(
        band,
        normal[:size, size:],
        normal[size:, size:],
        gradient[:size],
        gradient[size:],
        block=block,
    )
    return equations, normal, gradient


def test_what_passes_is_eliminated_as_a_dense_solution_has_it():
    rng = np.random.default_rng(1)
    functions, block, border, kept = 9, 3, 4, DEGREE
    equations, normal, gradient = drawn(rng, functions, block, border)
    found = eliminated(equations, kept)
    gone = (functions - kept) * block
    left = normal[gone:, gone:] - normal[gone:, :gone] @ np.linalg.solve(
        normal[:gone, :gone], normal[:gone, gone:]
    )
    right = gradient[gone:] - normal[gone:, :gone] @ np.linalg.solve(
        normal[:gone, :gone], gradient[:gone]
    )
    size = kept * block
    scale = np.abs(left).max()
    assert np.abs(found.side - left[:size, size:]).max() < 1e-10 * scale
    assert np.abs(found.corner - left[size:, size:]).max() < 1e-10 * scale
    assert np.abs(found.motion_gradient - right[:size]).max() < 1e-10 * scale
    assert np.abs(found.border_gradient - right[size:]).max() < 1e-10 * scale
    for d in range(size):
        own = np.diagonal(left[:size, :size], -d)
        assert np.abs(found.band[d, : size - d] - own).max() < 1e-10 * scale


def test_equations_seen_from_elsewhere_have_the_gradient_there():
    rng = np.random.default_rng(2)
    functions, block, border = 8, 2, 3
    equations, normal, gradient = drawn(rng, functions, block, border)
    at = Point(rng.normal(size=(functions, block)), rng.normal(size=border))
    there = Point(rng.normal(size=(functions, block)), rng.normal(size=border))
    found = Linear(equations, at).seen_from(there)
    moved = np.concatenate([(there.motion - at.motion).ravel(), there.border - at.border])
    expected = gradient - normal @ moved
    got = np.concatenate([found.motion_gradient, found.border_gradient])
    assert got == pytest.approx(expected, rel=1e-10, abs=1e-8)


def test_equations_over_some_columns_are_those_where_the_others_stay():
    rng = np.random.default_rng(4)
    functions, block, border = 8, 2, 5
    equations, normal, gradient = drawn(rng, functions, block, border)
    at = Point(rng.normal(size=(functions, block)), rng.normal(size=border))
    use, size = np.array([0, 3]), functions * block
    there = Point(rng.normal(size=(functions, block)), at.border.copy())
    there.border[use] += rng.normal(size=2)
    found = Linear(equations, at).of_columns(use).seen_from(Point(there.motion, there.border[use]))
    moved = np.concatenate([(there.motion - at.motion).ravel(), there.border - at.border])
    kept = np.concatenate([np.arange(size), size + use])
    got = np.concatenate([found.motion_gradient, found.border_gradient])
    assert got == pytest.approx((gradient - normal @ moved)[kept], rel=1e-10, abs=1e-8)
    assert found.corner == pytest.approx(normal[np.ix_(size + use, size + use)])
    assert found.side == pytest.approx(normal[:size, size + use])


def test_rows_in_one_make_the_equations_of_all_over_some_columns():
    rng = np.random.default_rng(5)
    functions, border, use = 9, 5, np.array([1, 3, 4])

    def rows(n, k, columns):
        first = rng.integers(0, functions - DEGREE, n)  # in any order
        size = border if columns is None else len(columns)
        derivatives = rng.normal(size=(n, k, WIDTH)), rng.normal(size=(n, k, size))
        return Rows(first, rng.normal(size=(n, k)), *derivatives, columns)

    parts = [rows(40, 3, None), rows(0, 2, None), rows(25, 2, np.array([4, 1, 0])),
             rows(7, 1, np.zeros(0, dtype=int))]  # fmt: skip
    found = accumulate(functions, len(use), [in_one(parts, use, border)])
    # Row by row, densely.
    size = functions * POSE
    lines = []
    for part in parts:
        columns = np.arange(border) if part.columns is None else part.columns
        for sample, first in enumerate(part.first):
            for row in range(part.residual.shape[1]):
                line = np.zeros(size + border + 1)
                line[first * POSE : first * POSE + WIDTH] = part.by_motion[sample, row]
                line[size + columns] = part.by_errors[sample, row]
                line[-1] = part.residual[sample, row]
                lines.append(line)
    normal = np.transpose(lines) @ np.array(lines)
    kept = size + use
    assert found.corner == pytest.approx(normal[np.ix_(kept, kept)], rel=1e-12, abs=1e-12)
    assert found.side == pytest.approx(normal[:size, kept], rel=1e-12, abs=1e-12)
    assert found.motion_gradient == pytest.approx(-normal[:size, -1], rel=1e-12, abs=1e-12)
    assert found.border_gradient == pytest.approx(-normal[kept, -1], rel=1e-12, abs=1e-12)
    for d in range(WIDTH):
        own = np.diagonal(normal[:size, :size], -d)
        assert found.band[d, : size - d] == pytest.approx(own, rel=1e-12, abs=1e-12)


def test_chunks_placed_one_after_the_other_are_the_whole():
    rng = np.random.default_rng(3)
    one, normal, _ = drawn(rng, 8, 2, 3)
    two, other, _ = drawn(rng, 7, 2, 3)
    whole = together([one, two], [0, 3])
    size = 10 * 2
    dense = np.zeros((size + 3, size + 3))
    for start, functions, each in ((0, 8, normal), (3, 7, other)):
        place = np.concatenate([2 * start + np.arange(2 * functions), size + np.arange(3)])
        dense[np.ix_(place, place)] += each
    for d in range(len(whole.band)):
        assert whole.band[d, : size - d] == pytest.approx(np.diagonal(dense[:size, :size], -d))
    assert whole.side == pytest.approx(dense[:size, size:])
    assert whole.corner == pytest.approx(dense[size:, size:])


def test_a_grid_of_chunks_is_that_of_the_whole():
    grid, count = KnotGrid(1.5, 0.1, 5, 7), 4
    whole = grid.knots(0, count)
    for number in range(count):
        start = number * grid.intervals
        own = whole[start : start + grid.functions + DEGREE + 1]
        assert grid.knots(number) == pytest.approx(own)
        assert grid.span(number) == pytest.approx((own[DEGREE], own[-DEGREE - 1]))
    # Squares of a process over chunks are those over the whole.
    value, rate, _ = integrals_of(whole)
    summed = np.zeros_like(value), np.zeros_like(rate)
    for number in range(count):
        own = slice(number * grid.intervals, number * grid.intervals + grid.functions)
        for total, each in zip(summed, grid.integrals[:2], strict=True):
            total[:, own] += each
    assert summed[0] == pytest.approx(value, abs=1e-12)
    short = KnotGrid(1.5, 0.1, 1, 7)
    begin, end = short.ends
    assert begin[:, -1] == pytest.approx(0.0)
    assert begin + end == pytest.approx(short.integrals.ends)
    assert summed[1] == pytest.approx(rate, abs=1e-9)


@pytest.fixture(scope="module")
def points():
    return read_experiment(DATA / "points-00" / "experiment.yaml")


@pytest.mark.slow
@pytest.mark.integration
def test_all_chunks_say_what_the_same_readings_say_at_once(points):
    # So long a beginning that nothing moves afterwards: both are linearised alike.
    *_, found = follow(points, own=replace(RECURSIVE, begin=60.0))
    parts, recursion = found.parts, found.recursion
    grid = KnotGrid(
        parts[0].segment.span[0],
        float(np.diff(parts[0].segment.knots[:2])[0]),
        len(parts[0].segment.coefficients) - DEGREE,
        parts[0].segment.block,
    )
    motion = np.vstack([part.segment.coefficients[: grid.intervals] for part in parts])
    motion = np.vstack([motion, parts[-1].segment.coefficients[grid.intervals :]])
    readings = []
    for source in dict.fromkeys(r.source for part in parts for r in part.segment.readings):
        own = [r for part in parts for r in part.segment.readings if r.source == source]
        values = np.concatenate([r.values for r in own])
        readings.append(replace(own[0], time=np.concatenate([r.time for r in own]), values=values))
    samples = [part.force_samples for part in parts]
    forces = replace(
        samples[0],
        time=np.concatenate([s.time for s in samples]),
        readings={q: np.concatenate([s.readings[q] for s in samples]) for q in samples[0].readings},
        left_out=np.concatenate([s.left_out for s in samples]),
    )
    knots = grid.knots(0, len(parts))
    whole = KnotGrid(knots[DEGREE], grid.spacing, grid.intervals * len(parts), grid.block)
    segment: Segment = replace(
        parts[0].segment,
        knots=knots,
        coefficients=motion,
        readings=tuple(readings),
        jerks=whole.jerks,
    )
    state = replace(recursion.state, segments=(segment,))
    expected = segment_equations(recursion.task, state, segment, forces, None, run=0)
    normal = sum(part.equations.normal for part in parts)
    size = np.maximum(np.sqrt(np.diag(expected.equations.normal)), 1e-9)
    scale = np.outer(size, size)
    assert np.abs((normal - expected.equations.normal) / scale).max() < 5e-3
    assert sum(p.tally.cost for p in parts) == pytest.approx(expected.tally.cost, rel=2e-2)
    assert sum(p.equations.freedom for p in parts) == expected.equations.freedom


@pytest.mark.slow
@pytest.mark.integration
def test_the_end_of_a_recording_is_known_as_by_the_whole_fit(points):
    found = identify(points, ["maximum-likelihood", "recursive"])
    whole, chunks = found.estimates["maximum-likelihood"], found.estimates["recursive"]
    assert found.result == "maximum-likelihood"
    assert chunks.verdict.accepted
    off = (chunks.value - whole.value) / whole.standard_deviation
    assert np.abs(off).max() < 0.4
    ratio = chunks.standard_deviation / whole.standard_deviation
    assert ratio == pytest.approx(1.0, abs=0.05)


def without(experiment, names, start, end):
    """The experiment with nothing of some instruments for a while [s]."""
    (run,) = experiment.runs
    streams = dict(run.streams)
    for name in names:
        since = streams[name].time - streams[name].time[0]
        streams[name] = streams[name].at_rows((since < start) | (since > end))
    return replace(experiment, runs=(replace(run, streams=streams),))


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.integration
@pytest.mark.parametrize(
    ("lost", "start", "end"),
    [
        (("cables",), 2.0, 4.0),  # in the beginning
        (("cables",), 12.0, 17.0),
        (("imu", "tracker"), 9.0, 12.0),
        (("cables", "imu", "tracker"), 9.0, 12.0),
        (("imu", "tracker"), 15.0, np.inf),
        (("tracker",), 12.0, 17.0),
    ],
)
def test_a_motion_goes_on_after_seconds_that_were_not_read(points, lost, start, end):
    there = without(points, lost, start, end)
    one, other = (
        identify(there, name).estimates[name] for name in ("recursive", "maximum-likelihood")
    )
    assert (np.abs(one.value - other.value) < 0.5 * other.standard_deviation).all()
    assert one.standard_deviation == pytest.approx(other.standard_deviation, rel=0.1)
    assert one.verdict.accepted
    # A tracker alone is not needed, and what has ended does not read again.
    again = lost != ("tracker",) and np.isfinite(end)
    assert any("not all instruments read" in note for note in one.notes) == again


@pytest.mark.slow
@pytest.mark.integration
def test_it_begins_where_all_instruments_read(points):
    there = without(points, ("tracker",), 0.0, 6.0)
    found = begin(there)
    (run,) = there.runs
    read = run.streams["tracker"].time[0] - points.runs[0].streams["tracker"].time[0]
    start, _ = found.window.grid.span(0)
    assert start == pytest.approx(read, abs=0.1)
    one = identify(there, "recursive").estimate
    since = replace(there, runs=(replace(run, window=(start, np.inf)),))
    other = identify(since, "maximum-likelihood").estimate
    assert one.verdict.accepted
    assert (np.abs(one.value - other.value) < 1.0 * other.standard_deviation).all()


@pytest.mark.integration
def test_it_does_not_wait_for_a_command(points):
    (run,) = points.runs
    late = without(points, ("command",), 0.0, 8.0)
    whole, found = begin(points), begin(late)
    assert found.window.grid.span(0) == pytest.approx(whole.window.grid.span(0), abs=0.05)
    assert "command" in run.streams


@pytest.mark.slow
@pytest.mark.integration
def test_what_is_known_grows_with_time(points):
    instants = None
    for found in follow(points):
        instants = found.instants
    sigmas = np.array([np.sqrt(np.diag(each.covariance)) for each in instants])
    assert np.all(np.diff(sigmas, axis=0)[8:] < 0.05 * sigmas[8:-1])
    assert np.all(sigmas[-1] < 0.9 * sigmas[len(sigmas) // 3])


@pytest.mark.slow
@pytest.mark.integration
def test_the_motion_of_then_follows_what_has_been_learnt_since(points):
    # Body and offsets are known well in the end only; the motion had stayed 1 mm off, and what was
    # left of the forces went with it.
    recording = centred(points)
    *_, found = follow(recording)
    whole = fit_jointly(recording).fit.state.segments[0]
    there = posterior_of(found).fit.state.segments[0]
    times = np.linspace(there.span[0] + 0.5, min(there.span[1], whole.span[1]) - 0.5, 500)
    one, other = (values_at(each.basis(times), each.coefficients)[:, :3] for each in (there, whole))
    assert np.sqrt(np.mean((one - other) ** 2)) < 5e-5


@pytest.mark.slow
@pytest.mark.integration
def test_parts_that_are_summed_up_tell_the_same(points):
    *_, found = follow(points)
    few = found.summed(4)
    assert len(few.parts) == 5
    # For a verdict nobody draws the course of the motion.
    posterior, judged = posterior_of(found), posterior_of(few, courses=False)
    assert posterior.motion
    assert not judged.motion
    one, other = posterior.solution, judged.solution
    assert other.value == pytest.approx(one.value, rel=1e-6, abs=1e-9)
    assert np.diag(other.covariance) == pytest.approx(np.diag(one.covariance), rel=1e-6)


@pytest.mark.integration
def test_what_leaves_the_window_changes_nothing_that_is_known_now(points):
    found, (run,) = begin(points), points.runs
    while len(found.parts) < 2:
        told = followed_on(found, run)
        found = told.relieved()
        instant = told.instants[-1]
        again = Instant.of(instant.run, instant.time, found.recursion)
        assert np.array_equal(again.value, instant.value)
        assert np.array_equal(again.covariance, instant.covariance)
    assert len(told.window.chunks) == len(found.window.chunks) + 1


@pytest.mark.integration
def test_what_is_judged_meanwhile_is_what_has_passed(points):
    found = begin(points)
    (run,) = points.runs
    while len(found.parts) < 6:
        found = advanced(found, run)
    recursion = found.ended_before().recursion
    assert recursion.window is None
    told = sum(part.equations.normal for part in found.parts)
    # Nothing is told of what the platform does not have.
    size = np.sqrt(np.maximum(np.diag(told), 1e-300))
    assert recursion.told.normal / np.outer(size, size) == pytest.approx(
        told / np.outer(size, size), abs=1e-9
    )
    # The seconds that it leaves out tell more.
    whole = found.ended().recursion.told.normal
    assert np.all(np.diag(whole) >= 0.99 * np.diag(told))
    assert whole[0, 0] > 1.05 * told[0, 0]


@pytest.mark.slow
@pytest.mark.integration
def test_what_readings_bring_is_kept_once_for_all_parts(points):
    found = begin(points)
    (run,) = points.runs
    while len(found.parts) < 3:
        found = advanced(found, run)
    *before, last = found.parts
    assert not any(each.by_source for each in before)
    further = with_further(found.parts, last)
    assert len(further) == len(found.parts) + 1
    assert not further[-2].by_source
    for source, matrix in last.by_source.items():
        assert further[-1].by_source[source] == pytest.approx(2 * matrix)
    # The readings bring all of what the motion leaves of the border, but what holds it smooth.
    brought = sum(last.by_source.values())
    known = sum(each.equations.normal for each in found.parts)
    assert np.trace(brought[:3, :3]) == pytest.approx(np.trace(known[:3, :3]), rel=0.2)


@pytest.mark.integration
def test_the_beginning_takes_no_more_than_it_is_given(points):
    early = begin(points, own=replace(RECURSIVE, begin=4.0))
    last = max(each.time[-1] for each in early.begun.fit.state.segments[0].readings)
    assert last < 4.0 + 1.0
    assert early.is_beginning


@pytest.mark.integration
def test_another_run_is_as_noisy_as_it_is(points):
    tracker = points.instruments["tracker"]
    unstated = replace(
        points,
        instruments={**points.instruments, "tracker": tracker.model_copy(update={"noise": None})},
    )
    (run,) = points.runs
    stream = run.streams["tracker"]
    (values,) = (v for v in stream.values.values())
    shaken = values + np.random.default_rng(1).normal(scale=0.004, size=values.shape)
    louder = replace(stream, values=dict.fromkeys(stream.values, shaken))
    second = replace(run, name="second", streams={**run.streams, "tracker": louder})
    followed = begin(replace(unstated, runs=(run, second)))
    resumed = followed.resumed(second)

    def sigma(found):
        return next(r.sigma for r in found.like.segment.readings if r.source[0] == "tracker")

    assert sigma(followed) == pytest.approx(tracker.noise, rel=0.5)
    assert sigma(resumed) == pytest.approx(0.004, rel=0.25)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.integration
@pytest.mark.parametrize("rest", [7.0, 20.0])
def test_a_motion_may_begin_after_a_rest(rest):
    found = identify(rested(rest)(3), ["maximum-likelihood", "recursive"]).estimates
    one, other = found["recursive"], found["maximum-likelihood"]
    assert one.verdict.accepted
    assert (np.abs(one.value - other.value) < 0.4 * other.standard_deviation).all()
    assert one.standard_deviation == pytest.approx(other.standard_deviation, rel=0.05)


@pytest.mark.slow
@pytest.mark.integration
def test_a_platform_that_begins_to_vibrate_is_followed_on_finer_knots():
    experiment = vibrating(8.0)(5)
    whole = identify(experiment, ["maximum-likelihood"]).estimate
    passed = list(follow(centred(experiment)))
    spacings = [each.window.grid.spacing for each in passed[:-1]]
    assert spacings[-1] < 0.7 * spacings[0]
    first = int(np.argmin(spacings))
    assert 8.0 < passed[first].instants[-1].time < 9.0
    assert passed[-1].recursion.unsettled == 0
    found = identify(experiment, ["recursive"]).estimate
    assert found.verdict.accepted
    assert (np.abs(found.value - whole.value) < 0.5 * whole.standard_deviation).all()
    assert found.standard_deviation == pytest.approx(whole.standard_deviation, rel=0.1)


@pytest.mark.slow
@pytest.mark.integration
def test_a_motion_that_finer_knots_lose_goes_on_upon_those_that_there_are(monkeypatch):
    def lost(*_):
        raise np.linalg.LinAlgError

    monkeypatch.setattr("steelyard.identification.recursive.events.on_finer_knots", lost)
    passed = list(follow(centred(vibrating(11.0)(5))))
    assert len({each.window.grid.spacing for each in passed[:-1]}) == 1
    assert passed[-1].coarse_until > 11.0
    assert passed[-1].instants[-1].time > 12.0


def test_a_motion_and_what_is_known_of_it_are_the_same_on_finer_knots():
    rng = np.random.default_rng(4)
    block, border, intervals = 7, 3, 11
    grid = KnotGrid(2.0, 0.3, 4, block)
    equations, *_ = drawn(rng, 9, block, border)
    motion = rng.normal(size=(DEGREE, block))
    point, at = rng.normal(size=border), rng.normal(size=(DEGREE, block))
    past = Linear(eliminated(equations, DEGREE), Point(at, point))
    window = Window(grid, None, first=3, motion=motion, past=past)
    finer = on_finer_knots(window, intervals)
    assert finer.grid.span(3) == pytest.approx(grid.span(3))
    start, _ = grid.span(3)

    def derivatives(grid, motion):
        further = np.zeros((grid.intervals, block))
        spline = BSpline(grid.knots(3), np.vstack([motion, further]), DEGREE)
        return np.array([spline(start, nu=order) for order in range(DEGREE)])

    expected = derivatives(grid, motion)
    np.testing.assert_allclose(derivatives(finer.grid, finer.motion), expected, rtol=1e-6)
    # Of any motion, coefficients on the one knots by those on the other.
    change = np.array(
        [
            on_finer_knots(replace(window, motion=np.outer(e, np.ones(block))), intervals).motion[
                :, 0
            ]
            for e in np.eye(DEGREE)
        ]
    ).T
    for moved in (motion, at, rng.normal(size=(DEGREE, block))):
        there = past.seen_from(Point(moved, point + 1.0))
        other = finer.past.seen_from(Point(change @ moved, point + 1.0))
        expected = there.motion_gradient.reshape(DEGREE, block)
        found = change.T @ other.motion_gradient.reshape(DEGREE, block)
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())
        np.testing.assert_allclose(other.border_gradient, there.border_gradient, rtol=1e-6)


@pytest.mark.integration
def test_a_run_at_rest_is_named_however_long_it_is():
    whole = rested(30.0)(3)
    (run,) = whole.runs
    start = run.streams["imu"].time[0]
    still = replace(whole, runs=(replace(run, window=(start, start + 25.0)),))
    with pytest.raises(InputError, match=r"found a platform \(nearly\) at rest"):
        begin(still)
