"""The verb `schema`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from steelyard.cli.options import force_option, out_option


@click.command(short_help="The JSON schema of experiment or robot files.")
@click.argument("which", type=click.Choice(["experiment", "robot"]), default="experiment")
@out_option(help="File to write. Default: print it.")
@force_option(help="Replace the file.")
def schema(which: Any, out: Path | None, force: bool) -> None:
    """Print the JSON schema of experiment or robot files: editors complete and check YAML with
    it.
    """
    from steelyard.experiment.schema import schema as json_schema
    from steelyard.output import check_file_target, results_file, to_json, write_file

    if out is not None:
        check_file_target(out, force=force)
    text = to_json(json_schema(which), ascii_only=True) + "\n"
    if out is None:
        print(text, end="")
        return
    with results_file(out, force=force) as fresh:
        write_file(fresh, text)
    print(f"{out}: begin a file beside it with")
    print(f"# yaml-language-server: $schema={out.name}")
