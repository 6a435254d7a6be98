"""The KUKA recording in Python: the static poses alone, then all runs, against the mass that others
fitted.

`--best` takes maximum likelihood for all runs, which follows the vibrations of the arm: half a
minute to a minute. Without it `consistent` does, in seconds; it filters what vibrates.
"""

import sys
from dataclasses import replace
from pathlib import Path

import steelyard

PUBLISHED = (
    0.932  # [kg], fitted by the author of the data set to the same poses; nobody weighed the tool
)

experiment = steelyard.read_experiment(Path(__file__).parent / "experiment.yaml")
print(experiment)

poses = replace(experiment, runs=(experiment.run("poses"),))
found = {
    "24 poses at rest": steelyard.identify(poses, "maximum-likelihood").estimate,
    "all runs": (
        steelyard.identify(
            experiment, "maximum-likelihood" if "--best" in sys.argv[1:] else "consistent"
        ).estimate
    ),
}
for heading, estimate in found.items():
    print(f"\n{heading}, by {estimate!r}")

print(f"\npublished: {PUBLISHED} kg")
for heading, estimate in found.items():
    difference = estimate.mass - PUBLISHED
    print(
        f"{heading}: {difference * 1e3:+.1f} g, 1-sigma"
        f" {estimate.standard_deviation[0] * 1e3:.1f} g"
    )
