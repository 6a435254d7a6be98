"""Dead weights on force sensors: gains and offsets against small linear problems of plain algebra."""

from dataclasses import replace

import numpy as np
import pytest
from simulated import BODY, EXACT, PAPER, ROBOT, Recorder, changed

from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.experiment.observations import DeadWeights
from steelyard.experiment.recording import Run, Stream
from steelyard.identification.identify import identify
from steelyard.identification.model.calibration_parameters import gather
from steelyard.instruments import Pose, Tension, Weight

G = 9.81
GAIN, COMMON, OFFSET, NOISE = 0.01, 0.005, 5.0, 2.0
CALIBRATION = {"gain": GAIN, "common_gain": COMMON, "offset": OFFSET}
STEPS = (20.0, 60.0, 100.0)  # [kg]


def cells(**calibration):
    return Tension.model_validate(
        {"kind": "tension", "noise": 5.0, "calibration": {**CALIBRATION, **calibration}}
    )


def hung(seed=0, m=8, masses=STEPS, noise=NOISE, stated=True, drawn=None, scale=None, true=1.0):
    """Readings of all cells under weights, and their gains and offsets."""
    rng = np.random.default_rng(seed)
    gain, offset = drawn or (
        (1 + COMMON * rng.standard_normal()) * (1 + GAIN * rng.standard_normal(m)),
        OFFSET * rng.standard_normal(m),
    )
    cable, mass = np.repeat(np.arange(m), len(masses)), np.tile(masses, m)
    reading = gain[cable] * true * mass * G + offset[cable] + noise * rng.standard_normal(len(mass))
    form = {"kind": "weight", "of": "cables"}
    form |= {"noise": noise} if stated else {}
    form |= {} if scale is None else {"calibration": {"scale": scale}}
    table = DeadWeights("weights", "weights", Weight.model_validate(form), cable + 1, mass, reading)
    return table, gain, offset


def experiment(*tables, instrument=None, **keys):
    """One pose at rest, which nobody looks at."""
    stream = Stream(np.zeros(1), {"tension": np.full((1, ROBOT.m), 500.0)}, "cables")
    runs = (Run("poses", {"cables": stream}, static=True),)
    instruments = {"cables": instrument or cells()}
    return Experiment("cells", ROBOT, instruments, runs, weights=tables, **keys)


def line(reading, pull, noise, gain):
    """Gain and offset of one cell beside what is known of them, and their covariance."""
    A = np.column_stack([pull, np.ones(len(pull))]) / noise
    prior = np.diag([gain**-2, OFFSET**-2])
    covariance = np.linalg.inv(A.T @ A + prior)
    return covariance @ (A.T @ (reading / noise) + prior @ [1.0, 0.0]), covariance


def test_one_cell_is_a_straight_line():
    table, _, _ = hung(m=1)
    at = gather(experiment(table, instrument=cells(common_gain=0)))
    value, covariance = line(table.reading, table.mass * G, NOISE, GAIN)
    gain, offset = at.places["cables", "gain", None], at.places["cables", "offset", None]
    own = [gain.start, offset.start]
    np.testing.assert_allclose(at.mean[own], value, rtol=1e-7)
    np.testing.assert_allclose(at.deviation[own], np.sqrt(np.diag(covariance)), rtol=1e-6)
    precision = at.precision[np.ix_(own, own)]
    np.testing.assert_allclose(precision, np.linalg.inv(covariance), rtol=1e-6)
    # Cells without a weight are known as before.
    np.testing.assert_allclose(at.deviation[gain][1:], GAIN)
    np.testing.assert_allclose(at.mean[gain][1:], 1.0)


def test_a_gain_that_all_share_is_told_from_all_of_them():
    """To first order the product of both gains is their sum less one."""
    table, _, _ = hung(3)
    at = gather(experiment(table))
    m = ROBOT.m
    A = np.zeros((len(table), 2 * m + 1))
    rows, cell = np.arange(len(table)), table.cable - 1
    A[rows, cell], A[rows, m + cell], A[:, 2 * m] = 1.0, table.mass * G, table.mass * G
    prior = np.diag([OFFSET**-2] * m + [GAIN**-2] * m + [COMMON**-2])
    covariance = np.linalg.inv(A.T @ A / NOISE**2 + prior)
    value = covariance @ A.T @ (table.reading - table.mass * G) / NOISE**2
    value[m:] += 1.0
    own = np.concatenate(
        [np.arange(ROBOT.m) + at.places["cables", key, None].start for key in ("offset", "gain")]
        + [[at.places["cables", "common_gain", None].start]]
    )
    sigma = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose((at.mean[own] - value) / sigma, 0, atol=0.06)
    np.testing.assert_allclose(at.deviation[own], sigma, rtol=0.03)
    correlation = np.linalg.inv(at.precision[np.ix_(own, own)]) / np.outer(sigma, sigma)
    np.testing.assert_allclose(correlation, covariance / np.outer(sigma, sigma), atol=0.06)


