"""The verb that puts estimates side by side."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np

from steelyard.errors import InputError
from steelyard.estimates.comparison import compare
from steelyard.estimates.estimate_file import read_estimates
from steelyard.estimates.payload import payload
from steelyard.output import to_json
from steelyard.report.comparison import show_comparison, show_payload

EXCEEDED = 1
"""Exit status where differences exceed what was asked for."""
_MOST = 20
"""Estimates at once; every two of them are compared."""


def run_comparison(
    places: Sequence[str],
    *,
    method: str | None,
    fail_above: float | None,
    as_json: bool,
) -> None:
    """Compare estimates; ends the process with status 1 where they differ by more sigmas than
    ``fail_above``.
    """
    if fail_above is not None and not (np.isfinite(fail_above) and fail_above > 0):
        raise InputError(
            f"--fail-above: expected a number of sigmas above 0, found {fail_above:g}; correct it"
        )
    estimates = read_estimates(places, method)
    if len(estimates) > _MOST:
        raise InputError(
            f"compare: expected at most {_MOST} estimates, found {len(estimates)}; name fewer"
        )
    comparison = compare(estimates)
    exceeding = comparison.exceeding(fail_above) if fail_above is not None else ()
    if as_json:
        verdict = (
            {} if fail_above is None else {"fail_above": fail_above, "exceeding": list(exceeding)}
        )
        print(to_json({**comparison.to_dict(), **verdict}, ascii_only=True))
    else:
        show_comparison(comparison, fail_above=fail_above)
    if exceeding:
        sys.exit(EXCEEDED)


def run_payload(
    places: Sequence[str], *, method: str | None, fail_above: float | None, as_json: bool
) -> None:
    """What was added between two estimates."""
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
    if as_json:
        print(to_json(found.to_dict(), ascii_only=True))
    else:
        show_payload(found)
