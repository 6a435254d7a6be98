"""Where things stand in the report: the result first, remarks folded, one run at a time; what is
under its title; and on paper.
"""

import json
import os
import stat
from dataclasses import replace
from datetime import UTC, datetime

import pytest
from browser import look, open_page, until
from recordings import write_small
from written_summary import METHODS, summary, traces

from steelyard.errors import InputError
from steelyard.experiment.read import read_experiment
from steelyard.report import pdf
from steelyard.report.blocks.document import Fold, Grid, OneOf, flat
from steelyard.report.documents.identification import document_of
from steelyard.report.documents.sections.intervals import intervals
from steelyard.report.evidence.made import made_of, with_facts
from steelyard.report.forms.markdown import markdown
from steelyard.report.forms.page import page
from steelyard.report.write import write_report

RUNS = tuple(f"run {i}" for i in range(8))


def with_runs(runs=RUNS, methods=2):
    found = summary(methods)
    return replace(found, evidence=replace(found.evidence, traces=traces(runs)))


def test_remarks_and_runs_are_folded_and_verdicts_are_not():
    (result,) = (s for s in document_of(summary(2)).sections if s.name == "result")
    verdicts = [each.text for each in result.blocks[0].items]
    assert verdicts == [f"{name}: accepted" for name in METHODS[:2]]
    folds = {block.title: block for block in result.blocks if isinstance(block, Fold)}
    assert list(folds) == ["One remark", "Each run alone"]
    assert "weight of the cables" in folds["One remark"].blocks[0].items[0].text
    grids = [block for block in result.blocks if isinstance(block, Grid)]
    # The result is the first column of numbers.
    assert grids[0].head[2].startswith("maximum-likelihood")


def test_one_run_at_a_time():
    (section,) = (s for s in document_of(with_runs()).sections if s.name == "residuals")
    (choice,) = (block for block in section.blocks if isinstance(block, OneOf))
    assert tuple(name for name, _ in choice.options) == RUNS
    (alone,) = (s for s in document_of(with_runs(RUNS[:1])).sections if s.name == "residuals")
    assert not any(isinstance(block, OneOf) for block in alone.blocks)
    one = [type(block) for block in choice.options[0][1]]
    assert one == [type(block) for block in flat(alone.blocks)][-len(one) :]


def test_markdown_has_all_runs_under_headings():
    text = markdown(document_of(with_runs()))
    for run in RUNS:
        assert f"### Run {run}\n" in text


def test_rows_of_intervals_have_names_in_both_layouts():
    figure = intervals(summary(6))
    names = [*METHODS, "smallest possible"]
    for layout in (figure.layout, figure.narrow.layout):
        for i in range(10):
            axis = layout[f"yaxis{'' if not i else i + 1}"]
            assert axis["ticktext"] == names
            assert axis["tickvals"] == [6, 5, 4, 3, 2, 1, 0]
    # Marks stand at the heights of their names.
    for trace in figure.data:
        if trace["mode"] == "markers":
            assert trace["y"] == [6 - names.index(trace["name"])]
            assert not trace["showlegend"]
    lefts = {figure.narrow.layout[f"xaxis{i}"]["domain"][0] for i in range(2, 11)}
    assert lefts == {0.0}


def test_project_operator_and_date_stand_under_the_title():
    made = with_facts(summary(1).made, {"operator": "A. <b>", "project": "Crane 4", "date": None})
    assert made.facts == (("project", "Crane 4"), ("operator", "A. <b>"))
    document = document_of(replace(summary(1), made=made))
    text = page(document)
    assert text.index("Crane 4") < text.index('class="lead')
    assert "<dd>A. &lt;b&gt;</dd>" in text
    assert "project: Crane 4; operator: A. &#60;b&#62;" in markdown(document)
    assert with_facts(made, {"operator": "B"}).facts == (("project", "Crane 4"), ("operator", "B"))


def test_the_date_is_that_of_the_recording_and_never_of_today(tmp_path):
    experiment = read_experiment(write_small(tmp_path / "small"))
    assert made_of(experiment, {}).facts == ()
    day = datetime(2025, 3, 7, 12, tzinfo=UTC).timestamp()
    runs = tuple(
        replace(
            run,
            streams={n: replace(s, time=s.time - s.time[0] + day) for n, s in run.streams.items()},
        )
        for run in experiment.runs
    )
    dated = replace(experiment, runs=runs)
    assert made_of(dated, {}).facts == (("date", "2025-03-07"),)
    assert made_of(dated, {}, {"date": "2025-03-08"}).facts == (("date", "2025-03-08"),)


