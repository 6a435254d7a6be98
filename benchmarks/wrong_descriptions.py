"""Mistakes that people make in a description, and what `steelyard identify` alone says to change: a
table with times of the command in units of a sound identification; and alarms on sound recordings."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from children import seconds_of_children
from recordings import SHARED, recordings
from sound import SOUND

from steelyard.experiment.model import Experiment
from steelyard.experiment.read import read_experiment
from steelyard.experiment.write import write_experiment
from steelyard.inspection.description import check_description
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
    """Whether the command rejected it, what to change, and how long that took on the processor, with
    loading and the report [s].
    """
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "recording"
        place.mkdir()
        write_experiment(experiment, place, tables="parquet")
        before = seconds_of_children()
        command = [
            sys.executable,
            "-m",
            "steelyard",
            "identify",
            place / "experiment.yaml",
            "--out",
            f"{folder}/out",
        ]
        ended = subprocess.run(command, capture_output=True, text=True, check=False)
        taken = seconds_of_children() - before
        if ended.returncode not in (0, 3):
            return False, ended.stderr, taken
        estimate = json.loads(Path(folder, "out", "estimate.json").read_text("utf-8"))
    return ended.returncode == 3, estimate.get("amendment") or "", taken


def main(*, alarms: bool) -> None:
    """Print the tables."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    print("| mistake | robot | said | time [s] | of a sound one |\n|---|---|---|---|---|")
    for name, sound in experiments().items():
        timed(sound)  # once, so that files and compiled functions are kept
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
