"""The verb `design`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.core import ParameterSource

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
        "Free swings without force sensors, in place of a motion: on which cables to hang the"
        " platform, where, and how to push it: swings.json, swings.html, swings.md and robot.yaml."
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
    help="How many at rest: with --calibration (20), or at most with --reference (9); swings with"
    " --free (6).",
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
    help="Of a robot alone: paper, ideal, calibration (a tracker and lengths; taken with"
    " --calibration where nothing is said), swings (motion capture; likewise with --free), or a"
    " YAML file with 'instruments'."
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
    from steelyard.cli.designs.request import (
        check_numbers,
        check_unused,
        checked_motion,
        design_task,
        pose_of,
    )
    from steelyard.cli.designs.shown import Shown
    from steelyard.excitation.design import design as designed
    from steelyard.excitation.design_file import RESULT, design_dict, evaluation_dict, write_design
    from steelyard.output import check_target, write_json
    from steelyard.report.documents.design_document import design_document
    from steelyard.simulation.sensors import CALIBRATION_SENSORS, SWING_SENSORS

    check_numbers(margin, runs, budget, rate)
    if out is not None:
        check_target(out, force=force)
    moves = {"--start": start, "--end": end, "--body": body, "--after": after}
    of_motion = {"--duration": duration, "--check": check, "--target": target}
    shown = Shown(out, force, as_json, quiet)
    of_reference = {"--reference": reference or None, "--reference-sigma": reference_sigma}
    source = click.get_current_context().get_parameter_source("sensors")
    if free:
        from steelyard.cli.designs.swings import propose_swings

        of_motion.pop("--duration")
        others = {**moves, **of_motion, **of_reference, "--calibration": calibration or None}
        check_unused(others, "--free")
        if source is ParameterSource.DEFAULT:
            sensors = SWING_SENSORS
        propose_swings(place, poses, duration, cables, sensors, shown)
        return
    check_unused({"--cables": cables}, "anything but --free")
    if calibration:
        from steelyard.cli.designs.poses import propose_poses

        check_unused({**moves, **of_motion, **of_reference}, "--calibration")
        if source is ParameterSource.DEFAULT:
            # Those of the paper do not tell where cables are fixed.
            sensors = CALIBRATION_SENSORS
        propose_poses(place, poses, sensors, margin, seed, shown)
        return
    if reference:
        from steelyard.cli.designs.references import compare_references

        check_unused(moves, "--reference")
        compare_references(place, sensors, check, duration, poses, reference_sigma, target, shown)
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

        def write(folder: Path) -> None:
            if found is None:
                write_json(values, folder / RESULT)
            else:
                write_design(found, folder, rate)

        shown.write(write, document, REPORT)
    print_result(values, document, as_json=as_json)
    if not as_json and found is not None and out is not None:
        _print_next_steps(found, place, out)


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
