"""Designed motions: against the paper's and random ones, whether their prediction is true, and
other robots.

`python benchmarks/design.py NAME`, with one of the names in the table at the end; `truth 40` for 40
experiments.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from recorder import Recorder
from recordings import SHARED
from scipy.interpolate import BSpline

from steelyard.arrays import Array
from steelyard.excitation.command.commanded_state import COMMAND
from steelyard.excitation.information.linearisation_point import (
    LinearisationPoint,
    prior_information,
)
from steelyard.excitation.information.noise_free_recording import fit_noise_free
from steelyard.excitation.information.optimality_criterion import OptimalityCriterion, Target
from steelyard.excitation.information.predicted_information import PredictedInformation
from steelyard.excitation.limits.motion_constraints import Margin, MotionConstraints
from steelyard.excitation.limits.rest_poses import default_start_pose, with_tension_level
from steelyard.experiment.model import Experiment
from steelyard.experiment.write import write_yaml
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.imports.formats import import_robot
from steelyard.inertia import BODY_PARAMETERS, Inertia
from steelyard.motion.limits import check_times, commanded_tensions
from steelyard.motion.trajectory import RestToRest, Sampled, Trajectory, multisine
from steelyard.robot.file import read_robot, robot_file
from steelyard.robot.model import Robot
from steelyard.simulation.sensors import paper_sensors
from steelyard.simulation.trajectories import from_file, repeated_move, workspace_of

FIRST_SEED = 300_000
"""Apart from the seeds of every test and of the other benchmarks."""
DURATION = 20.0
HARMONICS = 10
RANDOM = 1000
MARGIN = 0.2


def planned(robot: Robot) -> Experiment:
    exact = {"anchor": 0.0, "attachment": 0.0, "gravity": 0.0}
    return Experiment(robot.name, robot, paper_sensors(robot).instruments, (), uncertainty=exact)


def designed(robot: str, *options: str) -> tuple[Sampled, dict, float]:
    """Command, what is said of it, and the time of the whole process [s]."""
    with tempfile.TemporaryDirectory() as place:
        out = Path(place) / "design"
        begun = time.perf_counter()
        command = [
            sys.executable,
            "-m",
            "steelyard",
            "design",
            robot,
            "--duration",
            f"{DURATION:g}",
            "--out",
            str(out),
        ]
        subprocess.run([*command, *options], check=True, stdout=subprocess.DEVNULL)
        taken = time.perf_counter() - begun
        return (
            from_file(out / "command.csv", read_robot(robot)),
            json.loads((out / "design.json").read_text(encoding="utf-8")),
            taken,
        )


def sigmas(predicted_values: dict) -> Array:
    """The ten 1-sigma of a design or of one of its commands."""
    J = np.array(predicted_values["inertia"])
    return np.concatenate(
        [
            [predicted_values["mass"]],
            predicted_values["center_of_gravity"],
            np.diag(J),
            [J[1, 2], J[0, 2], J[0, 1]],
        ]
    )


def worst_of(robot: Robot, trajectory: Trajectory, level: float = 0.0) -> Array:
    """The ten 1-sigma that a motion gives, also where they are so large that an estimator says
    nothing instead."""
    joint = fit_noise_free(planned(robot), {"run": trajectory}, level)
    known = prior_information(joint.fit.state.calibration.calibration_parameters)
    point = LinearisationPoint.of(joint, joint.experiment.runs[0], level)
    predicted = PredictedInformation(point, joint.fit.state.segments[0], trajectory.duration)
    commands = np.hstack([trajectory.derivative(predicted.times, order) for order in range(4)])
    assert robot.platform is not None
    target = Target.default(robot.platform)
    criterion = OptimalityCriterion(joint.parameters, target, known, np.zeros(10))
    return np.asarray(criterion.ratios(predicted.information(commands)[0])[0] * target.each)


def random_motions(robot: Robot, count: int) -> Iterator[tuple[Sampled, Array]]:
    """Multisines of random axes, as large as the limits allow, and their 1-sigma by the matrix of
    the search."""
    middle, reach = workspace_of(robot)
    joint = fit_noise_free(
        planned(robot),
        {"run": multisine(list(middle), list(0.3 * reach), DURATION, HARMONICS)},
        0.0,
    )
    run = joint.experiment.runs[0]
    known = prior_information(joint.fit.state.calibration.calibration_parameters)
    predicted = PredictedInformation(
        LinearisationPoint.of(joint, run, 0.0), joint.fit.state.segments[0], DURATION
    )
    assert robot.platform is not None
    target = Target.default(robot.platform)
    criterion = OptimalityCriterion(joint.parameters, target, known, np.zeros(10))
    constraints = MotionConstraints(
        robot, planned(robot).instruments, Margin(MARGIN, robot.size), 0.0, 1.0
    )
    times = check_times(multisine([0.0] * 6, [1.0] * 6, DURATION, HARMONICS))[::5]
    rng = np.random.default_rng(1)
    for seed in range(count):
        base = multisine(
            [0.0] * 6,
            list(reach * rng.uniform(0.1, 1.0, 6)),
            DURATION,
            HARMONICS,
            seed=FIRST_SEED + seed,
        )

        def scaled(scale: float, base: Sampled = base) -> Sampled:
            return Sampled(
                BSpline(base.spline.t, middle + scale * base.spline.c, base.spline.k), DURATION
            )

        low, high = 0.0, 1.0
        for _ in range(8):
            scale = (low + high) / 2
            commands = np.hstack(
                [scaled(scale).derivative(times, order) for order in range(COMMAND // 6)]
            )
            low, high = (scale, high) if constraints.values(commands).max() <= 1 else (low, scale)
        commands = np.hstack([scaled(low).derivative(predicted.times, order) for order in range(4)])
        yield scaled(low), criterion.ratios(predicted.information(commands)[0])[0] * target.each


def best() -> None:
    """A designed motion of CoGiRo beside the paper's own move and the best of random multisines."""
    robot = read_robot("cogiro")
    trajectory, predicted_values, taken = designed("cogiro")
    ours = worst_of(robot, trajectory)
    paper = worst_of(robot, repeated_move(DURATION)) * np.sqrt(
        repeated_move(DURATION).duration / DURATION
    )
    drawn = [each for _, each in random_motions(robot, RANDOM)]
    luckiest = min(drawn, key=lambda each: each[4:].max())
    print(
        f"{'worst 1-sigma of moments and products [kg m^2]':58} designed {ours[4:].max():.3f}  "
        f" ({taken:.1f} s)"
    )
    print(
        f"{'the paper move, as long in all':58} {paper[4:].max():8.3f}  "
        f" {paper[4:].max() / ours[4:].max():.1f} times worse   limit 20"
    )
    print(
        f"{f'best of {RANDOM} random multisines of {HARMONICS} harmonics':58}"
        f" {luckiest[4:].max():8.3f}   ours over it {ours[4:].max() / luckiest[4:].max():.2f}  "
        " limit .6"
    )
    print(
        f"{'said beforehand over the full matrix, least and most':58}"
        f" {(sigmas(predicted_values['standard_deviation']) / ours).min():.3f}"
        f" {(sigmas(predicted_values['standard_deviation']) / ours).max():.3f}"
    )


