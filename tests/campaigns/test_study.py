"""Studies: what draws say of stated uncertainties, once each, by the numbers and in words."""

import json
import re

import numpy as np
import polars as pl
import pytest
from campaign_work import here
from drawn_estimates import covariance
from grids import columns, is_a_deviation
from places import DATA
from recordings import simulated, write_small

from steelyard.campaigns.rows import TABLE, frame
from steelyard.campaigns.study.document import study_document
from steelyard.campaigns.study.draw import BOUND, drawn
from steelyard.campaigns.study.resample import resampled
from steelyard.campaigns.study.result import Study
from steelyard.campaigns.study.run import study
from steelyard.campaigns.study.setup import Setup, setup_of_experiment, setup_of_robot
from steelyard.campaigns.study.summary import summaries
from steelyard.digits import LABELS
from steelyard.errors import InputError
from steelyard.experiment.read import read_experiment
from steelyard.identification.identify import identify
from steelyard.inertia import BODY_PARAMETERS

TRUTH = np.array([160, 0, -0.08, -0.12, 95, 89, 32, 4, 0, 0])
TWO_STEP = "two-step"


def rows(n, factor=1.0, seed=0):
    """Estimates whose stated sigmas are smaller than the true ones by a factor."""
    rng = np.random.default_rng(seed)
    for i in range(n):
        C = covariance(rng)
        value = rng.multivariate_normal(TRUTH, C, method="cholesky")
        stated = C / factor**2
        sigma = np.sqrt(np.diag(stated))
        names = [f"sigma_{p}" for p in BODY_PARAMETERS]
        common = {"experiment": f"draw-{i:06}", "status": "done"}
        yield {
            **common, "method": "consistent", "accepted": i % 4 > 0,
            "covariance": stated.ravel().tolist(),
            **dict(zip(BODY_PARAMETERS, value.tolist(), strict=True)),
            **dict(zip(names, sigma.tolist(), strict=True)),
        }  # fmt: skip
        yield {
            **common,
            "method": BOUND,
            **dict(zip(names, (sigma * factor).tolist(), strict=True)),
        }


def test_true_sigmas_are_found_consistent():
    found = summaries(frame(rows(400)), {"consistent": TRUTH})["consistent"]
    assert (found.count, found.accepted, found.rejected) == (400, 300, 100)
    # A binomial, a chi-square and the mean of one, four standard deviations each.
    np.testing.assert_allclose(found.coverage, 0.95, atol=4 * np.sqrt(0.95 * 0.05 / 400))
    np.testing.assert_allclose(found.chi_square, 1.0, atol=4 * np.sqrt(2 / 400))
    assert found.joint == pytest.approx(10, abs=4 * np.sqrt(20 / 400))
    np.testing.assert_allclose(found.rmse / found.bound, 1.0, atol=0.15)
    assert {found.outcome(p) for p in range(10)} == {"consistent"}


@pytest.mark.parametrize(("factor", "said"), [(1.4, "too small"), (0.7, "too large")])
def test_sigmas_that_are_not_true_are_named(factor, said):
    found = summaries(frame(rows(400, factor)), {"consistent": TRUTH})["consistent"]
    assert [found.outcome(p) for p in range(10)] == [said] * 10
    np.testing.assert_allclose(found.chi_square, factor**2, rtol=0.3)


@pytest.mark.parametrize("bootstrap", [False, True])
def test_errors_are_written_with_the_digits_that_the_draws_leave(bootstrap, tmp_path):
    methods = summaries(frame(rows(400)), {"consistent": TRUTH})
    document = study_document(Study("cogiro", tmp_path, 400, bootstrap, TRUTH, methods, ()))
    deviations = columns(document, r"^rmse$|^scatter$|^stated 1-sigma$|^bound$")
    assert len(deviations) == 20 if bootstrap else 30
    assert [text for text in deviations if not is_a_deviation(text)] == []
    ratios = columns(document, "rmse / bound|coverage|chi-square|scatter / stated")
    assert all(re.fullmatch(r"\d+\.\d\d", text) for text in ratios)
    # The mean error is known twenty times as well as a single one.
    of_mean = methods["consistent"].rmse / 20
    for text, sigma, (_, _, factor) in zip(
        columns(document, "^bias$|^mean shift$"), of_mean, LABELS, strict=True
    ):
        last = 10.0 ** -len(text.partition(".")[2])
        assert last <= sigma * factor / 10 * (1 + 1e-9) < 10 * last


