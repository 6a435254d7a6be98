"""Payload by difference: the platform alone, the platform with something on it, and what was
added.
"""

from dataclasses import replace

import numpy as np
import polars as pl

import steelyard

robot = steelyard.read_robot("cogiro")
# A crate of 60 kg, .8 x .6 x .8 m, not in the middle.
width, depth, height = 0.8, 0.6, 0.8
crate = steelyard.Inertia(
    60.0,
    np.array([0.2, 0.1, 0.3]),
    60.0 / 12 * np.diag([depth**2 + height**2, width**2 + height**2, width**2 + depth**2]),
)
# Mass, first moment and inertia about the origin of the platform add up.
loaded = steelyard.Inertia.from_parameters(robot.platform.parameters + crate.parameters)

# Two days: sensors, clocks and mounting err anew.
before = steelyard.simulate(robot, duration=12.0, seed=1)
after = steelyard.simulate(replace(robot, platform=loaded), duration=12.0, seed=2)
estimates = [
    steelyard.identify(each.experiment, "maximum-likelihood").estimate for each in (before, after)
]
found = steelyard.payload(*estimates)
print(found)

truth = crate.body_parameters
print("\nagainst the truth, SI units")
table = found.estimate.to_polars().select("parameter", "unit", "value", "sigma")
with pl.Config(tbl_hide_dataframe_shape=True, tbl_rows=10, float_precision=4):
    print(
        table.with_columns(truth=truth, error_in_sigmas=(pl.col("value") - truth) / pl.col("sigma"))
    )

for note in found.estimate.notes:
    print(f"note: {note}")
print(
    "\nThe crate's inertia about its own centre is what is left of two large numbers; the motion of"
    " the platform was made for neither.\nErrors that both recordings share (offsets of the force"
    " sensors, the robot file, where the sensors sit) are in both, and the 1-sigma takes\nthem as"
    " independent. One experiment with two loads knows better:\n"
)

# One day, one experiment: the runs share all errors but those of the clocks.
both = steelyard.simulate(
    robot, duration=12.0, seed=1, loads={"empty": robot.platform, "with-crate": loaded}
)
together = steelyard.identify(both.experiment, "maximum-likelihood").estimate
difference = together.loads.differences["with-crate - empty"]
print(difference)
sigmas = [each.to_polars()["sigma"] for each in (found.estimate, difference)]
off = (difference.value - truth) / difference.standard_deviation
print(
    f"\nmass: 1-sigma {sigmas[0][0]:.3f} kg as two recordings, {sigmas[1][0]:.3f} kg as two loads"
    f" of one experiment; errors between {off.min():+.1f} and {off.max():+.1f} sigma"
)
