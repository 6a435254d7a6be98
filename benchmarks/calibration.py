"""A robot's own calibration: what is found, against the truth and its 1-sigma.

`python benchmarks/calibration.py [DRAWS]`: robots of 3, 4, 8 and 12 cables, forty poses at rest,
lengths and tracker of .5 mm, anchors off by 30 cm and attachments by 3 cm.

`python benchmarks/calibration.py [DRAWS] motion [CABLES]`: 60 s in motion with the sensors of the
paper and lengths of .5 mm; anchors of the robot are 5 cm off their drawing, where the fit begins
30 cm, attachments 1 cm. Eight cables are CoGiRo's (own simulator: catenaries over rollers); four are
a platform that hangs and swings in MuJoCo.

`python benchmarks/calibration.py [DRAWS] soft [NOISE [RATIO [SEED]]]`: 30 s of these four on ropes
that stretch by 2.6 per cent, whose axial stiffness is off by ten per cent in the robot file: noise of
the force sensors [N], damping of the ropes over the critical one, first seed. Winches read what they
have fed.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.interpolate import make_interp_spline

sys.path.append(str(Path(__file__).parents[1] / "tests"))
from halls import errors, recorded
from mujoco_cables import moved, point_robot

from steelyard.calibration.calibrate import calibrate
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.instruments import Length
from steelyard.motion.trajectory import multisine
from steelyard.robot.file import read_robot
from steelyard.robot.model import Robot
from steelyard.simulation.recording import draw_errors, record
from steelyard.simulation.response import ExactMotion
from steelyard.simulation.sensors import Sensors, paper_sensors
from steelyard.simulation.simulate import simulate
from steelyard.simulation.trajectories import feasible_multisine

FIRST_SEED = 800_000
"""Apart from the seeds of every test and of the other benchmarks."""
DURATION = 60.0
"""Of a recording in motion [s]."""
SOFT_DURATION = 30.0
"""The same on soft ropes."""
FORCES = 5.0
"""Noise of the force sensors [N]."""
DAMPED = 0.1
"""Damping of the ropes, over the critical one of a quarter of the platform."""
STRETCH = 0.1
"""1-sigma of the axial stiffness in the robot file of soft ropes."""
BUILT, DRAWN, ATTACHED = 0.05, 0.3, 0.01
"""1-sigma of the anchors about their drawing, of the anchors that the fit begins with, and of the
attachments [m]."""
FOUR = np.array([[-7.2, -5.4, 5.4], [-7.1, 5.3, 5.3], [7.3, 5.4, 5.45], [7.2, -5.5, 5.35]])
"""Anchors of four cables [m]."""
CORNERS = np.array([[-0.5, -0.45, 1.0], [-0.5, 0.4, 1.0], [0.5, 0.45, 1.0], [0.5, -0.4, 1.0]])
"""Their attachments [m]."""


def sensors(robot: Robot, forces: float = FORCES) -> Sensors:
    """Those of the paper without the command, with a noise of the forces [N], and the winches."""
    own = dict(paper_sensors(robot).instruments)
    del own["command"]
    own["cables"] = own["cables"].model_copy(update={"noise": forces})
    own["lengths"] = Length.model_validate(
        {
            "kind": "length",
            "noise": 5e-4,
            "rate": 25.0,
            "clock": "recorder",
            "calibration": {"offset": 0.5, "gain": 0.0},
        }
    )
    return Sensors(own)


def off_by(robot: Robot, anchors: float, rng: np.random.Generator) -> Robot:
    """The robot with its points elsewhere."""
    return replace(
        robot,
        anchors=robot.anchors + anchors * rng.standard_normal((robot.m, 3)),
        attachments=robot.attachments + ATTACHED * rng.standard_normal((robot.m, 3)),
    )


def eight(seed: int) -> tuple[Experiment, Robot]:
    """A minute of CoGiRo."""
    rng = np.random.default_rng(seed)
    nominal = read_robot("cogiro")
    true = off_by(nominal, BUILT, rng)
    motion = {"move": feasible_multisine(nominal, DURATION)}
    return _begun(simulate(true, motion, sensors(true), seed=seed).experiment, true, rng)


def soft(seed: int, forces: float = FORCES, damped: float = DAMPED) -> tuple[Experiment, Robot]:
    """The same on ropes that stretch by 2.6 per cent, whose stiffness the robot file has wrong."""
    own = {"stiffer": 0.1, "duration": SOFT_DURATION}
    experiment, true = four(seed, **own, forces=forces, damped=damped)
    factor = 1 + STRETCH * np.random.default_rng([seed, 1]).standard_normal()
    cable = replace(
        experiment.robot.cable, axial_stiffness=true.cable.axial_stiffness * max(0.5, factor)
    )
    return replace(experiment, robot=replace(experiment.robot, cable=cable)), true


def four(
    seed: int,
    stiffer: float = 1.0,
    duration: float = DURATION,
    forces: float = FORCES,
    damped: float = DAMPED,
) -> tuple[Experiment, Robot]:
    """A minute of a platform on four cables, whose winches feed what it needs to hang in a path."""
    rng = np.random.default_rng(seed)
    none = {"pulley_radius": np.zeros(4), "pulley_axis": np.tile([0.0, 0.0, 1.0], (4, 1))}
    robot = replace(
        point_robot(damping_ratio=damped, stiffer=stiffer),
        anchors=FOUR,
        attachments=CORNERS,
        **none,
    )
    true = off_by(robot, BUILT, rng)
    assert true.platform is not None
    time = np.linspace(0, duration, int(duration * 100) + 1)
    ramp = np.clip(time / 4, 0, 1)
    ramp = ramp**3 * (10 - 15 * ramp + 6 * ramp**2)

    def wave(*parts: tuple[float, float]) -> np.ndarray:
        return ramp * sum(size * np.sin(2 * np.pi * f * time) for size, f in parts)

    x, y, z = (
        wave((1.3, 0.05), (0.4, 0.11)),
        wave((1.0, 0.06), (0.3, 0.13)),
        wave((0.5, 0.04), (0.2, 0.12)),
    )
    place = np.column_stack([x, y, 1.5 + z])
    pull = true.anchors - place[:, None] - true.attachments
    length = np.linalg.norm(pull, axis=2)
    along = (pull / length[:, :, None]).transpose(0, 2, 1)
    tension = np.linalg.pinv(along) @ (-true.platform.mass * true.gravity)
    feed = make_interp_spline(time, length / (1 + tension / true.cable.axial_stiffness), k=5)
    hanging = moved(true, feed, np.concatenate([place[0], [1, 0, 0, 0]]), duration)
    instruments = sensors(true, forces).instruments
    drawn = draw_errors(instruments, 4, ["move"], rng)["move"]
    unused = ExactMotion(true, true.platform, multisine([0] * 6, [0.1] * 6, duration, 3))
    streams, sync = record(hanging, instruments, drawn, true, unused, rng)
    return _begun(Experiment("four", true, instruments, (Run("move", streams, sync),)), true, rng)


def _begun(
    experiment: Experiment, true: Robot, rng: np.random.Generator
) -> tuple[Experiment, Robot]:
    """The recording as its file says it, from a robot file that is far off."""
    stated = {"anchor": DRAWN, "attachment": ATTACHED}
    return replace(experiment, robot=off_by(true, DRAWN, rng), uncertainty=stated), true


def table(
    kinds: dict[int, Callable[[int], tuple[Experiment, Robot]]],
    count: int,
    first: int = FIRST_SEED,
) -> None:
    """One line for each robot."""
    print(
        "cables  draws  accepted  chi2/k  95 %   anchor rms  1-sigma  attachment rms  1-sigma   CPU"
    )
    for m, drawn in kinds.items():
        chi, inside, accepted, spent = [], [], 0, 0.0
        off, sigma = [], []
        for seed in range(first, first + count):
            experiment, true = drawn(seed)
            begun = time.process_time()
            found = calibrate(experiment)
            spent += time.process_time() - begun
            error = errors(found, true)
            chi.append(float(error @ np.linalg.solve(found.covariance, error)) / len(error))
            deviation = np.sqrt(np.diag(found.covariance))
            inside.append(np.mean(np.abs(error) < 1.96 * deviation))
            accepted += not found.reasons
            off.append(error)
            sigma.append(deviation)
        rms, stated = (
            [
                1000 * np.sqrt(np.mean(np.square(part)))
                for part in np.split(np.array(each), 2, axis=1)
            ]
            for each in (off, sigma)
        )
        print(
            f"{m:6d} {count:6d} {accepted:9d} {np.mean(chi):7.2f} {np.mean(inside):5.1%}"
            f" {rms[0]:8.2f} mm {stated[0]:5.2f} mm {rms[1]:12.2f} mm {stated[1]:5.2f} mm"
            f" {spent / count:5.2f} s",
            flush=True,
        )


def main(count: int, *rest: str) -> None:
    if rest[:1] == ("motion",):
        kinds = {8: eight, 4: four}
        chosen = [int(m) for m in rest[1:]] or list(kinds)
        table({m: kinds[m] for m in chosen}, count)
    elif rest[:1] == ("soft",):
        forces, damped, first = (
            float(rest[i]) if len(rest) > i else usual
            for i, usual in enumerate((FORCES, DAMPED, FIRST_SEED), start=1)
        )
        table({4: lambda seed: soft(seed, forces, damped)}, count, int(first))
    else:
        table({m: lambda seed, m=m: recorded(seed, m=m) for m in (3, 4, 8, 12)}, count)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 20, *sys.argv[2:])