_recorder: Recorder | None = None


def draw(task: tuple[int, Sampled]) -> tuple[Array, Array, bool]:
    """Error, stated 1-sigma and verdict of maximum likelihood for one experiment."""
    global _recorder
    seed, trajectory = task
    _recorder = _recorder or Recorder(trajectory=trajectory)
    estimate = MaximumLikelihood()(_recorder(seed))
    body = _recorder.robot.platform
    assert body is not None
    return (
        estimate.value - body.body_parameters,
        estimate.standard_deviation,
        estimate.verdict.accepted,
    )


def truth(count: int = 200, processes: int = 2) -> None:
    """Whether the predicted 1-sigma of a designed motion are those of its simulated recordings."""
    trajectory, *_ = designed("cogiro")
    predicted = worst_of(read_robot("cogiro").with_straight_cables(), trajectory)
    with get_context("spawn").Pool(processes) as pool:
        drawn = list(pool.imap(draw, [(FIRST_SEED + i, trajectory) for i in range(count)]))
    errors, stated = (np.array([each[k] for each in drawn]) for k in (0, 1))
    rmse = np.sqrt(np.mean(errors**2, axis=0))
    print(
        f"{count} experiments with the designed motion, simulated on elastic cables, sensors of the"
        " paper"
    )
    print(f"{'':40}" + "".join(f"{name:>9}" for name in BODY_PARAMETERS) + "   pooled")
    for what, values in (
        (
            "predicted 1-sigma [kg], [mm], [kg m^2]",
            predicted * np.array([1, 1e3, 1e3, 1e3, 1, 1, 1, 1, 1, 1]),
        ),
        ("rmse over predicted", rmse / predicted),
        ("reported over predicted, mean", stated.mean(axis=0) / predicted),
    ):
        pooled = f"{np.sqrt(np.mean(values**2)):9.3f}" if "over" in what else ""
        print(f"{what:40}" + "".join(f"{v:9.3f}" for v in values) + pooled)
    print(f"accepted {sum(each[2] for each in drawn)} of {count}")


