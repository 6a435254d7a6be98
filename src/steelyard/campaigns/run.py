"""A campaign: many experiments, one after the other or at once, and what became of each."""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from steelyard.campaigns.database import DatabaseTable
from steelyard.campaigns.engines.dask_cluster import DaskCluster, require_dask
from steelyard.campaigns.engines.processes import Processes
from steelyard.campaigns.items import Item, find_items
from steelyard.campaigns.journal import JOURNAL, LOCK, Journal, alone_in, joined
from steelyard.campaigns.page import write_page
from steelyard.campaigns.results import best_rows
from steelyard.campaigns.rows import DONE, LOST, REFUSED, TABLE, failed, known_hashes
from steelyard.campaigns.tasks import Engine, ExperimentTask, Lost, Outcome, TaskT, Work
from steelyard.campaigns.work import INSPECT, asked_for, work_on
from steelyard.errors import InputError
from steelyard.output import check_target
from steelyard.report.evidence.made import steelyard_version

if TYPE_CHECKING:
    import polars as pl

Progress = Callable[[str, float], None] | None
FORMAT = "steelyard-campaign/1"
_VERBS = ("identify", INSPECT)


@dataclass(frozen=True, eq=False)
class Campaign:
    """What became of many experiments."""

    folder: Path
    """With ``campaign.parquet``, ``campaign.html`` and a folder of results for each experiment."""
    experiments: int
    """That were asked for."""
    unchanged: int
    """That were done before, from the same files by the same version."""
    counts: dict[str, int]
    """Of the experiments worked on: ``accepted``, ``not accepted``, ``not assessed`` (by the best
    method), ``inspected``, ``refused``, ``lost``."""
    problems: tuple[str, ...]
    """Of all that were asked for, those that were rejected, refused or lost, with the reason."""

    @property
    def table(self) -> Path:
        """``campaign.parquet``."""
        return self.folder / TABLE

    @property
    def sound(self) -> bool:
        """Whether no experiment that was asked for was rejected, refused or lost; a baseline alone
        is neither accepted nor rejected, as in ``identify``.
        """
        return not self.problems

    def to_polars(self) -> pl.DataFrame:
        """The table."""
        return joined(self.folder)

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "format": FORMAT,
            "folder": str(self.folder),
            "experiments": self.experiments,
            "unchanged": self.unchanged,
            "counts": self.counts,
            "problems": list(self.problems),
        }

    def __repr__(self) -> str:
        words = [f"{count} {what}" for what, count in self.counts.items()]
        if self.unchanged:
            words.append(f"{self.unchanged} done before")
        return f"{self.folder}: {self.experiments} experiments: {', '.join(words) or 'none'}"


def campaign(
    paths: Sequence[str | Path] | str | Path,
    out: str | Path,
    methods: str | Sequence[str] = (),
    *,
    jobs: int | None = None,
    client: Any = None,
    verb: str = "identify",
    reports: bool = False,
    table: str | None = None,
    engine: Engine | None = None,
    progress: Progress = None,
) -> Campaign:
    """Identify (or inspect) many experiments; what is done already, from the same files by the same
    version, is not done again.

    Rows are written as they come: a campaign that was ended, by whatever, goes on where it was.
    A script that calls this on processes of its own needs ``if __name__ == "__main__":`` around
    the call.

    Args:
        paths: Experiment files, folders, globs, and URLs of them.
        out: Folder for the table, the page and all results; new, or of a campaign.
        methods: Names of estimators, as in :func:`steelyard.identify`; none: the default ones.
        jobs: Processes on this machine; None: as many as it has cores.
        client: Of Dask (``distributed.Client``): work on its cluster instead.
        verb: ``identify`` or ``inspect``.
        reports: Whether to write a report beside each estimate.
        table: ``postgresql://USER@HOST:PORT/DATABASE``, with ``#TABLE`` behind it where it is not
            ``campaign``: all rows are written there, too, in place of older ones of these
            experiments.
        engine: Where to work, in place of ``jobs`` and ``client``.
        progress: Is told what is being done and the fraction that is done.

    Raises:
        InputError: There is nothing to work on, the folder or the database cannot be used, or the
            cluster is not there. An experiment that is wrong raises nothing: it has a row that says
            so.
    """
    from steelyard.identification.chosen_methods import chosen_methods

    methods = (methods,) if isinstance(methods, str) else tuple(methods)
    chosen_methods(methods)
    if verb not in _VERBS:
        raise InputError(
            f"--verb: expected one of {', '.join(_VERBS)}, found '{verb}'; choose one of these"
        )
    if isinstance(paths, str | Path):
        paths = [paths]
    engine = engine or engine_of(jobs, client)
    items = find_items(paths)
    database = None if table is None else DatabaseTable.of(table)
    if database is not None:
        database.check()
    folder = prepared(out)
    asked = asked_for(verb, methods)
    with alone_in(folder):
        before = joined(folder)
        _check_names(items, before)
        known = known_hashes(before, asked, steelyard_version())
        tasks = [
            ExperimentTask(
                item.name,
                item.path,
                str(folder / asked / item.name),
                verb,
                methods,
                reports,
                asked,
                known.get(item.name, ""),
            )
            for item in items
        ]
        counts = work_through(folder, engine, work_on, tasks, progress)
        rows = joined(folder)
        write_page(rows, folder)
        if database is not None:
            database.write(rows)
        return _ended(folder, rows, asked, items, counts)


