"""Recordings with the imperfections of real robots: `python benchmarks/imperfect.py [NAME ...]`.

Prints for each whether it is accepted, chi-square per parameter on the stated covariance, the error
of the mass and what was found beside the body, and the first reason of a rejection.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from recordings import SHARED, chi_square

from steelyard.errors import InputError
from steelyard.experiment.read import read_experiment
from steelyard.identification.identify import Identification, identify
from steelyard.identification.methods.from_posterior.unstated import found_errors
from steelyard.inertia import Inertia

_PLACES = SHARED / "rough-robots", Path(__file__).parents[1] / "tests" / "data" / "rough-robots"


def imperfect() -> Iterator[tuple[str, Path, Inertia]]:
    """Name, experiment file and true body of every recording of the first place that exists."""
    folder = next(place for place in _PLACES if (place / "truth.json").exists())
    for name, body in sorted(json.loads((folder / "truth.json").read_text("utf-8")).items()):
        path = folder / name / "experiment.yaml"
        if path.exists():
            truth = Inertia.from_body_parameters(np.array(body, dtype=np.float64))
            yield name, path, truth


def main(names: list[str]) -> None:
    """Print the table."""
    print(f"{'recording':26}{'verdict':>9}{'chi2/k':>8}{'k':>4}{'mass error':>12}{'CPU':>7}  found")
    for name, path, truth in imperfect():
        if names and name not in names:
            continue
        start = time.process_time()
        try:
            found = identify(read_experiment(path), ["maximum-likelihood"])
        except InputError as refusal:
            print(f"{name:26}{'refused':>9}  {str(refusal).split(': ', 1)[-1][:90]}")
            continue
        estimate = found.estimate
        k = int(np.isfinite(estimate.value).sum())
        chi = chi_square(estimate, truth.body_parameters) / max(k, 1)
        verdict = estimate.verdict.short
        error = estimate.value[0] - truth.mass
        print(
            f"{name:26}{verdict:>9}{chi:8.2f}{k:4d}{error:+9.3f} kg"
            f"{time.process_time() - start:6.1f}s  {_beside(found)}",
            flush=True,
        )


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
    errors = dict.fromkeys(name.split()[0] for name in found_errors(posterior))
    reasons = [f"[{reason[:60]}]" for reason in found.estimate.verdict.reasons[:1]]
    return "; ".join([*reasons, *errors, *processes])


if __name__ == "__main__":
    main(sys.argv[1:])