@pytest.mark.integration
@pytest.mark.parametrize("stated", [True, False])
def test_intervals_of_the_cells_cover(stated):
    chi = []
    for seed in range(1000, 1100):
        table, gain, offset = hung(seed, stated=stated)
        found = gather(experiment(table, instrument=cells())).weighed
        values = {key: value for (_, key, _), (value, _) in found.each.items()}
        # What a cell reads, and what is uncertain of that.
        m, common = ROBOT.m, values["common_gain"]
        off = np.concatenate([values["offset"] - offset, common * values["gain"] - gain])
        J = np.zeros((2 * m, 2 * m + 1))
        J[:m, :m] = np.eye(m)
        J[m:, m : 2 * m], J[m:, 2 * m] = common * np.eye(m), values["gain"]
        spread = J @ found.covariance @ J.T
        chi.append(off @ np.linalg.solve(spread, off) / (2 * m))
    print(f"chi-square over its freedom: {np.mean(chi):.3f}")
    assert 0.9 < np.mean(chi) < 1.1


def test_noise_that_is_not_stated_is_found():
    found = [
        gather(experiment(hung(seed, masses=(5, 20, 40, 60, 80, 100), stated=False)[0]))
        for seed in range(10)
    ]
    levels = [each.weighed.tables[0].noise for each in found]
    assert np.mean(levels) == pytest.approx(NOISE, rel=0.1)


def test_how_well_the_set_is_known_stays_in_the_gains():
    table, _, _ = hung(scale=0.003)
    at = gather(experiment(table))
    m, places = ROBOT.m, at.places
    own = np.arange(m) + places["cables", "gain", None].start
    own = np.append(own, places["cables", "common_gain", None].start)
    spread = np.linalg.inv(at.precision[np.ix_(own, own)])
    # The mean of all products: that of the set, and what is stated of the cells themselves.
    along = np.append(np.full(m, 1 / m), 1.0)
    before = COMMON**2 + GAIN**2 / m
    expected = (0.003**-2 + 1 / before) ** -0.5
    assert np.sqrt(along @ spread @ along) == pytest.approx(expected, rel=0.1)


def test_an_offset_of_another_run_says_nothing_of_this_one():
    instrument = cells(offset={"sigma": OFFSET, "per": "run"})
    at = gather(experiment(hung()[0], instrument=instrument))
    place = at.places["cables", "offset", "poses"]
    np.testing.assert_allclose(at.deviation[place], OFFSET)
    assert ("cables", "offset", "weights") not in at.places
    gain = at.deviation[at.places["cables", "gain", None]]
    assert (gain < 0.8 * GAIN).all()
    table = replace(hung()[0], run="poses")
    beside = gather(experiment(table, instrument=instrument))
    assert (beside.deviation[beside.places["cables", "offset", "poses"]] < OFFSET / 2).all()


def test_cells_at_the_winch_are_weighed_without_their_cables():
    instrument = Tension.model_validate(
        {"kind": "tension", "end": "winch", "noise": 5.0, "calibration": CALIBRATION}
    )
    table = hung()[0]
    heavy = replace(ROBOT, cable=replace(ROBOT.cable, linear_density=0.5))
    there = gather(replace(experiment(table, instrument=instrument), robot=heavy))
    here = gather(experiment(table))
    for key in ("gain", "offset", "common_gain"):
        place = there.places["cables", key, None], here.places["cables", key, None]
        np.testing.assert_allclose(there.mean[place[0]], here.mean[place[1]], rtol=1e-9)


def test_gravity_pulls_at_the_weights_too():
    """What is uncertain of it goes into the gains, and out again where the platform hangs."""
    uncertain = {**EXACT, "gravity": 0.1}
    at = gather(experiment(hung()[0], uncertainty=uncertain))
    exact = gather(experiment(hung()[0]))
    place = at.places["cables", "common_gain", None]
    assert at.deviation[place] > exact.deviation[exact.places["cables", "common_gain", None]]
    down = at.places["robot", "gravity", None].stop - 1
    spread = np.linalg.inv(at.precision[np.ix_(at.of_weighed, at.of_weighed)])
    own = np.flatnonzero(at.of_weighed == down)[0]
    common = np.flatnonzero(at.of_weighed == place.start)[0]
    assert spread[own, common] > 0  # a smaller gravity (less negative) is a larger gain


