"""The certificate: one page of what was measured, how well, and why."""

import base64
import json
import re

import pytest
from browser import open_page
from recordings import write_small

from steelyard.cli.verbs.report import report as report_verb
from steelyard.experiment.read import read_experiment
from steelyard.identification.identify import identify
from steelyard.report.blocks.document import Grid
from steelyard.report.documents.certificate import certificate_of
from steelyard.report.evidence.made import made_of
from steelyard.report.evidence.report_file import read_summary, write_summary
from steelyard.report.evidence.summary import summarise
from steelyard.report.forms.markdown import markdown
from steelyard.report.write import draw_certificate, write_identification

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module")
def identification(tmp_path_factory):
    path = write_small(tmp_path_factory.mktemp("small"))
    text = path.read_text()
    path.write_text(f"{text}known: {{mass: {{value: 161.1, sigma: 0.5}}}}\n")
    return identify(read_experiment(path))


@pytest.fixture(scope="module")
def summary(identification):
    return summarise(identification, made=made_of(identification.recorded, {"method": "all"}))


@pytest.fixture(scope="module")
def text(summary):
    return markdown(certificate_of(summary))


def grids(summary):
    blocks = [each for section in certificate_of(summary).sections for each in section.blocks]
    return {each.caption: each for each in blocks if isinstance(each, Grid)}


def test_it_says_what_and_how_well(summary, text):
    found = grids(summary)
    (ten,) = (grid for caption, grid in found.items() if caption.startswith("Platform"))
    assert [row[0] for row in ten.rows][:2] == ["mass", "centre of gravity x"]
    assert all(re.search("±", row[2]) or "not identifiable" in row[2] for row in ten.rows)
    assert found["Instruments"].rows[0][:2] == ("cables", "tension")
    assert summary.made.inputs[0].sha256 in text
    assert "1-sigma" in text


def test_the_budget_adds_up(summary):
    for i in range(10):
        shares = [each.shares[i] for each in summary.evidence.budget]
        assert sum(shares) == pytest.approx(1.0, abs=1e-3)
    names = {each.name for each in summary.evidence.budget}
    assert {"noise of cables", "offsets of cables", "the body beforehand"} <= names


def test_a_reference_is_checked(summary):
    (found,) = summary.evidence.known
    assert (found.name, found.stated, found.sigma) == ("mass", 161.1, 0.5)
    assert abs(found.z) < 4
    assert grids(summary)["Reference"].rows[0][0] == "mass"


def test_it_is_drawn_from_what_identify_wrote(identification, summary, tmp_path, capsys):
    write_identification(identification, summary, tmp_path)
    assert not (tmp_path / "certificate.html").exists()
    report_verb.main([str(tmp_path), "--certificate", "--json"], standalone_mode=False)
    written = json.loads(capsys.readouterr().out)["written"]
    assert [each.rpartition("/")[2] for each in written] == ["certificate.html", "certificate.md"]
    assert "<script" not in (tmp_path / "certificate.html").read_text()


def test_a_report_of_before_has_no_budget(summary, tmp_path):
    write_summary(summary, tmp_path / "report.json")
    values = json.loads((tmp_path / "report.json").read_text())
    for key in ("budget", "known", "instruments", "recorded"):
        del values["summary"]["evidence"][key]
    del values["summary"]["loads"]
    (tmp_path / "report.json").write_text(json.dumps(values))
    draw_certificate(read_summary(tmp_path), tmp_path)
    assert "Uncertainty budget" not in (tmp_path / "certificate.md").read_text()


@pytest.mark.browser
def test_it_prints_on_one_page(driver, summary, tmp_path):
    draw_certificate(summary, tmp_path)
    open_page(driver, tmp_path / "certificate.html")
    pdf = base64.b64decode(driver.print_page())
    assert len(re.findall(rb"/Type\s*/Page[^s]", pdf)) == 1
