"""The verb `calibrate`."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from steelyard.cli.inputs import read_files
from steelyard.cli.options import (
    check_there,
    common,
    experiment_argument,
    force_option,
    limits_option,
    out_option,
)
from steelyard.cli.printing import print_result, progress

NOT_ACCEPTED = 3
"""Exit status of a calibration that was made and written, but is not accepted."""


@click.command(short_help="Find anchors, attachments and drums of the robot.")
@experiment_argument
@out_option(
    help="Folder for robot.yaml, robot.covariance.csv, calibration.json, calibration.html and"
    " calibration.md; without it nothing is written."
)
@force_option()
@limits_option
@common
def calibrate(experiment: Path, out: Path | None, force: bool, as_json: bool, quiet: bool) -> None:
    """Find anchors, attachments and drums of the robot from the poses at rest and the recordings in
    motion that EXPERIMENT lists.
    """
    check_there(experiment)
    with progress(quiet=quiet) as tell:
        from steelyard.calibration.calibrate import calibrate as calibrated
        from steelyard.experiment.read import read_experiment
        from steelyard.output import check_target
        from steelyard.report.documents.calibration import calibration_document
        from steelyard.report.write_calibration import write_calibration

        if out is not None:
            check_target(out, force=force)
        recorded = read_experiment(experiment, weighed=False)
        found = calibrated(recorded, tell)
    if out is not None:
        inputs = read_files(recorded, experiment)
        write_calibration(found, out, force=force, inputs=inputs, command=sys.argv[1:])
    print_result(found.to_dict(), calibration_document(found), as_json=as_json)
    if found.reasons:
        sys.exit(NOT_ACCEPTED)