def caspr(name: str, *, tension: float, limits: dict) -> dict:
    """A robot file from CASPR's description, with limits of our own."""
    files = [SHARED / "caspr" / name / f"{name}_{kind}.xml" for kind in ("bodies", "cables")]
    values = import_robot(files).values
    return {
        **values,
        "name": name.lower(),
        "tension": {**values["tension"], "min": tension},
        "limits": limits,
    }


def scaled_down(factor: float) -> dict:
    """CoGiRo with its geometry, mass and inertia scaled."""
    robot = read_robot("cogiro")
    body, limits = robot.platform, robot.limits
    assert body is not None
    assert limits.position is not None
    low, high = (tuple(factor * v for v in corner) for corner in limits.position)
    small = replace(
        robot,
        name="small",
        anchors=factor * robot.anchors,
        attachments=factor * robot.attachments,
        pulley_radius=factor * robot.pulley_radius,
        cable=replace(robot.cable, axial_stiffness=5e4, linear_density=0.005),
        tension_limits=(1.0, 500.0),
        limits=replace(limits, position=(low, high), speed=1.5),
        platform=Inertia(
            factor**3 * body.mass, factor * body.center_of_gravity, factor**5 * body.inertia
        ),
    )
    return robot_file(small)


IPANEMA = {
    "position": [[-1.0, -0.75, 0.5], [1.0, 0.75, 1.5]],
    "rpy_deg": [[-15.0] * 3, [15.0] * 3],
    "speed": 2.0,
    "acceleration": 3.0,
    "angular_speed": 1.5,
    "angular_acceleration": 5.0,
}
CAROCA = {
    "position": [[-1.5, -1.0, 0.8], [1.5, 1.0, 2.2]],
    "rpy_deg": [[-20.0] * 3, [20.0] * 3],
    "speed": 1.5,
    "acceleration": 2.0,
    "angular_speed": 1.0,
    "angular_acceleration": 3.0,
}


def robots() -> None:
    """Other robots, against a smooth move of the same length between two far poses."""
    with tempfile.TemporaryDirectory() as place:
        files = {"cogiro-cuboid": "cogiro-cuboid"}
        for name, values in (
            ("ipanema 1", caspr("IPAnema_1", tension=5.0, limits=IPANEMA)),
            ("caroca", caspr("CAROCA", tension=10.0, limits=CAROCA)),
            ("cogiro x .3", scaled_down(0.3)),
        ):
            files[name] = str(Path(place) / f"{name}.yaml")
            write_yaml(values, Path(files[name]))
        for name, file in files.items():
            robot = read_robot(file)
            trajectory, predicted_values, taken = designed(file)
            constraints = with_tension_level(
                MotionConstraints(
                    robot, planned(robot).instruments, Margin(MARGIN, robot.size), 0.0, 1.0
                )
            )
            ours, move = (
                worst_of(robot, trajectory, constraints.level),
                point_to_point(robot, constraints),
            )
            plain = worst_of(robot, move, constraints.level)
            print(
                f"{name:16} feasible {predicted_values['feasible']}   worst of the inertia"
                f" {ours[4:].max():.4f}, of a plain move {plain[4:].max():.4f} kg m^2:"
                f" {plain[4:].max() / ours[4:].max():.1f} times better   limit 5   ({taken:.1f} s)",
                flush=True,
            )


