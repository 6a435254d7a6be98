"""The four robots of the public benchmark and what their recordings have to cope with.

Plain values: nothing of steelyard is in them, nor in the generator.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

Array = np.ndarray
GRAVITY = 9.81
"""[m/s^2]"""


@dataclass(frozen=True)
class Sensing:
    """1-sigma of every error, which is what the description states and what is drawn."""

    rate: float
    """Of force cells and IMU, which share a clock [Hz]."""
    tension: float
    """Noise of a sample [N]."""
    offset: float
    """Constant per cable [N]."""
    gain: float = 0.0
    """Factor of each cable."""
    common_gain: float = 0.0
    """Factor that all cables share."""
    angular_velocity: float = 0.00175
    """Noise of a sample [rad/s]."""
    specific_force: float = 0.03
    """Likewise [m/s^2]."""
    orientation: float = 0.0035
    """Likewise [rad]."""
    gyro_bias: float = 0.0052
    """Constant per axis [rad/s]."""
    accelerometer_bias: float = 0.05
    """Likewise [m/s^2]."""
    misalignment: float = 0.0105
    """Of the IMU in the platform, per axis [rad]."""
    reference: float = 0.0
    """Of the IMU's world against the world [rad]."""
    imu_position: float = 0.0
    """Of the IMU's stated place [m]."""
    tracker: float = 0.0005
    """Noise of a sample [m]."""
    target: float = 0.0
    """Of the target's stated place [m]."""
    frame_position: float = 0.0
    """Of the tracker's frame in the world [m]."""
    frame_rotation: float = 0.0
    """Likewise [rad]."""
    delay: float = 0.012
    """Of the tracker's clock against that of the forces [s]."""
    geometry: float = 0.0
    """Of every coordinate of anchors and attachments [m]."""


@dataclass(frozen=True, eq=False)
class PublicRobot:
    """A cable robot with its true body, its motion and its sensors."""

    name: str
    words: str
    anchors: Array
    """In the world [m], shape (m, 3)."""
    attachments: Array
    """In the platform [m], shape (m, 3)."""
    axial_stiffness: float
    """EA [N]."""
    mass: float
    """[kg]"""
    center_of_gravity: Array
    """In the platform [m]."""
    inertia: Array
    """About the centre of gravity, platform axes [kg m^2], shape (3, 3)."""
    center: Array
    """Middle of the motion: x, y, z [m]."""
    reach: Array
    """1-sigma of the command: x, y, z [m], rotation vector [rad]."""
    frequency: float
    """Highest of the command [Hz]."""
    tension: float
    """Mean of the command [N]."""
    imu: Array
    """Stated place in the platform [m]."""
    target: Array
    """Of the tracker, stated place in the platform [m]."""
    sensing: Sensing
    step: float = 5e-4
    """Of the integration [s]."""


def _matrix(xx: float, yy: float, zz: float, yz: float, xz: float, xy: float) -> Array:
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _box(half: tuple[float, float, float], order: tuple[tuple[int, int, int], ...]) -> Array:
    return np.array(order, dtype=float) * np.array(half)


_QUADRANTS = ((-1, -1), (-1, 1), (1, 1), (1, -1))

COGIRO = PublicRobot(
    name="cogiro",
    words="CoGiRo with a forklift: 161 kg suspended on eight cables in a hall of 15 m",
    anchors=np.array(
        [
            [-7.1967, -5.4398, 5.3928],
            [-7.4786, -5.1544, 5.4009],
            [-7.4083, 5.1914, 5.3987],
            [-7.1197, 5.4726, 5.4106],
            [7.2243, 5.3689, 5.4080],
            [7.5056, 5.0789, 5.4182],
            [7.4288, -5.2613, 5.3878],
            [7.1435, -5.5416, 5.3975],
        ]
    ),
    attachments=np.array(
        [
            [0.5032, -0.4928, 0.0],
            [-0.5097, 0.3508, 0.9976],
            [-0.5032, -0.2700, 0.0],
            [0.4961, 0.3561, 0.9996],
            [-0.5032, 0.4928, 0.0],
            [0.4998, -0.3404, 0.9991],
            [0.5021, 0.2750, -0.0007],
            [-0.5045, -0.3463, 0.9977],
        ]
    ),
    axial_stiffness=5e5,
    mass=161.058,
    center_of_gravity=np.array([-0.001, -0.077, 0.318]),
    inertia=_matrix(54.955, 48.859, 31.635, 4.136, -0.085, -0.393),
    center=np.array([0.0, 0.0, 2.0]),
    reach=np.array([0.35, 0.35, 0.25, 0.16, 0.16, 0.2]),
    frequency=0.5,
    tension=600.0,
    imu=np.array([0.05, -0.04, 0.3]),
    target=np.array([0.1, 0.2, 1.1]),
    sensing=Sensing(rate=100.0, tension=5.0, offset=5.0),
)

FOUR_CABLES = PublicRobot(
    name="four-cables",
    words="10 kg suspended on four cables in a frame of 3 m: the cables cannot turn it",
    anchors=np.array([[1.5 * x, 1.0 * y, 2.5] for x, y in _QUADRANTS]),
    attachments=np.array([[0.2 * x, 0.15 * y, 0.15] for x, y in _QUADRANTS]),
    axial_stiffness=5e4,
    mass=10.2,
    center_of_gravity=np.array([0.012, -0.018, 0.031]),
    inertia=_matrix(0.21, 0.26, 0.32, 0.011, -0.007, 0.009),
    center=np.array([0.0, 0.0, 1.0]),
    reach=np.array([0.08, 0.07, 0.07, 0.0, 0.0, 0.0]),
    frequency=0.4,
    tension=40.0,
    imu=np.array([0.015, -0.012, 0.09]),
    target=np.array([0.06, 0.09, 0.18]),
    sensing=Sensing(rate=100.0, tension=0.3, offset=0.3),
)

