"""The summary on disk: ``report.json``, from which a report is drawn again."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

from pydantic import TypeAdapter, ValidationError

from steelyard.errors import InputError
from steelyard.inertia import BODY_PARAMETERS
from steelyard.json_file import read_json
from steelyard.report.summary import Summary
from steelyard.yaml_file import require_file

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


def write_summary(summary: Summary, path: Path) -> None:
    """Write a summary as JSON, the same bytes for the same values."""
    path.write_bytes(_form().dump_json(_ReportFile(FORMAT, summary)) + b"\n")


def read_summary(folder: Path) -> Summary:
    """Read what `identify` wrote beside its estimate.

    Args:
        folder: The one that `identify` wrote into.

    Raises:
        InputError: It is not there, too large, no JSON, or not of this form.
    """
    path = folder / FILE_NAME if folder.is_dir() else folder
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
    problem = _inconsistency(summary)
    if problem:
        raise InputError(f"{path}: {problem}; run identify again with --out")
    return summary


def _inconsistency(summary: Summary) -> str | None:
    """What is wrong with a summary whose parts are well formed."""
    if summary.result not in {body.name for body in summary.bodies}:
        return f"result: expected the name of one of the bodies, found '{summary.result[:60]}'"
    ten = len(BODY_PARAMETERS)
    for body in summary.bodies:
        sizes = {
            len(body.value),
            len(body.covariance),
            len(body.labels),
            *(len(row) for row in body.covariance),
        }
        if sizes != {ten}:
            return (
                f"body '{body.name[:60]}': expected {ten} values with their covariance, found"
                f" {sorted(sizes)}"
            )
    for given in (summary.nominal, summary.truth, summary.attainable):
        if given is not None and len(given) != ten:
            return f"expected {ten} values of a body, found {len(given)}"
    for table in (summary.table, *summary.runs):
        for column in table.columns:
            if any(
                values is not None and len(values) != ten
                for values in (column.values, column.deviations, column.errors)
            ):
                return (
                    f"table '{table.title[:60]}': expected {ten} values a column, found another"
                    " number"
                )
    for trace in summary.evidence.traces:
        k, n = len(trace.channels), len(trace.time)
        parts = (trace.measured, trace.residual)
        if (
            any(len(part) != k or any(len(row) != n for row in part) for part in parts)
            or len(trace.rms) != k
        ):
            return (
                f"trace '{trace.instrument[:60]}': expected {k} channels of {n} samples, found"
                " another number"
            )
        if trace.sigma is not None and len(trace.sigma) != k:
            return (
                f"trace '{trace.instrument[:60]}': expected {k} values of sigma, found"
                f" {len(trace.sigma)}"
            )
        if any(not (0 <= c < k and 0 <= s < n) for c, s in trace.left_out):
            return (
                f"trace '{trace.instrument[:60]}': expected places of samples that are there, found"
                " others"
            )
        if trace.spectrum and len(trace.spectrum.frequency) != len(trace.spectrum.power):
            return (
                f"trace '{trace.instrument[:60]}': expected as many powers as frequencies, found"
                " another number"
            )
    for motion in summary.evidence.motions:
        if not len(motion.time) == len(motion.position) == len(motion.rotation):
            return (
                f"motion of run '{motion.run[:60]}': expected as many poses as times, found another"
                " number"
            )
    shape = summary.evidence.shape
    if shape and len(shape.anchors) != len(shape.attachments):
        return "shape: expected as many attachments as anchors, found another number"
    return None
