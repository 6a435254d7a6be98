"""Prints how long things take and how accurate they are: `make bench`, or `python benchmarks/run.py
[NAME ...]`.

Every time is that of a whole process, the median of three, beside that of a bare import of the same
libraries in the same run: machines differ and are noisy, ratios less so.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import design
import disturbed
import far_off
import general_solver
import length_scaling
import numpy as np
import reading
import report
import studies
from recordings import recordings

from steelyard.arrays import Array
from steelyard.bodies.consistent_body import solve
from steelyard.experiment.read import read_experiment
from steelyard.identification.methods.consistent import Consistent, body_problem
from steelyard.identification.methods.instrumental_variables import InstrumentalVariables
from steelyard.identification.methods.least_squares import LeastSquares
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.methods.two_step import TwoStep
from steelyard.inertia import BODY_PARAMETERS, Inertia

STEELYARD = [sys.executable, "-m", "steelyard"]
REFERENCE = [
    sys.executable,
    "-c",
    "import casadi, numpy, polars, pydantic, scipy.interpolate, scipy.integrate",
]


def process(command: list[str]) -> tuple[float, float]:
    """Wall time [s] and peak memory [MiB] of a whole process."""
    start = time.perf_counter()
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        raise RuntimeError(f"{' '.join(command)} ended with {child.returncode}")
    return time.perf_counter() - start, usage.ru_maxrss / 1024


def measured(command: list[str], repeat: int = 3) -> float:
    """Median wall time of a whole process [s]."""
    return statistics.median(process(command)[0] for _ in range(repeat))


def show(what: str, seconds: float, limit: float, reference: float) -> None:
    print(
        f"{what:58} {seconds:7.2f} s   limit {limit:5.1f} s   {seconds / reference:6.1f} x bare"
        " import"
    )


def speed(folder: Path) -> None:
    """Whole-process times of the verbs."""
    reference = measured(REFERENCE)
    print(f"{'bare import of the libraries':58} {reference:7.2f} s")
    out = folder / "experiment"
    simulate = [
        *STEELYARD,
        "simulate",
        "cogiro",
        "--trajectory",
        "multisine",
        "--duration",
        "20",
        "--force",
        "--out",
        str(out),
    ]
    show("steelyard --help", measured([*STEELYARD, "--help"]), 0.3, reference)
    show("simulate cogiro, 20 s, sensors of the paper", measured(simulate), 5.0, reference)
    show(
        "simulate cogiro, 20 s, ideal sensors",
        measured([*simulate, "--sensors", "ideal"]),
        5.0,
        reference,
    )
    show(
        "identify 20 s (250 Hz), two-step",
        measured([*STEELYARD, "identify", str(out / "experiment.yaml")]),
        2.5,
        reference,
    )
    measured(simulate, 1)
    show(
        "identify 20 s (sensors of the paper), two-step",
        measured([*STEELYARD, "identify", str(out / "experiment.yaml")]),
        2.5,
        reference,
    )
    demo = [*STEELYARD, "demo", "--force", "--out", str(folder / "demo")]
    show("demo", measured(demo, 1), 60.0, reference)


def hour(folder: Path) -> None:
    """One hour of recording."""
    reference = measured(REFERENCE)
    # In a process of its own: what this one holds would count as the memory of its children.
    process([sys.executable, str(Path(__file__).parent / "hour.py"), str(folder / "hour")])
    seconds, peak = process([*STEELYARD, "identify", str(folder / "hour" / "experiment.yaml")])
    show("identify 1 h (forces, IMU 100 Hz, tracker 238 Hz), two-step", seconds, 30.0, reference)
    print(f"{'  its peak memory':58} {peak:7.0f} MiB limit  1024 MiB")


UNITS = np.array([1, 1e3, 1e3, 1e3, 1, 1, 1, 1, 1, 1])
MOMENTS = slice(4, 7)


def accuracy(_: Path) -> None:
    """Errors of every method on recordings of another simulator, with parts of the cable model left
    out too."""
    header = "".join(f"{name:>9}" for name in BODY_PARAMETERS)
    print(f"{'recording':14}{'method':24}{header}     chi2  verdict   [kg], [mm], [kg m^2]")
    errors: dict[tuple[str, str], list[Array]] = {}
    for name, path, truth in recordings():
        experiment = read_experiment(path)
        methods = [
            TwoStep(),
            TwoStep(acceleration="tracker"),
            LeastSquares(),
            InstrumentalVariables(),
            Consistent(),
            MaximumLikelihood(),
        ]
        variants = [
            (m.name + (", tracker" if i == 1 else ""), experiment, m) for i, m in enumerate(methods)
        ]
        if name.startswith("pulleys"):
            straight = replace(experiment, robot=experiment.robot.with_straight_cables())
            points = replace(
                experiment,
                robot=replace(experiment.robot, pulley_radius=np.zeros(experiment.robot.m)),
            )
            variants += [("least-squares, no sag", straight, LeastSquares())]
            variants += [("least-squares, no pulleys", points, LeastSquares())]
        for label, given, method in variants:
            estimate = method(given)
            error = estimate.value - truth.body_parameters
            known = np.isfinite(error)
            block = estimate.covariance[np.ix_(known, known)]
            scaled = error[known] / estimate.standard_deviation[known]
            block /= np.outer(
                estimate.standard_deviation[known], estimate.standard_deviation[known]
            )
            chi = float(scaled @ np.linalg.pinv(block, hermitian=True) @ scaled)
            print(
                f"{name:14}{label:24}"
                + "".join(f"{e:9.3f}" if np.isfinite(e) else f"{'null':>9}" for e in error * UNITS)
                + f"{chi:9.1f}  {estimate.verdict.short}",
                flush=True,
            )
            errors.setdefault((name.split("-")[0], label), []).append(error)
    for group in ("points", "pulleys", "chains"):
        base = _pooled(errors[group, "two-step"])
        for (own, label), values in errors.items():
            if own == group:
                rmse = np.sqrt(np.mean(np.square(values), axis=0)) * UNITS
                print(
                    f"{'rmse ' + group:14}{label:24}"
                    + "".join(f"{e:9.3f}" for e in rmse)
                    + f"   moments pooled {_pooled(values):.2f} kg m^2,"
                    f" {_pooled(values) / base:.2f} of two-step's"
                )


def _pooled(errors: list[Array]) -> float:
    return float(np.sqrt(np.mean(np.square(errors)[:, MOMENTS])))


def logs(folder: Path) -> None:
    """Reading an hour of CSV, and what is made to do harm."""
    reading.main(folder)


def pages(folder: Path) -> None:
    """The report of an hour beside its estimate."""
    report.main(folder)


def million(folder: Path) -> None:
    """A million samples by least squares, on cables that sag."""
    reference = measured(REFERENCE)
    process([sys.executable, str(Path(__file__).parent / "million.py"), str(folder / "million")])
    command = [
        *STEELYARD,
        "identify",
        str(folder / "million" / "experiment.yaml"),
        "--method",
        "least-squares",
    ]
    seconds, peak = process(command)
    show("identify 1e6 samples, least-squares, whole process", seconds, 20.0, reference)
    print(f"{'  its peak memory':58} {peak:7.0f} MiB limit  1024 MiB")


def semidefinite(_: Path) -> None:
    """The step onto real bodies."""
    rng = np.random.default_rng(0)
    times = []
    for _turn in range(30):
        body = Inertia(150.0, rng.normal(0, 0.1, 3), np.diag([90.0, 60.0, 160.0]))
        root = rng.normal(size=(10, 10)) * np.array([1, 10, 10, 10, 3, 3, 3, 3, 3, 3])
        problem = body_problem(body.parameters, root.T @ root / 10, 0.7)
        start = time.perf_counter()
        solve(problem)
        times.append(1e3 * (time.perf_counter() - start))
    print(
        f"{'semidefinite step and Newton of the same, median and worst':58} {np.median(times):7.1f}"
        f" ms {max(times[1:]):7.1f} ms   limit 50 ms"
    )


def coverage(folder: Path) -> None:
    """Whether stated 1-sigma are true."""
    print(
        "(a reference of chance: 95 % intervals of 200 experiments cover 92 to 98 % in 95 of 100"
        " such tables)"
    )
    studies.coverage(folder / "coverage")


def verdicts(folder: Path) -> None:
    """Wrong descriptions, disturbed and sound recordings, and what the verdict says."""
    studies.verdicts(folder / "verdicts")


def robust(_: Path) -> None:
    """Maximum likelihood with spikes and a hole in the tracker's stream."""
    disturbed.robust()


def starts(_: Path) -> None:
    """Maximum likelihood from descriptions that are far off."""
    far_off.starts()


def lengths(_: Path) -> None:
    """Time and memory of maximum likelihood, up to ten minutes of recording."""
    length_scaling.lengths()


def scipy(_: Path) -> None:
    """The joint problem by a general solver."""
    general_solver.general()


def designs(_: Path) -> None:
    """Designed motions beside others, on other robots, with other bodies, and what is refused."""
    for each in (design.best, design.robots, design.margin, design.refusals):
        each()


def truth(_: Path) -> None:
    """Whether what is said of a designed motion beforehand is true."""
    design.truth(200, os.cpu_count() or 1)


BENCHMARKS = {
    "speed": speed,
    "hour": hour,
    "million": million,
    "logs": logs,
    "pages": pages,
    "semidefinite": semidefinite,
    "accuracy": accuracy,
    "coverage": coverage,
    "verdicts": verdicts,
    "robust": robust,
    "starts": starts,
    "lengths": lengths,
    "scipy": scipy,
    "designs": designs,
    "truth": truth,
}

if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as temporary:
        for chosen in sys.argv[1:] or BENCHMARKS:
            print(f"\n== {chosen}")
            BENCHMARKS[chosen](Path(temporary))