EIGHT_TIGHT = PublicRobot(
    name="eight-tight-cables",
    words="8 kg held by eight cables from above and below in a frame of 4 m",
    anchors=np.array([[2.0 * x, 1.5 * y, z] for z in (2.0, 0.0) for x, y in _QUADRANTS]),
    # Crossed: the upper cables go to the lower edge, the lower ones to the upper edge.
    attachments=np.array([[0.25 * x, 0.25 * y, z] for z in (-0.2, 0.2) for x, y in _QUADRANTS]),
    axial_stiffness=1.2e5,
    mass=8.3,
    center_of_gravity=np.array([0.006, 0.011, -0.014]),
    inertia=_matrix(0.24, 0.27, 0.31, -0.006, 0.004, 0.008),
    center=np.array([0.0, 0.0, 1.0]),
    reach=np.array([0.12, 0.1, 0.08, 0.035, 0.035, 0.045]),
    frequency=1.0,
    tension=200.0,
    imu=np.array([0.015, -0.012, 0.05]),
    target=np.array([0.06, 0.09, 0.23]),
    sensing=Sensing(rate=100.0, tension=1.0, offset=1.0),
)

DESK = PublicRobot(
    name="desk",
    words="1 kg suspended on eight cables in a frame of .8 m on a desk",
    anchors=np.array(
        [
            [-0.40, -0.30, 0.6],
            [-0.42, -0.28, 0.6],
            [-0.42, 0.28, 0.6],
            [-0.40, 0.30, 0.6],
            [0.40, 0.30, 0.6],
            [0.42, 0.28, 0.6],
            [0.42, -0.28, 0.6],
            [0.40, -0.30, 0.6],
        ]
    ),
    # As on CoGiRo: crossed, so that eight cables from above hold every pose.
    attachments=np.array(
        [
            [0.06, -0.06, 0.0],
            [-0.06, 0.04, 0.12],
            [-0.06, -0.035, 0.0],
            [0.06, 0.04, 0.12],
            [-0.06, 0.06, 0.0],
            [0.06, -0.04, 0.12],
            [0.06, 0.035, 0.0],
            [-0.06, -0.04, 0.12],
        ]
    ),
    axial_stiffness=1500.0,
    mass=1.04,
    center_of_gravity=np.array([0.003, -0.002, 0.035]),
    inertia=_matrix(2.6e-3, 2.2e-3, 1.9e-3, 1.0e-4, -6.0e-5, 8.0e-5),
    center=np.array([0.0, 0.0, 0.2]),
    reach=np.array([0.03, 0.03, 0.02, 0.14, 0.14, 0.16]),
    frequency=1.2,
    tension=4.0,
    imu=np.array([0.01, -0.005, 0.03]),
    target=np.array([0.02, 0.03, 0.14]),
    sensing=Sensing(rate=200.0, tension=0.02, offset=0.02, tracker=0.0002),
)

ROBOTS = {each.name: each for each in (COGIRO, FOUR_CABLES, EIGHT_TIGHT, DESK)}


@dataclass(frozen=True)
class Condition:
    """What the recordings of one kind have beside noise."""

    words: str
    calibrated: bool = True
    """Whether geometry, gains and places are as stated; otherwise they are off by their stated
    1-sigma."""
    friction: float = 0.0
    """Part of the tension that the roller takes before the cell at the winch."""
    presliding: float = 0.005
    """Cable travel over which that builds up after a reversal [m]."""
    attitude_filter: float = 0.0
    """Time constant with which the orientation follows the accelerometer [s]."""
    late: float = 0.0
    """How late the tracker's clock is beside what is drawn [s]."""
    roller_radius: float = 0.0
    """Of the rollers over which cables leave [m]."""
    linear_density: float = 0.0
    """Of the cables [kg/m]."""
    robots: tuple[str, ...] = field(default=tuple(ROBOTS))


CONDITIONS = {
    "plain": Condition(
        "noise, offsets, biases, a misaligned IMU, clocks; geometry and gains exact"
    ),
    "rough": Condition(
        "as plain, and geometry, gains, places, frames off by their stated 1-sigma",
        calibrated=False,
    ),
    "friction": Condition(
        "as plain; force cells at the winch behind rollers that take 2 %, built up over 5 mm",
        friction=0.02,
        robots=("cogiro",),
    ),
    "attitude-filter": Condition(
        "as plain; the orientation leans after the accelerometer with 2 s, which is not stated",
        attitude_filter=2.0,
        robots=("cogiro",),
    ),
    "late-clock": Condition(
        "as plain; the tracker's clock is 60 ms late, five of its stated 1-sigma",
        late=0.06,
        robots=("cogiro",),
    ),
    "rollers": Condition(
        "as plain; cables come up posts and leave over swivelling rollers of 60 mm radius",
        roller_radius=0.06,
        robots=("cogiro",),
    ),
    "heavy-cables": Condition(
        "as plain; cables weigh 80 g/m, and sag",
        linear_density=0.08,
        robots=("cogiro",),
    ),
}


def sensing_of(robot: PublicRobot, condition: Condition) -> Sensing:
    """What is stated, and drawn, of the sensors of a recording."""
    if condition.calibrated:
        return robot.sensing
    size = float(np.ptp(robot.attachments, axis=0).max())
    return replace(
        robot.sensing,
        gain=0.01,
        common_gain=0.005,
        reference=0.01,
        imu_position=min(0.005, 0.02 * size),
        target=min(0.005, 0.02 * size),
        frame_position=min(0.002, 0.01 * size),
        frame_rotation=0.0005,
        geometry=min(0.002, 0.01 * size),
    )
