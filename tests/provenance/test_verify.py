"""What results were made of: every changed bit is found, and the numbers come out again."""

import json
import shutil
from pathlib import Path

import pytest
from halls import recorded
from recordings import write_small

from steelyard.errors import InputError
from steelyard.experiment.write import write_experiment
from steelyard.provenance.record import read_provenance
from steelyard.provenance.verify import compare_numbers, verify

pytestmark = pytest.mark.integration


@pytest.fixture
def made(run, tmp_path):
    """A folder of results, and the one with what they were made of."""
    small = Path(write_small(tmp_path / "small"))
    status, _, err = run("identify", small, "--method", "two-step", "--out", tmp_path / "out")
    assert status in (0, 3), err
    return tmp_path / "out", small


def files_below(*folders):
    return [p for folder in folders for p in sorted(folder.rglob("*")) if p.is_file()]


def test_one_changed_bit_is_found_wherever_it_is(made):
    out, small = made
    assert verify(out).changed == ()
    known = read_provenance(out)
    listed = {(out / each.file).resolve() for each in (*known.inputs, *known.results)}
    recorded = {p for p in files_below(small.parent, out) if p.name != "command.csv"}
    assert recorded - listed <= {out / "provenance.json"}
    for path in sorted(listed | {out / "provenance.json"}):
        content = path.read_bytes()
        for place in sorted({0, len(content) // 3, len(content) // 2, len(content) - 1}):
            for bit in (0, 6):
                damaged = bytearray(content)
                damaged[place] ^= 1 << bit
                path.write_bytes(damaged)
                try:
                    found = verify(out).changed
                except InputError:
                    # The record itself can no longer be read.
                    assert path.name == "provenance.json"
                else:
                    assert any(path.name in sentence for sentence in found), (path, place, bit)
        path.write_bytes(content)
    assert verify(out).changed == ()


@pytest.mark.slow
def test_every_bit_of_the_record_counts(made):
    out, _ = made
    path = out / "provenance.json"
    content = path.read_bytes()
    for place in range(0, len(content), 7):
        damaged = bytearray(content)
        damaged[place] ^= 1 << place % 7
        path.write_bytes(damaged)
        try:
            assert verify(out).changed, place
        except InputError:
            continue


def test_the_verb_says_what_has_changed(run, made):
    out, small = made
    status, said, _ = run("verify", out)
    assert status == 0
    assert "inputs and 4 results are as they were" in said
    (small.parent / "truth.json").unlink(missing_ok=True)
    (out / "report.md").write_text("mine")
    status, said, err = run("verify", out, "--json")
    assert (status, err) == (3, "")
    values = json.loads(said)
    assert not values["unchanged"]
    assert any("report.md: has changed" in sentence for sentence in values["changed"])


@pytest.mark.parametrize("place", ["nowhere", "empty", "file"])
def test_a_folder_without_provenance_is_refused(run, tmp_path, place):
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").write_text("1")
    status, out, err = run("verify", tmp_path / place)
    assert (status, out) == (2, "")
    assert err.count("\n") == 1
    assert "expected a folder" in err


@pytest.mark.slow
def test_results_move_with_what_they_were_made_of(run, made, tmp_path):
    out, small = made
    far = tmp_path / "far" / "away"
    far.mkdir(parents=True)
    shutil.move(out, far / "out")
    shutil.move(small.parent, far / "small")
    assert verify(far / "out").changed == ()
    status, said, _ = run("verify", far / "out", "--again")
    assert status == 0
    assert "the same to the last bit" in said


def test_other_numbers_are_found(made, tmp_path):
    out, _ = made
    other = tmp_path / "other"
    shutil.copytree(out, other)
    values = json.loads((out / "estimate.json").read_text())
    own = values["estimates"]["two-step"]
    for off, agrees in ((1e-12, True), (1e-6, False)):
        own["mass"] += off * own["standard_deviation"]["mass"]
        (other / "estimate.json").write_text(json.dumps(values))
        found = compare_numbers(out, other)
        assert not found.same_bits
        assert found.agrees is agrees
        assert found.where == "estimate.json: estimates: two-step: mass"
    assert found.largest == pytest.approx(1e-6, rel=1e-3)
    (other / "estimate.json").unlink()
    assert not compare_numbers(out, other).agrees


@pytest.mark.slow
def test_a_command_that_writes_elsewhere_is_not_followed(run, made, tmp_path):
    out, _ = made
    path = out / "provenance.json"
    values = json.loads(path.read_text())
    values["command"] += ["--out", str(tmp_path / "elsewhere"), "--force"]
    path.write_text(json.dumps(values))
    assert run("verify", out, "--again")[0] == 3
    assert not (tmp_path / "elsewhere").exists()
    values["command"] = ["simulate", "cogiro"]
    path.write_text(json.dumps(values))
    status, _, err = run("verify", out, "--again")
    assert status == 2
    assert "only these can be made again" in err


def test_results_drawn_again_are_results(run, made):
    out, _ = made
    assert run("report", out, "--certificate")[0] == 0
    assert verify(out).changed == ()
    (out / "certificate.md").write_text("mine")
    assert "certificate.md" in verify(out).changed[0]


def test_a_stated_time_gives_the_same_bytes(run, made, tmp_path, monkeypatch):
    _, small = made
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    texts = []
    for _ in range(2):
        run("identify", small, "--method", "two-step", "--out", tmp_path / "again", "--force")
        texts.append({p.name: p.read_bytes() for p in (tmp_path / "again").iterdir()})
    assert texts[0] == texts[1]
    assert b'"2023-11-14T22:13:20Z"' in texts[0]["provenance.json"]


def test_nothing_names_the_machine(made):
    out, small = made
    for path in out.iterdir():
        assert str(small.parent).encode() not in path.read_bytes(), path


@pytest.mark.slow
@pytest.mark.long
def test_calibrations_and_designs_have_it_too(run, tmp_path):
    (tmp_path / "hall").mkdir()
    write_experiment(recorded(m=4)[0], tmp_path / "hall")
    hall = tmp_path / "hall" / "experiment.yaml"
    assert run("calibrate", hall, "--out", tmp_path / "calibrated")[0] in (0, 3)
    found = json.loads((tmp_path / "calibrated" / "calibration.json").read_text())
    names = {each["file"] for each in found["provenance"]["inputs"]}
    assert {"experiment.yaml", "robot.yaml"} < names
    robot = tmp_path / "hall" / "robot.yaml"
    (tmp_path / "mine.yaml").write_text(robot.read_text())
    design = ["design", "cogiro", "--check", "multisine", "--duration", "3"]
    assert run(*design, "--out", tmp_path / "design")[0] == 0
    for name in ("calibrated", "design"):
        assert verify(tmp_path / name).changed == ()
        assert run("verify", tmp_path / name, "--again")[0] == 0
    robot.write_text(robot.read_text() + "\n")
    assert "robot.yaml: has changed" in verify(tmp_path / "calibrated").changed[0]


def test_what_convert_wrote_is_verified_too(run, tmp_path):
    small = Path(write_small(tmp_path / "small"))
    out = tmp_path / "tidy"
    status, _, err = run("convert", small, "--out", out)
    assert status == 0, err
    assert verify(out).changed == ()
    known = read_provenance(out)
    assert {each.file for each in known.inputs} >= {
        "../small/experiment.yaml",
        "../small/robot.yaml",
    }
    log = next(out.rglob("cables.parquet"))
    content = bytearray(log.read_bytes())
    content[20] ^= 1
    log.write_bytes(content)
    assert "result moving/cables.parquet: has changed" in verify(out).changed[0]
    # It is no estimate that comes out again.
    assert run("verify", out, "--again")[0] == 2
