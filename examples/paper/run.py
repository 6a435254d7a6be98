"""The paper's experiment, simulated: CoGiRo's eight moves from rest to rest with the sensors of the
paper.

The two steps as the paper takes them, once with the accelerations of the tracker and once with
those of the IMU, against the truth, and what limits them: with ideal sensors on the same cables,
and with ideal sensors on the straight cables without weight that the method assumes. Then maximum
likelihood on the very recordings of the two steps.
"""

import numpy as np

import steelyard

NAMES = ("mass", "cog x", "cog y", "cog z", "Jxx", "Jyy", "Jzz", "Jyz", "Jxz", "Jxy")
UNITS = ("kg", *["mm"] * 3, *["kg m^2"] * 6)
FACTORS = np.array([1.0, *[1e3] * 3, *[1.0] * 6])

robot = steelyard.read_robot("cogiro")
virtual = steelyard.simulate(robot, "paper", "paper", seed=0)
ideal = steelyard.simulate(robot, "paper", "ideal", seed=0)
straight = steelyard.simulate(robot.with_straight_cables(), "paper", "ideal", seed=0)
truth = virtual.body.body_parameters

# The median over the runs, as in Table III.
tracker, imu = (steelyard.TwoStep(acceleration=source) for source in ("tracker", "imu"))
estimates = {
    "two steps, tracker": tracker(virtual.experiment),
    "two steps, IMU": imu(virtual.experiment),
    "ideal sensors": imu(ideal.experiment),
    "and straight cables": imu(straight.experiment),
    "maximum likelihood": steelyard.identify(virtual.experiment, "maximum-likelihood").estimate,
}

print(virtual)
print("\nestimate less truth ± stated 1-sigma (-: the motion does not tell it)\n")
print(" " * 22 + "".join(f"{heading:>22}" for heading in estimates))
for i, (name, unit) in enumerate(zip(NAMES, UNITS, strict=True)):
    cells = []
    for estimate in estimates.values():
        error, sigma = (
            (estimate.value - truth)[i] * FACTORS[i],
            estimate.standard_deviation[i] * FACTORS[i],
        )
        cells.append("-" if np.isnan(error) else f"{error:+.2f} ± {sigma:.2f}")
    print(
        f"{name:6} {unit:6} {truth[i] * FACTORS[i]:8.2f}" + "".join(f"{cell:>22}" for cell in cells)
    )

print("\nverdicts")
for heading, estimate in estimates.items():
    print(f"{heading}: {estimate.verdict}")

mass, moments = (
    {
        heading: np.abs((estimate.value - truth)[places]).max()
        for heading, estimate in estimates.items()
    }
    for places in (slice(0, 1), slice(4, 7))
)
print(
    f"""
What limits the two steps: with ideal sensors the mass is still {mass["ideal sensors"]:.2f} kg off and the worst moment {moments["ideal sensors"]:.0f} kg m^2, on straight
cables {mass["and straight cables"]:.2f} kg and {moments["and straight cables"]:.2f} kg m^2: the method takes sagging cables as straight. Noise, offsets and clocks come on top, most with the
tracker, whose places must be differentiated twice, and three seconds from rest to rest tell little of the inertia. Maximum
likelihood, with the sag and every error of the sensors in its model, is {mass["maximum likelihood"]:.2f} kg off, and {moments["maximum likelihood"]:.1f} kg m^2."""
)
