"""The verb `design`."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click
from click.core import ParameterSource

from steelyard.cli.inputs import named_files
from steelyard.cli.options import (
    common,
    force_option,
    limits_option,
    out_option,
    pose_option,
    seed_option,
    sensors_option,
)
from steelyard.cli.printing import print_result, progress, say
from steelyard.errors import InputError

if TYPE_CHECKING:
    from steelyard.excitation.design import Design

REPORT = "design"
"""Name of the pages, without their endings."""


@click.command(short_help="Find the motion, or the poses, that tell most.")
@click.argument("place", metavar="ROBOT|EXPERIMENT")
@click.option(
    "--duration",
    type=float,
    metavar="S",
    help="Of each motion [s]; with --free of each swing (10).",
)
@click.option(
    "--calibration",
    is_flag=True,
    help=(
        "Poses at rest that tell anchors and attachments best, in place of a motion: poses.csv,"
        " poses.json, poses.html and poses.md."
    ),
)
@click.option(
    "--free",
    is_flag=True,
    help=(
        "Free swings without force sensors, in place of a motion: on which cables to hang the platform,"
        " where, and how to push it: swings.json, swings.html, swings.md and robot.yaml."
    ),
)
@click.option(
    "--cables",
    metavar="1,2,…",
    help="--free: the cables that stay. Default: all of fewer than six, else those that tell most.",
)
@click.option(
    "--reference",
    is_flag=True,
    help=(
        "A table of the weighed bodies and poses at rest that would help most if they were recorded"
        " beside the experiment (or, of what is not recorded yet, beside the motion of --check):"
        " reference.json, reference.html and reference.md."
    ),
)
@click.option(
    "--reference-sigma",
    type=float,
    help="1-sigma to which these bodies are weighed [kg]. Default: 0.01.",
)
@click.option(
    "--poses",
    type=int,
    help="How many at rest: with --calibration (20), or at most with --reference (9); swings with --free"
    " (6).",
)
@out_option(
    help="Folder for command.csv, design.json, design.html, design.md and motion.parquet; must be"
    " new or empty."
)
@click.option(
    "--check",
    metavar="FILE.csv",
    help=(
        "Look at this motion instead of searching: a CSV file of kind 'command', paper (its own"
        " move, repeated for --duration) or multisine."
    ),
)
@pose_option("--start", help="Pose to begin in [m], [deg]. Default: a good one.")
@pose_option("--end", help="Pose to end in. Default: where it began.")
@click.option(
    "--target",
    metavar="mass=…,cog=…,inertia=…",
    help=(
        "Wanted 1-sigma [kg], [m], [kg m^2]; mass and inertia also in %. Default: 1 % of the mass,"
        " 2 mm, 1 % of the largest moment."
    ),
)
@click.option(
    "--margin",
    type=float,
    default=0.2,
    show_default=True,
    help=(
        "By which share mass and inertia may differ from the nominal ones; the centre of gravity by"
        " 40 % of it, in radii of the platform."
    ),
)
@click.option(
    "--runs",
    type=int,
    default=1,
    show_default=True,
    help="How many motions, each to add what the others lack.",
)
@click.option(
    "--after",
    multiple=True,
    metavar="ESTIMATE|EXPERIMENT",
    help="What has been found already: the motion adds what it lacks; may be repeated.",
)
@click.option(
    "--body",
    metavar="ESTIMATE",
    help="Design for this body. Default: 'platform' of the robot file.",
)
@sensors_option(
    help="Of a robot alone: paper, ideal, calibration (a tracker and lengths; taken with --calibration"
    " where nothing is said), swings (motion capture; likewise with --free), or a YAML file with"
    " 'instruments'."
)
@click.option(
    "--budget",
    type=float,
    default=60.0,
    show_default=True,
    help="Time to spend [s]; more time, more starts.",
)
@seed_option(help="The same seed gives the same motion.")
@click.option(
    "--rate", type=float, default=100.0, show_default=True, help="Of the rows of the commands [Hz]."
)
@click.option(
    "--jobs",
    "--processes",
    "processes",
    type=click.IntRange(1),
    metavar="N",
    help="Processes that search at a time. Default: one per processor.",
)
@force_option()
@limits_option
@common
def design(
    place: str,
    duration: float | None,
    calibration: bool,
    free: bool,
    cables: str | None,
    reference: bool,
    reference_sigma: float | None,
    poses: int | None,
    out: Path | None,
    check: str | None,
    start: tuple[float, ...] | None,
    end: tuple[float, ...] | None,
    target: str | None,
    margin: float,
    runs: int,
    after: tuple[str, ...],
    body: str | None,
    sensors: str,
    budget: float,
    seed: int,
    rate: float,
    processes: int | None,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Find the motion within the robot's limits that makes the estimate most precise, and say
    beforehand how precise.

    Speeds, accelerations, workspace and tensions are those of 'limits' and 'tension' in the robot
    file.
    """
    from steelyard.cli.design_request import (
        check_numbers,
        check_unused,
        checked_motion,
        design_task,
        pose_of,
    )
    from steelyard.excitation.design import design as designed
    from steelyard.excitation.design_file import RESULT, design_dict, evaluation_dict, write_design
    from steelyard.output import check_target, results_folder, write_json
    from steelyard.provenance.record import write_provenance
    from steelyard.report.documents.design_document import design_document
    from steelyard.report.write import write_document
    from steelyard.simulation.sensors import CALIBRATION_SENSORS, SWING_SENSORS

    check_numbers(margin, runs, budget, rate)
    if out is not None:
        check_target(out, force=force)
    moves = {"--start": start, "--end": end, "--body": body, "--after": after}
    of_motion = {"--duration": duration, "--check": check, "--target": target}
    shown = _Shown(out, force, as_json, quiet)
    of_reference = {"--reference": reference or None, "--reference-sigma": reference_sigma}
    source = click.get_current_context().get_parameter_source("sensors")
    if free:
        of_motion.pop("--duration")
        others = {**moves, **of_motion, **of_reference, "--calibration": calibration or None}
        check_unused(others, "--free")
        if source is ParameterSource.DEFAULT:
            sensors = SWING_SENSORS
        _propose_swings(place, poses, duration, cables, sensors, shown)
        return
    check_unused({"--cables": cables}, "anything but --free")
    if calibration:
        check_unused({**moves, **of_motion, **of_reference}, "--calibration")
        if source is ParameterSource.DEFAULT:
            # Those of the paper do not tell where cables are fixed.
            sensors = CALIBRATION_SENSORS
        _propose_poses(place, poses, sensors, margin, seed, shown)
        return
    if reference:
        check_unused(moves, "--reference")
        _compare_references(place, sensors, check, duration, poses, reference_sigma, target, shown)
        return
    check_unused({"--poses": poses, "--reference-sigma": reference_sigma}, "a motion")
    with progress(quiet=quiet) as tell:
        task = design_task(place, sensors, body, after, target)
        found: Design | None = None
        if check is not None:
            evaluation = checked_motion(task, check, duration, margin, tell)
            values = evaluation_dict(evaluation)
        else:
            if duration is None:
                raise InputError(
                    "--duration: expected the length of the motion in seconds, found none; add it"
                )
            if out is None:
                raise InputError("--out: expected a folder for the commands, found none; add it")
            found = designed(
                task.experiment,
                duration,
                start=pose_of(start),
                end=pose_of(end),
                target=task.target,
                margin=margin,
                runs=runs,
                before=task.before,
                budget=budget,
                seed=seed,
                processes=processes or os.cpu_count() or 1,
                progress=tell,
            )
            evaluation, values = found.appraisal, design_dict(found)
        document = design_document(evaluation)
        if out is not None:
            with results_folder(out, force=force) as folder:
                if found is None:
                    write_json(values, folder / RESULT)
                else:
                    write_design(found, folder, rate)
                write_document(document, folder, REPORT)
                write_provenance(folder, out, named_files(sys.argv[1:], out), sys.argv[1:])
    print_result(values, document, as_json=as_json)
    if not as_json and found is not None and out is not None:
        _print_next_steps(found, place, out)


