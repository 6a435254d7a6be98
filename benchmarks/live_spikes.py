"""Spikes while data arrive: `recursive` on recordings with single readings that are far off, against
itself on the same recordings without: `python benchmarks/live_spikes.py [SEED ...]`.

Prints the largest distance of the ten to what was known without spikes, in the 1-sigma of that: over
all instants after ten seconds, and at the end; chi-square per parameter against the truth; how many
numbers were spiked and how many left out; events, of which there are none.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.experiment.read import read_experiment
from steelyard.identification.recursive.follow import follow
from steelyard.identification.recursive.following import Following
from steelyard.inertia import COLUMNS, ROWS
from steelyard.simulation.edits import with_values

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
RECORDINGS = (
    "elastic-cogiro/chains-00",
    "elastic-cogiro/pulleys-00",
    "rough-robots/four-cables-00",
)
CASES = (
    ("forces", 0.001), ("forces", 0.01), ("forces", 0.03), ("one cell", 0.01), ("one cell", 0.03),
    ("whole samples", 0.01), ("whole samples", 0.03), ("three in a row", 0.01),
    ("IMU", 0.002), ("IMU", 0.01), ("IMU", 0.03), ("tracker", 0.01), ("tracker", 0.03),
)  # fmt: skip
"""What is spiked, and which part of it."""
SIZES = {"angular_velocity": 0.5, "specific_force": 5.0, "position": 0.1}
"""1-sigma of spikes [rad/s], [m/s^2], [m]; of forces it is half the pull."""
LATE = 10.0
"""[s]"""


def spiked(
    experiment: Experiment, what: str, share: float, rng: np.random.Generator
) -> tuple[Experiment, int]:
    """A recording with spikes, and in how many numbers."""
    name = {"IMU": "imu", "tracker": "tracker"}.get(what, "cables")
    count = 0

    def change(streams: Mapping[str, Array]) -> dict[str, Array]:
        nonlocal count
        found = {}
        for quantity, values in streams.items():
            if quantity not in (*SIZES, "tension"):
                continue
            at = rng.random(values.shape) < share
            if what == "one cell":
                at[:, [i for i in range(values.shape[1]) if i != 2]] = False
            elif what == "whole samples":
                at[:] = at[:, :1]
            elif what == "three in a row":
                at = rng.random(values.shape) < share / 3
                first = at.copy()
                at[1:] |= first[:-1]
                at[2:] |= first[:-2]
            size = SIZES.get(quantity, 0.5 * float(np.median(np.abs(values))))
            found[quantity] = values + at * rng.normal(0.0, size, values.shape)
            count += int(at.sum())
        return found

    return with_values(experiment, name, change), count


def truth_of(name: str) -> Array:
    """The ten of a recording."""
    folder, own = name.split("/")
    truth = json.loads((DATA / folder / "truth.json").read_text(encoding="utf-8"))[own]
    if isinstance(truth, list):
        return np.array(truth)
    moments = np.array(truth["inertia"])[ROWS, COLUMNS]
    return np.array([truth["mass"], *truth["center_of_gravity"], *moments])


def distances(found: Following, sound: Following) -> Iterator[tuple[float, float]]:
    """Times, and how far what is known is from what was without spikes, in 1-sigma."""
    times = np.array([each.time for each in sound.instants])
    for one in found.instants:
        # Knots, and so chunks, may be others.
        other = sound.instants[int(np.argmin(np.abs(times - one.time)))]
        sigma = np.sqrt(np.diag(other.covariance))
        yield other.time, float(np.max(np.abs(one.value - other.value) / sigma))


def row(found: Following, sound: Following, truth: Array) -> str:
    """What became of a recording."""
    every = list(distances(found, sound))
    last = found.instants[-1]
    error = last.value - truth
    chi = error @ np.linalg.solve(last.covariance, error) / len(error)
    left = sum(found.recursion.alone.values())
    largest = max(far for time, far in every if time > LATE)
    return f"{largest:8.2f} {every[-1][1]:8.2f} {chi:9.2f} {left:9d} {len(found.events):7d}"


def main(seeds: list[int]) -> None:
    print(f"{'recording':28} {'spikes in':20} {'numbers':>8} {'largest':>8} {'at end':>8}"
          f" {'chi2/10':>9} {'left out':>9} {'events':>7}")  # fmt: skip
    for name in RECORDINGS:
        experiment, truth = read_experiment(DATA / name / "experiment.yaml"), truth_of(name)
        *_, sound = follow(experiment)
        print(f"{name:28} {'none':20} {0:8d} {row(sound, sound, truth)}", flush=True)
        for what, share in CASES:
            for seed in seeds:
                rng = np.random.default_rng(seed)
                changed, count = spiked(experiment, what, share, rng)
                case = f"{100 * share:g} % of {what}"
                try:
                    *_, found = follow(changed)
                except InputError as error:
                    print(f"{name:28} {case:20} {count:8d} {error}", flush=True)
                    continue
                print(f"{name:28} {case:20} {count:8d} {row(found, sound, truth)}", flush=True)


if __name__ == "__main__":
    main([int(each) for each in sys.argv[1:]] or [1])
