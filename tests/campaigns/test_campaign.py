"""Campaigns: a row for every experiment and method, done once, whatever ends in between."""

import fcntl
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from campaign_work import here
from recordings import write_small

import steelyard
from steelyard.campaigns.journal import JOURNAL, LOCK, Journal, alone_in, joined
from steelyard.campaigns.rows import LOST, REFUSED, TABLE, columns, failed, frame, merged
from steelyard.campaigns.run import campaign
from steelyard.campaigns.tasks import ExperimentTask, Lost, Outcome
from steelyard.campaigns.work import recorded_at, work_on
from steelyard.errors import InputError
from steelyard.estimates.file.estimate_file import read_estimate_file
from steelyard.inertia import BODY_PARAMETERS

TWO_STEP = "two-step"
CONTRACT = [
    *("experiment", "path", "sha256", "method", "status", *BODY_PARAMETERS),
    *(f"sigma_{name}" for name in BODY_PARAMETERS),
    *("covariance", "accepted", "reason", "seconds", "version"),
]


@pytest.fixture
def data(tmp_path):
    for name in ("b", "a", "deep/c"):
        write_small(tmp_path / "data" / name)
    return tmp_path / "data"


@pytest.fixture
def out(tmp_path):
    return tmp_path / "out"


def run(data, out, methods=TWO_STEP, **keys):
    return campaign(data, out, methods, **{"engine": here, **keys})


def counting(done):
    def engine(work, tasks):
        for task in tasks:
            outcome = work(task)
            done.append((task.name, outcome.unchanged))
            yield task, outcome

    return engine


def numbers(table):
    return table.drop("seconds", "path")


@pytest.mark.integration
def test_a_row_for_every_experiment_has_what_the_estimate_file_has(data, out):
    found = run(data, out)
    table = pl.read_parquet(out / TABLE)
    assert table.columns[: len(CONTRACT)] == CONTRACT == list(columns())[: len(CONTRACT)]
    assert table["experiment"].to_list() == ["a", "b", "deep/c"]
    assert set(table["method"]) == {TWO_STEP}
    for row in table.iter_rows(named=True):
        file = read_estimate_file(out / TWO_STEP / row["experiment"])
        estimate = file.estimates[TWO_STEP].estimate
        np.testing.assert_array_equal([row[p] for p in BODY_PARAMETERS], estimate.value)
        sigma = [row[f"sigma_{p}"] for p in BODY_PARAMETERS]
        np.testing.assert_allclose(sigma, estimate.standard_deviation, rtol=1e-12)
        covariance = np.reshape(row["covariance"], (10, 10))
        np.testing.assert_allclose(covariance, estimate.covariance, rtol=1e-9, atol=1e-15)
        assert row["accepted"] is estimate.verdict.accepted
    assert (found.experiments, found.unchanged) == (3, 0)
    assert "3 experiments" in repr(found)


@pytest.mark.integration
def test_what_is_done_is_not_done_again_until_its_files_change(data, out):
    run(data, out)
    first = pl.read_parquet(out / TABLE)
    done = []
    again = run(data, out, engine=counting(done))
    assert again.unchanged == 3
    assert pl.read_parquet(out / TABLE).equals(first)
    log = data / "a" / "moving" / "cables.csv"
    log.write_text(log.read_text() + "\n")
    done.clear()
    run(data, out, engine=counting(done))
    assert done == [("a", False), ("b", True), ("deep/c", True)]
    second = pl.read_parquet(out / TABLE)
    assert numbers(second).drop("sha256").equals(numbers(first).drop("sha256"))


def test_a_folder_with_other_files_is_left_alone_and_one_of_a_killed_campaign_is_gone_on_with(
    data, out
):
    out.mkdir()
    (out / "mine.txt").touch()
    with pytest.raises(InputError, match="one of a campaign, found other files") as error:
        run(data / "a", out)
    assert "--force" not in str(error.value)
    # Killed before the first row was written.
    (out / LOCK).touch()
    assert run(data / "a", out).experiments == 1


def test_a_baseline_alone_is_neither_accepted_nor_rejected_as_in_identify(data, out):
    found = run(data / "a", out)
    assert (found.counts, found.problems, found.sound) == ({"not assessed": 1}, (), True)


def test_what_rejects_beside_a_baseline_decides(data, out):
    def judged(work, tasks):
        for task in tasks:
            row = {"experiment": task.name, "path": task.path, "status": "done"} | {
                "asked": task.asked
            }
            rejecting = {**row, "method": "consistent", "accepted": False, "reason": "drifts"}
            yield task, Outcome((rejecting, {**row, "method": TWO_STEP, "mass": 1.0}))

    found = run(data / "a", out, engine=judged)
    assert found.counts == {"not accepted": 1}
    assert found.problems == ("a: not accepted: drifts",)


