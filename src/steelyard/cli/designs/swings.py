"""Free swings that tell the body of a platform without force sensors."""

from __future__ import annotations

from steelyard.cli.designs.shown import Shown
from steelyard.cli.printing import print_result, progress, say
from steelyard.errors import InputError
from steelyard.excitation.swings.swing_design import (
    USUAL_DURATION,
    USUAL_SWINGS,
    design_swings,
)
from steelyard.excitation.swings.swing_file import RESULT, ROBOT, swings_dict, write_swings
from steelyard.report.documents.free_swings import free_swings_document


def propose_swings(
    place: str,
    swings: int | None,
    duration: float | None,
    cables: str | None,
    sensors: str,
    shown: Shown,
) -> None:
    """Free swings to record; see :func:`steelyard.design_swings`."""
    with progress(quiet=shown.quiet) as tell:
        found = design_swings(
            place,
            USUAL_SWINGS if swings is None else swings,
            duration=USUAL_DURATION if duration is None else duration,
            cables=_numbers_of(cables),
            sensors=sensors,
            progress=tell,
        )
        document = free_swings_document(found)
        shown.write(lambda folder: write_swings(found, folder), document, "swings")
    print_result(swings_dict(found), document, as_json=shown.as_json)
    if shown.out is not None and not shown.as_json:
        print()
        say(
            f"{RESULT} and {ROBOT}, with the cables that stay, are in {shown.out}/. Record each"
            " swing as a run with 'winches: locked', then:"
        )
        print("  steelyard identify EXPERIMENT --out DIR")


def _numbers_of(cables: str | None) -> list[int] | None:
    """Of cables, with commas between.

    Raises:
        InputError: They are no numbers.
    """
    if cables is None:
        return None
    try:
        return [int(each) for each in cables.split(",")]
    except ValueError:
        raise InputError(
            f"--cables: expected numbers with commas between, such as 1,3,5, found '{cables}';"
            " correct it"
        ) from None
