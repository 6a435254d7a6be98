"""The report of an identification: what it says is what was found, in all its forms, for whatever
names and values."""

import json
import math
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from recordings import RUN, write_small

from steelyard.digits import LABELS
from steelyard.errors import InputError
from steelyard.experiment.read import read_experiment
from steelyard.identification.identify import identify
from steelyard.identification.methods.least_squares import LeastSquares
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.methods.two_step import TwoStep
from steelyard.inspection.identify import identify as identify_checked
from steelyard.report.blocks.document import Figure, Grid, Scene
from steelyard.report.documents.identification import brief_of, document_of
from steelyard.report.evidence.gather import evidence_of
from steelyard.report.evidence.made import made_of
from steelyard.report.evidence.report_file import read_summary, write_summary
from steelyard.report.evidence.summary import summarise
from steelyard.report.evidence.thinning import THINNING
from steelyard.report.forms.markdown import markdown
from steelyard.report.forms.page import page
from steelyard.report.write import write_report

pytestmark = pytest.mark.integration

HOSTILE = "<script>alert(1)</script>"


@pytest.fixture(scope="module")
def experiment(tmp_path_factory):
    return read_experiment(write_small(tmp_path_factory.mktemp("small")))


@pytest.fixture(scope="module")
def identification(experiment):
    return identify(experiment)


@pytest.fixture(scope="module")
def summary(identification, experiment):
    return summarise(
        identification, experiment.robot.platform, made=made_of(experiment, {"method": "all"})
    )


@pytest.fixture(scope="module")
def document(summary):
    return document_of(summary)


@pytest.fixture(scope="module")
def folder(summary, tmp_path_factory):
    found = tmp_path_factory.mktemp("report")
    write_report(summary, found)
    return found


class Tables(HTMLParser):
    """Cells of all tables of a page, by caption."""

    def __init__(self):
        super().__init__()
        self.tables, self.open, self.text = {}, "", ""

    def handle_starttag(self, tag, attributes):
        if tag == "caption":
            self.rows = []
        if tag == "tr":
            self.rows.append([])
        if tag in {"caption", "td", "th"}:
            self.open, self.text = tag, ""

    def handle_data(self, data):
        self.text += data

    def handle_endtag(self, tag):
        if tag == "caption":
            self.tables[self.text.strip()] = self.rows
        elif tag in {"td", "th"}:
            self.rows[-1].append(self.text.strip())


def tables_of(html):
    parser = Tables()
    parser.feed(html)
    return parser.tables


def test_all_sections_are_there(document):
    names = [section.name for section in document.sections]
    assert names == [
        "result",
        "platform",
        "wrench",
        "residuals",
        "budget",
        "calibration",
        "correlation",
        "made",
    ]
    figures = [
        block
        for section in document.sections
        for block in section.blocks
        if isinstance(block, Figure | Scene)
    ]
    flat = [block.figure if isinstance(block, Scene) else block for block in figures]
    assert len({figure.name for figure in flat}) == len(flat)
    assert all(figure.alternative and figure.title for figure in flat)
    assert any(isinstance(block, Scene) and block.courses for block in figures)
    for section in document.sections:
        for block in section.blocks:
            if isinstance(block, Grid):
                assert {len(row) for row in block.rows} == {len(block.head)}


def test_all_forms_have_the_same_numbers(summary, folder):
    """What JSON holds is what tables show, rounded to the digits that they show."""
    kept = json.loads((folder / "report.json").read_text())["summary"]
    table = tables_of((folder / "report.html").read_text())[kept["table"]["title"]]
    lines = [
        line for line in (folder / "report.md").read_text().splitlines() if line.startswith("|")
    ]
    shown = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in lines[: len(LABELS) + 2]
    ]
    del shown[1]
    assert table == shown
    for row, cells in enumerate(table[1:]):
        numbers = [float(cell.split(" ± ")[0]) if cell != "-" else None for cell in cells[2:]]
        deviations = [float(cell.split(" ± ")[1]) for cell in cells[2:] if " ± " in cell]
        expected, sigmas = [], []
        for column in kept["table"]["columns"]:
            expected.append(column["values"][row])
            sigmas += [column["deviations"][row]] if column["deviations"] else []
            expected += [column["errors"][row]] if column["errors"] else []
        for number, value, cell in zip(numbers, expected, cells[2:], strict=True):
            digits = len(cell.split(" ")[0].partition(".")[2])
            assert math.isclose(number, value, abs_tol=0.5000001 * 10**-digits, rel_tol=1e-5)
        np.testing.assert_allclose(deviations, sigmas, rtol=0.06)


