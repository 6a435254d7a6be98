"""The kinds of imperfection, at the size of real robots; a seed draws how large each is.

Sizes are for any robot: forces are parts of what a cable pulls or of the weight, lengths parts of
the platform.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np


@dataclass(frozen=True)
class Kind:
    """What is imperfect beside what the files state."""

    friction: float = 0.0
    """Part of the tension that rollers take, scattered by 30 % between cables."""
    presliding: float = 0.005
    """Cable over which it builds up after a reversal [m]."""
    viscous: float = 0.0
    """Part of a cable's pull for each [m/s]."""
    force_filter: float = 0.0
    """Time constant of the amplifier [s]."""
    drift: float = 0.0
    """1-sigma of an offset's linear drift, part of the pull for each minute."""
    coloured: float = 0.0
    """Time constant of the force noise [s]."""
    crosstalk: float = 0.0
    """1-sigma of what each cell reads of every other cable."""
    attitude_filter: float = 0.0
    """Time constant with which the orientation follows the accelerometer [s]."""
    heading_walk: float = 0.0
    """Of the orientation [rad/sqrt(s)]."""
    imu_scale: float = 0.0
    """1-sigma of the factors of gyro and accelerometer axes."""
    gyro_walk: float = 0.0
    """Of the bias [rad/s/sqrt(s)]."""
    jumps: float = 0.0
    """1-sigma of six stretches of the tracker [m]."""
    reacquired: float = 0.0
    """1-sigma of the tracker's shift from the middle on [m]."""
    jitter: float = 0.0
    """1-sigma of the tracker's time stamps, late by its absolute value, each [s]."""
    clipped: float = 0.0
    """Range of the gyro, part of its largest reading."""
    hose: float = 0.0
    """Force downwards, and stiffness times 1 m, part of the weight."""
    air: float = 0.0
    """Drag's area, in the platform's size squared."""
    swinging: float = 0.0
    """Part of the mass that hangs below on a string of .6 sizes."""
    bending: float = 0.0
    """Part of the mass that swings on top at 7 Hz."""
    cells: str = "platform"
    """Where the force cells are: platform or winch."""
    instruments: tuple[str, ...] = ("imu", "orientation", "tracker")
    """Beside the force cells: imu, orientation, tracker, length, attitude, pose."""
    pushed: bool = False
    """Winches are locked, a hand pushes three times, the mass is known, and no noise is stated."""
    gains: float = 1.0
    """How much larger gains and their stated 1-sigma are."""
    motion: str = "multisine"
    """Of the platform: multisine, moves, circles or slow, a multisine at a third of the pace."""
    robots: tuple[str, ...] = ("cogiro", "six", "twelve", "desk")


_FEW = ("three", "four", "five")
_ALL = ("cogiro", "six", "twelve", "desk", "three", "four", "five", "tight")

KINDS = {
    "sound": Kind(robots=_ALL),
    "friction-presliding": Kind(friction=0.02, presliding=0.005, cells="winch"),
    "friction-and-viscous": Kind(friction=0.03, presliding=0.002, viscous=0.025, cells="winch"),
    "force-filter": Kind(force_filter=0.027),
    "force-drift": Kind(drift=0.016),
    "force-coloured": Kind(coloured=0.3, robots=("cogiro", "six", "twelve", "desk", "four")),
    "crosstalk": Kind(crosstalk=0.005),
    "attitude-filter": Kind(attitude_filter=2.0, robots=("cogiro", "six", "twelve", "four")),
    "heading-walk": Kind(heading_walk=0.02),
    "imu-scale": Kind(imu_scale=0.01),
    "gyro-walk": Kind(gyro_walk=0.002),
    "tracker-jumps": Kind(jumps=0.03, robots=("cogiro", "six", "twelve", "four")),
    "tracker-reacquired": Kind(reacquired=0.01),
    "stamp-jitter": Kind(jitter=0.012),
    "clipped-imu": Kind(clipped=0.7),
    "hose": Kind(hose=0.008, robots=("cogiro", "six", "twelve", "four")),
    "air": Kind(air=3.0, robots=("cogiro", "six", "twelve", "four")),
    "load-swings": Kind(swinging=0.025, robots=("cogiro", "six", "twelve", "five")),
    "platform-bends": Kind(bending=0.19),
    "lengths-alone": Kind(instruments=("length",)),
    "winch-lengths-imu": Kind(instruments=("imu", "orientation", "length"), cells="winch"),
    "no-attitude": Kind(instruments=("imu", "tracker"), robots=(*_ALL[:4], "five")),
    "tracker-and-lengths": Kind(instruments=("tracker", "length")),
    # All that one robot has, each at the size of a well-kept one.
    "typical": Kind(
        friction=0.01, presliding=0.003, viscous=0.008, force_filter=0.01, drift=0.005,
        crosstalk=0.002, attitude_filter=2.0, heading_walk=0.002, imu_scale=0.003,
        gyro_walk=0.0003, jitter=0.002, hose=0.002, air=0.5, cells="winch", robots=_ALL,
    ),
    "typical-lengths": Kind(
        friction=0.01, presliding=0.003, viscous=0.008, force_filter=0.01, drift=0.005,
        crosstalk=0.002, imu_scale=0.003, gyro_walk=0.0003, air=0.5, cells="winch",
        instruments=("imu", "length"), robots=_ALL,
    ),
    "typical-at-platform": Kind(
        force_filter=0.02, drift=0.01, coloured=0.05, crosstalk=0.005, attitude_filter=1.0,
        imu_scale=0.005, gyro_walk=0.001, jumps=0.01, jitter=0.004, hose=0.004, air=1.0,
        robots=_ALL,
    ),
    "typical-capture": Kind(
        friction=0.01, presliding=0.003, force_filter=0.01, drift=0.01, crosstalk=0.003,
        cells="winch", instruments=("pose", "length"), robots=_ALL,
    ),
    "all-together-swinging": Kind(
        friction=0.012, presliding=0.003, viscous=0.015, attitude_filter=1.0, cells="winch",
        instruments=("attitude", "pose", "length"), pushed=True, gains=10.0, robots=_FEW,
    ),
}  # fmt: skip
"""Of a name; the given recordings have the same, but for those with several imperfections."""

_SIZES = frozenset(
    each.name for each in fields(Kind) if each.type == "float" and each.name != "gains"
)
_FIXED = frozenset({"clipped"})


def drawn(kind: Kind, rng: np.random.Generator) -> Kind:
    """The kind with other sizes, .6 to 1.5 times the usual."""
    factors = {name: float(rng.uniform(0.6, 1.5)) for name in sorted(_SIZES)}
    return replace(kind, **{k: f * getattr(kind, k) for k, f in factors.items() if k not in _FIXED})
