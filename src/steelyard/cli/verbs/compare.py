"""The verb `compare`."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from steelyard.cli.options import common, force_option, out_option
from steelyard.cli.printing import print_result
from steelyard.errors import InputError

if TYPE_CHECKING:
    from steelyard.report.blocks.document import Document

EXCEEDED = 1
"""Exit status where differences exceed what was asked for."""
_MOST = 20
"""Estimates at once; every two of them are compared."""


@click.command(short_help="Put estimates side by side.")
@click.argument("estimates", nargs=-1, required=True, metavar="ESTIMATE ESTIMATE...")
@click.option(
    "--payload", is_flag=True, help="What was added between two estimates: before, after."
)
@click.option(
    "--fail-above",
    type=float,
    metavar="SIGMAS",
    help="Exit status 1 where a parameter, or all as a whole, differ by more.",
)
@click.option(
    "--method", metavar="NAME", help="Which estimate of each file, or all. Default: its result."
)
@out_option(
    help="Folder for comparison.html with the intervals side by side, .md and .json (payload.… with"
    " --payload); must be new or empty."
)
@force_option()
@common
def compare(
    estimates: tuple[str, ...],
    payload: bool,
    fail_above: float | None,
    method: str | None,
    out: Path | None,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Put estimates side by side: differences in units of their uncertainty, and whether they
    agree.

    ESTIMATE is an estimate.json or a folder with one, with :METHOD behind it for one of its methods
    (:all for every one), and #LOAD for one of its loads.
    """
    if out is not None:
        from steelyard.output import check_target

        check_target(out, force=force)
    target = _PageFolder(out, force)
    if payload:
        _payload(estimates, method, fail_above, target, as_json=as_json)
    else:
        _comparison(estimates, method, fail_above, target, as_json=as_json)


@dataclass(frozen=True)
class _PageFolder:
    """Where the page goes."""

    out: Path | None
    force: bool

    def write(self, name: str, values: Mapping[str, Any], document: Document) -> None:
        """Write what there is to say, where it is asked for."""
        if self.out is None:
            return
        from steelyard.output import results_folder, write_json
        from steelyard.report.write import write_document

        with results_folder(self.out, force=self.force) as folder:
            write_json(values, folder / f"{name}.json")
            write_document(document, folder, name)


def _comparison(
    places: Sequence[str],
    method: str | None,
    fail_above: float | None,
    target: _PageFolder,
    *,
    as_json: bool,
) -> None:
    """Compare estimates; ends the process with status 1 where they differ by more sigmas than
    ``fail_above``.
    """
    from steelyard.estimates.comparison import compare as compared
    from steelyard.estimates.file.places import read_estimates
    from steelyard.report.documents.comparison import comparison_document, comparison_page

    if fail_above is not None and not (math.isfinite(fail_above) and fail_above > 0):
        raise InputError(
            f"--fail-above: expected a number of sigmas above 0, found {fail_above:g}; correct it"
        )
    estimates = read_estimates(places, method)
    if len(estimates) > _MOST:
        raise InputError(
            f"compare: expected at most {_MOST} estimates, found {len(estimates)}; name fewer"
        )
    comparison = compared(estimates)
    exceeding = comparison.exceeding(fail_above) if fail_above is not None else ()
    values = comparison.to_dict()
    if fail_above is not None:
        values |= {"fail_above": fail_above, "exceeding": list(exceeding)}
    target.write("comparison", values, comparison_page(comparison, fail_above=fail_above))
    print_result(values, comparison_document(comparison, fail_above=fail_above), as_json=as_json)
    if exceeding:
        sys.exit(EXCEEDED)


def _payload(
    places: Sequence[str],
    method: str | None,
    fail_above: float | None,
    target: _PageFolder,
    *,
    as_json: bool,
) -> None:
    """Say what was added between two estimates."""
    from steelyard.estimates.file.places import read_estimates
    from steelyard.estimates.payload import payload
    from steelyard.report.documents.comparison import payload_document

    if fail_above is not None:
        raise InputError(
            "--fail-above: expected none with --payload, whose estimates are meant to differ; leave"
            " one out"
        )
    estimates = read_estimates(places, method)
    if len(estimates) != 2:
        raise InputError(
            f"--payload: expected two estimates, before and after, found {len(estimates)}; name one"
            " file or FILE:METHOD for each"
        )
    found = payload(*estimates)
    target.write("payload", found.to_dict(), payload_document(found))
    print_result(found.to_dict(), payload_document(found), as_json=as_json)
