"""What the verbs do: library calls, and where their results go."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.bodies.mass_region import Box, Ellipsoid
from steelyard.cli.progress import progress
from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.experiment.read import read_experiment
from steelyard.identification.identify import chosen_methods, identify
from steelyard.identification.methods.consistent import Consistent
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.methods.two_step import TwoStep
from steelyard.inertia import Inertia
from steelyard.output import check_target, results_folder, to_json
from steelyard.report.made import made_of
from steelyard.report.summary import summarise, tabulate
from steelyard.report.terminal import show
from steelyard.report.write import write_identification
from steelyard.robot.file import bundled_names, bundled_text, read_robot, robot_file
from steelyard.simulation.simulate import simulate as simulate_experiment
from steelyard.simulation.simulate import write_virtual

NOT_ACCEPTED = 3
"""Exit status of an estimate that was made and written, but is not accepted."""


def say(text: str, *, quiet: bool) -> None:
    """Narrate on stderr where a person looks at it."""
    if not quiet and sys.stderr.isatty():
        sys.stderr.write(text + "\n")


def print_json(values: Mapping[str, Any]) -> None:
    """Print the result as JSON alone."""
    print(to_json(values, ascii_only=True))


def list_robots(name: str | None, *, as_json: bool) -> None:
    """List the bundled robots, or print one."""
    if name is not None:
        text = bundled_text(name)
        if as_json:
            print_json(robot_file(read_robot(name)))
        else:
            print(text.rstrip("\n"))
        return
    robots = {each: read_robot(each) for each in bundled_names()}
    if as_json:
        print_json(
            {
                "robots": [
                    {"name": n, "cables": r.m, "mass": _mass(r.platform)} for n, r in robots.items()
                ]
            }
        )
        return
    for each, robot in robots.items():
        print(f"{each:16} {robot.m} cables, nominal platform {_mass(robot.platform) or 0:.3f} kg")


def _mass(body: Inertia | None) -> float | None:
    return None if body is None else body.mass


def run_simulation(
    robot: str,
    out: Path,
    *,
    trajectory: str,
    sensors: str,
    duration: float | None,
    seed: int,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Simulate and write an experiment."""
    check_target(out, force=force)
    model = read_robot(robot)
    with progress(quiet=quiet) as tell:
        virtual = simulate_experiment(
            model, trajectory, sensors, duration=duration, seed=seed, progress=tell
        )
    virtual.write(out, force=force)
    runs = {
        run.name: {name: len(stream) for name, stream in run.streams.items()}
        for run in virtual.experiment.runs
    }
    if as_json:
        print_json(
            {
                "experiment": str(out / "experiment.yaml"),
                "truth": str(out / "truth.json"),
                "samples": runs,
            }
        )
        return
    print(
        f"{out / 'experiment.yaml'}: {len(runs)} run{'s' if len(runs) > 1 else ''} of {model.name},"
        f" truth in {out / 'truth.json'}"
    )
    for name, samples in runs.items():
        print(
            f"  {name}: "
            + ", ".join(f"{count} samples of {stream}" for stream, count in samples.items())
        )


