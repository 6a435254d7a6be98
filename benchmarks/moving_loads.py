"""Loads on strings that are stated as what they are: how well a motion tells their mass.

`python benchmarks/moving_loads.py [DRAWS [ROBOT ...]]`: recordings of MuJoCo, 20 s, of drawn robots
with a part of their mass on a string (3, 10 and 20 %, drawn about that), `rigid: false`. Gains are as
good as exact, so that what swings is what is uncertain.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import yaml
from rough import kinds
from rough.recording import recorded

import steelyard

PARTS = (0.03, 0.1, 0.2)
"""Of the mass that hang on a string."""
GAINS = 0.02
"""Of gains as they are elsewhere."""
FIRST = 20
"""Draw, apart from those of other benchmarks."""


def told(robot: str, part: float, number: int, folder: Path) -> tuple[float, float, float, bool]:
    """Mass, error and 1-sigma [kg], and whether the estimate is accepted."""
    name = f"moving-{part:g}"
    kinds.KINDS[name] = replace(kinds.KINDS["load-swings"], swinging=part, gains=GAINS)
    path, body = recorded(robot, name, number, folder, 20.0)
    stated = yaml.safe_load(path.read_text())
    stated["loads"] = {"hanging": {"rigid": False}}
    gains = {"gain": 0.01 * GAINS, "common_gain": 0.005 * GAINS}
    stated["instruments"]["cables"].setdefault("calibration", {}).update(gains)
    path.write_text(yaml.safe_dump(stated))
    found = steelyard.identify(path, "maximum-likelihood").estimate
    sigma = float(np.sqrt(found.covariance[0, 0]))
    return float(body[0]), float(found.value[0] - body[0]), sigma, bool(found.verdict.accepted)


def main(draws: int, robots: list[str]) -> None:
    print(
        f"{'robot':8}{'part':>6}{'mass':>10}{'error':>10}{'1-sigma':>10}  error / 1-sigma  accepted"
    )
    every = []
    for robot in robots:
        for part in PARTS:
            for number in range(FIRST, FIRST + draws):
                with TemporaryDirectory() as folder:
                    mass, off, sigma, accepted = told(robot, part, number, Path(folder))
                every.append(off / sigma)
                print(
                    f"{robot:8}{part:6.0%}{mass:10.3f}{off:10.3f}{sigma:10.3f}{every[-1]:17.2f}"
                    f"  {'yes' if accepted else 'no'}",
                    flush=True,
                )
    print(f"rms of error / 1-sigma {np.sqrt(np.mean(np.square(every))):.2f} over {len(every)}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if sys.argv[1:] else 2, sys.argv[2:] or ["cogiro", "six", "desk"])
