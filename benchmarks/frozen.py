"""Freezes what `identify` says of all given recordings, and of simulated ones, into a JSON file, and
compares two such files: the proof that a refactoring changes no result.

`python benchmarks/frozen.py freeze FILE [--simulated N] [--methods NAME ...] [--only PATTERN]`
`python benchmarks/frozen.py compare BEFORE AFTER`
"""

from __future__ import annotations

import argparse
import fnmatch
import json
import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from recorder import METHODS, Recorder
from recordings import SHARED

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.experiment.read import read_experiment
from steelyard.identification.identify import identify
from steelyard.inertia import Inertia

GROUPS = ("elastic-cogiro", "rough-robots")
"""Folders of recordings beside the project."""
KUKA = Path(__file__).parents[1] / "examples" / "kuka-tool" / "experiment.yaml"
FIRST_SEED = 100_000
"""Of simulated recordings; apart from the seeds of every test and of the other benchmarks."""
SAME = 0.05
"""Largest change of a parameter, in its 1-sigma before, that counts as none: a twentieth of what
the recording can say."""
COVERED = 1.96
"""1-sigma on either side that hold 95 %."""
RANK = 1e-6
"""Relative eigenvalue of a correlation matrix below which it is singular: the digits of the
file."""
_TASKS = 20
"""Recordings after which a process is replaced, so that its memory stays bounded."""

_recorder: Recorder | None = None


def names(simulated: int) -> Iterator[str]:
    """Recordings beside the project, the KUKA example, and simulated ones by their seed."""
    for group in GROUPS:
        for path in sorted((SHARED / group).glob("*/experiment.yaml")):
            yield f"{group}/{path.parent.name}"
    yield "kuka"
    for i in range(simulated):
        yield f"simulated/{FIRST_SEED + i}"


def recorded(name: str) -> tuple[Experiment, Array | None]:
    """A recording, and the ten true parameters where they are known, shape (10,)."""
    global _recorder
    if name == "kuka":
        return read_experiment(KUKA), None
    group, own = name.split("/")
    if group == "simulated":
        _recorder = _recorder or Recorder()
        assert _recorder.robot.platform is not None
        return _recorder(int(own)), _recorder.robot.platform.body_parameters
    truth = json.loads((SHARED / group / "truth.json").read_text(encoding="utf-8"))[own]
    if isinstance(truth, dict):
        truth = Inertia.from_dict(truth).body_parameters
    return read_experiment(SHARED / group / own / "experiment.yaml"), np.asarray(truth, dtype=float)


def frozen(task: tuple[str, tuple[str, ...]]) -> tuple[str, dict[str, Any]]:
    """What every method says of one recording, as plain values."""
    name, methods = task
    try:
        experiment, truth = recorded(name)
    except Exception as error:
        return name, {"error": _words(error)}
    entry: dict[str, Any] = {} if truth is None else {"truth": truth.tolist()}
    for method in methods:
        begun = time.process_time()
        try:
            entry[method] = _estimated(experiment, method)
        except Exception as error:
            entry[method] = {"error": _words(error)}
        entry[method]["cpu"] = round(time.process_time() - begun, 2)
    return name, entry


