"""What arrives piece by piece tells what the recording tells."""

import json
import socket
import threading
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from other_frames import ANY_WAY, FAR, body_in_other_frame, in_other_frames
from places import DATA
from simulated import TRUTH, loaded, rested

from steelyard.errors import InputError
from steelyard.experiment.read import read_experiment
from steelyard.identification.identify import identify
from steelyard.identification.recursive.following import Following
from steelyard.live.message import Arrival
from steelyard.live.session import Session, in_words
from steelyard.live.settings import LIVE
from steelyard.live.sources.replay import ReplayedRun, asked_for
from steelyard.live.sources.table import open_source
from steelyard.live.watch import ended, watch

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module")
def points():
    return read_experiment(DATA / "points-00" / "experiment.yaml")


@pytest.fixture(scope="module")
def recursive(points):
    return identify(points, ["recursive"]).estimate


def replayed(points, *, lost=(), shuffled=False):
    """A session over the whole run, without what is lost, in pieces of any order."""
    run = points.runs[0]
    rng = np.random.default_rng(4)
    session = Session(replace(points, runs=()), run.name, run.sync)
    times = {name: points.common_time(run, name) for name in run.streams}
    edges = np.arange(-0.1, max(t[-1] for t in times.values()) + 0.1, 0.1)
    records = []
    for start, end in pairwise(edges):
        arrivals = []
        for name, stream in run.streams.items():
            use = (times[name] >= start) & (times[name] < end)
            for a, b in lost:
                use &= ~((times[name] >= a) & (times[name] < b))
            which = np.flatnonzero(use)
            if shuffled:
                rng.shuffle(which)
            if len(which):
                arrivals.append(Arrival(name, stream.at_rows(which)))
        session, new = session.taken(arrivals).advanced()
        records += new
    return session, records


@pytest.mark.slow
def test_a_replay_ends_where_the_recursion_does(points, recursive):
    session, records = replayed(points)
    _, found = session.ended()
    off = (found.value - recursive.value) / recursive.standard_deviation
    assert np.abs(off).max() < 0.3
    assert found.verdict.accepted
    times = [each.time for each in records]
    assert np.all(np.diff(times) > 0)
    last = records[-1].to_dict()
    assert last["accepted"] is True
    assert last["mass"] == pytest.approx(recursive.value[0], abs=1.0)
    assert json.loads(json.dumps(last, allow_nan=False)) == last
    assert np.nanmax(records[0].deviation / records[-1].deviation) > 1.2


@pytest.mark.slow
@pytest.mark.long
def test_rows_are_in_the_platform_frame_as_it_is_stated(points):
    _, records = replayed(points)
    _, elsewhere = replayed(in_other_frames(points))
    assert len(records) == len(elsewhere)
    for one, other in zip(records, elsewhere, strict=True):
        off = (other.value - body_in_other_frame(one.value)) / other.deviation
        assert np.nanmax(np.abs(off), initial=0.0) < 1e-3
        force, torque = np.split(ANY_WAY.inv().as_matrix() @ one.unmodelled.reshape(2, 3).T, 2, 1)
        expected = torque[:, 0] + np.cross(FAR, force[:, 0])
        np.testing.assert_allclose(other.unmodelled[:3], force[:, 0], atol=1e-3)
        np.testing.assert_allclose(other.unmodelled[3:], expected, atol=1e-3)


@pytest.mark.slow
def test_a_row_waits_neither_for_the_past_nor_for_the_verdict(points):
    session, records = replayed(points)
    # What the first row shows has been judged after it.
    assert [each.accepted for each in records] == [None, *[True] * (len(records) - 1)]
    window = session.following.window
    lag = session.settings.recursion.lag
    # A call later the last row waits no longer.
    after, none = session.advanced()
    assert not none
    assert len(after.following.window.chunks) * window.grid.length <= lag
    assert after.following.instants[-1] is session.following.instants[-1]


@pytest.mark.slow
def test_a_chunk_that_cannot_leave_the_window_ends_the_motion_before_the_last_one(
    points, monkeypatch
):
    relieved, failed = Following.relieved, []

    def fails_once(following):
        if following.number == 30 and not failed:
            failed.append(following)
            raise np.linalg.LinAlgError
        return relieved(following)

    monkeypatch.setattr(Following, "relieved", fails_once)
    session, records = replayed(points)
    (lost,) = failed
    # It goes on after two seconds, as after a gap.
    times = np.array([each.time for each in records])
    assert np.diff(times).max() > 1.5
    assert times[-1] > lost.instants[-1].time + 3.0
    assert session.ended()[1].verdict.accepted


@pytest.mark.slow
@pytest.mark.long
def test_samples_out_of_order_tell_the_same(points):
    one, _ = replayed(points)
    other, _ = replayed(points, shuffled=True)
    a, b = one.ended()[1], other.ended()[1]
    assert b.value == pytest.approx(a.value, rel=1e-9)


@pytest.mark.slow
def test_after_a_gap_the_motion_is_followed_again(points, recursive):
    session, records = replayed(points, lost=[(9.0, 11.5)])
    _, found = session.ended()
    times = np.array([each.time for each in records])
    assert np.diff(times).max() > 2.0
    off = (found.value - recursive.value) / recursive.standard_deviation
    assert np.abs(off).max() < 2.5
    assert np.all(found.standard_deviation > 0.97 * recursive.standard_deviation)
    assert np.all(found.standard_deviation < 1.5 * recursive.standard_deviation)


