"""The verb `verify`."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import click

from steelyard.cli.options import common
from steelyard.cli.printing import print_json
from steelyard.errors import InputError

if TYPE_CHECKING:
    from steelyard.provenance.record import Provenance
    from steelyard.provenance.verify import Repetition

CHANGED = 3
"""Exit status where something is not as it was."""
_REPEATABLE = ("identify", "calibrate", "design")


@click.command(short_help="Check that results and their inputs are as they were.")
@click.argument("folder", type=click.Path(path_type=Path), metavar="DIR")
@click.option("--again", is_flag=True, help="Compute the results again, and compare all numbers.")
@common
def verify(folder: Path, again: bool, as_json: bool, quiet: bool) -> None:
    """Say whether the results in DIR, and every file that they were made of, are still those that
    identify, calibrate or design read and wrote.

    Exit status: 0 all is as it was, 3 something is not.
    """
    from steelyard.provenance.verify import verify as verified

    if not folder.is_dir():
        found = "a file" if folder.exists() else "nothing"
        raise InputError(f"{folder}: expected a folder of results, found {found}; check the path")
    found_out = verified(folder)
    repeated = _repeat(found_out.provenance, folder) if again else None
    if as_json:
        again_values = {} if repeated is None else {"again": repeated.to_dict()}
        print_json({**found_out.to_dict(), **again_values})
    else:
        known = found_out.provenance
        for line in found_out.changed:
            click.echo(line)
        if not found_out.changed:
            click.echo(
                f"{folder}: {len(known.inputs)} inputs and {len(known.results)} results are as they"
                f" were on {known.time}"
            )
        for line in found_out.other_versions:
            click.echo(f"another version here: {line}")
        if repeated is not None:
            click.echo(_in_words(repeated))
    if found_out.changed or (repeated is not None and not repeated.agrees):
        sys.exit(CHANGED)


def _repeat(known: Provenance, folder: Path) -> Repetition:
    """Run the command again, into a folder that is thrown away.

    Raises:
        InputError: There is no command, or it does not end with results.
    """
    from steelyard.provenance.verify import compare_numbers

    words = list(known.command)
    if not words or words[0] not in _REPEATABLE or "--" in words:
        raise InputError(
            f"{folder}: expected the command that made it, {', '.join(_REPEATABLE)}, found"
            f" '{' '.join(words)[:100]}'; only these can be made again"
        )
    with tempfile.TemporaryDirectory() as place:
        fresh = Path(place) / "again"
        # The last --out counts: nothing else is written, whatever the command says.
        command = [
            sys.executable,
            "-m",
            "steelyard",
            *words,
            "--quiet",
            "--force",
            "--out",
            str(fresh),
        ]
        ended = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        if not fresh.is_dir():
            said = ended.stderr.strip().removeprefix("steelyard: ")
            raise InputError(f"{folder}: expected the same results again, found: {said}")
        return compare_numbers(folder, fresh)


def _in_words(repeated: Repetition) -> str:
    """What came out again."""
    if repeated.same_bits:
        return f"again: {repeated.numbers} numbers, the same to the last bit"
    largest = (
        f"{repeated.largest:.2g} 1-sigma (of a thousand times the number where it has none) at"
        f" {repeated.where}"
    )
    return f"again: {repeated.numbers} numbers, the largest difference {largest}"
