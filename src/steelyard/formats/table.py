"""Every kind of file that is written: its number, where it is found, and its schema."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from steelyard.formats import plans, results, tables
from steelyard.formats.parts import Schema

DIALECT = "https://json-schema.org/draft/2020-12/schema"


@dataclass(frozen=True)
class FileKind:
    """A kind of file."""

    number: str
    """As it stands in the file."""
    where: str
    """Which files are of this kind."""
    schema: Schema | None
    """Of the whole, or of a row of a table; None: drawn from the forms of its reader."""
    table: bool = False
    """Whether the number stands in the footer of a table, and the schema is that of a row."""


FORMATS: Mapping[str, FileKind] = {
    "experiment": FileKind("steelyard/1", "an experiment file", None),
    "robot": FileKind("steelyard/1", "a robot file, which states no number", None),
    "estimate": FileKind("steelyard-estimate/1", "estimate.json", results.ESTIMATE),
    "report": FileKind("steelyard-report/1", "report.json", None),
    "provenance": FileKind("steelyard-provenance/1", "provenance.json", results.PROVENANCE),
    "calibration": FileKind("steelyard-calibration/1", "calibration.json", results.CALIBRATION),
    "comparison": FileKind("steelyard-comparison/1", "comparison.json", results.COMPARISON),
    "inspection": FileKind("steelyard-inspection/1", "inspection.json", results.INSPECTION),
    "frequencies": FileKind(
        "steelyard-frequencies/1", "what `frequencies --json` prints", results.FREQUENCIES
    ),
    "body": FileKind("steelyard-body/1", "YAML and JSON of `export`", results.BODY_FILE),
    "truth": FileKind("steelyard-truth/1", "truth.json of `simulate`", results.TRUTH),
    "watch": FileKind("steelyard-watch/1", "every line of `watch`", results.WATCH),
    "design": FileKind("steelyard-design/1", "design.json", plans.DESIGN),
    "poses": FileKind("steelyard-poses/1", "poses.json", plans.POSES),
    "swings": FileKind("steelyard-swings/1", "swings.json", plans.SWINGS),
    "reference": FileKind("steelyard-reference/1", "reference.json", plans.REFERENCE),
    "study": FileKind("steelyard-study/1", "study.json", plans.STUDY),
    "campaign": FileKind("steelyard-campaign/1", "what `campaign --json` prints", plans.CAMPAIGN),
    "rows": FileKind("steelyard-rows/1", "campaign.parquet", tables.CAMPAIGN_ROW, table=True),
    "stream": FileKind(
        "steelyard-stream/1", "RUN/INSTRUMENT.parquet of `convert`", tables.STREAM_ROW, table=True
    ),
    "records": FileKind(
        "steelyard-records/1", "Parquet of `watch --out`", tables.RECORD_ROW, table=True
    ),
    "motion": FileKind("steelyard-motion/1", "motion.parquet", tables.MOTION_ROW, table=True),
}
"""Name for ``steelyard schema`` -> kind of file."""


def schema_of(name: str) -> dict[str, Any]:
    """JSON Schema (2020-12) of a kind of file.

    Later versions may add keys to what has the same number; where a mapping is closed, as in files
    that people write, an unknown key is a mistake.

    Args:
        name: Key of :data:`FORMATS`.
    """
    kind = FORMATS[name]
    if kind.schema is None:
        return _drawn(name)
    said = kind.schema
    if not kind.table:
        number = {"format": {"const": kind.number}}
        said = {
            **said,
            "properties": {**number, **said["properties"]},
            "required": ["format", *said["required"]],
        }
    return {"$schema": DIALECT, "title": f"{kind.number}: {kind.where}", **said}


def _drawn(name: str) -> dict[str, Any]:
    """The schema of what a reader checks by its forms."""
    from steelyard.experiment.schema import schema
    from steelyard.report.evidence.report_file import report_schema

    which: Mapping[str, Literal["experiment", "robot"]] = {
        "experiment": "experiment",
        "robot": "robot",
    }
    if name in which:
        return schema(which[name])
    kind = FORMATS[name]
    return {"$schema": DIALECT, "title": f"{kind.number}: {kind.where}", **report_schema()}
