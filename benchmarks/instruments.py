"""What instruments, priors and motions are worth: 1-sigma at best of one experiment on CoGiRo,
changed in one thing at a time.

`python benchmarks/instruments.py`. The 1-sigma are those that maximum likelihood would report
(`design --check` says the same), without any noise drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from design import planned

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.excitation.information.noise_free_recording import fit_noise_free
from steelyard.experiment.model import Experiment
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.instruments import Pose
from steelyard.motion.trajectory import Sampled, Trajectory
from steelyard.robot.file import read_robot
from steelyard.simulation.trajectories import repeated_move, trajectories

Change = Callable[[Experiment], Experiment]
KNOWN = {"anchor": 0.002, "attachment": 0.002, "gravity": 0.005}
"""What the robot file is taken to be good for where nothing is said."""


def with_keys(name: str, **keys: Any) -> Change:
    """The experiment with other keys of one instrument; those of ``calibration`` are added to what
    it states."""

    def change(experiment: Experiment) -> Experiment:
        old = experiment.instruments[name]
        stated = old.model_dump(exclude_unset=True)
        stated |= {
            **keys,
            "calibration": {**stated.get("calibration", {}), **keys.get("calibration", {})},
        }
        return replace(
            experiment,
            instruments={**experiment.instruments, name: type(old).model_validate(stated)},
        )

    return change


def without(*names: str) -> Change:
    """The experiment without instruments."""
    return lambda experiment: replace(
        experiment, instruments={n: i for n, i in experiment.instruments.items() if n not in names}
    )


def unstated(name: str) -> Change:
    """The experiment with an instrument of which only kind, place, rate and noise are stated."""

    def change(experiment: Experiment) -> Experiment:
        old = experiment.instruments[name]
        stated = old.model_dump(exclude_unset=True, exclude={"calibration"})
        return replace(
            experiment,
            instruments={**experiment.instruments, name: type(old).model_validate(stated)},
        )

    return change


def with_camera(experiment: Experiment) -> Experiment:
    """The experiment with a camera system: pose at 100 Hz, 1 mm and .1 degrees."""
    keys = {"kind": "pose", "rate": 100.0, "noise": {"position": 0.001, "rotation": 0.0017}}
    return replace(
        experiment, instruments={**experiment.instruments, "camera": Pose.model_validate(keys)}
    )


def both(*changes: Change) -> Change:
    """One change after the other."""

    def change(experiment: Experiment) -> Experiment:
        for each in changes:
            experiment = each(experiment)
        return experiment

    return change


def known(**values: tuple[float, float]) -> Change:
    return lambda experiment: replace(experiment, known=values)


def uncertain(**values: float) -> Change:
    return lambda experiment: replace(experiment, uncertainty={**experiment.uncertainty, **values})


GAINS = with_keys("cables", calibration={"gain": 0.01, "common_gain": 0.005})
CLOCKS = with_keys("tracker", calibration={"delay": 0.012})

CHANGES: Mapping[str, Change] = {
    "as it is": both(),
    "forces 100 Hz": with_keys("cables", rate=100.0),
    "forces and IMU 100 Hz": both(with_keys("cables", rate=100.0), with_keys("imu", rate=100.0)),
    "forces and IMU 250 Hz": both(with_keys("cables", rate=250.0), with_keys("imu", rate=250.0)),
    "force noise 1 N": with_keys("cables", noise=1.0),
    "force noise 20 N": with_keys("cables", noise=20.0),
    "force offsets exact": with_keys("cables", calibration={"offset": 0.0}),
    "force offsets within 50 N": with_keys("cables", calibration={"offset": 50.0}),
    "gains within 1 %, one sensor each": with_keys("cables", calibration={"gain": 0.01}),
    "gain of all sensors within .5 %": with_keys("cables", calibration={"common_gain": 0.005}),
    "both": GAINS,
    "both, mass known within .1 kg": both(GAINS, known(mass=(161.058, 0.1))),
    "anchors, attachments within 2 mm": uncertain(anchor=0.002, attachment=0.002),
    "anchors, attachments within 10 mm": uncertain(anchor=0.01, attachment=0.01),
    "gravity within .005 m/s^2": uncertain(gravity=0.005),
    "IMU placed within 5 mm": with_keys("imu", calibration={"position": 0.005}),
    "IMU mounted within 3 degrees": with_keys("imu", calibration={"misalignment": 0.05}),
    "IMU's north and horizon within 1 degree": with_keys("imu", calibration={"reference": 0.02}),
    "target placed within 5 mm": with_keys("tracker", calibration={"target": 0.005}),
    "tracker's clock within 50 ms": with_keys("tracker", calibration={"delay": 0.05}),
    "tracker's clock exact": with_keys("tracker", calibration={"delay": 0.0}),
    "IMU's clock within 50 ms": with_keys("imu", clock="imu", calibration={"delay": 0.05}),
    "tracker noise 3 mm": with_keys("tracker", noise=0.003),
    "no tracker, command instead": without("tracker"),
    "a camera instead of IMU and tracker": both(without("imu", "tracker"), with_camera),
    "a camera instead of the tracker": both(without("tracker"), with_camera),
    "defaults of all priors": both(GAINS, uncertain(**KNOWN), unstated("imu"), unstated("tracker")),
}


def slower(trajectory: Trajectory, factor: float) -> Sampled:
    """The same path, taken more slowly."""
    times = np.linspace(0.0, trajectory.duration, int(100 * trajectory.duration) + 1)
    return Sampled.through(times * factor, trajectory.derivative(times, 0))


def repeated(trajectory: Trajectory) -> Sampled:
    """The same motion twice; it begins and ends in one pose."""
    times = np.linspace(0.0, trajectory.duration, int(100 * trajectory.duration) + 1)
    poses = trajectory.derivative(times, 0)
    return Sampled.through(
        np.append(times, times[1:] + trajectory.duration), np.vstack([poses, poses[1:]])
    )


def only(trajectory: Trajectory, *axes: int) -> Sampled:
    """The same motion in some of the six coordinates."""
    times = np.linspace(0.0, trajectory.duration, int(100 * trajectory.duration) + 1)
    poses = trajectory.derivative(times, 0)
    held = np.tile(poses[0], (len(poses), 1))
    held[:, axes] = poses[:, axes]
    return Sampled.through(times, held)


def smaller(trajectory: Trajectory, factor: float) -> Sampled:
    """The same motion about where it begins, less far."""
    times = np.linspace(0.0, trajectory.duration, int(100 * trajectory.duration) + 1)
    poses = trajectory.derivative(times, 0)
    return Sampled.through(times, poses[0] + factor * (poses - poses[0]))


def sigmas(experiment: Experiment, motion: Trajectory) -> Array:
    """1-sigma of the ten that would be reported; NaN: not identifiable."""
    return (
        MaximumLikelihood().of(fit_noise_free(experiment, {"run": motion}, 0.0)).standard_deviation
    )


def row(label: str, experiment: Experiment, motion: Trajectory) -> str:
    """One line of the tables: mass, worst of the centre of gravity, of the moments, of the
    products."""
    try:
        s = sigmas(experiment, motion)
    except InputError as error:
        return f"{label:42}{error}"
    numbers = [s[0], 1e3 * s[1:4].max(), s[4:7].max(), s[7:].max()]
    return f"{label:42}" + "".join(
        f"{each:12.3g}" if np.isfinite(each) else f"{'null':>12}" for each in numbers
    )


def main() -> None:
    """Print the tables."""
    robot = read_robot("cogiro")
    experiment, motion = CLOCKS(planned(robot)), trajectories(robot, "multisine", 20.0)["multisine"]
    header = f"{'':42}{'mass [kg]':>12}{'cog [mm]':>12}{'moments':>12}{'products':>12}"
    print(
        "20 s on six axes, sensors of the paper, changed in one thing; worst 1-sigma of each kind"
        f" [kg], [mm], [kg m^2]\n{header}"
    )
    for label, change in CHANGES.items():
        print(row(label, change(experiment), motion), flush=True)
    print(f"\nThe same instruments, other motions\n{header}")
    motions = {
        "20 s, six axes": motion,
        "once more, 40 s in all": repeated(motion),
        "half as far": smaller(motion, 0.5),
        "half as fast, 40 s": slower(motion, 2.0),
        "translation only": only(motion, 0, 1, 2),
        "rotation only": only(motion, 3, 4, 5),
        "yaw only": only(motion, 5),
        "the paper's move to and fro": repeated_move(20.0),
    }
    for label, each in motions.items():
        print(row(label, experiment, each), flush=True)


if __name__ == "__main__":
    main()