def point_to_point(robot: Robot, constraints: MotionConstraints) -> RestToRest:
    """One smooth move through the workspace in all six coordinates, as far as the limits let it."""
    middle, (_, reach) = default_start_pose(constraints), workspace_of(robot)
    for share in 0.95 ** np.arange(60):
        move = RestToRest(middle - share * reach, middle + share * reach, DURATION)
        commands = np.hstack([move.derivative(check_times(move), order) for order in range(3)])
        if constraints.values(commands).max() <= 1:
            return move
    raise SystemExit(f"{robot.name}: no move")


def margin() -> None:
    """A margin of .35, and bodies 30 % lighter or heavier with their mass 10 cm off in any
    direction."""
    robot = read_robot("cogiro")
    assert robot.platform is not None
    trajectory, *_ = designed("cogiro", "--margin", ".35")
    rng = np.random.default_rng(2)
    least, most = np.inf, 0.0
    for i in range(60):
        way = rng.normal(size=3)
        share = (0.7, 1.3)[i % 2]
        shift = robot.platform.center_of_gravity + 0.1 * way / np.linalg.norm(way)
        body = Inertia(share * robot.platform.mass, shift, share * robot.platform.inertia)
        for still in (False, True):
            times = check_times(trajectory)
            tension = commanded_tensions(
                replace(robot, platform=body), trajectory, times, still=still
            )
            least, most = min(least, tension.min()), max(most, tension.max())
    print(
        f"{'tensions over 60 bodies, moving and at rest [N]':58} {least:.0f} to {most:.0f}   limits"
        " 50 to 5000"
    )


def refusals() -> None:
    """What cannot be done, and how long it takes to say so."""
    robot = robot_file(read_robot("cogiro"))
    with tempfile.TemporaryDirectory() as place:
        cases: dict[str, tuple[dict, list[str]]] = {
            "duration too short": (robot, ["--duration", "1"]),
            "no workspace": ({**robot, "tension": {"min": 900.0, "max": 1000.0}}, []),
            "start outside": (robot, ["--start", "0", "0", "9", "0", "0", "0"]),
            "one cable missing": ({**robot, "cables": robot["cables"][:-1]}, []),
            "two cables missing": ({**robot, "cables": robot["cables"][:-2]}, []),
            "three cables missing": ({**robot, "cables": robot["cables"][:-3]}, []),
        }
        for i, (what, (values, options)) in enumerate(cases.items()):
            file = Path(place) / f"{i}.yaml"
            write_yaml(values, file)
            begun = time.perf_counter()
            command = [
                sys.executable,
                "-m",
                "steelyard",
                "design",
                str(file),
                "--out",
                f"{place}/{i}",
            ]
            found = subprocess.run(
                [
                    *command,
                    *(options if "--duration" in options else ["--duration", "20", *options]),
                ],
                check=False,
                capture_output=True,
                text=True,
            )
            print(
                f"{what:24} status {found.returncode} in {time.perf_counter() - begun:.1f} s:"
                f" {found.stderr.strip()[-300:]}",
                flush=True,
            )


BENCHMARKS: dict[str, Callable[..., None]] = {
    "best": best,
    "truth": truth,
    "robots": robots,
    "margin": margin,
    "refusals": refusals,
}

if __name__ == "__main__":
    names = sys.argv[1:2] or list(BENCHMARKS)
    for chosen in names:
        print(f"\n== {chosen}")
        BENCHMARKS[chosen](*(int(each) for each in sys.argv[2:]))
