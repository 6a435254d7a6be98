"""The command line: verbs around library calls.

``steelyard --help`` must answer at once, so this file imports nothing heavy; every verb imports
what it needs.
"""

from __future__ import annotations

import io
import os
import signal
import sys
from pathlib import Path
from typing import Any

import click

from steelyard.display import printable
from steelyard.errors import SteelyardError

_FOLDER = click.Path(path_type=Path, file_okay=True)


def _common(function: Any) -> Any:
    """Options of every verb."""
    function = click.option("--quiet", is_flag=True, help="No progress on stderr.")(function)
    return click.option("--json", "as_json", is_flag=True, help="Print the result as JSON alone.")(
        function
    )


@click.group(
    no_args_is_help=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)
@click.version_option(package_name="steelyard")
def app() -> None:
    """Find the mass, centre of gravity and inertia of what a cable robot carries, and how well each
    is known.

    Begin with `steelyard demo`, or with `steelyard identify EXPERIMENT` on recordings of your own.
    Exit status: 0 done, 2 the input or the command line is wrong, 3 the estimate was made but not
    accepted.
    """


@app.command()
@click.option(
    "--out",
    type=_FOLDER,
    default=Path("steelyard-demo"),
    show_default=True,
    help="Folder for data and report.",
)
@click.option("--force", is_flag=True, help="Replace what an earlier demo wrote.")
@_common
def demo(out: Path, force: bool, as_json: bool, quiet: bool) -> None:
    """The whole story: simulate CoGiRo with the sensors of the paper, identify it, compare with the
    truth.
    """
    from steelyard.cli.verbs import run_demo

    run_demo(out, force=force, as_json=as_json, quiet=quiet)


@app.command()
@click.argument("name", required=False)
@_common
def robots(name: str | None, as_json: bool, quiet: bool) -> None:
    """List the bundled robots, or print NAME as a robot file."""
    from steelyard.cli.verbs import list_robots

    list_robots(name, as_json=as_json)


