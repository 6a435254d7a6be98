"""The summary on disk: ``report.json``, from which a report is drawn again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

from pydantic import TypeAdapter, ValidationError

from steelyard.errors import InputError
from steelyard.files.json_file import read_json
from steelyard.files.regular_file import require_file
from steelyard.output import settle, write_file
from steelyard.report.evidence.summary import Summary
from steelyard.report.evidence.values import Trace

FILE_NAME = "report.json"
FORMAT: Literal["steelyard-report/1"] = "steelyard-report/1"


@dataclass(frozen=True)
class _ReportFile:
    """What stands in the file."""

    format: Literal["steelyard-report/1"]
    summary: Summary


@cache
def _form() -> TypeAdapter[_ReportFile]:
    return TypeAdapter(_ReportFile)


def report_schema() -> dict[str, Any]:
    """JSON Schema of the file, drawn from what the reader checks."""
    drawn = _form().json_schema(mode="serialization")
    drawn.pop("title", None)
    return drawn


def write_summary(summary: Summary, path: Path) -> None:
    """Write a summary as JSON, the same bytes for the same values."""
    write_file(path, _form().dump_json(_ReportFile(FORMAT, summary)) + b"\n")


def read_summary(folder: Path) -> Summary:
    """Read what `identify` wrote beside its estimate.

    Args:
        folder: The one that `identify` wrote into.

    Raises:
        InputError: It is not there, too large, no JSON, or not of this form.
    """
    path = folder / FILE_NAME if folder.is_dir() else folder
    # Of a process that was killed while it replaced results.
    settle(path.parent)
    require_file(path, f"{FILE_NAME} that identify wrote, or its folder")
    try:
        summary = _form().validate_python(read_json(path)).summary
    except ValidationError as error:
        first: Any = error.errors(include_url=False, include_context=False)[0]
        key = ".".join(str(part) for part in first["loc"])
        raise InputError(
            f"{path}: {f'{key[:100]}: ' if key else ''}expected a summary that identify wrote"
            f" ({FORMAT}), found that it is not one ({str(first['msg'])[:100]}); run identify again"
            " with --out"
        ) from None
    problem = next(_inconsistencies(summary), None)
    if problem:
        raise InputError(f"{path}: {problem}; run identify again with --out")
    return summary


def _inconsistencies(summary: Summary) -> Iterator[str]:
    """Parts that do not fit each other."""
    if summary.result not in {body.name for body in summary.bodies}:
        yield f"result: expected the name of one of the bodies, found '{summary.result[:60]}'"
    for trace in summary.evidence.traces:
        yield from _of_trace(trace)
    for motion in summary.evidence.motions:
        if not len(motion.time) == len(motion.position) == len(motion.rotation):
            yield (
                f"motion of run '{motion.run[:60]}': expected as many poses as times, found another"
                " number"
            )
    shape = summary.evidence.shape
    if shape and len(shape.anchors) != len(shape.attachments):
        yield "shape: expected as many attachments as anchors, found another number"


def _of_trace(trace: Trace) -> Iterator[str]:
    """What does not fit in one of k channels with n samples."""
    name = f"trace '{trace.instrument[:60]}'"
    k, n = len(trace.channels), len(trace.time)
    channels = {len(trace.measured), len(trace.residual), len(trace.rms)}
    samples = {len(row) for row in (*trace.measured, *trace.residual)}
    if channels != {k} or samples - {n}:
        yield f"{name}: expected {k} channels of {n} samples, found another number"
    if trace.sigma is not None and len(trace.sigma) != k:
        yield f"{name}: expected {k} values of sigma, found {len(trace.sigma)}"
    if any(not (0 <= c < k and 0 <= s < n) for c, s in trace.left_out):
        yield f"{name}: expected places of samples that are there, found others"
    if trace.spectrum and len(trace.spectrum.frequency) != len(trace.spectrum.power):
        yield f"{name}: expected as many powers as frequencies, found another number"
