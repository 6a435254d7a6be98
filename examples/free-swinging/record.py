"""Records the swings of this example anew, in MuJoCo: three and four cables, hands that push,
motion capture at 100 Hz with .3 mm and .5 mrad.

Usage: python examples/free-swinging/record.py FOLDER
"""

import json
import sys
from pathlib import Path

import numpy as np
from mujoco_swings import BODY, swings

from steelyard.experiment.write import write_experiment

DIGITS = {"t": 2, "x": 5, "y": 5, "z": 5, "qw": 6, "qx": 6, "qy": 6, "qz": 6}
"""As motion capture writes them."""


def shortened(path):
    """The same table with as many digits as a device has."""
    header, *rows = path.read_text().splitlines()
    names = header.split(",")
    text = [
        ",".join(f"{float(v):.{DIGITS[n]}f}" for n, v in zip(names, row.split(","), strict=True))
        for row in rows
    ]
    path.write_text("\n".join([header, *text]) + "\n")


def main(folder):
    """Writes the folder of each robot."""
    for cables, name, seed in ((3, "three-cables", 31), (4, "four-cables", 41)):
        own = folder / name
        own.mkdir(parents=True)
        recorded = swings(cables, runs=4, seed=seed, duration=8.0)
        write_experiment(recorded.experiment, own)
        for path in own.rglob("*.csv"):
            shortened(path)
        truth = {
            "mass": BODY.mass,
            "center_of_gravity": BODY.center_of_gravity.tolist(),
            "inertia": np.asarray(BODY.inertia).tolist(),
        }
        (own / "truth.json").write_text(json.dumps(truth, indent=1) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