@pytest.mark.slow
@pytest.mark.long
def test_a_robot_that_stands_still_for_long_is_waited_for():
    experiment = rested(24.0)(3)
    settings = replace(LIVE, longest=10.0)
    remarks, records, session = [], [], None
    source = ReplayedRun(experiment, experiment.runs[0], np.inf)
    for each in watch(experiment, source, "run", settings):
        session = each.session
        remarks += each.remarks
        records += each.records
    assert remarks == ["no estimate yet: the platform is (nearly) at rest; move it on all six axes"]
    start = records[0].time - min(t.time[0] for t in experiment.runs[0].streams.values())
    assert 24.0 < start < 24.0 + 2.5 * LIVE.recursion.begin
    found = ended(session).estimate
    assert found.verdict.accepted
    assert np.abs((found.value - TRUTH) / found.standard_deviation).max() < 3.5


def test_nothing_is_told_of_nothing(points):
    session = Session(replace(points, runs=()), "live", {})
    _, found = session.ended()
    assert np.isnan(found.value).all()
    assert not found.verdict.accepted
    assert "nothing was told" in found.verdict.reasons[0]


@pytest.mark.slow
def test_a_source_of_datagrams(points, recursive):
    run = points.runs[0]
    plan = replace(points, runs=())
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    source = open_source(f"udp://127.0.0.1:{port}", plan)
    sent = messages(points, run)

    def send():
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            for each in sent:
                out.sendto(each, ("127.0.0.1", port))
                got.wait(0.002)
            done.set()

    got, done = threading.Event(), threading.Event()
    thread = threading.Thread(target=send)
    thread.start()
    session, quiet = None, 0

    def stopped():
        nonlocal quiet
        quiet = quiet + 1 if done.is_set() else 0
        return quiet > 20

    for each in watch(plan, source, stopped=stopped):
        session = each.session
    thread.join()
    source.close()
    found = ended(session).estimate
    assert session.buffer.counts.refused == 1
    assert "1 message that could not be read" in in_words(session)
    off = (found.value - recursive.value) / recursive.standard_deviation
    assert np.abs(off).max() < 0.5


def messages(points, run):
    """Messages of twenty samples each on one clock, with one that is none."""
    parts = []
    for name in ("cables", "imu", "tracker"):
        time = points.common_time(run, name) + 100.0
        columns = points.columns(run.name, name)
        for start in range(0, len(time), 20):
            own = slice(start, start + 20)
            found = {"instrument": name, "t": time[own].tolist()}
            found |= {k: v[own].tolist() for k, v in columns.items() if k != "t"}
            parts.append((time[own][-1], json.dumps(found).encode()))
    parts.append((101.0, b"not a message"))
    return [data for _, data in sorted(parts)]


def test_a_replay_hands_over_every_sample_once(points):
    run = points.runs[0]
    source, counts = ReplayedRun(points, run, np.inf), dict.fromkeys(run.streams, 0)
    while not (received := source.receive(0.0)).ended:
        for each in received.arrivals:
            counts[each.instrument] += len(each.stream)
    for each in received.arrivals:
        counts[each.instrument] += len(each.stream)
    assert counts == {name: len(stream) for name, stream in run.streams.items()}


def test_addresses_of_replays():
    assert asked_for("replay:run") == ("run", 1.0)
    assert asked_for("replay:run@2.5") == ("run", 2.5)
    assert asked_for("replay:a@b@max") == ("a@b", np.inf)
    with pytest.raises(InputError, match="positive number or 'max'"):
        asked_for("replay:run@fast")


@pytest.mark.parametrize("url", ["ftp://x:1", "udp://nowhere", "udp://localhost:99999", "run"])
def test_addresses_of_no_kind_are_refused(points, url):
    with pytest.raises(InputError, match="source"):
        open_source(url, points)


@pytest.mark.slow
def test_memory_does_not_grow_with_what_has_passed(points):
    settings = replace(LIVE, parts=4)
    run = points.runs[0]
    session = Session(replace(points, runs=()), run.name, run.sync, settings=settings)
    sizes = []
    source = ReplayedRun(points, run, np.inf)
    while True:
        received = source.receive(0.0)
        session, _ = session.taken(received.arrivals).advanced()
        if session.following is not None:
            sizes.append((len(session.following.parts), len(session.buffer.streams["tracker"])))
        if received.ended:
            break
    assert max(parts for parts, _ in sizes) <= 2 * settings.parts
    assert max(own for _, own in sizes[-20:]) < 10 * 238


@pytest.mark.slow
def test_a_payload_that_is_picked_up_is_an_event():
    session, records = replayed(loaded(3, since=6.8))
    (record,) = [each for each in records if each.events]
    (event,) = record.to_dict()["events"]
    assert event["kind"] == "load"
    assert event["load"] == record.load == "load 2"
    origin = session.sync["cables"]
    assert event["t"] - origin == pytest.approx(6.8, abs=0.3)
    assert abs(event["mass"] - 3.2) < 4 * event["sigma_mass"]
    assert records[0].load == "load 1"
    _, found = session.ended()
    assert set(found.loads.estimates) == {"load 1", "load 2"}
