"""Poses at rest that tell the geometry of a robot best."""

from __future__ import annotations

from steelyard.cli.designs.shown import Shown
from steelyard.cli.printing import print_result, progress, say
from steelyard.excitation.poses.pose_design import USUAL_POSES, design_poses
from steelyard.excitation.poses.pose_file import POSES, poses_dict, write_poses
from steelyard.report.documents.poses import poses_document


def propose_poses(
    place: str, poses: int | None, sensors: str, margin: float, seed: int, shown: Shown
) -> None:
    """Poses at rest for a calibration; see :func:`steelyard.design_poses`."""
    count = USUAL_POSES if poses is None else poses
    with progress(quiet=shown.quiet) as tell:
        found = design_poses(place, count, sensors=sensors, margin=margin, seed=seed, progress=tell)
    document = poses_document(found)
    shown.write(lambda folder: write_poses(found, folder), document, "poses")
    print_result(poses_dict(found), document, as_json=shown.as_json)
    if shown.out is not None and not shown.as_json:
        print()
        say(
            f"The poses are in {shown.out / POSES}. Record one row a pose with every instrument, as"
            " a run with 'static: true', then:"
        )
        print("  steelyard calibrate EXPERIMENT --out DIR")
