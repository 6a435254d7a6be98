"""Sound recordings as amplifiers, clocks and loggers spoil them: `python benchmarks/logged.py [NAME ...]`.

Draws sound recordings of several robots (`rough/`, which needs MuJoCo), changes their tables as real
logs are changed, and prints for each what `imperfect.py` prints. NAME is one of the changes;
`--robots` and `--seed` say of which recordings.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import polars as pl
from imperfect import Row, row_of, summed_up
from rough.recording import recorded
from rough.shared import Array

from steelyard.inertia import Inertia

Change = Callable[[Array, np.random.Generator], Array]
"""Of a table, time first, shape (n, 1 + k)."""


def _pull(table: Array) -> float:
    return float(np.median(np.abs(table[:, 1:])))


def _quantised(table: Array, _: np.random.Generator) -> Array:
    """A converter that resolves a hundredth of the pull."""
    step = 0.01 * _pull(table)
    return np.column_stack([table[:, 0], step * np.round(table[:, 1:] / step)])


def _nonlinear(table: Array, rng: np.random.Generator) -> Array:
    """Cells whose curve bends by about 1 % of the pull."""
    values = table[:, 1:]
    bend = rng.normal(0, 0.01, values.shape[1]) * (values - values.mean(axis=0)) ** 2
    return np.column_stack([table[:, 0], values + bend / _pull(table)])


def _lagging(table: Array, _: np.random.Generator) -> Array:
    """Cells with play: they follow once the force has changed by a hundredth of the pull."""
    play, found = 0.01 * _pull(table), table.copy()
    for before, row in pairwise(found):
        row[1:] = np.clip(before[1:], row[1:] - play, row[1:] + play)
    return found


def _spiked(share: float, size: float | None, most: int | None = None) -> Change:
    """Single readings of so many channels that are far off by a size; None: of all, by half the
    pull.
    """

    def change(table: Array, rng: np.random.Generator) -> Array:
        found = table.copy()
        values = found[:, 1:][:, :most]
        at = rng.random(values.shape) < share
        values[at] += rng.normal(0, size or 0.5 * _pull(table), int(at.sum()))
        return found

    return change


def _dropped(table: Array, rng: np.random.Generator) -> Array:
    """3 % of the rows are lost, and four stretches of up to .6 s."""
    keep, time = rng.random(len(table)) > 0.03, table[:, 0] - table[0, 0]
    for start, length in zip(rng.uniform(0, time[-1], 4), rng.uniform(0.05, 0.6, 4), strict=True):
        keep &= (time < start) | (time > start + length)
    return table[keep]


def _stuck(table: Array, rng: np.random.Generator) -> Array:
    """One channel stands for two seconds."""
    found, time = table.copy(), table[:, 0] - table[0, 0]
    start, channel = rng.uniform(2, 16), rng.integers(1, table.shape[1])
    at = (time > start) & (time < start + 2)
    found[at, channel] = found[np.argmax(at), channel]
    return found


def _dead(table: Array, rng: np.random.Generator) -> Array:
    """One channel that has never worked."""
    found, channel = table.copy(), rng.integers(1, table.shape[1])
    found[:, channel] = 0.01 * _pull(table)
    return found


def _dead_rate(table: Array, rng: np.random.Generator) -> Array:
    """An axis of a gyro that has never worked."""
    found = table.copy()
    found[:, rng.integers(1, 4)] = 0.0
    return found


def _dying(table: Array, rng: np.random.Generator) -> Array:
    """One channel that reads the same from a third of the recording on."""
    found, first, channel = table.copy(), len(table) // 3, rng.integers(1, table.shape[1])
    found[first:, channel] = found[first, channel]
    return found


def _late(table: Array, _: np.random.Generator) -> Array:
    """Readings that come 30 ms late."""
    return np.column_stack([table[:, 0] + 0.03, table[:, 1:]])


def _lost(table: Array, rng: np.random.Generator) -> Array:
    """Nothing for three seconds."""
    time, start = table[:, 0] - table[0, 0], rng.uniform(4, 12)
    return table[(time < start) | (time > start + 3)]


def _fast_clock(table: Array, _: np.random.Generator) -> Array:
    """A clock that is fast by 5e-4."""
    time = table[0, 0] + (table[:, 0] - table[0, 0]) * (1 + 5e-4)
    return np.column_stack([time, table[:, 1:]])


def _held(table: Array, _: np.random.Generator) -> Array:
    """A sensor that reads at a quarter of the logged rate."""
    return np.column_stack([table[:, 0], table[np.arange(len(table)) // 4 * 4, 1:]])


def _shaken(table: Array, rng: np.random.Generator) -> Array:
    """An accelerometer that a drive shakes by .8 m/s^2 at 23.3 Hz."""
    found = table.copy()
    phase = 2 * np.pi * 23.3 * table[:, :1] + rng.uniform(0, 2 * np.pi, 3)
    found[:, 4:7] += 0.8 * np.sin(phase)
    return found


def _humming(table: Array, rng: np.random.Generator) -> Array:
    """Cells with 2 % of the pull at 49.3 Hz."""
    phase = 2 * np.pi * 49.3 * table[:, :1] + rng.uniform(0, 2 * np.pi, table.shape[1] - 1)
    return np.column_stack([table[:, 0], table[:, 1:] + 0.02 * _pull(table) * np.sin(phase)])


_UNSTATED = "without noise stated"
CHANGES: dict[str, tuple[tuple[str, Change], ...]] = {
    _UNSTATED: (),
    "forces quantised": (("cables", _quantised),),
    "forces not linear": (("cables", _nonlinear),),
    "forces with play": (("cables", _lagging),),
    "forces with spikes": (("cables", _spiked(0.004, None)),),
    "forces at a quarter": (("cables", _held),),
    "forces hum": (("cables", _humming),),
    "one force stuck": (("cables", _stuck),),
    "one force dead": (("cables", _dead),),
    "one force dies": (("cables", _dying),),
    "forces late": (("cables", _late),),
    "gyro axis dead": (("imu", _dead_rate),),
    "IMU late": (("imu", _late),),
    "IMU with spikes": (("imu", _spiked(0.002, 5.0, 6)),),
    "IMU at a quarter": (("imu", _held),),
    "IMU shaken": (("imu", _shaken),),
    "tracker at a quarter": (("tracker", _held),),
    "tracker's clock fast": (("tracker", _fast_clock),),
    "tracker lost": (("tracker", _lost),),
    "rows dropped": (("cables", _dropped), ("imu", _dropped), ("tracker", _dropped)),
    "several": (
        ("cables", _quantised), ("cables", _nonlinear), ("cables", _spiked(0.004, None)),
        ("imu", _dropped), ("imu", _spiked(0.002, 5.0, 6)),
        ("tracker", _dropped), ("tracker", _fast_clock),
    ),
}  # fmt: skip
"""Name -> what is done to which stream, one after the other."""
_WITHOUT_NOISE = frozenset({_UNSTATED, "forces quantised", "several"})
"""Those of which nobody has stated the noise."""


def spoiled(sound: Path, folder: Path, name: str, rng: np.random.Generator) -> Path:
    """A sound recording changed; its experiment file."""
    shutil.copytree(sound, folder)
    for stream, change in CHANGES[name]:
        log = folder / "run" / f"{stream}.csv"
        table = pl.read_csv(log)
        changed = change(table.cast(pl.Float64).to_numpy().copy(), rng)
        pl.DataFrame(changed, schema=table.columns).write_csv(log)
    path = folder / "experiment.yaml"
    if name in _WITHOUT_NOISE:
        values = json.loads(path.read_text(encoding="utf-8"))
        for instrument in values["instruments"].values():
            instrument.pop("noise", None)
        path.write_text(json.dumps(values, indent=1), encoding="utf-8")
    return path


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="changes; none: all")
    parser.add_argument("--robots", nargs="*", default=["cogiro", "six", "twelve", "desk", "four"])
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args(arguments)
    if unknown := set(chosen.names) - set(CHANGES):
        parser.error(f"expected some of {', '.join(CHANGES)}, found {', '.join(unknown)}")
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as place:
        for robot in chosen.robots:
            sound = Path(place) / robot
            _, body = recorded(robot, "sound", chosen.seed, sound, 20.0)
            for i, name in enumerate(CHANGES):
                if chosen.names and name not in chosen.names:
                    continue
                rng = np.random.default_rng([chosen.seed, i, *robot.encode()])
                path = spoiled(sound, Path(place) / f"{robot}-{i}", name, rng)
                truth = Inertia.from_body_parameters(body)
                rows.append(row_of(f"{robot}, {name}", name, robot, path, truth, None))
                print(rows[-1], flush=True)
    print()
    for line in summed_up(rows, lambda row: row.robot):
        print(line)


if __name__ == "__main__":
    main(sys.argv[1:])