@pytest.mark.integration
def test_numbers_after_a_resumed_campaign_are_those_of_an_undisturbed_one(data, out, tmp_path):
    def ended(work, tasks):
        for i, task in enumerate(tasks):
            if i == 1:
                raise KeyboardInterrupt
            yield task, work(task)

    with pytest.raises(KeyboardInterrupt):
        run(data, out, engine=ended)
    assert pl.read_parquet(out / TABLE)["experiment"].to_list() == ["a"]
    assert run(data, out).unchanged == 1
    run(data, tmp_path / "whole")
    whole = pl.read_parquet(tmp_path / "whole" / TABLE)
    assert numbers(pl.read_parquet(out / TABLE)).equals(numbers(whole))


@pytest.mark.integration
def test_a_broken_recording_costs_only_itself_and_says_why(data, out):
    (data / "b" / "moving" / "imu.csv").unlink()
    found = run(data, out)
    table = pl.read_parquet(out / TABLE)
    row = table.filter(experiment="b").row(0, named=True)
    assert (row["status"], row["method"], row["mass"]) == (REFUSED, "", None)
    assert "imu.csv" in row["reason"]
    assert not found.sound
    assert any(text.startswith("b: refused: ") for text in found.problems)
    # It is not tried again until its files change.
    assert run(data, out).unchanged == 3
    write_small(data / "b")
    assert run(data, out).unchanged == 2
    assert pl.read_parquet(out / TABLE)["status"].to_list() == ["done"] * 3


@pytest.mark.integration
def test_what_the_machine_lost_is_tried_again(data, out):
    def losing(work, tasks):
        for task in tasks:
            yield task, Lost("killed") if task.name == "a" else work(task)

    found = run(data, out, engine=losing)
    assert found.counts[LOST] == 1
    row = pl.read_parquet(out / TABLE).row(0, named=True)
    assert (row["experiment"], row["status"], row["reason"]) == ("a", LOST, "killed")
    assert run(data, out).unchanged == 2


@pytest.mark.slow
@pytest.mark.integration
def test_rows_of_two_campaigns_are_merged(data, out):
    run(data / "a", out)
    run([data / "b"], out)
    run(data / "a", out, ["least-squares"])
    table = pl.read_parquet(out / TABLE)
    rows = table.select("experiment", "method").rows()
    assert rows == [("a", "least-squares"), ("a", TWO_STEP), ("b", TWO_STEP)]
    assert (out / "least-squares" / "a" / "estimate.json").is_file()
    assert (out / TWO_STEP / "a" / "estimate.json").is_file()


def row(name, method, sha="1", version="1", **keys):
    return {
        "experiment": name, "method": method, "sha256": sha, "version": version, **keys
    }  # fmt: skip


def test_new_rows_take_the_place_of_old_ones_of_other_files():
    old = frame(
        [
            row("a", "x"),
            row("a", "y"),
            row("b", "x"),
            failed(ExperimentTask("c", "", ""), LOST, "?"),
        ]
    )
    new = frame([row("a", "x", sha="2", mass=1.0), row("b", "y"), row("c", "x", sha=None)])
    found = merged(old, new)
    assert found.select("experiment", "method").rows() == [
        ("a", "x"), ("b", "x"), ("b", "y"), ("c", "x"),
    ]  # fmt: skip
    assert found["mass"].to_list() == [1.0, None, None, None]


def test_rows_survive_a_line_that_was_cut_in_two(tmp_path):
    journal = Journal(tmp_path)
    journal.add([row("a", "x", mass=0.1 + 0.2)])
    journal.close()
    with (tmp_path / JOURNAL).open("ab") as file:
        file.write(b'{"experiment": "b", "me')
    assert joined(tmp_path)["mass"].to_list() == [0.1 + 0.2]
    again = Journal(tmp_path)
    again.add([row("c", "x")])
    assert again.join()["experiment"].to_list() == ["a", "c"]
    assert not (tmp_path / JOURNAL).exists()


def test_rows_wait_where_the_disk_is_full(tmp_path, monkeypatch):
    journal = Journal(tmp_path)
    journal.add([row("a", "x")])

    journal.close()

    class Full:
        def write(self, line):
            with (tmp_path / JOURNAL).open("ab") as file:
                file.write(line[:5])
            raise OSError(28, "No space left on device")

        def close(self):
            pass

    monkeypatch.setattr(journal, "_file", Full())
    journal.add([row("b", "x")])
    assert (tmp_path / JOURNAL).read_bytes().count(b"\n") == 1
    journal.add([row("c", "x")])
    assert journal.join()["experiment"].to_list() == ["a", "b", "c"]