class _Shown(NamedTuple):
    """Where a result goes."""

    out: Path | None
    force: bool
    as_json: bool
    quiet: bool


def _propose_poses(
    place: str, poses: int | None, sensors: str, margin: float, seed: int, shown: _Shown
) -> None:
    """Poses at rest for a calibration; see :func:`steelyard.design_poses`."""
    from steelyard.excitation.poses.pose_design import USUAL_POSES, design_poses
    from steelyard.excitation.poses.pose_file import POSES, poses_dict, write_poses
    from steelyard.output import results_folder
    from steelyard.provenance.record import write_provenance
    from steelyard.report.documents.poses import poses_document
    from steelyard.report.write import write_document

    count = USUAL_POSES if poses is None else poses
    with progress(quiet=shown.quiet) as tell:
        found = design_poses(place, count, sensors=sensors, margin=margin, seed=seed, progress=tell)
    document = poses_document(found)
    if shown.out is not None:
        with results_folder(shown.out, force=shown.force) as folder:
            write_poses(found, folder)
            write_document(document, folder, "poses")
            write_provenance(folder, shown.out, named_files(sys.argv[1:], shown.out), sys.argv[1:])
    print_result(poses_dict(found), document, as_json=shown.as_json)
    if shown.out is not None and not shown.as_json:
        print()
        say(
            f"The poses are in {shown.out / POSES}. Record one row a pose with every instrument, as"
            " a run with 'static: true', then:"
        )
        print("  steelyard calibrate EXPERIMENT --out DIR")