def with_row(table, row, **values):
    changed = {key: getattr(table, key).copy() for key in values}
    for key, value in values.items():
        changed[key][row] = value
    return replace(table, **changed)


@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize(
    ("wrong", "would"), [({"mass": 50.0}, 60.0), ({"mass": 6.0}, 60.0), ({"reading": 60.0}, None)]
)
def test_a_row_that_is_wrong_is_named_and_left_out(wrong, would, stated):
    table, _, _ = hung(2, stated=stated)
    at = gather(experiment(with_row(table, 7, **wrong)))
    (row,) = at.weighed.wrong
    assert "run 'weights': row 8 of 'weights'" in str(row)
    assert "on cable 3" in str(row)
    if would:
        assert row.would_be == pytest.approx(would, rel=0.05)
    without = replace(
        table, **{key: np.delete(getattr(table, key), 7) for key in ("cable", "mass", "reading")}
    )
    there = gather(experiment(without))
    np.testing.assert_allclose(at.mean, there.mean, atol=1e-3)
    np.testing.assert_allclose(at.deviation, there.deviation, rtol=1e-3)
    assert not at.weighed.reasons


def test_a_noise_that_is_none_is_a_reason_and_not_a_number_of_wrong_rows():
    table, _, _ = hung(4)
    form = table.description.model_copy(update={"noise": NOISE / 10})
    weighed = gather(experiment(replace(table, description=form))).weighed
    assert not weighed.wrong
    (reason,) = weighed.reasons
    assert "times the stated noise of weights" in reason
    assert weighed.tables[0].noise > NOISE / 2


def test_a_gain_that_nobody_has_stated_so_is_a_reason():
    table, _, _ = hung(5, true=1.3)
    reasons = " ".join(gather(experiment(table)).weighed.reasons)
    assert "dead weights say that cables.common_gain is" in reasons
    assert "state a larger 1-sigma under 'calibration' of cables" in reasons
    wide = gather(experiment(table, instrument=cells(gain=0.5))).weighed
    assert not wide.reasons


def test_too_few_rows_for_a_noise_that_is_not_stated():
    with pytest.raises(InputError, match="expected 'noise' of the readings, or more rows") as error:
        gather(experiment(hung(masses=(50.0,), stated=False)[0]))
    assert "\n" not in str(error.value)


PLAIN = replace(ROBOT, pulley_radius=np.zeros(ROBOT.m))


def hanging(seed, poses=12):
    """A platform at rest on cables from points, exactly placed, and what its cells read."""
    rng = np.random.default_rng(seed)
    place = rng.uniform([-2, -1.5, 1], [2, 1.5, 2.5], (poses, 3))
    arms = ROBOT.attachments
    along = ROBOT.anchors - (place[:, None] + arms)
    pull = along / np.linalg.norm(along, axis=2)[:, :, None]
    W = np.concatenate([pull, np.cross(arms, pull)], axis=2).transpose(0, 2, 1)
    weight = np.array([0.0, 0.0, -BODY.mass * G])
    needed = -np.concatenate([weight, np.cross(BODY.center_of_gravity, weight)])
    even = np.full(ROBOT.m, 600.0)
    tension = even + np.einsum("nmk,nk->nm", np.linalg.pinv(W), needed - W @ even)
    table, gain, offset = hung(seed)
    reading = gain * tension + offset + 0.5 * rng.standard_normal(tension.shape)
    number = np.arange(float(poses))
    streams = {
        "cables": Stream(number, {"tension": reading}, "cables"),
        "pose": Stream(
            number,
            {"position": place, "orientation": np.tile(np.eye(3), (poses, 1, 1))},
            "pose",
        ),
    }
    exact = {"target": 0, "misalignment": 0, "frame": {"position": 0, "rotation": 0}}
    instruments = {
        "cables": cells().model_copy(update={"noise": 0.5}),
        "pose": Pose.model_validate(
            {
                "kind": "pose",
                "noise": {"position": 1e-6, "rotation": 1e-6},
                "calibration": exact,
            }
        ),
    }
    runs = (Run("poses", streams, static=True),)
    found = Experiment("hanging", PLAIN, instruments, runs, uncertainty=EXACT)
    return found, table, (W, reading)