def test_a_full_disk_of_a_worker_costs_one_experiment(data, tmp_path, monkeypatch):
    def full(values, path):
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr("steelyard.output.write_json", full)
    outcome = work_on(
        ExperimentTask(
            "a", str(data / "a/experiment.yaml"), str(tmp_path / "r"), "identify", (TWO_STEP,)
        )
    )
    assert outcome.rows[0]["status"] == LOST
    assert "No space left" in outcome.rows[0]["reason"]


def test_ten_thousand_rows_are_joined_in_parts(tmp_path):
    journal = Journal(tmp_path)
    for i in range(10_000):
        journal.add([row(f"{i:05}", "x", mass=float(i))])
    table = journal.join()
    assert len(table) == 10_000
    assert table["mass"].to_list() == list(map(float, range(10_000)))


def test_two_campaigns_at_once_are_refused(data, out):
    run(data / "a", out)
    with (out / ".steelyard-campaign.lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        with pytest.raises(InputError, match="found one at work there"):
            run(data, out)
    assert len(pl.read_parquet(out / TABLE)) == 1
    with alone_in(out):
        pass


@pytest.mark.parametrize(
    ("places", "said"),
    [
        (["nowhere"], "nowhere: expected an experiment file, a folder or a glob, found nothing"),
        (["empty"], "expected files experiment.yaml in this folder"),
        (["*.yaml"], "expected experiments, found none; check the glob"),
        (["data/a", "other/a"], "expected experiments of different names, found 'a' for"),
        ([], "expected experiments, found none"),
        (["nothing://x"], "expected a URL that fsspec reads"),
        (["memory://nothing"], "expected experiments, found none; check the URL"),
    ],
)
def test_what_is_no_experiment_is_one_sentence(places, said, data, out, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    shutil.copytree(data / "a", tmp_path / "other" / "a")
    with pytest.raises(InputError, match=said.replace("*", r"\*")) as error:
        run(places, out)
    assert "\n" not in str(error.value)
    assert not out.exists()


def test_a_name_of_the_table_stays_that_of_its_experiment(data, out, tmp_path):
    run(data / "a", out)
    other = write_small(tmp_path / "other" / "a")
    with pytest.raises(InputError, match="a name that is not in the table yet, found 'a'"):
        run(other, out)
    # Data that were moved are the same as before.
    shutil.rmtree(data / "a")
    assert run(other, out).unchanged == 1


def test_a_folder_of_something_else_is_refused(data, out):
    out.mkdir()
    (out / "thesis.tex").touch()
    with pytest.raises(InputError, match="expected a new or empty folder"):
        run(data, out)
    (out / "thesis.tex").unlink()
    (out / TABLE).write_text("no table")
    with pytest.raises(InputError, match="expected the table of a campaign"):
        run(data, out)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_place_without_permission_is_refused(data, tmp_path):
    place = tmp_path / "locked"
    place.mkdir(mode=0o555)
    with pytest.raises(InputError, match="expected a place that can be written to"):
        run(data, place / "out")


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"methods": "guess"}, "methods: expected one of"),
        ({"verb": "weigh"}, "verb: expected one of"),
        ({"engine": None, "jobs": 0}, "jobs: expected at least 1"),
    ],
)
def test_wrong_requests_are_refused_before_anything_is_written(keys, said, data, out):
    with pytest.raises(InputError, match=said):
        run(data, out, **keys)
    assert not out.exists()


@pytest.mark.integration
def test_globs_name_experiments_below_their_fixed_part(data, out):
    found = run(str(data / "*" / "experiment.yaml"), out)
    assert found.to_polars()["experiment"].to_list() == ["a", "b"]
    again = run(str(data / "**"), out)
    assert (again.experiments, again.unchanged) == (3, 2)


@pytest.mark.integration
@pytest.mark.parametrize("scheme", ["file", "memory"])
def test_experiments_behind_urls_give_the_same_numbers(scheme, data, out, tmp_path):
    fsspec = pytest.importorskip("fsspec")
    url = f"file://{data}"
    if scheme == "memory":
        url = "memory://bucket"
        fsspec.filesystem("memory").put(str(data), "/bucket", recursive=True)
    found = run(url, out).to_polars()
    local = run(data, tmp_path / "local").to_polars()
    assert found["path"][0].startswith(f"{scheme}://")
    assert numbers(found).equals(numbers(local))


def test_a_log_that_a_url_does_not_have_is_said(data, out):
    fsspec = pytest.importorskip("fsspec")
    (data / "a" / "moving" / "imu.csv").unlink()
    fsspec.filesystem("memory").put(str(data / "a"), "/short/a", recursive=True)
    (problem,) = run("memory://short", out).problems
    assert "imu.csv" in problem