@pytest.fixture
def folder(tmp_path):
    write_report(summary(2), tmp_path)
    return tmp_path


def test_report_takes_what_stands_under_the_title(run, folder):
    before = (folder / "report.json").read_bytes()
    status, _, err = run("report", folder, "--operator", "A. Smith", "--date", "2026-05-31")
    assert (status, err) == (0, "")
    assert "<dd>A. Smith</dd>" in (folder / "report.html").read_text()
    assert (folder / "report.json").read_bytes() == before
    status, _, err = run("report", folder, "--date", "31.5.2026")
    assert status == 2
    assert err == (
        "steelyard: --date: expected a day such as 2026-05-31, found '31.5.2026'; correct it\n"
    )


class TestPdf:
    def test_without_a_browser_one_sentence(self, run, folder, monkeypatch):
        monkeypatch.setattr(pdf.shutil, "which", lambda _: None)
        before = sorted(path.name for path in folder.iterdir())
        status, out, err = run("report", folder, "--pdf")
        assert (status, out) == (2, "")
        assert err.count("\n") == 1
        assert "--pdf: expected an installed browser (chromium, chromium-browser" in err
        assert sorted(path.name for path in folder.iterdir()) == before

    def program(self, folder, text):
        path = folder / "browser"
        path.write_text(f"#!/bin/sh\n{text}\n")
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
        return str(path)

    @pytest.mark.parametrize(
        ("text", "patience", "said"),
        [
            ("exit 1", 60, "expected a PDF file from browser, found none"),
            ("exec sleep 60", 0.2, "expected browser to print within 0.2 s"),
        ],
    )
    def test_a_browser_that_fails_is_one_sentence(self, tmp_path, text, patience, said):
        browser = self.program(tmp_path, text)
        html = tmp_path / "a.html"
        html.write_text("<p>a</p>")
        with pytest.raises(InputError, match=said):
            pdf.write_pdf(html, tmp_path / "a.pdf", browser, patience=patience)
        assert not (tmp_path / "a.pdf").exists()

    @pytest.mark.parametrize("root", [True, False])
    def test_only_root_has_no_sandbox(self, tmp_path, monkeypatch, root):
        browser = self.program(tmp_path, f'echo "$@" > {tmp_path}/given; exit 1')
        monkeypatch.setattr(os, "geteuid", lambda: 0 if root else 1000)
        with pytest.raises(InputError):
            pdf.write_pdf(tmp_path / "a.html", tmp_path / "a.pdf", browser)
        assert ("--no-sandbox" in (tmp_path / "given").read_text()) == root


@pytest.fixture(scope="module")
def opened(driver, tmp_path_factory):
    path = tmp_path_factory.mktemp("looks") / "report.html"
    path.write_text(page(document_of(with_runs(methods=6))), encoding="utf-8")
    open_page(driver, path, width=1400)
    return driver


@pytest.mark.browser
class TestInBrowser:
    @pytest.mark.parametrize("width", [400, 1400])
    def test_the_result_is_seen_without_scrolling_sideways(self, opened, width):
        look(opened, width=width)
        right = opened.execute_script(
            "return [...document.querySelectorAll('#section-result tbody tr')].slice(0, 10)"
            ".map((row) => row.children[2].getBoundingClientRect().right)"
        )
        assert max(right) <= width
        assert opened.execute_script("return document.documentElement.scrollWidth") <= width

    def test_eight_runs_are_no_longer_than_one(self, opened):
        heights = opened.execute_script(
            "return [...document.querySelectorAll('.option')].map((each) => each.clientHeight)"
        )
        assert sum(height > 0 for height in heights) == 1

    def test_another_run_is_chosen(self, opened):
        opened.execute_script(
            "const s = document.querySelector('.chooser select'); s.value = 'run 5';"
            " s.dispatchEvent(new Event('change'))"
        )
        seen = opened.execute_script(
            "return [...document.querySelectorAll('.option')].filter((o) => !o.hidden)"
            ".map((o) => o.dataset.option)"
        )
        assert seen == ["run 5"]
        assert until(
            opened,
            "const p = document.querySelector('.option:not([hidden]) .plot');"
            " p.scrollIntoView(); return p.dataset.drawn",
        )

    @pytest.mark.slow
    def test_the_page_is_printed(self, run, folder):
        status, out, err = run("report", folder, "--pdf", "--json")
        assert (status, err) == (0, "")
        assert json.loads(out)["written"][-1] == str(folder / "report.pdf")
        printed = (folder / "report.pdf").read_bytes()
        assert printed.startswith(b"%PDF-")
        assert 1 <= printed.count(b"/Type /Page\n") <= 4
