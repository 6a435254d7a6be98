"""Designed motions on elastic cables in MuJoCo: limits, tensions and what is identified from them.

`python benchmarks/designed_motion.py [NAME ...]`, with names of the table at the end. `store
[SEED]` designs the motions that the tests have and writes them; `designs 3` designs three motions
for each robot and looks at them, which takes a minute each.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.signal import find_peaks

from steelyard.arrays import Array
from steelyard.excitation.design import design
from steelyard.experiment.model import Experiment
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.motion.trajectory import Trajectory
from steelyard.robot.file import read_robot
from steelyard.robot.model import Robot
from steelyard.simulation.forward_dynamics import CablePlatform
from steelyard.simulation.sensors import paper_sensors
from steelyard.simulation.trajectories import from_file

TESTS = Path(__file__).parents[1] / "tests"
sys.path.append(str(TESTS))
from mujoco_cables import (  # noqa: E402
    EXACT,
    LAWS,
    Hanging,
    chi_square,
    hung,
    point_robot,
    recorded,
)

FIRST_SEED = 500_000
"""Of recordings; apart from the seeds of every test and of the other benchmarks."""
STORED = TESTS / "data" / "designed-points.csv"
DURATION = 20.0
"""[s]"""
ROWS = 20
"""Of a stored command, a second: every knot of the spline falls on one, so that interpolation gives
the spline itself."""
SAME = 1e-5
"""[m], [rad]"""
STIFFER = (0.5, 1.0, 2.0)
LEVELS = (600.0, 300.0, 0.0)
"""[N]"""
PAST = 1.02
"""Part of a limit that may be reached."""
WINDOW = 3.0
"""Around the largest excess, in which its frequency is found [s]."""
SHORT = ("position", "angles", "speed", "accel.", "ang. sp.", "ang. acc.")


def designed(robot: Robot, seed: int) -> tuple[Trajectory, str]:
    """The motion that a search finds, and how that went."""
    experiment = Experiment(
        "design", robot, paper_sensors(robot).instruments, (), uncertainty=EXACT
    )
    begun = time.perf_counter()
    found = design(experiment, DURATION, seed=seed)
    parameter, ratio = found.appraisal.worst
    late = "" if found.in_time else ", late: not the same again"
    words = (
        f"{parameter} {ratio:.3f} of the wanted 1-sigma, {time.perf_counter() - begun:.0f} s{late}"
    )
    return found.appraisal.trajectories["design"], words


@dataclass(frozen=True)
class InMujoco:
    """What a motion takes of the robot in MuJoCo."""

    hanging: Hanging
    command: Trajectory
    level: float

    @property
    def over(self) -> list[str]:
        """Limits that it passes."""
        found = [name for name, use in self.hanging.uses().items() if use > PAST]
        low, high = self.hanging.robot.tension_limits
        least, most = self.hanging.tension.min(), self.hanging.tension.max()
        slack = ["slack"] if least <= 0 else []
        return found + (["tension"] if least < low / PAST or most > high * PAST else []) + slack

    def vibration(self) -> str:
        """When the acceleration is largest, how far it is from the command then, and at which
        frequencies."""
        t, real = self.hanging.time, self.hanging.seen[:, 13:16]
        off = real - self.command.derivative(t, 2)[:, :3]
        size = np.linalg.norm(real, axis=1)
        worst = int(size.argmax())
        axis = int(np.abs(off[worst]).argmax())
        start = np.clip(t[worst] - WINDOW / 2, 0.0, t[-1] - WINDOW)
        near = off[(t >= start) & (t <= start + WINDOW), axis]
        power = np.abs(np.fft.rfft(near * np.hanning(len(near)), 8 * len(near)))
        peaks, _ = find_peaks(power, height=power.max() / 3)
        frequencies = np.fft.rfftfreq(8 * len(near), t[1])[peaks]
        pose = self.command.derivative(t[worst : worst + 1], 0)[0]
        lowest = self.natural(pose)[:2]
        return (
            f"{size[worst]:.2f} m/s^2 at {t[worst]:.2f} s, {off[worst, axis]:+.2f} of it along"
            f" {'xyz'[axis]} not commanded, at {_listed(frequencies)} Hz (lowest natural"
            f" frequencies in that pose {_listed(lowest)} Hz)"
        )

    def natural(self, pose: Array) -> Array:
        """Frequencies of small swings about a commanded pose [Hz]."""
        robot = self.hanging.robot
        return CablePlatform(robot, robot.platform).natural_frequencies(pose, self.level)


def _listed(values: Array) -> str:
    return ", ".join(f"{value:.2f}" for value in values)


def header(what: str) -> None:
    print(
        f"{what:38}"
        + "".join(f"{name:>10}" for name in SHORT)
        + f"{'tension [N]':>14}{'chi-square':>22}"
    )


def line(what: str, found_in_mujoco: InMujoco, chi: list[tuple[float, bool]] | None = None) -> None:
    """Largest uses of the limits, range of tensions, chi-squares with a mark where the verdict
    rejects."""
    tension = found_in_mujoco.hanging.tension
    uses = "".join(
        f"{use:9.3f}{'!' if use > PAST else ' '}" for use in found_in_mujoco.hanging.uses().values()
    )
    found = " ".join(
        f"{value:.1f}{'' if accepted else ' rejected'}" for value, accepted in chi or ()
    )
    span = f"{tension.min():.0f} to {tension.max():.0f}"
    print(
        f"{what:38}{uses}{span:>14}{found:>22}{'   ' if found_in_mujoco.over else ''}{', '.join(found_in_mujoco.over)}",
        flush=True,
    )


def identified(found_in_mujoco: InMujoco, seed: int) -> tuple[float, bool]:
    estimate = MaximumLikelihood()(recorded(found_in_mujoco.hanging, found_in_mujoco.command, seed))
    return chi_square(estimate, found_in_mujoco.hanging.robot.platform), estimate.verdict.accepted


def looked(trajectory: Trajectory) -> Iterator[tuple[str, float, float, InMujoco]]:
    """Law, factor of the stiffness, tension that the winches hold, and what comes of it."""
    for law in LAWS:
        for stiffer in STIFFER:
            for level in LEVELS:
                hanging = hung(point_robot(stiffer=stiffer), trajectory, level, law)
                yield law, stiffer, level, InMujoco(hanging, trajectory, level)


def stored(count: int = 3) -> None:
    """The motion of the tests, on other cables too, recorded ``count`` times."""
    trajectory = from_file(STORED, point_robot())
    header(f"{STORED.name}; EA, winches hold")
    for law, stiffer, level, found_in_mujoco in looked(trajectory):
        # What MuJoCo's slack springs do is of no use to an estimator.
        taut = found_in_mujoco.hanging.tension.min() > 0
        chi = [identified(found_in_mujoco, FIRST_SEED + i) for i in range(count)] if taut else None
        line(f"{law}, {stiffer * 500:.0f} kN, {level:.0f} N", found_in_mujoco, chi)
        if found_in_mujoco.over:
            print(f"    {found_in_mujoco.vibration()}")


def designs(count: int = 2) -> None:
    """Motions that the search finds from several seeds, for cables from points without weight and
    for the robot file as it is."""
    for name, robot in (("from points", point_robot()), ("as in its file", read_robot("cogiro"))):
        for seed in range(count):
            trajectory, words = designed(robot, seed)
            lowest = min(
                CablePlatform(point_robot(), robot.platform).natural_frequencies(pose, 0.0)[0]
                for pose in trajectory.derivative(np.linspace(0, DURATION, 101), 0)
            )
            print(
                f"\nCoGiRo {name}, seed {seed}: {words}; lowest natural frequency on the way"
                f" {lowest:.2f} Hz"
            )
            header("EA, winches hold")
            for law, stiffer, level, found_in_mujoco in looked(trajectory):
                if level == LEVELS[0]:
                    chi = (
                        [identified(found_in_mujoco, FIRST_SEED)]
                        if stiffer == 1 and not found_in_mujoco.over
                        else None
                    )
                    line(f"{law}, {stiffer * 500:.0f} kN, {level:.0f} N", found_in_mujoco, chi)
                    if found_in_mujoco.over:
                        print(f"    {found_in_mujoco.vibration()}")


def store(seed: int = 0) -> None:
    """Design the motions of the tests and write their commands."""
    for name, robot in (
        ("designed-points", point_robot()),
        ("designed-file", read_robot("cogiro")),
    ):
        path = STORED.with_name(f"{name}.csv")
        trajectory, words = designed(robot, seed)
        times = np.arange(round(DURATION * ROWS) + 1) / ROWS
        table = np.column_stack([times, trajectory.derivative(times, 0)])
        np.savetxt(path, table, "%.8f", ",", header="t,x,y,z,roll,pitch,yaw", comments="")
        dense = np.linspace(0.0, DURATION, 20_001)
        again = from_file(path, robot)
        orders = [
            float(np.abs(again.derivative(dense, k) - trajectory.derivative(dense, k)).max())
            for k in range(3)
        ]
        print(
            f"{path.name}: {words}; interpolated, it is off by {orders[0]:.1e}, its derivatives by"
            f" {orders[1]:.1e} and {orders[2]:.1e}"
        )
        assert orders[0] < SAME


BENCHMARKS: dict[str, Callable[..., None]] = {"stored": stored, "designs": designs, "store": store}

if __name__ == "__main__":
    # Numbers and files belong to the name before them.
    words = sys.argv[1:] or ["stored"]
    starts = [i for i, word in enumerate(words) if word in BENCHMARKS]
    if not starts or starts[0]:
        sys.exit(f"expected one of {', '.join(BENCHMARKS)}, found '{words[0]}'")
    for i, end in zip(starts, [*starts[1:], len(words)], strict=True):
        BENCHMARKS[words[i]](*(int(word) for word in words[i + 1 : end]))