def test_numbers_are_those_of_the_estimate(summary, identification):
    estimate = identification.estimates["maximum-likelihood"]
    assert summary.best.value == tuple(estimate.value)
    assert np.array(summary.best.covariance) == pytest.approx(estimate.covariance)
    lead = document_of(summary).lead
    assert lead.tone == "good"
    assert f"{estimate.value[0]:.2f}" in lead.text


def test_the_same_input_gives_the_same_bytes(summary, experiment, folder, tmp_path):
    again = summarise(
        identify(experiment), experiment.robot.platform, made=made_of(experiment, {"method": "all"})
    )
    write_report(again, tmp_path)
    for name in ("report.json", "report.html", "report.md"):
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes()


def test_what_is_written_is_read_again(summary, folder):
    assert read_summary(folder) == summary
    assert page(document_of(read_summary(folder))) == (folder / "report.html").read_text()


def test_the_page_is_small_and_needs_nothing(folder):
    html = (folder / "report.html").read_text()
    assert len(html) < 8e6
    without = re.sub(r"<script\b.*?</script>", "", html, flags=re.S)
    assert not re.search(r"""(?:src|href)\s*=\s*(?!["']?(?:#|data:))""", without)


def test_files_that_were_read_are_named_without_their_place(summary):
    names = [each.name for each in summary.made.inputs]
    assert names == ["experiment.yaml", "robot 'straight', as it was understood", "robot.yaml", *(f"{RUN}/{n}.csv" for n in ("cables", "imu", "tracker"))]  # fmt: skip
    assert all(len(each.sha256) == 64 and each.size > 0 for each in summary.made.inputs)


def test_names_stay_text(experiment):
    named = replace(
        experiment, name=HOSTILE, runs=tuple(replace(run, name=HOSTILE) for run in experiment.runs)
    )
    document = document_of(summarise(identify(named, [TwoStep()])))
    html = page(document)
    assert HOSTILE not in html
    assert "&lt;script&gt;alert(1)" in html
    assert HOSTILE not in markdown(document)


def test_report_draws_again(run, folder, tmp_path):
    drawn = tmp_path / "copy"
    drawn.mkdir()
    (drawn / "report.json").write_bytes((folder / "report.json").read_bytes())
    (drawn / "notes.txt").write_text("mine")
    status, out, err = run("report", drawn)
    assert (status, err) == (0, "")
    assert "report.html" in out
    assert sorted(p.name for p in drawn.iterdir()) == [
        "notes.txt",
        "report.html",
        "report.json",
        "report.md",
    ]
    for name in ("report.html", "report.md"):
        assert (drawn / name).read_bytes() == (folder / name).read_bytes()
    status, out, _ = run("report", drawn, "--json")
    assert json.loads(out)["written"] == [str(drawn / "report.html"), str(drawn / "report.md")]


def broken(path, value):
    def change(kept):
        *keys, last = path
        for key in keys:
            kept = kept[key]
        kept[last] = value

    return change


SUMMARY = ("summary",)
TRACE = ("summary", "evidence", "traces", 0)
MISTAKES = {
    "another format": (broken(["format"], "steelyard-report/2"), "format"),
    "no format": (lambda kept: kept.pop("format"), "format"),
    "no summary": (lambda kept: kept.pop("summary"), "summary"),
    "text for a number": (broken([*SUMMARY, "bodies", 0, "value"], ["x"] * 10), "bodies"),
    "infinite": (broken([*TRACE, "measured", 0, 0], 1e999), "measured"),
    "nine values": (
        broken([*SUMMARY, "bodies", 0, "value"], [1.0] * 9),
        "10 items after validation, not 9",
    ),
    "no such result": (broken([*SUMMARY, "result"], "best"), "name of one of the bodies"),
    "short channel": (broken([*TRACE, "measured", 0], [1.0]), "channels"),
    "sample that is not there": (broken([*TRACE, "left_out"], [[0, 10**9]]), "places of samples"),
    "negative place": (broken([*TRACE, "left_out"], [[-1, 0]]), "places of samples"),
    "times without poses": (broken([*SUMMARY, "evidence", "motions", 0, "position"], []), "poses"),
    "cables of one end": (broken([*SUMMARY, "evidence", "shape", "anchors"], []), "attachments"),
    "short column": (
        broken([*SUMMARY, "table", "columns", 0, "values"], [1.0]),
        "columns.0.values: ",
    ),
    "nominal of three": (broken([*SUMMARY, "nominal"], [1.0, 2.0, 3.0]), "nominal: "),
}


