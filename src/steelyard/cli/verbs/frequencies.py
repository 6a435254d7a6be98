"""The verb `frequencies`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from steelyard.cli.options import common
from steelyard.cli.printing import print_result
from steelyard.errors import InputError

if TYPE_CHECKING:
    from steelyard.estimates.estimate import Estimate
    from steelyard.robot.model import Robot


@click.command(short_help="Where a body hangs at rest, and how it swings about that.")
@click.argument("body", metavar="ESTIMATE|ROBOT")
@click.option(
    "--robot",
    metavar="ROBOT",
    help="On whose cables the body of an ESTIMATE hangs: a bundled name or a robot file.",
)
@click.option(
    "--pose",
    metavar="X,Y,Z,ROLL,PITCH,YAW",
    help="The cables have the lengths of this pose [m], [rad].",
)
@click.option("--lengths", metavar="L1,…", help="Unstrained lengths of all cables [m].")
@click.option(
    "--elastic",
    is_flag=True,
    help="Cables stretch and sag as the robot file says; with six cables and more they always do.",
)
@common
def frequencies(
    body: str,
    robot: str | None,
    pose: str | None,
    lengths: str | None,
    elastic: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Where a body comes to rest on cables of constant length, and how it swings about that.

    ESTIMATE is an estimate.json or a folder with one, with :METHOD behind it for one of its
    methods; its covariance gives the 1-sigma. Of a ROBOT it is the nominal platform.
    """
    from steelyard.natural_frequencies.frequencies import frequencies as found_on
    from steelyard.report.documents.frequencies import frequencies_document

    own, estimate = _read(body, robot)
    found = found_on(
        own,
        estimate,
        pose=_numbers("--pose", pose),
        lengths=_numbers("--lengths", lengths),
        elastic=elastic,
    )
    print_result(found.to_dict(), frequencies_document(found), as_json=as_json)


def _read(body: str, robot: str | None) -> tuple[Robot, Estimate | None]:
    """The robot, and the estimate that hangs on it; None: its nominal platform."""
    from steelyard.estimates.file.places import read_estimates
    from steelyard.robot.file import bundled_names, read_robot

    if body in bundled_names() or body.endswith((".yaml", ".yml")):
        if robot is not None:
            raise InputError(
                f"--robot: expected an estimate beside it, found robot '{body}'; leave one out"
            )
        return read_robot(body), None
    (estimate,) = read_estimates([body])
    if robot is None:
        raise InputError(
            "--robot: expected the robot on whose cables the body hangs, found none; name a bundled"
            " robot or a robot file"
        )
    return read_robot(robot), estimate.estimate


def _numbers(option: str, text: str | None) -> list[float] | None:
    """Numbers between commas."""
    if text is None:
        return None
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(
            f"{option}: expected numbers between commas, found '{text}'; correct it"
        ) from None
