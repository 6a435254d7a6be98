"""What the verdict says of every mistake that people make, on drawn recordings of robots with few cables
and of held ones: `python benchmarks/mistakes_on_few.py DRAWS ROBOT …` (`rough/`, which needs MuJoCo).

`steelyard study --mistakes` simulates by itself; these recordings are from another simulator. Prints for each mistake
how many draws are rejected or refused, and how many are accepted though their chi-square per parameter
is above three, and the first reason of the first draw.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from recordings import chi_square
from rough.recording import recorded

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.experiment.read import read_experiment
from steelyard.inspection.identify import identify
from steelyard.simulation.mistakes import possible_mistakes

_WORST = 3.0
"""Chi-square per parameter of an accepted estimate that has misled."""
_SECONDS = 20.0
"""Length of the recordings."""


def said(experiment: Experiment, body: Array) -> tuple[bool, bool, str]:
    """Whether an experiment is rejected or refused, whether its estimate misleads, and why it was
    rejected first.
    """
    try:
        found = identify(experiment, ["maximum-likelihood"])
    except InputError as refusal:
        return True, False, str(refusal).split(": ", 1)[-1]
    estimate = found.estimate
    if not estimate.verdict.accepted:
        return True, False, next(iter(estimate.verdict.reasons), "")
    told = int(np.isfinite(estimate.value).sum())
    return False, bool(told) and chi_square(estimate, body) > _WORST * told, ""


def main(draws: int, robots: Sequence[str]) -> None:
    """Print the table."""
    for robot in robots:
        rows: dict[str, list[tuple[bool, bool, str]]] = {}
        with tempfile.TemporaryDirectory() as out:
            for number in range(draws):
                path, body = recorded(robot, "sound", number, Path(out) / str(number), _SECONDS)
                sound = read_experiment(path)
                rows.setdefault("sound", []).append(said(sound, body))
                for each in possible_mistakes(sound.instruments, sound.robot.m):
                    wrong = each(sound, np.random.default_rng([number, 2]))
                    rows.setdefault(each.name, []).append(said(wrong, body))
        print(f"\n{robot:44}{'rejected':>10}{'misled':>8}  first reason", flush=True)
        for name, own in rows.items():
            rejected, misled = (sum(each[i] for each in own) for i in (0, 1))
            reason = next((why for _, _, why in own if why), "")
            print(f"{name:44}{rejected:4d} of {len(own):2d}{misled:8d}  {reason[:90]}", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2:])
