"""What a worker does with one experiment: from names of files to rows and files of results."""

from __future__ import annotations

import os
import re
import shutil
import time
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from steelyard.campaigns.inputs import inputs_hash, local_experiment
from steelyard.campaigns.rows import DONE, LOST, REFUSED, failed
from steelyard.campaigns.tasks import ExperimentTask, Outcome, Row
from steelyard.errors import SteelyardError
from steelyard.report.evidence.made import steelyard_version

if TYPE_CHECKING:
    from steelyard.experiment.model import Experiment
    from steelyard.identification.identification import Identification

DEFAULT = "default"
"""Stands for the methods that are taken where none is named."""
INSPECT = "inspect"
_UNFINISHED = ".steelyard-"
_DATE = re.compile(
    r"(?<!\d)(20\d\d)-?([01]\d)-?([0-3]\d)(?:[T_"
    r" -]?([0-2]\d)[-:.h]?([0-5]\d)(?:[-:.m]?([0-5]\d))?)?"
)
"""A date in a name, with or without a time of the day behind it."""
_EPOCHS = (9.5e8, 4.1e9)
"""Time stamps between the years 2000 and 2100, as seconds since 1970."""


def asked_for(verb: str, methods: Sequence[str]) -> str:
    """What is asked for as one word, the same for the same request; results of it have a folder of
    this name.
    """
    return INSPECT if verb == INSPECT else "+".join(sorted(set(methods))) or DEFAULT


def work_on(task: ExperimentTask) -> Outcome:
    """Identify (or inspect) one experiment and write its files.

    Raises nothing: what fails becomes a row that says why.
    """
    # What is loaded once is no time of the experiment that happens to be the first.
    from steelyard.identification import identify as _  # noqa: F401

    start = time.perf_counter()
    about: dict[str, Any] = {
        "asked": task.asked,
        "version": steelyard_version(),
    }
    try:
        with local_experiment(task.path) as path:
            about["sha256"] = inputs_hash(path)
            if about["sha256"] == task.known:
                return Outcome(unchanged=True)
            rows = _inspected(task, path) if task.verb == INSPECT else _identified(task, path)
    except SteelyardError as error:
        rows = [failed(task, REFUSED, str(error))]
    except Exception as error:
        # Whatever it is: one experiment must not cost the others.
        rows = [failed(task, LOST, said_of(error))]
    seconds = time.perf_counter() - start
    return Outcome(tuple({**row, **about, "seconds": seconds} for row in rows))


def said_of(error: Exception) -> str:
    """One sentence about an error that is none of the user's."""
    if isinstance(error, OSError):
        return f"{error.filename or 'file'}: {error.strerror or error}"
    first = (str(error).splitlines() or [""])[0]
    return f"{type(error).__name__}: {first}".rstrip(": ")


def _identified(task: ExperimentTask, path: Path) -> list[Row]:
    """Rows of all methods."""
    from steelyard.estimates.named_estimate import FILE_NAME as ESTIMATE
    from steelyard.experiment.read import read_experiment
    from steelyard.inspection.identify import identify
    from steelyard.output import write_json
    from steelyard.report.evidence.made import made_of
    from steelyard.report.evidence.summary import summarise
    from steelyard.report.write import write_identification

    experiment = read_experiment(path)
    found = identify(experiment, task.methods)
    with _results(task) as folder:
        if task.reports:
            options = {"method": task.asked}
            summary = summarise(found, None, made=made_of(experiment, options))
            write_identification(found, summary, folder)
        else:
            write_json(found.to_dict(), folder / ESTIMATE)
    common = {
        "experiment": task.name,
        "path": task.path,
        "status": DONE,
        "recorded": recorded_at(task.name, experiment),
    }
    return [{**common, **numbers} for numbers in estimate_rows(found)]


def estimate_rows(found: Identification) -> Iterator[Row]:
    """What the table has of the estimates of one experiment; of several loads the first one."""
    from steelyard.estimates.estimate import plain
    from steelyard.inertia import BODY_PARAMETERS

    for name, estimate in found.estimates.items():
        deviations = plain(estimate.standard_deviation)
        values = plain(estimate.value)
        yield {
            "method": name,
            **dict(zip(BODY_PARAMETERS, values, strict=True)),
            **{f"sigma_{p}": s for p, s in zip(BODY_PARAMETERS, deviations, strict=True)},
            "covariance": plain(estimate.covariance.ravel()),
            "accepted": estimate.verdict.accepted,
            "reason": "; ".join(estimate.verdict.reasons),
        }


def _inspected(task: ExperimentTask, path: Path) -> list[Row]:
    """The row of an inspection: what it names as wrong is the reason."""
    from steelyard.experiment.read import read_experiment
    from steelyard.inspection.inspect import inspect
    from steelyard.output import write_json
    from steelyard.report.documents.inspection_document import inspection_document
    from steelyard.report.write import write_document

    experiment = read_experiment(path)
    found = inspect(experiment)
    with _results(task) as folder:
        write_json(found.to_dict(), folder / "inspection.json")
        if task.reports:
            write_document(inspection_document(found), folder, "inspection")
    return [
        {
            "experiment": task.name,
            "path": task.path,
            "method": INSPECT,
            "status": DONE,
            "reason": "; ".join(
                f"{m.amendment.subject}: {m.amendment.what}" for m in found.mistakes
            ),
            "recorded": recorded_at(task.name, experiment),
        }
    ]


def _results(task: ExperimentTask) -> Any:
    """A folder for the results of a task, without what a killed worker has left there."""
    from steelyard.output import results_folder

    folder = Path(task.folder)
    # Made before: experiments may lie within each other.
    folder.mkdir(parents=True, exist_ok=True)
    for entry in os.scandir(folder):
        if entry.name.startswith(_UNFINISHED):
            shutil.rmtree(entry.path, ignore_errors=True)
    return results_folder(folder, force=True)


def recorded_at(name: str, experiment: Experiment | None = None) -> float | None:
    """When it was recorded, in seconds since 1970 UTC: by a date in its name, or by time stamps
    that are such seconds; None where neither tells it.
    """
    # The last one: that of the experiment itself.
    for found in list(_DATE.finditer(name))[-1:]:
        parts = [int(part) for part in found.groups(default="0")]
        try:
            return datetime(*parts, tzinfo=UTC).timestamp()  # type: ignore[arg-type, misc]
        except ValueError:
            pass
    for run in experiment.runs if experiment is not None else ():
        for stream in run.streams.values():
            if len(stream) and _EPOCHS[0] < float(stream.time[0]) < _EPOCHS[1]:
                return float(stream.time[0])
    return None
