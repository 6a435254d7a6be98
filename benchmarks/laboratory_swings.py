"""Swings as a laboratory records them, one thing made real at a time: errors of what is told of the
body in stated 1-sigma, and natural frequencies predicted for poses that no recording had."""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.errors import InputError
from steelyard.estimates.per_mass import PerMass
from steelyard.experiment.unread import with_constant_lengths
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.natural_frequencies.frequencies import frequencies

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
sys.path.insert(0, str(Path(__file__).parents[1] / "examples" / "free-swinging"))
from laboratory_swings import Laboratory, record

SEED = 77
REAL: dict[str, dict[str, Any]] = {
    "nothing": {},
    "targets lost, jumps of centimetres": {"lost": 3, "jumps": 3},
    "markers 3 cm and 3 deg off, stated": {"marker": (0.03, 0.05)},
    "air": {"linear_drag": 0.05, "air": 0.5},
    "dry friction of .05 N m at anchors": {"swivel": 0.05},
    "a hand in the first second": {"hand": 1.0},
    "small swings": {"push": 0.15},
    "large swings": {"push": 2.0},
    "cables slack for moments": {"push": 2.5, "slack": True},
    "elastic cables, not stated": {"stiffness": 5e4, "stretch_stated": False},
    "geometry 5 mm off": {"geometry": 0.005},
    "50 Hz, jitter of 2 ms": {"rate": 50.0, "jitter": 0.002},
    "4 s each": {"duration": 4.0},
    "errors of 1 mrad over 3 s": {"slow": (3e-4, 1e-3)},
}
HELD_OUT = 6
"""Poses of which frequencies are predicted."""


def predicted(recorded: Any, found: Any, m: int) -> np.ndarray:
    """Relative errors of frequencies that no recording had, in per cent."""
    rng = np.random.default_rng([5, m])
    errors: list[float] = []
    for _ in range(5 * HELD_OUT):
        place = np.array([rng.uniform(-0.6, 0.6), rng.uniform(-0.4, 0.4), rng.uniform(0.8, 1.6)])
        reach = np.linalg.norm(recorded.true.anchors - place - recorded.true.attachments, axis=1)
        try:
            true = frequencies(recorded.true, recorded.body, lengths=reach)
            ours = frequencies(recorded.experiment.robot, found, pose=true.pose)
        except InputError:
            # A cable is at the edge of slack there.
            continue
        if len(true.modes) == len(ours.modes) == 6 - m:
            pairs = zip(true.modes, ours.modes, strict=True)
            errors += [100 * abs(b.frequency / a.frequency - 1) for a, b in pairs]
        if len(errors) >= HELD_OUT * (6 - m):
            break
    return np.array(errors or [np.nan])


def main(cables: str, runs: int, length_noise: float = 0.0) -> None:
    """With lengths that are constant to some millimetres; 0: that is not used."""
    print(
        f"{runs} swings of 10 s each, motion capture .2 mm and .3 mrad, geometry 2 mm"
        + (f", lengths constant to {length_noise:g} mm" if length_noise else "")
    )
    print(
        "cables  what is real                          swings [deg]  chi-square/9  centre [mm]"
        "  moments [%]  frequencies [%]  CPU [s]"
    )
    for m in map(int, cables.split(",")):
        for name, real in REAL.items():
            recorded = record(Laboratory(cables=m, runs=runs, **real), [SEED, m, 0])
            experiment = recorded.experiment
            if length_noise:
                stated = replace(experiment, length_noise=1e-3 * length_noise)
                experiment = with_constant_lengths(stated)
            begun = time.process_time()
            found = MaximumLikelihood()(experiment)
            seconds = time.process_time() - begun
            told = found.per_mass
            assert told is not None
            truth = PerMass.of(recorded.body.body_parameters, np.zeros((10, 10))).value
            off, sigma = told.value - truth, told.standard_deviation
            use = np.isfinite(off)
            z = (off / sigma)[use]
            correlation = (told.covariance / np.outer(sigma, sigma))[np.ix_(use, use)]
            chi = z @ np.linalg.solve(correlation, z) / max(use.sum(), 1)
            errors = predicted(recorded, found, m) if use.all() else np.array([np.nan])
            swung = np.degrees(recorded.amplitudes)
            verdict = (
                "accepted" if found.verdict.accepted else "; ".join(found.verdict.reasons)[:90]
            )
            begins = f"{m:6}  {name:37} {swung.min():5.1f}-{swung.max():<5.1f}"
            if not use.any():
                print(f"{begins}   nothing told, {seconds:.1f} s: {verdict}", flush=True)
                continue
            print(
                f"{begins} {chi:14.2f}"
                f" {1e3 * np.nanmax(np.abs(off[:3])):12.2f}"
                f" {100 * np.nanmax(np.abs(off[3:6] / truth[3:6])):12.2f}"
                f" {np.nanmedian(errors):8.3f} {np.nanmax(errors):7.3f} {seconds:8.1f}  " + verdict,
                flush=True,
            )


if __name__ == "__main__":
    main(
        sys.argv[1] if len(sys.argv) > 1 else "3,4,2",
        int((sys.argv[2:3] or [4])[0]),
        float((sys.argv[3:4] or [0])[0]),
    )