def test_parameters_without_numbers_are_null():
    table = [{**row, "Jyz": None, "sigma_Jyz": None} for row in rows(10)]
    found = summaries(frame(table), {"consistent": TRUTH})["consistent"].to_dict()
    assert found["parameters"]["Jyz"] == {
        "count": 0, "bias": None, "rmse": None, "stated": None, "bound": None, "coverage": None,
        "chi_square": None,
    }  # fmt: skip
    assert (found["joint_chi_square"], found["joint_count"]) == (None, 0)


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    folder = tmp_path_factory.mktemp("robot")
    write_small(folder)
    return folder / "robot.yaml"


def studied(robot, out, draws=3, **keys):
    keys = {"duration": 3.0, "engine": here, **keys}
    return study(robot, out, draws, TWO_STEP, **keys)


@pytest.mark.slow
@pytest.mark.long
def test_draws_are_simulated_once_and_gone_on_with(robot, tmp_path):
    first = studied(robot, tmp_path / "a", 2)
    assert (first.draws, list(first.methods), first.problems) == (2, [TWO_STEP], ())
    worked = []

    def counting(work, tasks):
        for task in tasks:
            worked.append(task.name)
            yield task, work(task)

    again = studied(robot, tmp_path / "a", 3, engine=counting)
    assert worked == ["draw-000002"]
    whole = studied(robot, tmp_path / "b", 3)
    tables = [pl.read_parquet(each.table).drop("seconds") for each in (again, whole)]
    assert tables[0].equals(tables[1])
    assert again.to_dict() == whole.to_dict()
    assert json.loads((tmp_path / "a" / "study.json").read_text()) == again.to_dict()
    for name in ("study.html", "study.md"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    # Another motion is another study, of which the old rows say nothing.
    other = studied(robot, tmp_path / "a", 2, duration=2.5, engine=counting)
    assert other.draws == 2
    assert worked[1:] == ["draw-000000", "draw-000001"]


@pytest.mark.integration
def test_an_experiment_is_simulated_as_it_was_recorded(tmp_path):
    path = write_small(tmp_path / "small")
    setup = setup_of_experiment(path, tmp_path / "out")
    experiment = drawn(setup, 5)
    real = simulated()
    assert set(experiment.instruments) == {"cables", "imu", "tracker"}
    assert experiment.instruments["imu"].rate == pytest.approx(25.0, rel=0.01)
    # The motion, held at both ends, reaches as far.
    first, second = (
        np.ptp(e.runs[0].streams["tracker"].values["position"], axis=0) for e in (real, experiment)
    )
    np.testing.assert_allclose(second, first, atol=0.1)
    np.testing.assert_allclose(setup.robot_of().platform.mass, real.robot.platform.mass, rtol=0.05)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.integration
@pytest.mark.parametrize("name", ["four-cables-00", "three-cables-00"])
def test_a_platform_that_swings_is_simulated_as_it_was_recorded(name, tmp_path):
    path = DATA / "rough-robots" / name / "experiment.yaml"
    setup = setup_of_experiment(path, tmp_path / "out")
    real, experiment = read_experiment(path), drawn(setup, 5)
    reach, width = (
        np.ptp(e.runs[0].streams["tracker"].values["position"], axis=0) for e in (real, experiment)
    )
    np.testing.assert_allclose(width, reach, atol=0.1 * reach.max())
    # Geometry lies off as is stated: that is no reason to reject.
    estimate = identify(experiment, ["maximum-likelihood"]).estimate
    assert estimate.verdict.accepted
    off = estimate.value - setup.robot_of().platform.body_parameters
    assert off @ np.linalg.solve(estimate.covariance, off) < 10 * 3.0


def test_the_geometry_that_records_is_drawn_about_the_described_one(robot):
    setup = setup_of_robot(str(robot), "paper", "multisine", 2.0)
    exact = drawn(setup, 1)
    uncertainty = (("anchor", 0.01), ("attachment", 0.0), ("gravity", 0.0))
    inexact = drawn(Setup(setup.robot, "paper", ("multisine",), 2.0, uncertainty), 1)
    np.testing.assert_array_equal(inexact.robot.anchors, exact.robot.anchors)
    assert inexact.uncertainty == dict(uncertainty)
    forces = [e.runs[0].streams["cables"].values["tension"] for e in (exact, inexact)]
    assert np.abs(forces[0] - forces[1]).max() > 0.5


def test_blocks_are_drawn_with_replacement():
    experiment = simulated()
    found = resampled(experiment, 0.5, np.random.default_rng(0))
    length = np.ptp(experiment.runs[0].streams["cables"].time)
    assert len(found.runs) == round(length / 0.5)
    starts = [run.streams["cables"].time[0] for run in found.runs]
    assert 1 < len(set(starts)) < len(starts)
    assert len({run.name for run in found.runs}) == len(found.runs)
    for run in found.runs:
        stream = run.streams["cables"]
        assert np.ptp(stream.time) < 0.6
        assert len(stream.values["tension"]) == len(stream.time)


@pytest.mark.integration
def test_a_bootstrap_is_about_the_estimate_of_the_whole(tmp_path):
    path = write_small(tmp_path / "small")
    found = study(path, tmp_path / "out", 0, TWO_STEP, bootstrap=3, block=0.7, engine=here)
    assert (found.draws, found.bootstrap, found.truth) == (3, True, None)
    table = pl.read_parquet(tmp_path / "out" / TABLE)
    assert table["experiment"].to_list() == ["draw-000000", "draw-000001", "draw-000002", "whole"]
    whole = table.filter(experiment="whole")["mass"][0]
    masses = table.filter(pl.col("experiment") != "whole")["mass"].to_numpy()
    assert found.methods[TWO_STEP].bias[0] == pytest.approx((masses - whole).mean())


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"draws": 0}, "expected at least two draws"),
        ({"draws": 2, "bootstrap": 2}, "give one of both"),
        ({"draws": 0, "bootstrap": 5}, "expected an experiment file to draw recordings from"),
        ({"sensors": "guess"}, "sensors: expected"),
        ({"trajectory": "guess", "duration": None}, "trajectory: expected"),
        ({"duration": 1e6}, "duration: expected"),
    ],
)
def test_wrong_studies_of_a_robot_are_refused_before_anything_is_written(
    keys, said, robot, tmp_path
):
    with pytest.raises(InputError, match=said):
        studied(robot, tmp_path / "out", **keys)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"draws": 2, "sensors": "paper"}, "sensors: expected none with an experiment"),
        ({"draws": 2, "duration": 3.0}, "duration: expected none with an experiment"),
        ({"bootstrap": 3}, "expected at least 5 runs or blocks to draw from, found 1 runs"),
    ],
)
def test_wrong_studies_of_an_experiment_are_refused(keys, said, tmp_path):
    path = write_small(tmp_path / "small")
    with pytest.raises(InputError, match=said):
        study(path, tmp_path / "out", **{"methods": TWO_STEP, "engine": here, **keys})
    assert not (tmp_path / "out").exists()


def test_noise_that_is_not_stated_is_asked_for(tmp_path):
    path = write_small(tmp_path / "small")
    path.write_text(path.read_text().replace("    noise: 0.0005\n", ""))
    with pytest.raises(InputError, match=r"instruments\.tracker: expected the key 'noise'"):
        study(path, tmp_path / "out", 2, TWO_STEP, engine=here)
