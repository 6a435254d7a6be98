"""A study: the same experiment again and again, and what the estimates say of their own 1-sigma."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from steelyard.arrays import number_given, whole_given
from steelyard.campaigns.inputs import inputs_hash
from steelyard.campaigns.journal import alone_in, joined
from steelyard.campaigns.rows import LOST, REFUSED, known_hashes
from steelyard.campaigns.run import Progress, engine_of, prepared, work_through
from steelyard.campaigns.study.document import study_document
from steelyard.campaigns.study.draw import DrawTask, ResampleTask, draw, resample
from steelyard.campaigns.study.power import SOUND, Rejections, mistaken, rejections
from steelyard.campaigns.study.resample import resampled
from steelyard.campaigns.study.result import Study
from steelyard.campaigns.study.setup import (
    Setup,
    is_experiment,
    setup_of_experiment,
    setup_of_robot,
)
from steelyard.campaigns.study.summary import summaries
from steelyard.campaigns.tasks import Engine
from steelyard.campaigns.work import asked_for
from steelyard.errors import InputError
from steelyard.experiment.read import read_experiment
from steelyard.identification.chosen_methods import chosen_methods
from steelyard.inertia import BODY_PARAMETERS
from steelyard.output import results_file, write_file, write_json
from steelyard.report.evidence.made import steelyard_version
from steelyard.report.forms.markdown import markdown
from steelyard.report.forms.page import page
from steelyard.simulation.mistakes import MISTAKES, possible_mistakes
from steelyard.simulation.sensors import read_sensors

if TYPE_CHECKING:
    import polars as pl

RESULT = "study"
"""Name of the files, without their endings."""
ALL = "all"
"""In place of names of mistakes."""
_SETUP = "setup.json"
"""Which experiment the folder ``basis`` is of."""
_WHOLE = "whole"
"""Name of the row of a bootstrap that is of the recording as it is."""


def study(
    what: str | Path,
    out: str | Path,
    draws: int = 0,
    methods: str | Sequence[str] = (),
    *,
    bootstrap: int = 0,
    block: float = 0.0,
    sensors: str | None = None,
    trajectory: str | None = None,
    duration: float | None = None,
    seed: int = 0,
    mistakes: str | Sequence[str] = (),
    jobs: int | None = None,
    client: Any = None,
    engine: Engine | None = None,
    progress: Progress = None,
) -> Study:
    """Check stated uncertainties: simulate an experiment many times and identify it each time, or
    identify what is drawn from its recordings.

    Draws that are done already are not done again, as in :func:`steelyard.campaign`.

    Args:
        what: Robot (bundled name or file), or experiment file: its motion and body, as `identify`
            finds them, are simulated with its own description.
        out: Folder for the results; new, or of the same study.
        draws: How many are simulated.
        methods: Names of estimators; none: the default ones.
        bootstrap: How many are drawn from the recordings instead, with replacement.
        block: Of a bootstrap: length of the blocks that are drawn [s]; 0: whole runs.
        sensors: Of a robot, as in `simulate`; None: those of the paper.
        trajectory: Of a robot, likewise; None: a multisine.
        duration: Of that motion [s].
        seed: Of the first draw; the following ones have the numbers behind it.
        mistakes: Names of mistakes (:data:`steelyard.simulation.mistakes.MISTAKES`) that are made
            in every draw, one at a time, for the power of the verdict against them; ``all``: all
            that these instruments can have.
        jobs: Processes on this machine; None: as many as it has cores.
        client: Of Dask: work on its cluster instead.
        engine: Where to work, in place of ``jobs`` and ``client``.
        progress: Is told what is being done and the fraction that is done.

    Raises:
        InputError: Something is wrong with what is asked for. A draw that fails raises nothing: it
            has a row that says so.
    """
    methods = (methods,) if isinstance(methods, str) else tuple(methods)
    chosen_methods(methods)
    draws, bootstrap = whole_given(draws, "--draws"), whole_given(bootstrap, "--bootstrap")
    seed, block = whole_given(seed, "--seed"), number_given(block, "--block", least=0, unit="s")
    count = draws or bootstrap
    if count < 2 or (draws and bootstrap):
        raise InputError(
            "study: expected at least two draws, by --draws or by --bootstrap, found"
            f" {draws} and {bootstrap}; give one of both"
        )
    recorded = is_experiment(str(what))
    if bootstrap and not recorded:
        raise InputError(
            f"{what}: expected an experiment file to draw recordings from, found a robot; use"
            " --draws"
        )
    given = [n for n, v in (("sensors", sensors), ("trajectory", trajectory)) if v is not None]
    if recorded and (given or duration is not None):
        name = (given or ["duration"])[0]
        raise InputError(
            f"--{name}: expected none with an experiment, which has its own, found one; leave it"
            " out"
        )
    wanted_mistakes = _named((mistakes,) if isinstance(mistakes, str) else tuple(mistakes))
    if wanted_mistakes and bootstrap:
        raise InputError(
            "--mistakes: expected draws, found a bootstrap, of which no truth is known; give"
            " --draws instead of --bootstrap"
        )
    engine = engine or engine_of(jobs, client)
    place = Path(what).resolve() if Path(what).is_file() else what
    setup = None
    if not recorded:
        setup = setup_of_robot(str(what), sensors or "paper", trajectory or "multisine", duration)
    if bootstrap:
        # Whether there is enough to draw from is said before anything is written.
        resampled(read_experiment(what), block, np.random.default_rng(seed))
    folder = prepared(out)
    asked = asked_for("identify", methods)
    made: tuple[str, ...] = ()
    with alone_in(folder):
        if recorded and not bootstrap:
            setup = _kept_setup(Path(what), folder, progress)
        common = (str(place), asked, methods)
        seeds = range(seed, seed + count)
        tasks: list[DrawTask] | list[ResampleTask]
        if setup is not None:
            sha256 = setup.sha256
            made = _possible(setup, wanted_mistakes)
            tasks = [
                DrawTask(mistaken(f"draw-{i:06}", name), *common, i, sha256, setup, name)
                for i in seeds
                for name in (SOUND, *made)
            ]
        else:
            sha256 = f"{inputs_hash(Path(what))}-{block:g}"
            tasks = [ResampleTask(f"draw-{i:06}", *common, i, sha256, block) for i in seeds] + [
                ResampleTask(_WHOLE, *common, 0, sha256, -1.0)
            ]
        known = known_hashes(joined(folder), asked, steelyard_version())
        left = [task for task in tasks if known.get(task.name) != sha256]
        work_through(folder, engine, draw if setup is not None else resample, left, progress)
        wanted = {task.name for task in tasks}
        found = _ended(str(what), folder, joined(folder), wanted, sha256, setup, made)
        _write(found)
        return found


def _named(mistakes: Sequence[str]) -> tuple[str, ...]:
    """Names of mistakes, in the order of their table; what is asked for as ``all`` is all of it.

    Raises:
        InputError: There is none of a name.
    """
    for name in mistakes:
        if name != ALL and name not in MISTAKES:
            raise InputError(
                f"--mistake: expected one of {', '.join(MISTAKES)}, found '{name}'; choose one of"
                " these"
            )
    return tuple(name for name in MISTAKES if ALL in mistakes or name in mistakes)


def _possible(setup: Setup, mistakes: Sequence[str]) -> tuple[str, ...]:
    """Those of some mistakes that can be made in what is simulated.

    Raises:
        InputError: None can.
    """
    robot = setup.robot_of()
    instruments = read_sensors(setup.sensors, robot).instruments
    possible = [each.name for each in possible_mistakes(instruments, robot.m)]
    found = tuple(name for name in mistakes if name in possible)
    if mistakes and not found:
        raise InputError(
            f"--mistake: expected one that these instruments can have ({', '.join(possible)}),"
            f" found '{mistakes[0]}'; choose one of these"
        )
    return found


def _kept_setup(path: Path, folder: Path, progress: Progress) -> Setup:
    """The setup of an experiment: that of the folder where it is of the same files."""
    digest = inputs_hash(path)
    kept = folder / _SETUP
    if kept.is_file():
        values = json.loads(kept.read_text(encoding="utf-8"))
        if values.pop("sha256") == digest:
            values["motions"] = tuple(values["motions"])
            values["uncertainty"] = tuple((name, v) for name, v in values["uncertainty"])
            return Setup(**values)
    setup = setup_of_experiment(path, folder, progress)
    with results_file(kept, force=True) as fresh:
        write_json({**vars(setup), "sha256": digest}, fresh)
    return setup


def _ended(
    what: str,
    folder: Path,
    table: pl.DataFrame,
    wanted: set[str],
    sha256: str,
    setup: Setup | None,
    mistakes: Sequence[str],
) -> Study:
    """What the rows of the present draws say."""
    import polars as pl

    own = table.filter(pl.col("experiment").is_in(sorted(wanted)) & (pl.col("sha256") == sha256))
    # That a mistake is refused is what it is made for.
    is_sound = ~pl.col("experiment").str.contains("/", literal=True)
    failed = (pl.col("status") == LOST) | ((pl.col("status") == REFUSED) & is_sound)
    lost = table.filter(pl.col("experiment").is_in(sorted(wanted)) & failed)
    problems = [f"{name}: {reason}" for name, reason in lost.select("experiment", "reason").rows()]
    truth, about = None, {}
    judged: tuple[Rejections, ...] = ()
    if setup is not None:
        body = setup.robot_of().platform
        assert body is not None  # setup_of_robot() and setup_of_experiment() have checked
        truth = body.body_parameters
        about = dict.fromkeys(own["method"].unique().to_list(), truth)
        judged = rejections(own, truth, mistakes)
        own = own.filter(is_sound)
    else:
        whole = own.filter(pl.col("experiment") == _WHOLE)
        for row in whole.iter_rows(named=True):
            values = [row[name] for name in BODY_PARAMETERS]
            about[row["method"]] = np.array(values, dtype=np.float64)
        own = own.filter(pl.col("experiment") != _WHOLE)
    return Study(
        what,
        folder,
        own["experiment"].n_unique(),
        setup is None,
        truth,
        summaries(own, about),
        tuple(problems),
        judged,
    )


def _write(found: Study) -> None:
    """Write ``study.json``, ``study.html`` and ``study.md``."""
    with results_file(found.folder / f"{RESULT}.json", force=True) as path:
        write_json(found.to_dict(), path)
    document = study_document(found)
    for ending, form in (("html", page), ("md", markdown)):
        with results_file(found.folder / f"{RESULT}.{ending}", force=True) as path:
            write_file(path, form(document))
