"""Every number that was ever released: the files that are kept of it have the form of its schema,
and are still read.

A file in tests/data/formats is never changed; a further number gets further files.
"""

import json
import re
from copy import deepcopy

import polars as pl
import pytest
from jsonschema import Draft202012Validator
from places import DATA, PACKAGE
from ruamel.yaml import YAML

from steelyard.campaigns.journal import joined
from steelyard.cli.truth import known_truth
from steelyard.estimates.file.estimate_file import read_estimate_file
from steelyard.experiment.read import read_experiment
from steelyard.exports.exported import read_exported
from steelyard.formats.table import FORMATS, schema_of
from steelyard.logs.formats import open_log
from steelyard.provenance.record import read_provenance
from steelyard.report.evidence.report_file import read_summary
from steelyard.robot.file import read_robot

KEPT = DATA / "formats"
"""What the versions wrote that released these numbers; shortened, never changed."""
NUMBERED = {
    "estimate": "identified/estimate.json",
    "report": "identified/report.json",
    "provenance": "identified/provenance.json",
    "calibration": "calibrated/calibration.json",
    "comparison": "comparison.json",
    "inspection": "inspection.json",
    "frequencies": "frequencies.json",
    "body": "body.json",
    "truth": "truth.json",
    "watch": "watched/log.jsonl",
    "design": "design.json",
    "poses": "poses.json",
    "swings": "swings.json",
    "reference": "reference.json",
    "study": "study/study.json",
    "campaign": "campaign/campaign.json",
    "rows": "campaign/campaign.parquet",
    "stream": "tidy/cables.parquet",
    "records": "watched/log.parquet",
    "motion": "motion.parquet",
    "experiment": "experiment/experiment.yaml",
    "robot": "calibrated/robot.yaml",
}


def values_of(path):
    """What stands in a file: a list, of the rows of tables and the lines of others."""
    if path.suffix == ".parquet":
        return pl.read_parquet(path).to_dicts()
    if path.suffix == ".yaml":
        return [YAML(typ="safe").load(path)]
    text = path.read_text()
    return [json.loads(each) for each in (text.splitlines() if path.suffix == ".jsonl" else [text])]


def problems(name, values):
    return [each.message for each in Draft202012Validator(schema_of(name)).iter_errors(values)]


def test_there_is_a_file_of_every_number():
    assert NUMBERED.keys() == FORMATS.keys()
    written = set()
    for path in PACKAGE.rglob("*.py"):
        if path.parent.name != "formats":
            written |= set(re.findall(r"\bsteelyard(?:-[a-z]+)?/[0-9]+\b", path.read_text()))
    assert written == {kind.number for kind in FORMATS.values()}


@pytest.mark.parametrize("name", FORMATS)
def test_a_kept_file_has_the_form_of_its_schema(name):
    schema = schema_of(name)
    Draft202012Validator.check_schema(schema)
    path = KEPT / NUMBERED[name]
    for values in values_of(path):
        assert problems(name, values) == []
    if FORMATS[name].table:
        about = json.loads(pl.read_parquet_metadata(path)["steelyard"])
        assert about["format"] == FORMATS[name].number
    elif name != "robot":
        assert values_of(path)[0]["format"] == FORMATS[name].number


@pytest.mark.integration
@pytest.mark.parametrize("name", [name for name in FORMATS if name != "stream"])
def test_a_schema_refuses_what_lacks_a_key_or_has_another_kind_of_value(name):
    values = values_of(KEPT / NUMBERED[name])[0]
    needed = schema_of(name).get("required", [])
    assert needed
    for key in needed:
        other = deepcopy(values)
        del other[key]
        assert problems(name, other), key
        # Nothing that is written may be all of these.
        assert any(problems(name, {**values, key: other}) for other in ("text", 0.5, [], {}, None))


def test_estimates_are_read():
    found = read_estimate_file(KEPT / "identified")
    assert found.result == "least-squares"
    assert found.estimates["least-squares"].estimate.value[0] == pytest.approx(162, abs=2)
    assert read_exported(str(KEPT / "identified")).version
    assert read_summary(KEPT / "identified").result == "least-squares"
    assert len(read_provenance(KEPT / "identified").results) == 5


def test_experiments_and_robots_are_read():
    assert read_experiment(KEPT / "experiment" / "experiment.yaml").runs[0].name == "moving"
    robot = read_robot("robot.yaml", KEPT / "calibrated")
    assert robot.m == 4
    assert robot.covariance is not None


def test_tables_of_campaigns_are_read_with_rows_that_wait():
    table = joined(KEPT / "campaign")
    assert table["experiment"].to_list() == ["one", "two"]


def test_what_is_simulated_is_known():
    assert known_truth(KEPT).mass == pytest.approx(161.058)


def test_commands_and_streams_are_read(run, tmp_path):
    status, _, err = run(
        "simulate", "cogiro", "--trajectory", KEPT / "command.csv", "--out", tmp_path / "out"
    )
    assert status == 0, err
    body = (KEPT / "body.yaml").read_text()
    platform = re.search(r"^platform:\n(?: .*\n)+", body, re.MULTILINE)[0]
    (tmp_path / "robot.yaml").write_text(platform + "cables: []\nname: body\n")
    assert read_robot("robot.yaml", tmp_path).platform.mass == pytest.approx(162, abs=2)
    with open_log(KEPT / NUMBERED["stream"]) as stream:
        assert len(stream.read(["t", "f8"])["f8"]) == 5


@pytest.mark.slow
def test_what_is_written_today_has_these_forms(run, tmp_path):
    recorded, found = tmp_path / "recorded", tmp_path / "found"
    run("simulate", "cogiro", "--duration", 3, "--out", recorded)
    file = recorded / "experiment.yaml"
    methods = ("--method", "two-step", "--method", "least-squares")
    assert run("identify", file, *methods, "--out", found)[0] in (0, 3)
    run("inspect", file, "--out", found, "--force")
    run("compare", f"{found}:two-step", found, "--out", found, "--force")
    run("export", found, "--format", "json", "--out", found / "body.json", "--anyway")
    written = {
        "estimate": found / "estimate.json",
        "report": found / "report.json",
        "provenance": found / "provenance.json",
        "inspection": found / "inspection.json",
        "comparison": found / "comparison.json",
        "motion": found / "motion.parquet",
        "body": found / "body.json",
        "truth": recorded / "truth.json",
        "experiment": file,
    }
    for name, path in written.items():
        assert [problems(name, each) for each in values_of(path)[:5] if problems(name, each)] == []


def test_the_verb_prints_each(run, tmp_path):
    assert all(name in run("schema", "list")[1] for name in FORMATS)
    assert json.loads(run("schema", "list", "--json")[1]).keys() == FORMATS.keys()
    assert json.loads(run("schema", "estimate", "--json")[1]) == schema_of("estimate")
    out = tmp_path / "estimate.schema.json"
    assert run("schema", "estimate", "--out", out)[0] == 0
    assert json.loads(out.read_text()) == schema_of("estimate")
    status, _, err = run("schema", "robots")
    assert status == 2
    assert "schema list" in err
