"""Weighed bodies and poses at rest that would help most beside an experiment."""

from __future__ import annotations

from steelyard.cli.designs.request import target_of
from steelyard.cli.designs.shown import Shown
from steelyard.cli.printing import print_result, progress
from steelyard.excitation.references.reference_design import (
    USUAL_REST,
    USUAL_SIGMA,
    design_references,
)
from steelyard.excitation.references.reference_file import RESULT, reference_dict
from steelyard.output import write_json
from steelyard.report.documents.references import reference_document


def compare_references(
    place: str,
    sensors: str,
    check: str | None,
    duration: float | None,
    poses: int | None,
    sigma: float | None,
    target: str | None,
    shown: Shown,
) -> None:
    """Reference bodies beside an experiment; see :func:`steelyard.design_references`."""
    with progress(quiet=shown.quiet) as tell:
        found = design_references(
            place,
            sensors=sensors,
            motion=check,
            duration=duration,
            poses=USUAL_REST if poses is None else poses,
            sigma=USUAL_SIGMA if sigma is None else sigma,
            target=target_of(place, sensors, target),
            progress=tell,
        )
    values, document = reference_dict(found), reference_document(found)
    shown.write(lambda folder: write_json(values, folder / RESULT), document, "reference")
    print_result(values, document, as_json=shown.as_json)
