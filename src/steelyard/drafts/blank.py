"""Robot, sensors and experiment to fill in: what a person has to say, with nothing said for them.

Places that have to be filled in are empty lists: what reads them says which, and no number is taken
for one of the robot's that is not.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

from steelyard.errors import InputError
from steelyard.output import results_folder, write_file
from steelyard.robot.file import MOST_CABLES

_NAME = re.compile(r"\w[\w .\-]*")
FILES = ("robot.yaml", "sensors.yaml", "experiment.yaml")


def new(folder: str | Path, cables: int = 8, *, force: bool = False) -> tuple[Path, ...]:
    """Write a folder with a robot file, sensors and an experiment to fill in.

    Args:
        folder: New or empty; its name is that of the robot.
        cables: Of the robot.
        force: Whether to replace files of the same names.

    Returns:
        Paths of the files.

    Raises:
        InputError: The folder cannot be written to or has files, its name is no name of a robot, or
            no robot has so many cables.
    """
    folder = Path(folder)
    name = folder.absolute().name
    if not _NAME.fullmatch(name):
        raise InputError(
            f"new: expected a name of letters, digits, '_', '-', '.' and blanks, found '{name}';"
            " choose another"
        )
    if not 1 <= cables <= MOST_CABLES:
        raise InputError(
            f"--cables: expected 1 to {MOST_CABLES}, found {cables}; choose another number"
        )
    texts = (_robot(name, cables), _sensors(), _experiment(name, cables))
    with results_folder(folder, force=force) as fresh:
        for file, text in zip(FILES, texts, strict=True):
            write_file(fresh / file, text)
    return tuple(folder / file for file in FILES)


def _robot(name: str, cables: int) -> str:
    """Its file, with a row a cable."""
    rows = "".join(
        f"  - {{anchor: [], attachment: []}}        # cable {i + 1}\n" for i in range(cables)
    )
    return f"""\
# The robot. Fill in every [], then look at it: steelyard robots robot.yaml --out robot.html
# Metres, kilograms, newtons; the order of the cables is that of the force sensors.
name: {json.dumps(name)}
gravity: 9.81                             # [m/s^2], where the robot stands
cables:
  # anchor: where the cable leaves the frame or enters its roller, world frame, such as [-7.197, -5.440, 5.393]
  # attachment: where it is fixed to the platform, in a frame that you choose on the platform, such as [0.503, -0.493, 0.0]
  # with a swivelling roller: {{anchor: [..], attachment: [..], pulley: {{radius: 0.05, axis: [0, 0, 1]}}}}
{rows}# What the cables are made of; without linear_density they are straight, without axial_stiffness they do not stretch.
# cable: {{diameter: 0.004, axial_stiffness: 5.0e5, linear_density: 0.064}}
# Allowed tensions [N], and what a motion must keep to (for simulate and design):
# tension: {{min: 50, max: 5000}}
# limits: {{position: [[-4, -3, 0.5], [4, 3, 3.5]], rpy_deg: [[-20, -20, -20], [20, 20, 20]], speed: 1.0, acceleration: 1.0, angular_speed: 0.5, angular_acceleration: 1.0}}
# What the drawing says of the platform; to compare with, to simulate and to design. Products are elements of the matrix.
# platform:
#   mass: 160
#   center_of_gravity: [0.0, 0.0, -0.1]
#   inertia: {{xx: 95, yy: 89, zz: 32, yz: 0, xz: 0, xy: 0}}     # about the centre of gravity
"""


def _sensors() -> str:
    """What a virtual recording takes from data sheets."""
    return """\
# The sensors with rate, noise and errors, as their data sheets have them, for steelyard simulate and design:
# what a motion would tell, before anything is recorded. The same entries belong under 'instruments' of experiment.yaml.
# Fill in every []; leave out what the robot does not have.
sync: 0.01                                # how well the clocks agree, 1-sigma [s]
instruments:
  cables:
    kind: tension
    rate: 100                             # [Hz]
    noise: 5.0                            # 1-sigma per sample [N]
    calibration: {offset: 5.0, gain: 0.01, common_gain: 0.005}
  imu:
    kind: imu
    rate: 100
    position: []                          # its origin in the platform frame [m]
    rpy_deg: [0, 0, 0]                    # instrument frame -> platform frame, R = Rz(yaw) Ry(pitch) Rx(roll)
    noise: {angular_velocity: 0.002, specific_force: 0.03, orientation: 0.005}     # [rad/s], [m/s^2], [rad]
  tracker:
    kind: position
    rate: 100
    target: []                            # the tracked point in the platform frame [m]
    noise: 0.0005                         # [m]
  command:
    kind: command                         # where the platform was told to go
    rate: 100
"""


def _experiment(name: str, cables: int) -> str:
    """Its file, with the logs where they are to be put."""
    return f"""\
# The recordings. Fill in every [], put the logs where 'runs' says, then: steelyard inspect experiment.yaml
# Or let the logs say it: steelyard init recordings --robot robot.yaml --out experiment.yaml --force
format: steelyard/1
name: {json.dumps(name)}
robot: robot.yaml
# What is known of the body beforehand, such as a weighed mass:
# known: {{mass: {{value: 161.1, sigma: 0.2}}}}
# How well the robot file is known, 1-sigma per coordinate [m]:
uncertainty: {{anchor: 0.002, attachment: 0.002}}
instruments:                              # leave out what was not recorded
  cables:
    kind: tension                         # columns t f1 … f{cables} [s], [N]
  imu:
    kind: imu                             # columns t wx wy wz ax ay az [rad/s], [m/s^2], and qw qx qy qz or roll pitch yaw
    position: []                          # its origin in the platform frame [m]
    rpy_deg: [0, 0, 0]
  tracker:
    kind: position                        # columns t x y z [m]
    target: []                            # the tracked point in the platform frame [m]
runs:
  - name: first
    cables: recordings/cables.csv         # where names or units differ: {{file: …, columns: {{f1: force_1}}, units: {{force_1: kN}}}}
    imu: recordings/imu.csv
    tracker: recordings/tracker.csv
    sync: auto                            # how far the clocks are apart is found; or the time of one event on each: {{cables: 2.41, …}}
"""
