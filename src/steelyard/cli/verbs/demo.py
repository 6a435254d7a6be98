"""The verb `demo`: the whole story in one command."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import click

from steelyard.cli.options import common, force_option, out_option
from steelyard.cli.printing import Tell, parts, print_json, progress, say

_MOTIONS = {"paper": "the paper's eight moves", "multisine": "20 s on all six axes"}


@click.command(short_help="The whole story: simulate, identify, compare with the truth.")
@out_option(help="Folder for data and report.", default=Path("steelyard-demo"), show_default=True)
@force_option(help="Replace what an earlier demo wrote.")
@common
def demo(out: Path, force: bool, as_json: bool, quiet: bool) -> None:
    """The whole story: simulate CoGiRo with the sensors of the paper, identify it, compare with the
    truth.
    """
    from steelyard.output import check_target, results_folder

    check_target(out, force=force)
    if not as_json:
        _introduce()
    with progress(quiet=quiet) as tell:
        from steelyard.identification.identify import identify
        from steelyard.identification.methods.two_step import TwoStep
        from steelyard.provenance.record import write_provenance
        from steelyard.report.documents.identification import brief_of
        from steelyard.report.evidence.made import made_of
        from steelyard.report.evidence.summary import summarise
        from steelyard.report.forms.terminal import show
        from steelyard.report.write import write_identification
        from steelyard.simulation.simulate import simulate, write_virtual

        recorded = {}
        *simulating, first, then = parts(tell, *(1.0 for _ in _MOTIONS), 0.5, 8.0)
        for (motion, words), told in zip(_MOTIONS.items(), simulating, strict=True):
            recorded[motion] = simulate(
                "cogiro", motion, seed=0, name=f"CoGiRo, {words}", progress=_simulating(told)
            )
        moves = identify(recorded["paper"].experiment, [TwoStep()], first)
        best = identify(recorded["multisine"].experiment, "all", then)
    truth = recorded["multisine"].body
    made = {
        name: made_of(virtual.experiment, {"demo": "seed 0"}) for name, virtual in recorded.items()
    }
    summary = summarise(
        best,
        truth,
        beside={"two-step, the paper's eight moves": moves.estimates["two-step"]},
        title="CoGiRo with the sensors of the paper, simulated: its eight moves, and 20 s on six"
        " axes",
        suffix=", six axes",
        made=made["multisine"],
    )
    with results_folder(out, force=force) as folder:
        write_virtual(recorded["multisine"], folder)
        write_identification(best, summary, folder)
        inner = folder / "paper-moves"
        inner.mkdir()
        write_virtual(recorded["paper"], inner)
        write_identification(moves, summarise(moves, truth, made=made["paper"]), inner)
        write_provenance(folder, out, (), sys.argv[1:])
    if as_json:
        print_json(best.to_dict())
        return
    show(brief_of(replace(summary, runs=())))
    print()
    say(f"Data, estimates and report are in {out}/,")
    say(f"those of the paper's moves in {out / 'paper-moves'}/. Look at")
    print(f"  {out / 'report.html'}\nin a browser, and try next:")
    print(f"  steelyard inspect {out / 'experiment.yaml'}")
    print(f"  steelyard export {out} --format urdf --out platform.urdf")
    print("Then with a robot and recordings of your own:")
    print("  steelyard new my-robot                  a folder to fill in")
    print("  steelyard init LOGS --robot my-robot/robot.yaml --out experiment.yaml")
    print("  steelyard identify experiment.yaml --out result")


def _introduce() -> None:
    """Say what is about to be done, and what should come out: all else takes some seconds."""
    from steelyard.robot.file import read_robot

    robot = read_robot("cogiro")
    assert robot.platform is not None  # the file has one
    mass = robot.platform.mass
    say(
        f"CoGiRo: {robot.m} cables, and a platform of {mass:g} kg that nobody weighs. Its motion is"
    )
    say("simulated, recorded by the sensors of the paper, and identified from these.\n")


def _simulating(tell: Tell | None) -> Tell | None:
    """The same, which says of a run that it is simulated."""
    if tell is None:
        return None
    return lambda run, fraction: tell(f"simulating CoGiRo: {run}", fraction)