def _propose_swings(
    place: str,
    swings: int | None,
    duration: float | None,
    cables: str | None,
    sensors: str,
    shown: _Shown,
) -> None:
    """Free swings to record; see :func:`steelyard.design_swings`."""
    from steelyard.excitation.swings.swing_design import (
        USUAL_DURATION,
        USUAL_SWINGS,
        design_swings,
    )
    from steelyard.excitation.swings.swing_file import RESULT, ROBOT, swings_dict, write_swings
    from steelyard.output import results_folder
    from steelyard.provenance.record import write_provenance
    from steelyard.report.documents.free_swings import free_swings_document
    from steelyard.report.write import write_document

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
        if shown.out is not None:
            with results_folder(shown.out, force=shown.force) as folder:
                write_swings(found, folder)
                write_document(document, folder, "swings")
                write_provenance(
                    folder, shown.out, named_files(sys.argv[1:], shown.out), sys.argv[1:]
                )
    print_result(swings_dict(found), document, as_json=shown.as_json)
    if shown.out is not None and not shown.as_json:
        print()
        say(
            f"{RESULT} and {ROBOT}, with the cables that stay, are in {shown.out}/. Record each swing"
            " as a run with 'winches: locked', then:"
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


def _compare_references(
    place: str,
    sensors: str,
    check: str | None,
    duration: float | None,
    poses: int | None,
    sigma: float | None,
    target: str | None,
    shown: _Shown,
) -> None:
    """Reference bodies beside an experiment; see :func:`steelyard.design_references`."""
    from steelyard.cli.design_request import target_of
    from steelyard.excitation.references.reference_design import (
        USUAL_REST,
        USUAL_SIGMA,
        design_references,
    )
    from steelyard.excitation.references.reference_file import RESULT, reference_dict
    from steelyard.output import results_folder, write_json
    from steelyard.provenance.record import write_provenance
    from steelyard.report.documents.references import reference_document
    from steelyard.report.write import write_document

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
    if shown.out is not None:
        with results_folder(shown.out, force=shown.force) as folder:
            write_json(values, folder / RESULT)
            write_document(document, folder, "reference")
            write_provenance(folder, shown.out, named_files(sys.argv[1:], shown.out), sys.argv[1:])
    print_result(values, document, as_json=shown.as_json)


def _print_next_steps(found: Design, place: str, out: Path) -> None:
    """Say where the commands are and what to do with them."""
    from steelyard.excitation.design_file import RESULT, command_names
    from steelyard.excitation.plan import is_experiment

    if not found.in_time:
        say(
            "The time was up before all searches had ended: another run may find another"
            " motion; a larger --budget helps."
        )
    files = ", ".join(name for _, name in command_names(found.appraisal))
    quoted = f"'{place}'" if " " in place else place
    print()
    say(f"{files} and {RESULT} are in {out}/; {REPORT}.html shows the motion.")
    if is_experiment(place):
        say(f"Record the motion, add it as a run to {place}, then:")
        print(f"  steelyard identify {quoted}")
        return
    print("Try it on the simulated robot next:")
    print(
        f"  steelyard simulate {quoted} --trajectory {out / 'command.csv'} --out {out / 'virtual'}"
    )