def engine_of(jobs: int | None, client: Any) -> Engine:
    """Processes, or the cluster of a client."""
    if client is not None:
        require_dask()
        return DaskCluster(client)
    if jobs is not None and jobs < 1:
        raise InputError(f"--jobs: expected at least 1, found {jobs}; correct it")
    return Processes(jobs or len(os.sched_getaffinity(0)))


def prepared(out: str | Path) -> Path:
    """The folder of a campaign, made where it is not there.

    Raises:
        InputError: It cannot be written to, or has files that are none of a campaign.
    """
    folder = Path(out)
    check_target(folder, force=True)
    # The lock is there before the first row: a campaign may have been killed in between.
    ours = any((folder / name).exists() for name in (TABLE, JOURNAL, LOCK))
    if not ours and folder.is_dir() and any(folder.iterdir()):
        raise InputError(
            f"{out}: expected a new or empty folder, or one of a campaign, found other files there;"
            " choose another with --out"
        )
    folder.mkdir(parents=True, exist_ok=True)
    return folder.resolve()


def _check_names(items: Sequence[Item], before: pl.DataFrame) -> None:
    """Refuse a name that means another experiment in the table, which is still there."""
    there = dict(before.select("experiment", "path").iter_rows())
    for item in items:
        path = there.get(item.name, item.path)
        if path != item.path and Path(path).exists():
            raise InputError(
                f"{item.path}: expected a name that is not in the table yet, found '{item.name}'"
                f" for {path}; name a folder above both, or choose another with --out"
            )


def work_through(
    folder: Path,
    engine: Engine,
    work: Work,
    tasks: Sequence[TaskT],
    progress: Progress = None,
) -> Counter[str]:
    """Work on all tasks and write their rows; however it ends, the table has what was done.

    Returns:
        How often an outcome was ``unchanged``.
    """
    journal = Journal(folder)
    counts: Counter[str] = Counter()
    try:
        with closing(_told(engine, work, tasks, progress)) as results:
            for task, found in results:
                if isinstance(found, Lost):
                    about = {"asked": task.asked, "version": steelyard_version()}
                    journal.add([failed(task, LOST, found.reason, **about)])
                elif found.unchanged:
                    counts["unchanged"] += 1
                else:
                    journal.add(found.rows)
    finally:
        journal.join()
    return counts


def _told(
    engine: Engine, work: Work, tasks: Sequence[TaskT], progress: Progress
) -> Generator[tuple[TaskT, Outcome | Lost], None, None]:
    """Results of an engine, with progress and an estimate of the time left."""
    start = time.monotonic()
    with closing(engine(work, tasks)) as results:
        for done, result in enumerate(results, start=1):
            if progress is not None:
                left = (time.monotonic() - start) / done * (len(tasks) - done)
                progress(f"{done} of {len(tasks)}, {duration(left)} left", done / len(tasks))
            yield result


def duration(seconds: float) -> str:
    """A time as people say it."""
    if seconds < 90:
        return f"about {seconds:.0f} s"
    if seconds < 5400:
        return f"about {seconds / 60:.0f} min"
    return f"about {seconds / 3600:.1f} h"


def _ended(
    folder: Path, table: pl.DataFrame, asked: str, items: Sequence[Item], counts: Counter[str]
) -> Campaign:
    """Counts and problems of the experiments that were asked for."""
    import polars as pl

    wanted = {item.name for item in items}
    own = table.filter(pl.col("asked") == asked)
    best = best_rows(own)
    # Beside a baseline whose numbers are there, a method that has none may reject.
    rejected = dict(own.filter(~pl.col("accepted")).select("experiment", "reason").iter_rows())
    found: Counter[str] = Counter()
    problems = []
    for row in best.select("experiment", "status", "accepted", "reason").iter_rows(named=True):
        if row["experiment"] not in wanted:
            continue
        what = row["status"]
        if what == DONE:
            judged = row["accepted"]
            if judged is None and row["experiment"] in rejected:
                judged, row["reason"] = False, rejected[row["experiment"]]
            accepted = {True: "accepted", False: "not accepted", None: "not assessed"}
            what = "inspected" if asked == INSPECT else accepted[judged]
        found[what] += 1
        if what not in ("accepted", "inspected", "not assessed"):
            problems.append(f"{row['experiment']}: {what}: {row['reason'] or 'no reason given'}")
    order = ("accepted", "inspected", "not accepted", "not assessed", REFUSED, LOST)
    return Campaign(
        folder,
        len(items),
        counts["unchanged"],
        {what: found[what] for what in order if found[what]},
        tuple(problems),
    )
