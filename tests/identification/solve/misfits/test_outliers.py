"""Spikes and hands on the platform: found, named and left out, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import BSpline
from scipy.spatial.transform import Rotation
from simulated import BODY, CENTER, EXACT, REACH, ROBOT, sound, with_stream

from steelyard.arrays import joined_stretches
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run, Stream
from steelyard.identification.model.balance import Forces, balance_of
from steelyard.identification.model.calibration_parameters import CalibrationValues, gather
from steelyard.identification.model.motion_segment import Reading, Segment
from steelyard.identification.solve.joint_motion import fit_jointly
from steelyard.identification.solve.misfits.outliers import look
from steelyard.instruments import Attitude, Tension, Wrench
from steelyard.motion.trajectory import multisine
from steelyard.robot.model import Robot
from steelyard.smoothing import DEGREE, knots

LENGTH, RATE = 8.0, 50.0  # [s], [Hz]
TIMES = np.arange(0.1, LENGTH - 0.1, 1 / RATE)
GRID = knots(0.0, LENGTH, 0.4)
SEEDS = 20
MARGIN = (
    0.25  # [s]; what is left out about a contact, and a few samples of its soft beginning or end
)
POINTS = replace(
    ROBOT, name="points", pulley_radius=np.zeros(8)
)  # cables leave from points: quicker
BARE = Robot("sensor", np.zeros((0, 3)), np.zeros((0, 3)))


class Case:
    """A motion that is known, and forces that balance it exactly."""

    def __init__(self, instrument, robot, guess, sigma):
        suite = {
            "forces": instrument,
            "attitude": Attitude.model_validate({"kind": "attitude", "noise": 0.01}),
        }
        streams = {name: Stream(np.arange(3.0), {}, name) for name in suite}
        run = Run("run", streams, dict.fromkeys(suite, 0.0))
        self.experiment = Experiment("forces", robot, suite, (run,), uncertainty=EXACT)
        calibration_parameters = gather(self.experiment)
        self.calibration = CalibrationValues(calibration_parameters, calibration_parameters.mean)
        pose = multisine(list(CENTER), list(REACH), LENGTH, 3).derivative(
            np.linspace(0, LENGTH, 300), 0
        )
        quaternion = Rotation.from_euler("ZYX", pose[:, :2:-1]).as_quat(scalar_first=True)
        design = BSpline.design_matrix(np.linspace(0, LENGTH, 300), GRID, DEGREE).toarray()
        coefficients = np.linalg.lstsq(design, np.hstack([pose[:, :3], quaternion]), rcond=None)[0]
        attitude = Reading(
            ("attitude", "orientation"), TIMES, np.tile(np.eye(3), (len(TIMES), 1, 1)), 1.0
        )
        self.segment = Segment("run", GRID, (attitude,), coefficients)
        none = np.zeros((len(TIMES), len(sigma)), dtype=bool)
        self.forces = Forces("forces", TIMES, guess, sigma, none)
        at = self.balance(self.forces)
        self.inverse = np.linalg.pinv(at.by_reading)
        self.forces = self.with_more(-np.einsum("nri,ni->nr", self.inverse, at.left_over))

    def balance(self, forces):
        return balance_of(
            self.experiment, self.segment, forces, self.calibration, BODY.parameters, {}
        )

    def with_more(self, by, forces=None):
        """Readings with something added, shape (n, r)."""
        forces = forces or self.forces
        ends = np.cumsum([v.shape[1] for v in forces.readings.values()])[:-1]
        parts = np.split(by, ends, axis=1)
        readings = {
            q: v + part for (q, v), part in zip(forces.readings.items(), parts, strict=True)
        }
        return replace(forces, readings=readings)

    def pushed(self, wrench, forces=None):
        """Readings with a wrench that something else exerts on the platform, shape (n, 6)."""
        return self.with_more(np.einsum("nri,ni->nr", self.inverse, -wrench), forces)

    def noisy(self, seed):
        rng = np.random.default_rng(seed)
        return self.with_more(rng.normal(size=self.forces.left_out.shape) * self.forces.sigma)

    def look(self, forces):
        return look(self.balance(forces), forces, forces.sigmas(self.segment, {}))


def _cables():
    tension = Tension.model_validate(
        {"kind": "tension", "clock": "recorder", "calibration": {"offset": 5.0}}
    )
    return Case(tension, POINTS, {"tension": np.full((len(TIMES), 8), 600.0)}, np.full(8, 5.0))


def _sensor():
    wrench = Wrench.model_validate(
        {
            "kind": "wrench",
            "clock": "recorder",
            "calibration": {"offset": {"force": 1.0, "torque": 0.1}},
        }
    )
    nothing = {"force": np.zeros((len(TIMES), 3)), "torque": np.zeros((len(TIMES), 3))}
    return Case(wrench, BARE, nothing, np.array([2.0, 2.0, 2.0, 0.2, 0.2, 0.2]))


CABLES, SENSOR = _cables(), _sensor()


def spike(shape, *places):
    """Nothing but a number at some samples and readings."""
    found = np.zeros(shape)
    for sample, reading, size in places:
        found[sample, reading] = size
    return found


def between(start, end):
    """Which samples are."""
    return np.array([start <= time <= end for time in TIMES])


def push(start, end, force, place=(0.0, 0.0, 0.0)):
    """Wrench of a hand that comes and goes softly, at a place of the platform [N], [N m], shape (n,
    6)."""
    phase = np.clip((TIMES - start) / (end - start), 0, 1)
    softly = np.minimum(1.0, 4 * np.sin(np.pi * phase))[:, None]
    return softly * np.concatenate([force, np.cross(place, force)])


# Sensors that spike


@pytest.mark.parametrize("size", [-400.0, 150.0, 300.0, 600.0])
@pytest.mark.parametrize("cable", range(8))
def test_a_spike_in_one_cable_is_found_and_named(cable, size):
    sample = 37 + 31 * cable
    forces = CABLES.with_more(spike((len(TIMES), 8), (sample, cable, size)), CABLES.noisy(cable))
    found = CABLES.look(forces)
    assert found.spikes == ((pytest.approx(TIMES[sample]), cable),)
    assert found.contacts == ()
    assert found.changed
    assert np.argwhere(found.force_samples.left_out).tolist() == [[sample, cable]]
    # Nothing else is changed, and the next look finds nothing more.
    assert found.force_samples.readings is forces.readings
    assert not CABLES.look(found.force_samples).changed


@pytest.mark.parametrize("reading", range(6))
def test_a_spike_in_one_axis_of_a_wrench_sensor_is_found_and_named(reading):
    size = 40 * SENSOR.forces.sigma[reading]
    found = SENSOR.look(
        SENSOR.with_more(spike((len(TIMES), 6), (100, reading, size)), SENSOR.noisy(reading))
    )
    assert found.spikes == ((pytest.approx(TIMES[100]), reading),)
    assert found.contacts == ()


def test_every_spike_is_found():
    rng = np.random.default_rng(4)
    samples = np.sort(rng.choice(np.arange(5, len(TIMES) - 5, 3), 20, replace=False))
    places = [
        (int(s), int(rng.integers(8)), float(rng.choice([-1, 1]) * rng.uniform(150, 600)))
        for s in samples
    ]
    found = CABLES.look(CABLES.with_more(spike((len(TIMES), 8), *places), CABLES.noisy(4)))
    assert [(s, c) for s, c, _ in places] == [
        (int(np.argmin(abs(TIMES - t))), c) for t, c in found.spikes
    ]
    assert found.contacts == ()
    np.testing.assert_array_equal(
        found.force_samples.left_out, spike((len(TIMES), 8), *places) != 0
    )


def test_a_sensor_that_is_off_for_a_while_is_no_hand():
    off = spike((len(TIMES), 8), *((sample, 5, 200.0) for sample in range(100, 125)))
    found = CABLES.look(CABLES.with_more(off, CABLES.noisy(5)))
    assert found.contacts == ()
    np.testing.assert_array_equal(found.force_samples.left_out, off != 0)
    assert {cable for _, cable in found.spikes} == {5}


@pytest.mark.parametrize("sigma", [5.0, 0.5, 0.05])
def test_a_sensor_that_drops_out_for_a_while_is_no_hand_however_exact_it_is(sigma):
    forces = replace(CABLES.forces, sigma=np.full(8, sigma))
    forces = CABLES.with_more(sigma * np.random.default_rng(1).normal(size=(len(TIMES), 8)), forces)
    out = spike((len(TIMES), 8), *((sample, 5, -600.0) for sample in range(100, 125)))
    once = CABLES.look(CABLES.with_more(out, forces))
    again = CABLES.look(once.force_samples)
    assert (once.contacts, again.contacts) == ((), ())
    np.testing.assert_array_equal(again.force_samples.left_out, out != 0)


def test_what_was_left_out_stays_left_out():
    first = spike((len(TIMES), 8), (50, 2, 300.0))
    forces = CABLES.noisy(6)
    force_samples = CABLES.look(CABLES.with_more(first, forces)).force_samples
    second = CABLES.look(CABLES.with_more(spike((len(TIMES), 8), (90, 3, 300.0)), force_samples))
    assert np.argwhere(second.force_samples.left_out).tolist() == [[50, 2], [90, 3]]
    assert second.spikes == ((pytest.approx(TIMES[90]), 3),)


# Hands on the platform

PUSHES = {
    "across": ((0.0, 60.0, 0.0), (0.5, 0.0, 0.0)),
    "along": ((60.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    "down on a corner": ((0.0, 0.0, -80.0), (0.5, 0.4, 1.0)),
    "hard": ((200.0, -150.0, 50.0), (0.1, 0.5, 0.5)),
}


@pytest.mark.parametrize("force", PUSHES.values(), ids=PUSHES)
@pytest.mark.parametrize("start", [1.0, 4.3])
def test_a_push_with_a_hand_is_found_as_a_contact(start, force):
    end = start + 0.5
    found = CABLES.look(CABLES.pushed(push(start, end, *force), CABLES.noisy(7)))
    ((first, last),) = found.contacts
    assert first == pytest.approx(start, abs=MARGIN)
    assert last == pytest.approx(end, abs=MARGIN)
    assert found.changed
    # All that was felt while it lasted is left out, and nothing before and after.
    assert found.force_samples.left_out[between(first, last)].all()
    assert not found.force_samples.left_out[~between(start - MARGIN, end + MARGIN)].any()
    # The whole push is within, as far as noise lets it be seen.
    size = np.linalg.norm(push(start, end, *force)[:, :3], axis=1)
    assert size[~found.force_samples.left_out.any(axis=1)].max() < 50


def test_a_push_that_one_cable_after_the_other_seems_to_explain_is_a_contact():
    gentle = push(3.0, 3.5, (15.5, 13.0, -14.5), (0.33, -0.49, -0.13))
    found = CABLES.look(CABLES.pushed(gentle, CABLES.noisy(22)))
    ((first, last),) = found.contacts
    assert (first, last) == (pytest.approx(3.0, abs=MARGIN), pytest.approx(3.5, abs=MARGIN))
    assert found.spikes == ()


def test_what_one_cable_explains_of_a_push_belongs_to_the_contact():
    """A push of 4 % of the weight began with ten samples that one cable explained: they were its spikes, the
    others stayed, and the estimate was 1.8 times off what it stated."""
    beginning = np.flatnonzero(between(2.5, 2.98))
    seen = [(int(sample), 4, 200.0) for sample in beginning if sample % 4]
    forces = CABLES.with_more(spike((len(TIMES), 8), *seen), CABLES.noisy(23))
    found = CABLES.look(CABLES.pushed(push(3.0, 3.5, *PUSHES["hard"]), forces))
    ((first, last),) = found.contacts
    assert (first, last) == (pytest.approx(2.5, abs=MARGIN), pytest.approx(3.5, abs=MARGIN))
    assert found.spikes == ()


def test_single_spikes_near_a_push_stay_spikes():
    samples = [int(np.argmin(abs(TIMES - time))) for time in (1.0, 2.7, 3.9, 6.0)]
    forces = CABLES.with_more(
        spike((len(TIMES), 8), *((sample, 4, 200.0) for sample in samples)), CABLES.noisy(24)
    )
    found = CABLES.look(CABLES.pushed(push(3.0, 3.5, *PUSHES["hard"]), forces))
    ((first, last),) = found.contacts
    assert (first, last) == (pytest.approx(3.0, abs=MARGIN), pytest.approx(3.5, abs=MARGIN))
    assert found.spikes == tuple((pytest.approx(TIMES[sample]), 4) for sample in samples)


def test_a_contact_that_would_take_too_much_is_left_out_as_far_as_no_cable_explains_it():
    beginning = [(int(sample), 4, 200.0) for sample in np.flatnonzero(between(0.0, 2.98))]
    forces = CABLES.with_more(spike((len(TIMES), 8), *beginning), CABLES.noisy(25))
    found = CABLES.look(CABLES.pushed(push(3.0, 3.5, *PUSHES["hard"]), forces))
    ((first, last),) = found.contacts
    assert (first, last) == (pytest.approx(3.0, abs=MARGIN), pytest.approx(3.5, abs=MARGIN))
    assert {cable for _, cable in found.spikes} == {4}


def test_a_push_on_a_wrench_sensor_is_found_as_a_contact():
    found = SENSOR.look(
        SENSOR.pushed(push(3.0, 3.5, (20.0, 15.0, 0.0), (0.0, 0.0, 0.3)), SENSOR.noisy(8))
    )
    ((first, last),) = found.contacts
    assert (first, last) == (pytest.approx(3.0, abs=MARGIN), pytest.approx(3.5, abs=MARGIN))


def test_two_pushes_are_two_contacts_and_a_pause_is_none():
    def contacts(pause):
        both = push(2.0, 2.5, *PUSHES["hard"]) + push(2.5 + pause, 3.0 + pause, *PUSHES["hard"])
        return CABLES.look(CABLES.pushed(both, CABLES.noisy(9))).contacts

    assert len(contacts(1.0)) == 2
    assert len(contacts(0.1)) == 1


def test_a_knock_of_two_samples_is_no_contact():
    knock = np.zeros((len(TIMES), 6))
    knock[[100, 101]] = push(0.0, LENGTH, *PUSHES["hard"])[len(TIMES) // 2]
    found = CABLES.look(CABLES.pushed(knock, CABLES.noisy(10)))
    assert found.contacts == ()


def test_a_contact_that_was_left_out_is_not_found_again():
    once = CABLES.look(CABLES.pushed(push(3.0, 3.5, *PUSHES["hard"]), CABLES.noisy(11)))
    again = CABLES.look(once.force_samples)
    assert once.changed
    assert not again.changed
    assert again.contacts == ()
    np.testing.assert_array_equal(again.force_samples.left_out, once.force_samples.left_out)


def test_a_spike_beside_a_contact_is_told_apart():
    forces = CABLES.pushed(push(3.0, 3.5, *PUSHES["hard"]), CABLES.noisy(12))
    found = CABLES.look(CABLES.with_more(spike((len(TIMES), 8), (300, 4, 300.0)), forces))
    assert len(found.contacts) == 1
    assert found.spikes[-1] == (pytest.approx(TIMES[300]), 4)
    # A spike within a contact is no news.
    assert all(not found.contacts[0][0] <= time <= found.contacts[0][1] for time, _ in found.spikes)


# The rule is no exception


@pytest.mark.parametrize("case", [CABLES, SENSOR], ids=["cables", "sensor"])
def test_noise_alone_touches_nothing(case):
    looked = [case.look(case.noisy(seed)) for seed in range(100, 100 + SEEDS)]
    assert sum(len(each.contacts) for each in looked) == 0
    # Beyond five 1-sigma is one reading of two million.
    assert sum(len(each.spikes) for each in looked) <= 1
    assert sum(int(each.force_samples.left_out.sum()) for each in looked) <= 1


def test_forces_that_balance_touch_nothing():
    found = CABLES.look(CABLES.forces)
    assert not found.changed
    assert (found.contacts, found.spikes) == ((), ())


@pytest.mark.parametrize("part", [0.35, 0.7, 1.0])
def test_where_much_would_be_cut_nothing_is(part):
    # A body that is wrong, forces that do not fit at all: no hand does that.
    long = push(0.5, 0.5 + part * (LENGTH - 1.0), *PUSHES["across"])
    found = CABLES.look(CABLES.pushed(long, CABLES.noisy(13)))
    assert found.contacts == ()
    assert not found.force_samples.left_out.all(axis=1).any()


def test_what_has_been_cut_counts_where_more_would_be():
    hard = PUSHES["hard"]
    once = CABLES.look(CABLES.pushed(push(1.0, 2.4, *hard), CABLES.noisy(14)))
    assert len(once.contacts) == 1
    # Another fifth of the run would make it more than a quarter.
    again = CABLES.look(CABLES.pushed(push(4.0, 5.4, *hard), once.force_samples))
    assert again.contacts == ()
    np.testing.assert_array_equal(
        again.force_samples.left_out.all(axis=1), once.force_samples.left_out.all(axis=1)
    )


def test_inputs_stay_as_they_are():
    forces = CABLES.with_more(spike((len(TIMES), 8), (100, 1, 400.0)), CABLES.noisy(15))
    CABLES.look(forces)
    assert not forces.left_out.any()


@pytest.mark.parametrize(
    ("mask", "expected"),
    [
        ("000000", []),
        ("111111", [(0, 6)]),
        ("010010", [(1, 2), (4, 5)]),
        ("101011", [(0, 6)]),
        ("100100", [(0, 1), (3, 4)]),
        ("000001", [(5, 6)]),
    ],
)
def test_stretches_with_short_pauses_are_one(mask, expected):
    time = np.array([0.0, 0.1, 0.2, 0.35, 0.4, 0.5])
    found = joined_stretches(time, np.array([c == "1" for c in mask]), 0.25)
    assert found == expected


@pytest.mark.integration
def test_what_a_filter_explains_touches_nothing():
    """Before a filter is found, forces depart so much where they change quickly that it seems to be a
    hand."""
    kept = 0.5

    def filtered(values):
        read = values["tension"].copy()
        for i in range(1, len(read)):
            read[i] = kept * read[i - 1] + (1 - kept) * read[i]
        return {"tension": read}

    (run,) = sound(1).runs
    late = kept / (1 - kept) * np.median(np.diff(run.streams["cables"].time))
    found = fit_jointly(with_stream(sound(1), "cables", filtered))
    constant = found.calibration.calibration_parameters.place("cables", "time_constant", "run")
    assert found.calibration.values[constant] == pytest.approx(late, rel=0.1)
    assert not any(found.contacts.values())
    assert not any(forces.left_out.any() for forces in found.force_samples)
