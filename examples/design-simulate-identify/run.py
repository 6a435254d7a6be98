"""Design a motion, carry it out on a simulated robot, identify, and compare what was reached with
what was said beforehand.
"""

import numpy as np
import polars as pl

import steelyard

DURATION = 10.0  # [s]
BUDGET = 8.0  # [s], for the search; a minute finds a better motion

design = steelyard.design("cogiro", DURATION, budget=BUDGET)
print(design)

virtual = steelyard.simulate("cogiro", design.trajectories, "paper", seed=0)
estimate = steelyard.identify(virtual.experiment, "maximum-likelihood").estimate
print()
print(estimate)

error = estimate.value - virtual.body.body_parameters
print("\n1-sigma said beforehand and stated with the recording, and the true error, SI units")
table = estimate.to_polars().select(
    "parameter", "unit", predicted=design.standard_deviation, stated="sigma"
)
with pl.Config(tbl_hide_dataframe_shape=True, tbl_rows=10, float_precision=4):
    print(table.with_columns(error=error, error_in_sigmas=error / design.standard_deviation))

ratio = estimate.standard_deviation / design.standard_deviation
print(f"\nstated 1-sigma over predicted: {ratio.min():.2f} to {ratio.max():.2f}")
print(
    "root mean square error in predicted sigmas:"
    f" {np.sqrt(np.mean((error / design.standard_deviation) ** 2)):.2f}"
)