def _words(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"


def _estimated(experiment: Experiment, method: str) -> dict[str, Any]:
    """Value, covariance and verdict of a method as plain values."""
    estimate = identify(experiment, [method]).estimates[method]
    return {
        "value": [_plain(v) for v in estimate.value],
        "covariance": [[_plain(float(f"{v:.9g}")) for v in row] for row in estimate.covariance],
        "accepted": estimate.verdict.accepted,
        "reasons": list(estimate.verdict.reasons),
    }


def _plain(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def freeze(
    file: Path, simulated: int, methods: Sequence[str], pattern: str, processes: int
) -> None:
    """Write what the methods say; the file is complete up to what has been printed."""
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    chosen = [name for name in names(simulated) if fnmatch.fnmatch(name, pattern)]
    found: dict[str, dict[str, Any]] = {}
    with get_context("spawn").Pool(processes, maxtasksperchild=_TASKS) as pool:
        tasks = [(name, tuple(methods)) for name in chosen]
        for name, entry in pool.imap_unordered(frozen, tasks):
            found[name] = entry
            said = {method: _short(entry[method]) for method in methods if method in entry}
            print(len(found), name, entry.get("error") or said, flush=True)
            ordered = {each: found[each] for each in chosen if each in found}
            file.write_text(json.dumps(ordered), encoding="utf-8")


def _short(entry: dict[str, Any]) -> str:
    if "error" in entry:
        return str(entry["error"])[:90]
    return "accepted" if entry["accepted"] else "rejected"


@dataclass(frozen=True, eq=False)
class FrozenEstimate:
    """What a method said of a recording."""

    value: Array
    """Shape (10,); NaN: null."""
    covariance: Array
    """Shape (10, 10)."""
    accepted: bool

    @classmethod
    def of(cls, entry: dict[str, Any]) -> FrozenEstimate:
        value = np.array(entry["value"], dtype=float)
        return cls(value, np.array(entry["covariance"], dtype=float), entry["accepted"])

    @property
    def sigma(self) -> Array:
        """1-sigma of the ten, shape (10,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    def chi_square(self, truth: Array) -> float:
        """Of what is known against the truth, per degree of freedom; NaN: nothing is known."""
        known = np.isfinite(self.value) & (self.sigma > 0)
        if not known.any():
            return np.nan
        scaled = (self.value - truth)[known] / self.sigma[known]
        outer = np.outer(self.sigma[known], self.sigma[known])
        correlation = self.covariance[np.ix_(known, known)] / outer
        inverse = np.linalg.pinv(correlation, rcond=RANK, hermitian=True)
        return float(scaled @ inverse @ scaled) / int(known.sum())


def compare(before: Path, after: Path) -> None:
    """Print, method by method, what differs; `*` marks another verdict or a moved estimate."""
    first, second = (json.loads(file.read_text(encoding="utf-8")) for file in (before, after))
    for method in METHODS:
        print(f"\n== {method}")
        pairs = []
        for name, old in first.items():
            new = second.get(name, {})
            if method not in old or method not in new:
                continue
            truth = np.array(old["truth"]) if "truth" in old else None
            if "error" in old[method] or "error" in new[method]:
                if old[method].get("error") != new[method].get("error"):
                    print(f"*{name:36} {_short(old[method])}  ->  {_short(new[method])}")
                continue
            pair = FrozenEstimate.of(old[method]), FrozenEstimate.of(new[method])
            if name.startswith("simulated"):
                pairs.append((*pair, truth))
            else:
                seconds = f"cpu {old[method]['cpu']} -> {new[method]['cpu']} s"
                print(f"{_difference(name, *pair, truth)}  {seconds}")
        if pairs:
            _summary(pairs)


def _difference(name: str, old: FrozenEstimate, new: FrozenEstimate, truth: Array | None) -> str:
    """How two estimates of one recording differ, in a line."""
    same = np.isfinite(old.value) & np.isfinite(new.value)
    moved, ratio = np.array([np.nan]), np.array([np.nan])
    if same.any():
        moved = np.abs(old.value - new.value)[same] / old.sigma[same]
        ratio = new.sigma[same] / old.sigma[same]
    nulls = f"nulls {np.sum(np.isnan(old.value))} -> {np.sum(np.isnan(new.value))}"
    chi = ""
    if truth is not None:
        chi = f"chi2/k {old.chi_square(truth):.2f} -> {new.chi_square(truth):.2f}"
    verdict = " -> ".join("accepted" if each.accepted else "rejected" for each in (old, new))
    mark = " " if old.accepted == new.accepted and moved.max() < SAME else "*"
    return (
        f"{mark}{name:36} moved {moved.max():.4f} sigma, 1-sigma times {ratio.min():.3f} to"
        f" {ratio.max():.3f}, {nulls}, {chi}, {verdict}"
    )


def _summary(pairs: Sequence[tuple[FrozenEstimate, FrozenEstimate, Array]]) -> None:
    """Coverage and errors over simulated recordings, before and after."""
    rmse = []
    for which in (0, 1):
        errors = np.array([pair[which].value - pair[2] for pair in pairs])
        scaled = errors / np.array([pair[which].sigma for pair in pairs])
        rmse.append(np.sqrt(np.mean(errors**2, axis=0)))
        covered = 100 * np.mean(np.abs(scaled) < COVERED)
        accepted = sum(pair[which].accepted for pair in pairs)
        print(
            f"simulated, {('before', 'after')[which]}: {len(pairs)} recordings, coverage"
            f" {covered:.1f} %, rms error {np.sqrt(np.mean(scaled**2)):.3f} sigma, accepted"
            f" {accepted}; rmse {np.array2string(rmse[-1], precision=4)}"
        )
    moved = np.array([(new.value - old.value) / old.sigma for old, new, _ in pairs])
    print(
        f"simulated: moved {np.sqrt(np.mean(moved**2)):.4f} sigma rms, {np.abs(moved).max():.4f} at"
        f" most; rmse after over before {np.array2string(rmse[1] / rmse[0], precision=3)}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    verbs = parser.add_subparsers(dest="verb", required=True)
    freezing = verbs.add_parser("freeze", help="write what identify says now")
    freezing.add_argument("file", type=Path)
    freezing.add_argument("--simulated", type=int, default=0, help="number of simulated recordings")
    freezing.add_argument("--methods", nargs="+", default=METHODS)
    freezing.add_argument("--only", default="*", help="pattern of names")
    freezing.add_argument("-j", "--processes", type=int, default=2)
    comparing = verbs.add_parser("compare", help="compare two files")
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    given = parser.parse_args()
    if given.verb == "freeze":
        freeze(given.file, given.simulated, given.methods, given.only, given.processes)
    else:
        compare(given.before, given.after)


if __name__ == "__main__":
    main()
