"""The verb that tells editors what the files may hold."""

from __future__ import annotations

from pathlib import Path

from steelyard.experiment.schema import Which, schema
from steelyard.output import check_file_target, results_file, to_json


def run_schema(which: Which, out: Path | None, *, force: bool) -> None:
    """Print or write the JSON schema of a file."""
    if out is not None:
        check_file_target(out, force=force)
    text = to_json(schema(which), ascii_only=True) + "\n"
    if out is None:
        print(text, end="")
        return
    with results_file(out, force=force) as fresh:
        fresh.write_text(text, encoding="utf-8")
    print(f"{out}: begin a file beside it with")
    print(f"# yaml-language-server: $schema={out.name}")