def run_identification(
    experiment: Path,
    *,
    methods: Sequence[str],
    acceleration: str | None,
    combine: str,
    runs: Sequence[str],
    holdout: Sequence[str],
    box: Sequence[float] | None,
    ellipsoid: Sequence[float] | None,
    towards_nominal: bool,
    out: Path | None,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Identify an experiment; ends the process with the status of the verdict."""
    mass = {"regions": _regions(box, ellipsoid), "towards_nominal": towards_nominal}
    with_options: tuple[TwoStep | Consistent | MaximumLikelihood, ...] = (
        TwoStep(acceleration=acceleration, combine=combine),  # type: ignore[arg-type]
        Consistent(**mass),  # type: ignore[arg-type]
        MaximumLikelihood(**mass),  # type: ignore[arg-type]
    )
    chosen = chosen_methods(methods, {method.name: method for method in with_options})
    if out is not None:
        check_target(out, force=force)
    recorded = selected(read_experiment(experiment), runs)
    with progress(quiet=quiet) as tell:
        identification = identify(recorded, chosen, tell, holdout=holdout)
    truth = known_truth(experiment.parent)
    if out is not None:
        options = _options(
            {
                "method": methods or ["maximum-likelihood", "two-step"],
                "acceleration": acceleration,
                "combine": combine,
                "run": runs,
                "holdout": holdout,
                "box": box,
                "ellipsoid": ellipsoid,
                "towards-nominal": towards_nominal,
            }
        )
        summary = summarise(identification, truth, made=made_of(recorded, options))
        with results_folder(out, force=force) as folder:
            write_identification(identification, summary, folder)
    if as_json:
        print_json(identification.to_dict())
    else:
        show(tabulate(identification, truth))
    if not identification.estimate.verdict.accepted:
        sys.exit(NOT_ACCEPTED)


def _options(given: Mapping[str, Any]) -> dict[str, str]:
    """What was asked for, in words."""
    chosen = {name: value for name, value in given.items() if value}
    return {
        name: (
            "yes"
            if value is True
            else value
            if isinstance(value, str)
            else ", ".join(map(str, value))
        )
        for name, value in chosen.items()
    }


def _regions(
    box: Sequence[float] | None, ellipsoid: Sequence[float] | None
) -> tuple[Box | Ellipsoid, ...]:
    """Where the mass lies, as the user says."""
    regions: list[Box | Ellipsoid] = []
    if box:
        lower, upper = box[:3], box[3:]
        if not all(low < high for low, high in zip(lower, upper, strict=True)):
            raise InputError(
                "--box: expected the lower corner, then the upper one [m], found"
                f" {' '.join(map(str, box))}; order them"
            )
        regions.append(Box(np.array(lower), np.array(upper)))
    if ellipsoid:
        if min(ellipsoid[3:]) <= 0:
            raise InputError(
                "--ellipsoid: expected the centre, then three semi-axes above 0 [m], found"
                f" {' '.join(map(str, ellipsoid))}; correct it"
            )
        regions.append(Ellipsoid(np.array(ellipsoid[:3]), np.array(ellipsoid[3:])))
    return tuple(regions)


def selected(experiment: Experiment, names: Sequence[str]) -> Experiment:
    """The experiment with some of its runs."""
    if not names:
        return experiment
    known = [run.name for run in experiment.runs]
    for name in names:
        if name not in known:
            raise InputError(
                f"--run: expected one of {', '.join(known)}, found '{name}'; choose one of these"
            )
    return replace(experiment, runs=tuple(run for run in experiment.runs if run.name in names))


_LARGEST_TRUTH = 1 << 24  # bytes


def known_truth(folder: Path) -> Inertia | None:
    """The true body, where a simulation left it beside its experiment; None where there is none
    that can be read.
    """
    import json

    path = folder / "truth.json"
    try:
        if not path.is_file() or path.stat().st_size > _LARGEST_TRUTH:
            return None
        return Inertia.from_dict(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return None


def run_demo(out: Path, *, force: bool, as_json: bool, quiet: bool) -> None:
    """The paper's moves and a six-axis motion of the same robot, identified by every method."""
    check_target(out, force=force)
    recorded = {}
    with progress(quiet=quiet) as tell:
        for motion in ("paper", "multisine"):
            say(f"simulating CoGiRo: {motion}", quiet=quiet)
            recorded[motion] = simulate_experiment(
                "cogiro",
                motion,
                seed=0,
                name=f"CoGiRo, {_DEMO_MOTIONS[motion]}",
                progress=tell,
            )
        say("identifying", quiet=quiet)
        moves = identify(recorded["paper"].experiment, [TwoStep()], tell)
        best = identify(recorded["multisine"].experiment, "all", tell)
    beside = {"two-step, the paper's eight moves": moves.estimates["two-step"]}
    truth = recorded["multisine"].body
    title = "CoGiRo with the sensors of the paper, simulated: its eight moves, and 20 s on six axes"
    made = {
        name: made_of(virtual.experiment, {"demo": "seed 0"}) for name, virtual in recorded.items()
    }
    summary = summarise(best, truth, beside, title, ", six axes", made["multisine"])
    with results_folder(out, force=force) as folder:
        write_virtual(recorded["multisine"], folder)
        write_identification(best, summary, folder)
        inner = folder / "paper-moves"
        inner.mkdir()
        write_virtual(recorded["paper"], inner)
        write_identification(moves, summarise(moves, truth, made=made["paper"]), inner)
    if as_json:
        print_json(best.to_dict())
        return
    show(summary, each_run=False)
    print(
        f"\nData, estimates and report are in {out}/ (the paper's moves in {out / 'paper-moves'}/)."
        " Look at"
    )
    print(f"  {out / 'report.html'}\nin a browser, and try next:")
    print(f"  steelyard identify {out / 'experiment.yaml'} --acceleration tracker")


_DEMO_MOTIONS = {"paper": "the paper's eight moves", "multisine": "20 s on all six axes"}
