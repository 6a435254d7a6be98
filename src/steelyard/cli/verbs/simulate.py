"""The verb `simulate`."""

from __future__ import annotations

from pathlib import Path

import click

from steelyard.cli.options import common, force_option, out_option, seed_option, sensors_option
from steelyard.cli.printing import print_json, print_samples, progress, samples_of, say
from steelyard.cli.truth import TRUTH


@click.command(short_help="Record a virtual experiment.")
@click.argument("robot")
@out_option(help="Folder for the experiment; must be new or empty.", required=True)
@click.option(
    "--trajectory",
    default="multisine",
    show_default=True,
    metavar="NAME|FILE",
    help="paper, multisine, or a CSV file of kind 'command'.",
)
@sensors_option(help="paper, ideal, or a YAML file with 'instruments'.")
@click.option(
    "--duration", type=float, metavar="S", help="Of the multisine, or of one move of the paper [s]."
)
@click.option(
    "--loads",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="YAML file with 'loads' as in an experiment file, and the 'order' of the recordings:"
    " every motion is recorded with every load.",
)
@seed_option(help="The same seed gives the same bytes.")
@force_option()
@common
def simulate(
    robot: str,
    out: Path,
    trajectory: str,
    sensors: str,
    duration: float | None,
    loads: Path | None,
    seed: int,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Record a virtual experiment with ROBOT, a bundled name or a robot file."""
    with progress(quiet=quiet) as tell:
        from steelyard.output import check_target
        from steelyard.robot.file import read_robot
        from steelyard.simulation.simulate import simulate as simulated

        check_target(out, force=force)
        model = read_robot(robot)
        virtual = simulated(
            model, trajectory, sensors, duration=duration, loads=loads, seed=seed, progress=tell
        )
    virtual.write(out, force=force)
    experiment, truth = out / "experiment.yaml", out / TRUTH
    samples = samples_of(virtual.experiment)
    if as_json:
        print_json({"experiment": str(experiment), "truth": str(truth), "samples": samples})
        return
    plural = "s" if len(samples) > 1 else ""
    say(f"{experiment}: {len(samples)} run{plural} of {model.name}, truth in {truth}")
    print_samples(samples)