@pytest.mark.integration
def test_inspections_are_rows_too(data, out):
    found = run(data / "a", out, (), verb="inspect", reports=True)
    table = found.to_polars()
    assert table.select("method", "status", "mass", "accepted").rows() == [
        ("inspect", "done", None, None)
    ]
    assert (out / "inspect" / "a" / "inspection.html").is_file()
    assert found.sound


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("2026-03-04/run-7", "2026-03-04T00:00"),
        ("20260304_1530", "2026-03-04T15:30"),
        ("2026-03-04T15:30:20 b", "2026-03-04T15:30"),
        ("2026-13-40", None),
        ("run-12", None),
        ("serial-12026030455", None),
    ],
)
def test_dates_in_names_are_read(name, said):
    found = recorded_at(name)
    assert (found is None) == (said is None)
    if said:
        assert time.strftime("%Y-%m-%dT%H:%M", time.gmtime(found)) == said


def test_time_stamps_since_1970_tell_the_date():
    from recordings import simulated

    experiment = simulated()
    assert recorded_at("run", experiment) is None
    run = experiment.runs[0]
    late = {k: replace(s, time=s.time + 1.7e9) for k, s in run.streams.items()}
    found = recorded_at("run", replace(experiment, runs=(replace(run, streams=late),)))
    assert found == pytest.approx(1.7e9, abs=60)


def test_the_public_name_is_the_function():
    assert steelyard.campaign is campaign


# --- the whole, in processes ---


def command(data, out, *further):
    return [
        sys.executable, "-m", "steelyard", "campaign", str(data), "--out", str(out),
        "--method", TWO_STEP, *further,
    ]  # fmt: skip


@pytest.mark.slow
@pytest.mark.integration
def test_the_verb_ends_with_3_where_one_experiment_fails_and_goes_on_then(data, out):
    (data / "b" / "experiment.yaml").write_text("format: [")
    ended = subprocess.run(
        command(data, out, "--jobs", "1", "--json"), capture_output=True, text=True, check=False
    )
    assert (ended.returncode, ended.stderr) == (3, "")
    found = json.loads(ended.stdout)
    assert found["counts"] == {"not assessed": 2, "refused": 1}
    assert len(pl.read_parquet(out / TABLE)) == 3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "status"),
    [(signal.SIGINT, 130), (signal.SIGTERM, 143)],
)
def test_an_interrupted_campaign_leaves_a_sound_table(number, status, data, out):
    # So many that they take long, also where this process waits for its turn.
    for i in range(100):
        shutil.copytree(data / "a", data / f"more-{i:02}")
    with subprocess.Popen(
        command(data, out, "--jobs", "1"), stderr=subprocess.PIPE, text=True
    ) as child:
        journal = out / JOURNAL
        while not (journal.exists() and journal.stat().st_size):
            assert child.poll() is None
            time.sleep(0.02)
        child.send_signal(number)
        _, said = child.communicate(timeout=60)
    assert child.returncode == status
    assert said.count("\n") == 1
    assert "the same command goes on" in said
    table = pl.read_parquet(out / TABLE)
    assert 1 <= len(table) < 103
    assert not journal.exists()


@pytest.mark.slow
def test_a_campaign_that_is_killed_loses_nothing_that_was_done(data, out):
    for i in range(20):
        shutil.copytree(data / "a", data / f"more-{i:02}")
    with subprocess.Popen(command(data, out, "--jobs", "1")) as child:
        journal = out / JOURNAL
        while not (journal.exists() and journal.stat().st_size):
            assert child.poll() is None
            time.sleep(0.02)
        child.kill()
    done = len(joined(out))
    assert 1 <= done < 23
    found = run(data, out)
    assert found.unchanged >= done
    assert len(pl.read_parquet(out / TABLE)) == 23


@pytest.mark.slow
@pytest.mark.long
def test_a_worker_that_is_killed_costs_no_experiment(data, out):
    for i in range(10):
        shutil.copytree(data / "a", data / f"more-{i:02}")
    with subprocess.Popen(command(data, out, "--jobs", "1")) as child:
        journal = out / JOURNAL
        while not (journal.exists() and journal.stat().st_size):
            assert child.poll() is None
            time.sleep(0.02)
        for worker in workers_of(child.pid):
            os.kill(worker, signal.SIGKILL)
        assert child.wait(timeout=300) in (0, 3)
    table = pl.read_parquet(out / TABLE)
    assert len(table) == 13
    assert set(table["status"]) == {"done"}


def workers_of(parent):
    for task in Path(f"/proc/{parent}/task").iterdir():
        for child in map(int, (task / "children").read_text().split()):
            if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes():
                yield child


def test_an_outcome_is_small(data, tmp_path):
    outcome = work_on(
        ExperimentTask(
            "a", str(data / "a/experiment.yaml"), str(tmp_path / "r"), "identify", (TWO_STEP,)
        )
    )
    assert isinstance(outcome, Outcome)
    assert len(json.dumps(outcome.rows)) < 10_000
