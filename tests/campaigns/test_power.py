"""How often the verdict rejects what was made wrong, by counting rows; intervals by SciPy's."""

import json

import numpy as np
import pytest
from campaign_work import here
from drawn_estimates import covariance
from recordings import write_small
from scipy.stats import binomtest

from steelyard.campaigns.rows import frame
from steelyard.campaigns.study.power import SOUND, mistaken, rejections, wilson_interval
from steelyard.campaigns.study.run import study
from steelyard.errors import InputError
from steelyard.inertia import BODY_PARAMETERS

TRUTH = np.array([160, 0, -0.08, -0.12, 95, 89, 32, 4, 0, 0])
KN, HAND = "forces in kN", "a hand on the platform"


@pytest.mark.parametrize(("hits", "count"), [(0, 2), (3, 8), (100, 100), (1, 200)])
def test_intervals_are_those_of_scipy(hits, count):
    found = binomtest(hits, count).proportion_ci(0.95, method="wilson")
    np.testing.assert_allclose(wilson_interval(hits, count), found, atol=1e-12)


def test_nothing_counted_says_nothing():
    assert wilson_interval(0, 0) == (0.0, 1.0)


def row(draw, mistake, *, accepted, sigmas_off=0.0):
    C = covariance(np.random.default_rng(0))
    sigma = np.sqrt(np.diag(C))
    value = TRUTH + np.eye(10)[0] * sigmas_off * sigma
    return {
        "experiment": mistaken(draw, mistake), "status": "done", "method": "consistent",
        "accepted": accepted, "covariance": C.ravel().tolist(),
        **dict(zip(BODY_PARAMETERS, value.tolist(), strict=True)),
    }  # fmt: skip


def test_rejections_refusals_and_what_is_accepted_though_wrong_are_counted():
    rows = [row(f"draw-{i}", SOUND, accepted=i > 0) for i in range(4)]
    rows += [row(f"draw-{i}", HAND, accepted=True, sigmas_off=9.0 * (i > 1)) for i in range(4)]
    rows += [row("draw-0", KN, accepted=False, sigmas_off=1e3)]
    rows += [{"experiment": f"draw-1/{KN}", "status": "refused", "method": "", "reason": "no"}]
    rows += [{"experiment": f"draw-2/{KN}", "status": "lost", "method": "", "reason": "no"}]
    found = {each.mistake: each for each in rejections(frame(rows), TRUTH, [KN, HAND])}
    counts = {name: (each.count, each.rejected, each.wrong) for name, each in found.items()}
    assert counts == {SOUND: (4, 1, 0), KN: (2, 2, 0), HAND: (4, 0, 2)}


def test_parameters_without_numbers_claim_nothing():
    wrong = {**row("draw-0", HAND, accepted=True, sigmas_off=50.0), "mass": None}
    wrong["covariance"] = [
        None if i < 10 or i % 10 == 0 else c for i, c in enumerate(wrong["covariance"])
    ]
    (_, found) = rejections(frame([wrong]), TRUTH, [HAND])
    assert (found.count, found.wrong) == (1, 0)


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    folder = tmp_path_factory.mktemp("robot")
    write_small(folder)
    return folder / "robot.yaml"


@pytest.mark.integration
def test_a_study_with_a_mistake_counts_it_apart(robot, tmp_path):
    keys = {"duration": 3.0, "engine": here}
    found = study(robot, tmp_path / "a", 2, "two-step", mistakes=KN, **keys)
    assert found.draws == 2
    assert found.methods["two-step"].count == 2
    sound, made = found.rejections
    assert (sound.mistake, sound.count, sound.rejected) == (SOUND, 2, 0)
    assert (made.mistake, made.count, made.rejected) == (KN, 2, 2)
    written = json.loads((tmp_path / "a" / "study.json").read_text())
    assert written["rejections"][1]["mistake"] == KN
    assert KN in (tmp_path / "a" / "study.html").read_text()


def test_wrong_names_of_mistakes_are_said_with_all_that_there_are(robot, tmp_path):
    with pytest.raises(InputError, match=r"mistake: expected one of forces in kN, .* found 'x'"):
        study(robot, tmp_path / "a", 2, mistakes="x", engine=here)
    with pytest.raises(InputError, match="mistakes: expected draws"):
        study(write_small(tmp_path / "s"), tmp_path / "a", bootstrap=5, mistakes="all", engine=here)
    assert not (tmp_path / "a").exists()
