"""The verb `schema`."""

from __future__ import annotations

from pathlib import Path

import click

from steelyard.cli.options import common, force_option, out_option
from steelyard.cli.printing import print_json


@click.command(short_help="The JSON schema of any file that steelyard reads or writes.")
@click.argument("which", default="experiment", metavar="[NAME]")
@out_option(help="File to write. Default: print it.")
@force_option(help="Replace the file.")
@common
def schema(which: str, out: Path | None, force: bool, as_json: bool, quiet: bool) -> None:
    """Print the JSON schema of a kind of file, of tables that of a row.

    NAME is experiment (the default), robot, estimate, report, calibration or another that
    `steelyard schema list` names. Editors complete and check YAML with the first two.
    """
    from steelyard.errors import InputError
    from steelyard.formats.table import FORMATS, schema_of
    from steelyard.output import check_file_target, results_file, to_json, write_file

    if which == "list":
        if as_json:
            print_json({
                name: {"format": kind.number, "where": kind.where} for name, kind in FORMATS.items()
            })  # fmt: skip
            return
        for name, kind in FORMATS.items():
            print(f"{name:12} {kind.number:24} {kind.where}")
        return
    if which not in FORMATS:
        raise InputError(
            f"expected one of {', '.join(FORMATS)}, found '{which}'; `steelyard schema list` says"
            " which files these are"
        )
    if out is not None:
        check_file_target(out, force=force)
    text = to_json(schema_of(which), ascii_only=True) + "\n"
    if out is None:
        print(text, end="")
        return
    with results_file(out, force=force) as fresh:
        write_file(fresh, text)
    if as_json:
        print_json({"out": str(out), "format": FORMATS[which].number})
        return
    if which not in ("experiment", "robot"):
        print(f"{out}: the schema of {FORMATS[which].number}")
        return
    print(f"{out}: begin a file beside it with")
    print(f"# yaml-language-server: $schema={out.name}")
