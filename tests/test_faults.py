"""Whatever fails, and wherever a process is killed: results are the old ones or the new ones.

Each verb is run once for what it computes; then, with that kept, once for every call of the
operating system that changes the disk and every way in which it can go wrong.
"""

import importlib
import os
import re
import shutil
from pathlib import Path

import pytest
from faults import WAYS, Disk, Killed, calls_to
from halls import recorded
from places import PACKAGE
from recordings import write_small

from steelyard.campaigns.journal import Journal, joined
from steelyard.experiment.write import write_experiment
from steelyard.output import results_folder, settle, write_file

pytestmark = pytest.mark.integration

KEPT = {
    "identify": (
        "steelyard.experiment.read:read_experiment",
        "steelyard.identification.identify:identify",
        "steelyard.report.evidence.summary:summarise",
        "steelyard.report.documents.identification:brief_of",
        "steelyard.report.write:document_of",
        "steelyard.report.write:page",
        "steelyard.report.write:markdown",
    ),
    "convert": (
        "steelyard.experiment.read:read_experiment",
        "steelyard.experiment.equivalent.tidy:tidied",
    ),
    "design": (
        "steelyard.cli.designs.request:design_task",
        "steelyard.cli.designs.request:checked_motion",
        "steelyard.excitation.design_file:evaluation_dict",
        "steelyard.report.documents.design_document:design_document",
        "steelyard.report.write:page",
        "steelyard.report.write:markdown",
    ),
    "calibrate": (
        "steelyard.experiment.read:read_experiment",
        "steelyard.calibration.calibrate:calibrate",
        "steelyard.report.documents.calibration:calibration_document",
        "steelyard.report.write_calibration:calibration_document",
        "steelyard.report.write:page",
        "steelyard.report.write:markdown",
    ),
    "report": (
        "steelyard.report.evidence.report_file:read_summary",
        "steelyard.report.write:document_of",
        "steelyard.report.write:page",
        "steelyard.report.write:markdown",
    ),
    "export": ("steelyard.exports.exported:read_exported",),
}
"""Verb -> what it computes, which is the same in every repetition."""


def kept(patch, verb):
    """Let what a verb computes be computed once."""
    for place in KEPT[verb]:
        module, name = place.split(":")
        module = importlib.import_module(module)
        patch.setattr(module, name, once(getattr(module, name)))


def once(function):
    results = {}

    def remembered(*arguments, **options):
        key = str((len(arguments), sorted(options)))
        if key not in results:
            results[key] = function(*arguments, **options)
        return results[key]

    return remembered


