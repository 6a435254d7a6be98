"""Mistakes that people make in a description, and what `identify` alone says to change: a table with
times in units of a sound identification; and alarms on sound recordings."""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from recordings import SHARED, recordings
from sound import SOUND

from steelyard.experiment.model import Experiment
from steelyard.experiment.read import read_experiment
from steelyard.inspection.description import check_description
from steelyard.inspection.identify import identify
from steelyard.simulation.simulate import simulate

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from mistaken import DESCRIPTIONS

TESTS = Path(__file__).parents[1] / "tests"
FOUR = TESTS / "data" / "rough-robots" / "four-cables-00" / "experiment.yaml"


def experiments(seed: int = 0) -> dict[str, Experiment]:
    """CoGiRo with the sensors of the paper, and a platform that swings on four cables; of neither is a
    nominal body known.
    """
    cogiro = simulate("cogiro", "multisine", duration=12.0, seed=seed).experiment
    bare = replace(cogiro, robot=replace(cogiro.robot, platform=None))
    return {"cogiro": bare, "four cables": read_experiment(FOUR)}


def timed(experiment: Experiment) -> tuple[bool, str, float]:
    """Whether it was rejected, what to change, and how long that took on the processor [s]."""
    start = time.process_time()
    found = identify(experiment)
    return found.is_rejected, found.amendment, time.process_time() - start


def main(*, alarms: bool) -> None:
    """Print the tables."""
    print("| mistake | robot | said | time [s] | of a sound one |\n|---|---|---|---|---|")
    for name, sound in experiments().items():
        identify(sound)  # once, so that everything is loaded
        _, said, usual = timed(sound)
        print(f"| none | {name} | {said or '-'} | {usual:.1f} | 1 |", flush=True)
        right = 0
        for what, (make, wanted) in DESCRIPTIONS.items():
            rejected, said, taken = timed(make(sound))
            good = rejected and wanted in said
            right += good
            told = " ".join(said.split()) if good else f"NOT SAID: {said!r}"
            print(f"| {what} | {name} | {told} | {taken:.1f} | {taken / usual:.1f} |", flush=True)
        print(f"{name}: {right} of {len(DESCRIPTIONS)}", flush=True)
    if alarms:
        rough = sorted((SHARED / "rough-robots").glob("*/experiment.yaml"))
        for path in [*(path for _, path, _ in recordings()), *rough]:
            found = check_description(read_experiment(path))
            print(f"{path.parent.name}: {'; '.join(found.reasons) or 'nothing'}", flush=True)
        named = 0
        for seed in (1, 2):
            sound = experiments(seed)["cogiro"]
            for what, make in SOUND.items():
                found = check_description(make(sound, np.random.default_rng(seed)))
                named += bool(found.mistakes)
                print(f"{what}, {seed}: {'; '.join(found.reasons) or 'nothing'}", flush=True)
        print(f"imperfect but sound: {named} of {2 * len(SOUND)} alarmed", flush=True)


if __name__ == "__main__":
    main(alarms="--alarms" in sys.argv)
