"""Recordings with the imperfections of real robots:
`OPENBLAS_NUM_THREADS=1 python benchmarks/imperfect.py [NAME ...]`.

Prints for each whether it is accepted, chi-square per parameter on the stated covariance, the error
of the mass and what was found beside the body, and the first reason of a rejection.

`--drawn SEEDS` draws other recordings of the same kinds (`rough/`, which needs MuJoCo), on robots with
three to twelve cables, and sums them up by kind and by robot; NAME is then the name of a kind.
`--motion moves` lets them work from rest to rest, `circles` go round and `slow` at a third of the pace.

`--part START SECONDS` takes a part of every motion only, as who has little time records.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from recordings import SHARED, chi_square

from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.experiment.read import read_experiment
from steelyard.experiment.recording import Run
from steelyard.identification.identification import Identification
from steelyard.identification.methods.from_posterior.unstated import found_errors
from steelyard.identification.solve.long_recording import span_of
from steelyard.inertia import Inertia
from steelyard.inspection.identify import identify

_PLACES = SHARED / "rough-robots", Path(__file__).parents[1] / "tests" / "data" / "rough-robots"
_WORST = 3.0
"""Chi-square per parameter of an accepted estimate that has misled."""


@dataclass(frozen=True)
class Row:
    """What came of one recording."""

    name: str
    kind: str
    robot: str
    verdict: str
    chi: float
    """Chi-square per parameter."""
    told: int
    """Of the ten numbers."""
    error: float
    """Of the mass [kg]."""
    seconds: float
    """Of CPU."""
    found: str

    def __str__(self) -> str:
        if self.verdict == "refused":
            return f"{self.name:34}{self.verdict:>13}  {self.found}"
        return (
            f"{self.name:34}{self.verdict:>13}{self.chi:8.2f}{self.told:4d}{self.error:+9.3f} kg"
            f"{self.seconds:6.1f}s  {self.found}"
        )


def imperfect() -> Iterator[tuple[str, Path, Inertia]]:
    """Name, experiment file and true body of every recording of the first place that exists."""
    folder = next(place for place in _PLACES if (place / "truth.json").exists())
    for name, body in sorted(json.loads((folder / "truth.json").read_text("utf-8")).items()):
        path = folder / name / "experiment.yaml"
        if path.exists():
            truth = Inertia.from_body_parameters(np.array(body, dtype=np.float64))
            yield name, path, truth


def drawn(
    seeds: Sequence[int],
    kinds: Sequence[str],
    robots: Sequence[str],
    seconds: float,
    out: Path,
    motion: str = "multisine",
) -> Iterator[tuple[str, str, Path, Inertia]]:
    """Robot, kind, experiment file and true body of drawn recordings."""
    from rough.further import FURTHER
    from rough.kinds import KINDS
    from rough.recording import recorded

    for kind, what in KINDS.items():
        for robot in (*what.robots, *(each for each in robots if each in FURTHER)):
            if (kinds and kind not in kinds) or (robots and robot not in robots):
                continue
            for seed in seeds:
                folder = out / f"{robot}-{kind}-{seed:02d}"
                path, body = recorded(robot, kind, seed, folder, seconds, motion)
                yield robot, kind, path, Inertia.from_body_parameters(body)


def of_part(experiment: Experiment, part: tuple[float, float]) -> Experiment:
    """A part of every motion only.

    Args:
        part: Where it begins, after the beginning of the motion, and how long it is [s].
    """

    def cut(run: Run) -> Run:
        start, end = span_of(experiment, run)
        return replace(run, window=(start + part[0], min(end, start + sum(part))))

    runs = tuple(each if each.static else cut(each) for each in experiment.runs)
    return replace(experiment, runs=runs)


def row_of(
    name: str,
    kind: str,
    robot: str,
    path: Path,
    truth: Inertia,
    part: tuple[float, float] | None,
) -> Row:
    """Identify one, or a part of it."""
    start = time.process_time()
    try:
        experiment = read_experiment(path)
        experiment = of_part(experiment, part) if part else experiment
        found = identify(experiment, ["maximum-likelihood"], anyway=True)
    except InputError as refusal:
        why = str(refusal).split(": ", 1)[-1][:90]
        return Row(name, kind, robot, "refused", np.nan, 0, np.nan, 0.0, why)
    seconds = time.process_time() - start
    estimate = found.estimate
    k = int(np.isfinite(estimate.value).sum())
    chi = chi_square(estimate, truth.body_parameters) / k if k else np.nan
    error = float(estimate.value[0] - truth.mass)
    return Row(name, kind, robot, estimate.verdict.short, chi, k, error, seconds, _beside(found))


def summed_up(rows: Sequence[Row], of: Callable[[Row], str]) -> Iterator[str]:
    """A line for each group of rows and one for all."""
    yield (
        f"{'':24}{'recordings':>11}{'accepted':>9}{'chi2/k mean':>12}{'worst':>7}"
        f"{'misled':>8}{'null':>6}{'CPU':>8}"
    )
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(of(row), []).append(row)
    for name, own in {**groups, "all": list(rows)}.items():
        accepted = [row for row in own if row.verdict == "accepted"]
        chi = np.array([row.chi for row in accepted if np.isfinite(row.chi)])
        mean, worst = (chi.mean(), chi.max()) if len(chi) else (np.nan, np.nan)
        null = sum(10 - row.told for row in own if row.verdict != "refused")
        yield (
            f"{name:24}{len(own):11d}{len(accepted):9d}{mean:12.2f}{worst:7.2f}"
            f"{int(np.sum(chi > _WORST)):8d}{null:6d}{np.mean([r.seconds for r in own]):7.1f}s"
        )


def main(arguments: list[str]) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="recordings, or kinds of drawn ones")
    parser.add_argument("--drawn", type=int, default=0, metavar="SEEDS", help="how many of each")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--robots", nargs="*", default=[], help="of drawn recordings")
    parser.add_argument("--seconds", type=float, default=20.0, help="length of drawn recordings")
    parser.add_argument(
        "--motion",
        default="multisine",
        choices=("multisine", "moves", "circles", "slow"),
        help="of drawn recordings",
    )
    parser.add_argument("--part", type=float, nargs=2, metavar=("START", "SECONDS"), help="of each")
    given = parser.parse_args(arguments)
    part = tuple(given.part) if given.part else None
    print(
        f"{'recording':34}{'verdict':>13}{'chi2/k':>8}{'k':>4}{'mass error':>12}{'CPU':>7}  found"
    )
    if not given.drawn:
        for name, path, truth in imperfect():
            if not given.names or name in given.names:
                print(row_of(name, name, "", path, truth, part), flush=True)
        return
    rows = []
    seeds = range(given.first, given.first + given.drawn)
    with tempfile.TemporaryDirectory() as out:
        every = drawn(seeds, given.names, given.robots, given.seconds, Path(out), given.motion)
        for robot, kind, path, truth in every:
            rows.append(row_of(path.parent.name, kind, robot, path, truth, part))
            print(rows[-1], flush=True)
    for of in (lambda row: row.kind, lambda row: row.robot):
        print("", *summed_up(rows, of), sep="\n")


def _beside(found: Identification) -> str:
    """Disturbances and errors that were asked for."""
    posterior = found.posterior
    if posterior is None:
        return ""
    processes = dict.fromkeys(
        f"{each.source[0]}.{each.source[1]} {each.level * each.sizes[0]:.2g} over {each.time:.2g} s"
        for segment in posterior.fit.state.segments
        for each in segment.processes
    )
    jitters = [f"jitter of {name}" for name in posterior.fit.state.jitters]
    errors = dict.fromkeys(name.split()[0] for name in found_errors(posterior))
    reasons = [f"[{reason[:60]}]" for reason in found.estimate.verdict.reasons[:1]]
    return "; ".join([*reasons, *errors, *jitters, *processes])


if __name__ == "__main__":
    main(sys.argv[1:])
