"""Every engine does every task once, whatever happens to its workers."""

import asyncio
import multiprocessing
import os

import pytest
from campaign_work import Chore, begun, do, fail, here
from recordings import write_small

from steelyard.campaigns.engines.dask_cluster import DaskCluster, connected
from steelyard.campaigns.engines.processes import Processes
from steelyard.campaigns.engines.slurm import Slurm, SlurmOptions, require_slurm
from steelyard.campaigns.run import campaign
from steelyard.campaigns.tasks import Lost
from steelyard.errors import InputError

pytestmark = pytest.mark.integration


def chores(count, tmp_path, **keys):
    return [Chore(f"c{i}", str(tmp_path), **keys) for i in range(count)]


def test_processes_do_every_task_once_each_with_one_thread(tmp_path):
    tasks = chores(6, tmp_path, seconds=0.2)
    found = list(Processes(2)(do, tasks))
    assert sorted(task.name for task, _ in found) == [task.name for task in tasks]
    rows = [outcome.rows[0] for _, outcome in found]
    assert {row["threads"] for row in rows} == {"1"}
    assert len({row["pid"] for row in rows} - {os.getpid()}) == 2
    assert all(begun(task) == 1 for task in tasks)


def test_a_killed_worker_costs_nothing_and_a_task_that_kills_again_only_itself(tmp_path):
    tasks = chores(5, tmp_path)
    tasks[1] = Chore("once", str(tmp_path), kills=1)
    tasks[3] = Chore("always", str(tmp_path), kills=99)
    found = dict(Processes(2)(do, tasks))
    assert len(found) == 5
    assert [task.name for task, each in found.items() if isinstance(each, Lost)] == ["always"]
    assert "killed twice" in found[tasks[3]].reason
    assert 2 <= begun(tasks[3]) <= 3


def test_an_error_of_a_task_is_its_own(tmp_path):
    ((_, lost),) = Processes(1)(fail, chores(1, tmp_path))
    assert lost == Lost("RuntimeError: c0 cannot be done")


def test_closing_ends_what_is_under_way(tmp_path):
    before = set(multiprocessing.active_children())
    results = Processes(2)(do, [Chore("quick"), *chores(4, tmp_path, seconds=600.0)])
    next(results)
    results.close()
    assert set(multiprocessing.active_children()) <= before


def test_tasks_are_taken_when_there_is_room():
    taken = []

    def endless():
        for i in range(1000):
            taken.append(i)
            yield Chore(str(i))

    results = Processes(1)(do, endless())
    next(results)
    assert len(taken) <= 3
    results.close()


@pytest.fixture(scope="module")
def cluster():
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        yield cluster


@pytest.mark.filterwarnings("ignore")
def test_dask_does_every_task_and_survives_a_killed_worker(cluster, tmp_path):
    tasks = [*chores(6, tmp_path), Chore("once", str(tmp_path), kills=1)]
    with connected(cluster.scheduler_address) as client:
        found = list(DaskCluster(client)(do, tasks))
    assert sorted(task.name for task, _ in found) == sorted(task.name for task in tasks)
    assert not [each for _, each in found if isinstance(each, Lost)]
    assert {outcome.rows[0]["threads"] for _, outcome in found} == {"1"}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_a_campaign_on_dask_gives_the_same_numbers(cluster, tmp_path):
    write_small(tmp_path / "data" / "a")
    with connected(cluster.scheduler_address) as client:
        there = campaign(tmp_path / "data", tmp_path / "dask", "two-step", client=client)
    alone = campaign(tmp_path / "data", tmp_path / "here", "two-step", engine=here)
    tables = [each.to_polars().drop("seconds") for each in (there, alone)]
    assert tables[0].equals(tables[1])


@pytest.mark.filterwarnings("ignore")
def test_an_error_in_dask_is_that_of_its_task(cluster, tmp_path):
    with connected(cluster.scheduler_address) as client:
        ((_, lost),) = DaskCluster(client)(fail, chores(1, tmp_path))
    assert lost == Lost("RuntimeError: c0 cannot be done")


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nonsense", "tcp://"])
@pytest.mark.filterwarnings("ignore")
def test_a_scheduler_that_does_not_answer_is_one_sentence(address, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("steelyard.campaigns.engines.dask_cluster._CONNECT", 0.5)
    with pytest.raises(InputError, match="scheduler: expected the address") as error:
        connected(address).__enter__()
    assert "\n" not in str(error.value)


@pytest.mark.filterwarnings("ignore")
def test_no_client_is_made_where_no_scheduler_answers(cluster, monkeypatch):
    """One that is collected while the next one begins would wait for ever."""
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr("steelyard.campaigns.engines.dask_cluster._CONNECT", 0.5)

    def none(*_args, **_named):
        raise AssertionError("a client was made")

    monkeypatch.setattr(distributed, "Client", none)
    worker = next(iter(cluster.scheduler_info["workers"]))
    for address in ("tcp://127.0.0.1:9", worker):
        with pytest.raises(InputError, match="scheduler: expected the address"):
            connected(address).__enter__()


@pytest.mark.filterwarnings("ignore")
def test_a_scheduler_is_found_from_within_a_loop_that_runs(cluster):
    """That of a notebook."""

    async def inside():
        with connected(cluster.scheduler_address) as client:
            return client.status

    assert asyncio.run(inside()) == "running"


@pytest.mark.long
@pytest.mark.parametrize(
    "killed",
    [False, pytest.param(True, marks=pytest.mark.slow)],  # submitit waits long for lost results
)
def test_jobs_of_submitit_do_every_task_and_one_that_is_killed_once_more(
    killed, tmp_path, monkeypatch
):
    pytest.importorskip("submitit")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(os.sys.path))
    marks = tmp_path / "marks"
    marks.mkdir()
    tasks = chores(3, marks)
    if killed:
        tasks += [Chore("once", str(marks), kills=1), Chore("bad", str(marks), kills=9)]
    options = SlurmOptions.of("array=2,tasks=2")
    engine = Slurm(options, tmp_path / "jobs", cluster="local", poll=0.05)
    found = list(engine(do, tasks))
    assert sorted(task.name for task, _ in found) == sorted(task.name for task in tasks)
    lost = [task.name for task, each in found if isinstance(each, Lost)]
    assert lost == (["bad"] if killed else [])


def test_options_of_slurm():
    found = SlurmOptions.of("partition=short, time=30,mem_gb=8")
    assert (found.time, found.mem_gb, found.further) == (30, 8, {"partition": "short"})


@pytest.mark.parametrize("text", ["partition", "=1", "time=long", "array=0", "a b=1"])
def test_wrong_options_of_slurm_are_named(text):
    with pytest.raises(InputError, match="slurm: expected"):
        SlurmOptions.of(text)


def test_slurm_without_its_commands_is_said(monkeypatch):
    monkeypatch.setattr("shutil.which", lambda name: None)
    with pytest.raises(InputError, match="sbatch"):
        require_slurm()
