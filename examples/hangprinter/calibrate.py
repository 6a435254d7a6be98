"""The anchors of a real four-cable robot from 44 poses at rest: four motor angles each, and where
the mover was in nine of them.
"""

from pathlib import Path

import numpy as np
import polars as pl

import steelyard
from steelyard.instruments import Length, Position

ADVANTAGE = np.array([2.0, 2.0, 2.0, 4.0])
SPOOL, BUILD_UP = 75.0, 0.06875  # [mm]: radius of a spool at the origin, growth of it with the line
TAPE = np.array([1.597, 1.795, 1.5825, 2.355])  # [m]: hand-measured distances from anchor to origin


def lengths(table: pl.DataFrame) -> np.ndarray:
    """By how much every line is longer than at the origin [m]."""
    angle = table.select("motor_a", "motor_b", "motor_c", "motor_d").to_numpy()
    c = -ADVANTAGE * BUILD_UP
    k0 = 2 * (255 / 20) * ADVANTAGE * 360 / (2 * np.pi) / c
    return ((angle / k0 + SPOOL) ** 2 - SPOOL**2) / c / 1000


table = pl.read_csv(Path(__file__).parent / "poses.csv")
places = table.select("x", "y", "z").cast(pl.Float64).to_numpy() / 1000
number = np.arange(len(table), dtype=float)
# The mover is a point on four lines; anchors as somebody would guess them.
robot = steelyard.Robot(
    name="hangprinter",
    anchors=np.array([[0, -1.6, -0.1], [1.5, 0.9, -0.1], [-1.4, 0.8, -0.1], [0, 0, 2.3]]),
    attachments=np.zeros((4, 3)),
)
# The spools are known to two per cent; places are those of the mover in the world itself.
exact = {"target": 0, "frame": {"position": 0, "rotation": 0}}
instruments = {
    "lines": Length.model_validate({"kind": "length", "calibration": {"gain": 0.02}}),
    "place": Position.model_validate({"kind": "position", "calibration": exact}),
}
streams = {
    "lines": steelyard.Stream(number, {"length": lengths(table)}, "poses.csv"),
    "place": steelyard.Stream(number, {"position": places}, "poses.csv"),
}
experiment = steelyard.Experiment(
    name="hangprinter",
    robot=robot,
    instruments=instruments,
    runs=(steelyard.Run("poses", streams, static=True),),
    uncertainty={"anchor": 0.3, "attachment": 0.0},
)

found = steelyard.calibrate(experiment)
print(found)
distance = np.linalg.norm(found.points["anchor"], axis=1)
print(
    "\ndistance from anchor to origin, found less tape [mm]:", np.round(1000 * (distance - TAPE), 1)
)
one_out = 1000 * found.leave_one_out
print(f"leave-one-out residual of the lines [mm]: {np.round(one_out, 2)},", end=" ")
print(f"pooled {np.sqrt(np.mean(one_out**2)):.2f}")
