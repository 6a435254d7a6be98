"""What is said of a result that another method contradicts."""

from dataclasses import replace

import numpy as np
import pytest
from written_estimates import file_of

from steelyard.estimates.estimate import Estimate, LoadEstimates, Verdict, judge, unassessed
from steelyard.estimates.file.estimate_file import read_estimate_file
from steelyard.estimates.joint_covariance import JointCovariance
from steelyard.identification.identification import Identification
from steelyard.identification.verdict.disagreement import with_disagreement
from steelyard.inertia import BODY_PARAMETERS
from steelyard.report.documents.identification import document_of
from steelyard.report.evidence.summary import summarise

TEN = np.array([10.0, 0, 0, 0, 1, 1, 1, 0, 0, 0])
LABELS = dict.fromkeys(BODY_PARAMETERS, "data")
ACCEPTED, REJECTED = (
    Verdict(True, (), LABELS),
    Verdict(False, ("anchor 2 z off by -.147 m",), LABELS),
)
BASELINE = unassessed(judge(TEN))


def estimate(method, verdict, value=TEN):
    return Estimate(method, value, np.eye(10) * 1e-4, verdict)


def methods(**verdicts):
    return {name: estimate(name, verdict) for name, verdict in verdicts.items()}


@pytest.mark.parametrize(("own", "other"), [(ACCEPTED, REJECTED), (REJECTED, ACCEPTED)])
def test_both_verdicts_are_said_with_their_reasons(own, other):
    found = with_disagreement(methods(best=own, second=other), "best")
    said = found["best"].verdict.disagreement
    assert said.startswith("the methods disagree: best is ")
    assert "anchor 2 z off by -.147 m" in said
    assert "no test of its residuals" in said
    assert found["best"].verdict.accepted is own.accepted
    assert str(found["best"].verdict).endswith(said)
    assert found["second"].verdict.disagreement == ""
    assert found["best"].to_dict()["verdict"]["disagreement"] == said


@pytest.mark.parametrize(
    ("own", "other"), [(ACCEPTED, ACCEPTED), (ACCEPTED, BASELINE), (BASELINE, REJECTED)]
)
def test_who_agrees_or_was_not_assessed_contradicts_nobody(own, other):
    found = with_disagreement(methods(best=own, second=other), "best")
    assert found["best"].verdict == own
    assert "disagreement" not in found["best"].to_dict()["verdict"]


def test_who_has_no_numbers_contradicts_nobody():
    both = {
        "best": estimate("best", ACCEPTED),
        "second": estimate("second", REJECTED, np.full(10, np.nan)),
    }
    assert with_disagreement(both, "best")["best"].verdict == ACCEPTED


def test_each_load_has_its_own():
    joint = JointCovariance(("a", "b"), np.eye(20))

    def of_loads(method, verdict):
        each = {"a": estimate(method, ACCEPTED), "b": estimate(method, verdict)}
        return replace(each["a"], loads=LoadEstimates(each, joint))

    found = with_disagreement(
        {"best": of_loads("best", ACCEPTED), "second": of_loads("second", REJECTED)}, "best"
    )["best"]
    assert found.verdict.disagreement == ""
    assert "anchor 2" in found.loads.estimates["b"].verdict.disagreement


def test_it_is_shown_and_read_back(tmp_path):
    both = methods(
        **{"maximum-likelihood": ACCEPTED, "least-squares": REJECTED, "two-step": BASELINE}
    )
    found = Identification("lab", None, with_disagreement(both, "maximum-likelihood"))
    lead = document_of(summarise(found, with_evidence=False)).lead
    assert "the methods disagree" in lead.text
    assert lead.tone == "note"
    assert not found.is_rejected
    best = found.estimate
    back = read_estimate_file(file_of(tmp_path, best)).estimates["maximum-likelihood"].estimate
    assert back.verdict.disagreement == best.verdict.disagreement


def test_the_assessed_methods_decide():
    nothing = np.full(10, np.nan)
    failed = estimate("maximum-likelihood", REJECTED, nothing)
    alone = {"two-step": estimate("two-step", BASELINE)}
    assert not Identification("lab", None, alone).is_rejected
    assert Identification("lab", None, {**alone, "maximum-likelihood": failed}).is_rejected