def tree(folder):
    """Path -> bytes of every file that is not hidden."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not any(p.startswith(".steelyard-") for p in path.parts)
    }


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sources")
    small = write_small(folder / "small")
    experiment, _ = recorded(m=4)
    (folder / "hall").mkdir()
    write_experiment(experiment, folder / "hall")
    return {"small": Path(small), "hall": folder / "hall" / "experiment.yaml"}


def command(verb, sources, out):
    small, hall = map(str, (sources["small"], sources["hall"]))
    if verb == "report":
        return ["report", str(out)]
    if verb == "export":
        return ["export", str(out), "--format", "urdf", "--out", str(out / "body.urdf"), "--force",
                "--anyway"]  # fmt: skip
    place = {
        "identify": [small, "--method", "two-step"],
        "convert": [small, "--format", "csv"],
        "design": ["cogiro", "--check", "multisine", "--duration", "3"],
        "calibrate": [hall],
    }[verb]
    return [verb, *place, "--out", str(out), "--force"]


OFTEN = ("kill", "no space from then on")
"""What is played each time, of verbs that are quick; the rest with the slow tests."""


def played():
    """Verbs with what is played to them."""
    cases = []
    for verb in KEPT:
        rest = set(WAYS)
        if verb in ("convert", "export"):
            cases.append(pytest.param(verb, OFTEN, id=f"{verb}-often"))
            rest -= set(OFTEN)
        cases.append(pytest.param(verb, rest, id=f"{verb}-all", marks=pytest.mark.slow))
    return cases


@pytest.mark.long
@pytest.mark.parametrize(("verb", "ways"), played())
def test_results_are_old_or_new_wherever_it_fails(run, verb, ways, sources, tmp_path, monkeypatch):
    out, start = tmp_path / "out", tmp_path / "start"
    arguments = command(verb, sources, out)
    begun = {}
    if verb in ("report", "export"):
        run("identify", sources["small"], "--method", "two-step", "--out", out)
        begun = tree(out)
        if verb == "report":
            (out / "certificate.md").write_text("old")
    kept(monkeypatch, verb)
    status, _, err = run(*arguments)
    assert status in (0, 3), err
    written = {name: content for name, content in tree(out).items() if begun.get(name) != content}
    if verb == "report":
        written = {name: begun[name] for name in ("report.html", "report.md")}
    for name in written:
        (out / name).write_bytes(b"old " + name.encode())
    (out / "notes").mkdir()
    for name in ("mine.txt", "notes/mine.txt"):
        (out / name).write_text("mine")
    old = tree(out)
    new = {**old, **written}
    shutil.copytree(out, start)

    def again(disk):
        shutil.rmtree(out)
        shutil.copytree(start, out)
        with calls_to(disk):
            try:
                return run(*arguments)
            except Killed:
                return None

    again(counting := Disk())
    assert tree(out) == new
    calls = counting.calls
    assert {"write", "fsync"} < {call[0] for call in calls}
    ends = dict.fromkeys(("old", "new"), 0)
    for at in range(len(calls)):
        for way in ways:
            ended = again(Disk(at, WAYS[way]))
            found = tree(out)
            where = f"{verb}: {way} at call {at}, {calls[at]}"
            assert found in (old, new), where
            ends["old" if found == old else "new"] += 1
            if ended is not None:
                code, _, err = ended
                assert code in (status, 2), f"{where}: {err}"
                if code == 2:
                    assert re.fullmatch(r"steelyard: .*\S\n", err), where
                    assert str(tmp_path) in err, where
                    assert ".steelyard-" not in err, where
                else:
                    assert found == new, where
            # The next run removes what this one left, and nothing else.
            settle(out)
            assert tree(out) == found, where
            assert not list(out.parent.rglob(".steelyard-*")), where
    assert min(ends.values()) > 0
    print(f"{verb}: {len(calls)} calls, {sum(ends.values())} faults, {ends}")


@pytest.mark.parametrize("way", WAYS)
def test_in_a_folder_that_must_stay_the_next_process_finishes(tmp_path, monkeypatch, way):
    # As `watch --out FILE` in a folder of the user, or `--out .`.
    out, _start = tmp_path / "out", tmp_path / "start"
    old = {"a": b"old", "b": b"old", "mine": b"mine"}
    new = {"a": b"new", "b": b"new", "c": b"new", "mine": b"mine"}

    def again(disk):
        shutil.rmtree(out, ignore_errors=True)
        out.mkdir()
        for name, content in old.items():
            (out / name).write_bytes(content)
        with calls_to(disk):
            try:
                with results_folder(out, force=True, shared=True) as folder:
                    for name in "abc":
                        write_file(folder / name, new[name])
            except (Killed, OSError):
                return
            assert tree(out) == new

    again(counting := Disk())
    ends = set()
    for at in range(len(counting.calls)):
        again(Disk(at, WAYS[way]))
        if way != "kill":
            assert tree(out) in (old, new)
        settle(out)
        assert tree(out) in (old, new), (at, counting.calls[at])
        assert not list(tmp_path.rglob(".steelyard-*"))
        ends.add(tree(out) == new)
    assert ends == {False, True}


@pytest.mark.parametrize("way", WAYS)
def test_a_campaign_or_study_loses_no_row_wherever_it_fails(tmp_path, way):
    # Rows come line by line and are merged into the table in the end.
    folder = tmp_path / "campaign"

    def row(name, seconds):
        return {"experiment": name, "path": name, "method": "two-step", "status": "done",
                "sha256": "0", "version": "1", "asked": "default", "seconds": seconds}  # fmt: skip

    def rows():
        return sorted(joined(folder).select("experiment", "seconds").rows())

    def begun():
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        first = Journal(folder)
        first.add([row("a", 1.0), row("b", 1.0)])
        first.join()
        journal = Journal(folder)
        journal.add([row("b", 2.0), row("c", 2.0)])
        return journal

    def ended(disk):
        journal = begun()
        try:
            with calls_to(disk):
                journal.join()
        except (Killed, OSError):
            pass
        finally:
            journal.close()

    ended(counting := Disk())
    whole = [("a", 1.0), ("b", 2.0), ("c", 2.0)]
    assert rows() == whole
    assert not (folder / "campaign.rows.jsonl").exists()
    for at in range(len(counting.calls)):
        ended(Disk(at, WAYS[way]))
        settle(folder)
        assert rows() == whole, (at, counting.calls[at])
        # It goes on where it was.
        again = Journal(folder)
        again.add([row("d", 3.0)])
        again.join()
        assert rows() == [*whole, ("d", 3.0)], (at, counting.calls[at])
        assert sorted(each.name for each in folder.iterdir()) == ["campaign.parquet"]
    print(f"{way}: {len(counting.calls)} calls")


def test_files_are_on_the_disk_before_their_names_are(tmp_path):
    out = tmp_path / "far" / "out"
    for force in (False, True):
        with calls_to(seen := Disk()), results_folder(out, force=force) as folder:
            os.mkdir(folder / "inner")
            for name in ("a", "inner/b"):
                write_file(folder / name, "1")
        names = [call[0] for call in seen.calls]
        visible = names.index("exchange" if force else "rename", names.index("write"))
        synced = names[:visible].count("fsync")
        # Two files and their two folders; with an exchange what is carried and the plan, too.
        assert synced >= 4
        assert names[:visible][::-1].index("write") > names[:visible][::-1].index("fsync")
        assert "fsync" in names[visible:]


def test_no_other_module_writes_files():
    wrong = re.compile(
        r"\.write_(text|bytes)\(|open\([^)]*[\"'][wax]b?[\"']|copyfile\(|\.write_csv\(path"
    )
    for path in PACKAGE.rglob("*.py"):
        if path.name not in ("fenced_reader.py", "journal.py"):
            assert not wrong.search(path.read_text()), path