def mass_by_algebra(W, reading, table=None):
    """1-sigma of the mass by linear least squares over mass, first moment, gains and offsets."""
    m, poses = ROBOT.m, len(W)
    # Mass and first moment across gravity; offsets, gains, the common gain.
    A = np.zeros((poses, 6, 3 + 2 * m + 1))
    A[:, 2, 0] = G
    A[:, 3, 2], A[:, 4, 1] = G, -G
    A[:, :, 3 : 3 + m] = W
    A[:, :, 3 + m : 3 + 2 * m] = W * reading[:, None]
    A[:, :, -1] = np.einsum("nkm,nm->nk", W, reading)
    information = np.zeros((A.shape[2], A.shape[2]))
    for own, structure in zip(A, W, strict=True):
        information += own.T @ np.linalg.solve(0.5**2 * structure @ structure.T, own)
    information += np.diag([0.0] * 3 + [OFFSET**-2] * m + [GAIN**-2] * m + [COMMON**-2])
    if table is not None:
        B = np.zeros((len(table), A.shape[2]))
        rows, cell = np.arange(len(table)), table.cable - 1
        B[rows, 3 + cell], B[rows, 3 + m + cell], B[:, -1] = 1, table.mass * G, table.mass * G
        information += B.T @ B / NOISE**2
    return float(np.sqrt(np.linalg.inv(information)[0, 0]))


@pytest.mark.integration
@pytest.mark.parametrize("method", ["maximum-likelihood", "least-squares", "consistent"])
def test_the_mass_before_and_after_is_that_of_plain_algebra(method):
    found, table, (W, reading) = hanging(1)
    before = identify(found, method).estimate
    after = identify(replace(found, weights=(table,)), method).estimate
    sigmas = [each.standard_deviation[0] for each in (before, after)]
    expected = [mass_by_algebra(W, reading), mass_by_algebra(W, reading, table)]
    print(f"1-sigma of the mass: {sigmas} kg, by algebra {expected} kg")
    np.testing.assert_allclose(sigmas, expected, rtol=0.03)
    assert expected[1] < expected[0] / 4
    assert abs(after.value[0] - BODY.mass) < 4 * sigmas[1]


RECORDED = Recorder()


def weighed_recording(seed):
    """A recording in motion and weights on the same cells."""
    instruments = {**PAPER, "cables": changed(PAPER["cables"], calibration=CALIBRATION)}
    found = RECORDED(seed, instruments=instruments)
    drawn = RECORDED.drawn["run"]["cables"].calibration
    gain = drawn["gain"] * drawn["common_gain"]
    drawn = gain, drawn["offset"]
    table, _, _ = hung(10_000 + seed, drawn=drawn, stated=seed % 2 == 0)
    return found, table


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.integration
def test_every_method_knows_the_mass_better():
    found, table = weighed_recording(0)
    weighed = identify(replace(found, weights=(table,)), "all")
    for name, estimate in weighed.estimates.items():
        if name == "two-step":
            assert any("does not use the dead weights on cables" in n for n in estimate.notes)
            continue
        assert estimate.standard_deviation[0] < 0.15
        assert abs(estimate.value[0] - BODY.mass) < 4 * estimate.standard_deviation[0]
        assert any("24 readings of cables under dead weights" in note for note in estimate.notes)
        budget = estimate.details["uncertainty_budget"]
        assert budget["gains, offsets and gravity after dead weights"]["mass"] > 0.5
    assert weighed.bound.standard_deviation[0] < 0.15
    alone = identify(found, "least-squares").estimate
    assert alone.standard_deviation[0] > 0.8


@pytest.mark.slow
@pytest.mark.long
def test_intervals_of_the_body_cover():
    chi, z = [], []
    for seed in range(24):
        found, table = weighed_recording(seed)
        estimate = identify(replace(found, weights=(table,)), "least-squares").estimate
        off = estimate.value - BODY.body_parameters
        chi.append(off @ np.linalg.solve(estimate.covariance, off) / len(off))
        z.append(off[0] / estimate.standard_deviation[0])
    print(f"chi-square {np.mean(chi):.2f}, mass {np.sqrt(np.mean(np.square(z))):.2f} sigma rms")
    assert 0.8 < np.mean(chi) < 1.2
    assert 0.75 < np.sqrt(np.mean(np.square(z))) < 1.25