@app.command()
@click.argument("robot")
@click.option(
    "--out", type=_FOLDER, required=True, help="Folder for the experiment; must be new or empty."
)
@click.option(
    "--trajectory",
    default="multisine",
    show_default=True,
    help="paper, multisine, or a CSV file of kind 'command'.",
)
@click.option(
    "--sensors",
    default="paper",
    show_default=True,
    help="paper, ideal, or a YAML file with 'instruments'.",
)
@click.option("--duration", type=float, help="Of the multisine, or of one move of the paper [s].")
@click.option(
    "--seed",
    type=click.IntRange(0),
    default=0,
    show_default=True,
    help="The same seed gives the same bytes.",
)
@click.option("--force", is_flag=True, help="Replace files of the same names.")
@_common
def simulate(
    robot: str,
    out: Path,
    trajectory: str,
    sensors: str,
    duration: float | None,
    seed: int,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Record a virtual experiment with ROBOT, a bundled name or a robot file."""
    from steelyard.cli.verbs import run_simulation

    run_simulation(
        robot,
        out,
        trajectory=trajectory,
        sensors=sensors,
        duration=duration,
        seed=seed,
        force=force,
        as_json=as_json,
        quiet=quiet,
    )


@app.command()
@click.argument("experiment", type=click.Path(path_type=Path))
@click.option(
    "--method",
    "methods",
    multiple=True,
    metavar="NAME",
    help=(
        "two-step, least-squares, instrumental-variables, consistent, maximum-likelihood, or all;"
        " may be repeated. Default: maximum-likelihood, with two-step beside it."
    ),
)
@click.option(
    "--acceleration",
    type=click.Choice(["imu", "tracker"]),
    help="two-step: where the acceleration comes from.",
)
@click.option(
    "--combine",
    type=click.Choice(["median", "pooled"]),
    default="median",
    show_default=True,
    help="two-step: the median over the runs, or one fit over all of them.",
)
@click.option(
    "--run", "runs", multiple=True, metavar="RUN", help="Use this run only; may be repeated."
)
@click.option(
    "--holdout",
    multiple=True,
    metavar="RUN",
    help="Leave this run out and predict its forces; may be repeated.",
)
@click.option(
    "--box",
    nargs=6,
    type=float,
    metavar="X0 Y0 Z0 X1 Y1 Z1",
    help="consistent, maximum-likelihood: corners of a box that holds all mass [m].",
)
@click.option(
    "--ellipsoid",
    nargs=6,
    type=float,
    metavar="X Y Z A B C",
    help="consistent, maximum-likelihood: centre and semi-axes of an ellipsoid, likewise [m].",
)
@click.option(
    "--towards-nominal",
    is_flag=True,
    help=(
        "consistent, maximum-likelihood: pull towards the nominal body as far as that predicts runs"
        " left out better."
    ),
)
@click.option(
    "--out",
    type=_FOLDER,
    help=(
        "Folder for estimate.json, the report (report.html, .md, .json) and motion.parquet; without"
        " it nothing is written."
    ),
)
@click.option("--force", is_flag=True, help="Replace files of the same names.")
@_common
def identify(
    experiment: Path,
    methods: tuple[str, ...],
    acceleration: str | None,
    combine: str,
    runs: tuple[str, ...],
    holdout: tuple[str, ...],
    box: tuple[float, ...] | None,
    ellipsoid: tuple[float, ...] | None,
    towards_nominal: bool,
    out: Path | None,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Estimate mass, centre of gravity and inertia from the recordings that EXPERIMENT lists."""
    from steelyard.cli.verbs import run_identification

    run_identification(
        experiment,
        methods=methods,
        acceleration=acceleration,
        combine=combine,
        runs=runs,
        holdout=holdout,
        box=box,
        ellipsoid=ellipsoid,
        towards_nominal=towards_nominal,
        out=out,
        force=force,
        as_json=as_json,
        quiet=quiet,
    )


@app.command()
@click.argument("experiment", type=click.Path(path_type=Path))
@click.option(
    "--run", "runs", multiple=True, metavar="NAME", help="Look at this run only; may be repeated."
)
@click.option(
    "--out",
    type=_FOLDER,
    help="Folder for inspection.json, inspection.md and inspection.html; must be new or empty.",
)
@click.option("--force", is_flag=True, help="Replace files of the same names.")
@_common
def inspect(
    experiment: Path,
    runs: tuple[str, ...],
    out: Path | None,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Say what is in the recordings that EXPERIMENT lists: rates, gaps, noise, clocks, mistakes of
    sign and unit, what can be found.

    Ends with status 0 also where it names mistakes.
    """
    from steelyard.cli.inspect import run_inspection

    run_inspection(experiment, runs=runs, out=out, force=force, as_json=as_json, quiet=quiet)


_POSE: dict[str, Any] = {"nargs": 6, "type": float, "metavar": "X Y Z ROLL PITCH YAW"}


@app.command()
@click.argument("place", metavar="ROBOT|EXPERIMENT")
@click.option("--duration", type=float, help="Of each motion [s].")
@click.option(
    "--out",
    type=_FOLDER,
    help=(
        "Folder for command.csv, design.json, design.html, design.md and motion.parquet; must be"
        " new or empty."
    ),
)
@click.option(
    "--check",
    metavar="FILE.csv",
    help=(
        "Look at this motion instead of searching: a CSV file of kind 'command', paper (its own"
        " move, repeated for --duration) or multisine."
    ),
)
@click.option("--start", **_POSE, help="Pose to begin in [m], [deg]. Default: a good one.")
@click.option("--end", **_POSE, help="Pose to end in. Default: where it began.")
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
@click.option(
    "--sensors",
    default="paper",
    show_default=True,
    help="Of a robot alone: paper, ideal, or a YAML file with 'instruments'.",
)
@click.option(
    "--budget",
    type=float,
    default=60.0,
    show_default=True,
    help="Time to spend [s]; more time, more starts.",
)
@click.option(
    "--seed",
    type=click.IntRange(0),
    default=0,
    show_default=True,
    help="The same seed gives the same motion.",
)
@click.option(
    "--rate", type=float, default=100.0, show_default=True, help="Of the rows of the commands [Hz]."
)
@click.option(
    "--processes", type=click.IntRange(1), help="That search at a time. Default: one per processor."
)
@click.option("--force", is_flag=True, help="Replace files of the same names.")
@_common
def design(
    place: str,
    duration: float | None,
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
    """Find the motion that tells the body best within the robot's limits, and say beforehand how
    well.

    Speeds, accelerations, workspace and tensions are those of 'limits' and 'tension' in the robot
    file.
    """
    from steelyard.cli.design import run_design

    run_design(
        place,
        duration=duration,
        out=out,
        check=check,
        start=start,
        end=end,
        target=target,
        margin=margin,
        runs=runs,
        after=after,
        body=body,
        sensors=sensors,
        budget=budget,
        seed=seed,
        processes=processes,
        rate=rate,
        force=force,
        as_json=as_json,
        quiet=quiet,
    )


@app.command("import")
@click.argument(
    "files", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="FILE..."
)
@click.option(
    "--out", type=_FOLDER, required=True, metavar="ROBOT.yaml", help="The robot file to write."
)
@click.option(
    "--products",
    type=click.Choice(["matrix", "integral"]),
    help=(
        "What the products of inertia are: elements of the inertia matrix, or +integral(x y dm)."
        " Default: what the format says; asked for where it does not."
    ),
)
@click.option(
    "--inertia-about",
    "about",
    type=click.Choice(["cog", "origin"]),
    help=(
        "About which point the inertia is, where the format does not say: the centre of gravity, or"
        " the origin of the platform frame."
    ),
)
@click.option(
    "--cables",
    "cable_set",
    metavar="NAME",
    help="CASPR: which set of cables. Default: the one that the file names.",
)
@click.option("--force", is_flag=True, help="Replace a file of the same name.")
@_common
def import_(
    files: tuple[Path, ...],
    out: Path,
    products: str | None,
    about: str | None,
    cable_set: str | None,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Make a robot file of FILE..., from CASPR XML (bodies and cables), IRMA JSON, cdpyr, or
    ROS-style YAML.

    The format is recognised by what stands in the files. What was taken for what, left out and
    assumed is said, also at the top of the robot file.
    """
    from steelyard.cli.imports import run_import

    run_import(
        files,
        out,
        products=products,
        about=about,
        cable_set=cable_set,
        force=force,
        as_json=as_json,
    )


@app.command()
@click.argument("folder", type=click.Path(path_type=Path), metavar="DIR")
@_common
def report(folder: Path, as_json: bool, quiet: bool) -> None:
    """Draw the report of DIR, a folder that identify wrote, again: report.html and report.md from
    its report.json.
    """
    from steelyard.cli.report import run_report

    run_report(folder, as_json=as_json)


@app.command()
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
@_common
def compare(
    estimates: tuple[str, ...],
    payload: bool,
    fail_above: float | None,
    method: str | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Put estimates side by side: differences in units of their uncertainty, and whether they
    agree.

    ESTIMATE is an estimate.json or a folder with one, with :METHOD behind it for one of its methods
    (:all for every one).
    """
    from steelyard.cli.compare import run_comparison, run_payload

    run = run_payload if payload else run_comparison
    run(estimates, method=method, fail_above=fail_above, as_json=as_json)


@app.command()
@click.argument("estimate")
@click.option(
    "--format",
    "format_",
    type=click.Choice(["urdf", "sdf", "mjcf", "yaml", "json", "c"]),
    required=True,
    help="Of the file: ROS, Pinocchio; Gazebo; MuJoCo; as in a robot file; the same; a C header.",
)
@click.option("--method", metavar="NAME", help="Which estimate of the file. Default: its result.")
@click.option("--out", type=_FOLDER, required=True, metavar="FILE", help="The file to write.")
@click.option(
    "--anyway",
    is_flag=True,
    help="Also an estimate that is not accepted or a body that cannot exist, with a comment.",
)
@click.option(
    "--robot",
    metavar="ROBOT",
    help="mjcf: the robot with its cables too; a bundled name or a robot file.",
)
@click.option(
    "--pose",
    **_POSE,
    help="--robot: where it hangs at rest [m], [deg]. Default: level, about the middle.",
)
@click.option("--force", is_flag=True, help="Replace a file of the same name.")
@_common
def export(
    estimate: str,
    format_: str,
    method: str | None,
    out: Path,
    anyway: bool,
    robot: str | None,
    pose: tuple[float, ...] | None,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Write the identified platform for a simulator or controller, with its verdict and the
    convention as comments.

    ESTIMATE is an estimate.json or a folder with one, with :METHOD behind it for one of its
    methods.
    """
    from steelyard.cli.export import run_export

    run_export(
        estimate,
        out,
        format_=format_,
        method=method,
        anyway=anyway,
        robot=robot,
        pose=pose,
        force=force,
        as_json=as_json,
    )


@app.command()
@click.argument("experiment", type=click.Path(path_type=Path))
@click.option(
    "--out", type=_FOLDER, required=True, help="Folder for the experiment; must be new or empty."
)
@click.option(
    "--format",
    "tables",
    type=click.Choice(["parquet", "csv"]),
    default="parquet",
    show_default=True,
    help="Of the streams.",
)
@click.option("--force", is_flag=True, help="Replace files of the same names.")
@_common
def convert(
    experiment: Path, out: Path, tables: Any, force: bool, as_json: bool, quiet: bool
) -> None:
    """Put EXPERIMENT with all its logs into one tidy form, on one clock and in SI units, to share
    and to keep.
    """
    from steelyard.cli.convert import run_conversion

    run_conversion(experiment, out, tables=tables, force=force, as_json=as_json, quiet=quiet)


@app.command()
@click.argument("which", type=click.Choice(["experiment", "robot"]), default="experiment")
@click.option("--out", type=_FOLDER, help="File to write. Default: print it.")
@click.option("--force", is_flag=True, help="Replace the file.")
def schema(which: Any, out: Path | None, force: bool) -> None:
    """Print the JSON schema of experiment or robot files: editors complete and check YAML with
    it.
    """
    from steelyard.cli.schema import run_schema

    run_schema(which, out, force=force)


@app.command()
@click.argument("logs", nargs=-1, required=True, metavar="LOG...", type=click.Path(path_type=Path))
@click.option("--robot", required=True, help="A bundled name or a robot file.")
@click.option("--out", type=_FOLDER, required=True, help="Experiment file to write.")
@click.option("--force", is_flag=True, help="Replace the file.")
@_common
def init(
    logs: tuple[Path, ...], robot: str, out: Path, force: bool, as_json: bool, quiet: bool
) -> None:
    """Draft a first experiment file from logs: guess instruments, columns, units and rates, and say
    what to check.

    LOG is a file of any format, or a folder with files in it or one level below.
    """
    from steelyard.cli.init import run_init

    run_init(logs, robot, out, force=force, as_json=as_json, quiet=quiet)


def main() -> None:
    """Run the command line and end with the exit status of the contract."""
    try:
        _run()
    except KeyboardInterrupt:
        # Also where it reaches us before the work has begun, or while an error is being said.
        _fail("interrupted; nothing was written", 130)


def _run() -> None:
    # Many small matrices: threads of the linear algebra cost more than they do. Before NumPy is
    # loaded, and only in this process.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # A polite kill unwinds like Ctrl-C, so that nothing half-written is left behind.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    if isinstance(sys.stdout, io.TextIOWrapper):
        # A terminal of few characters shows the others escaped.
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        status = app.main(standalone_mode=False)
        sys.exit(status if isinstance(status, int) else 0)
    except click.ClickException as error:
        command = (
            error.ctx.command_path
            if isinstance(error, click.UsageError) and error.ctx
            else "steelyard"
        )
        _fail(
            f"{error.format_message().rstrip('.?').replace('. ', '; ')}; see '{command} --help'", 2
        )
    except SteelyardError as error:
        _fail(str(error), 2)
    except (click.Abort, KeyboardInterrupt):
        _fail("interrupted; nothing was written", 130)
    except BrokenPipeError:
        # The reader of our output has gone; there is nobody left to tell.
        sys.stderr.close()
        sys.exit(1)
    except OSError as error:
        _fail(
            f"{error.filename or 'file'}: cannot be read or written ({error.strerror or error});"
            " check path and rights",
            2,
        )


_LONGEST_WORD = 200


def _fail(message: str, status: int) -> None:
    # A path or a name may be as long as a file likes; the sentence around it must stay readable.
    words = [
        w if len(w) <= _LONGEST_WORD else f"{w[:_LONGEST_WORD]}…{w[-20:]}" for w in message.split()
    ]
    # One line, and nothing of a file may steer the terminal.
    line = printable(" ".join(words))
    sys.stderr.write(f"steelyard: {line}\n")
    sys.exit(status)