@pytest.mark.parametrize(("change", "said"), MISTAKES.values(), ids=MISTAKES.keys())
def test_mistakes_in_the_summary_are_named(run, folder, tmp_path, change, said):
    kept = json.loads((folder / "report.json").read_text())
    change(kept)
    text = json.dumps(kept).replace("Infinity", "1e999")
    (tmp_path / "report.json").write_text(text)
    status, out, err = run("report", tmp_path)
    assert (status, out) == (2, "")
    assert err.count("\n") == 1
    assert said in err
    assert "identify" in err
    assert [p.name for p in tmp_path.iterdir()] == ["report.json"]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "JSON"),
        (b"{" * 100_000, "JSON|lists too deep"),
        (b"[" * 100_000, "lists too deep"),
        (b"\xff\xfe", "UTF-8"),
        (b'{"format": NaN}', "NaN"),
        (b"[]", "expected a summary"),
        (b"null", "expected a summary"),
    ],
)
def test_what_is_no_summary_is_said(run, tmp_path, content, said):
    (tmp_path / "report.json").write_bytes(content)
    status, _, err = run("report", tmp_path)
    assert status == 2
    assert re.search(said, err)
    assert err.count("\n") == 1


def test_a_folder_without_results_is_said(run, tmp_path):
    for place in (tmp_path, tmp_path / "nowhere", tmp_path / "file"):
        (tmp_path / "file").write_text("")
        status, _, err = run("report", place)
        assert status == 2
        assert "identify" in err


def test_a_rejected_estimate_says_so_first(summary):
    bad = replace(
        summary,
        bodies=tuple(replace(b, accepted=False, reasons=("the moon",)) for b in summary.bodies),
    )
    lead = document_of(bad).lead
    assert lead.tone == "bad"
    assert lead.text.startswith("Not accepted: the moon.")


def test_what_is_not_identifiable_is_no_number(summary):
    nothing = (None,) * 10
    body = replace(
        summary.best, value=nothing, covariance=(nothing,) * 10, labels=("unidentifiable",) * 10, accepted=False, reasons=("no data",)
    )  # fmt: skip
    document = document_of(replace(summary, bodies=(body,), result=body.name))
    assert "correlation" not in {section.name for section in document.sections}
    assert "mass not identifiable" in document.lead.text
    text = markdown(document)
    assert "Not identifiable from these data" in text
    assert "nan" not in text.lower().replace("nan=", "").replace("provenance", "")


def test_two_steps_alone_have_a_report_too(experiment):
    identification = identify(experiment, [TwoStep()])
    evidence = evidence_of(identification)
    assert {each.instrument for each in evidence.traces} == {"platform"}
    assert evidence.motions
    assert evidence.errors == ()
    page(document_of(summarise(identification)))


def test_many_runs_are_bounded(experiment):
    """Numbers of the first runs are kept, however many there are."""
    many = replace(
        experiment,
        runs=tuple(
            replace(experiment.runs[0], name=f"run {i}") for i in range(THINNING.most_runs + 3)
        ),
    )
    evidence = evidence_of(identify(many, [TwoStep()]))
    assert evidence.not_drawn == 3
    assert len({each.run for each in evidence.traces}) == THINNING.most_runs


@pytest.mark.parametrize("method", [LeastSquares, MaximumLikelihood])
def test_runs_that_are_not_shown_do_no_harm(experiment, method):
    run = experiment.runs[0]
    evidence = evidence_of(
        identify(replace(experiment, runs=(run, replace(run, name="again"))), [method()]),
        replace(THINNING, most_runs=1),
    )
    assert (
        {each.run for each in evidence.traces}
        == {each.run for each in evidence.motions}
        == {run.name}
    )
    assert {each.instrument for each in evidence.traces} >= {"platform", "imu", "tracker"}
    assert evidence.not_drawn == 1


def test_a_summary_with_an_infinite_number_is_refused(summary, tmp_path):
    path = tmp_path / "report.json"
    write_summary(summary, path)
    path.write_text(path.read_text().replace('"sigmas":', '"sigmas":1e999,"was":', 1))
    with pytest.raises(InputError, match="sigmas"):
        read_summary(tmp_path)


def test_identify_with_clocks_found_says_them(experiment):
    apart = replace(
        experiment,
        runs=tuple(replace(run, sync={}, unsynchronised=True) for run in experiment.runs),
    )
    evidence = evidence_of(identify(apart, [MaximumLikelihood()]))
    assert any(clock.found for clock in evidence.clocks)


@pytest.mark.slow
def test_a_reason_that_methods_share_is_said_once(experiment):
    wrong = replace(experiment, robot=replace(experiment.robot, gravity=-experiment.robot.gravity))
    found = identify_checked(wrong, ["two-step", "maximum-likelihood"])
    (reason, *_) = found.estimate.verdict.reasons
    brief = brief_of(summarise(found))
    blocks = [str(block) for section in brief.sections for block in section.blocks]
    assert reason in brief.lead.text
    assert not any(reason in block for block in blocks)
    assert any("not accepted, as said above" in block for block in blocks)
