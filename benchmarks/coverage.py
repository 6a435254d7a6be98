"""Whether the stated 1-sigma are true: simulated experiments of the project's own simulator, whose
errors are held against them."""

from __future__ import annotations

import sys
from multiprocessing import get_context

import numpy as np
from verdicts import Recorder

from steelyard.arrays import Array
from steelyard.identification.methods.consistent import Consistent
from steelyard.identification.methods.instrumental_variables import InstrumentalVariables
from steelyard.identification.methods.least_squares import LeastSquares
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.methods.two_step import TwoStep
from steelyard.identification.solve.held_motion import fit_with_held_motion
from steelyard.inertia import BODY_PARAMETERS

FIRST_SEED = 100_000
"""Apart from the seeds of every test."""
METHODS = (
    "two-step",
    "least-squares",
    "instrumental-variables",
    "consistent",
    "maximum-likelihood",
)
UNITS = np.array([1, 1e3, 1e3, 1e3, 1, 1, 1, 1, 1, 1])

_recorder: Recorder | None = None


def draw(seed: int) -> tuple[dict[str, tuple[Array, Array, bool, bool | None]], Array]:
    """Error, covariance, verdict and physical of every method for one experiment, and the
    attainable 1-sigma."""
    global _recorder
    _recorder = _recorder or Recorder()
    experiment = _recorder(seed)
    truth = _recorder.robot.platform.body_parameters
    found = fit_with_held_motion(experiment)
    estimates = [
        TwoStep()(experiment),
        LeastSquares().of(found),
        InstrumentalVariables().of(found),
        Consistent().of(found),
        MaximumLikelihood()(experiment),
    ]
    return {
        e.method: (e.value - truth, e.covariance, e.verdict.accepted, e.physical) for e in estimates
    }, found.bound.standard_deviation


def main(count: int, processes: int) -> None:
    with get_context("spawn").Pool(processes) as pool:
        drawn = list(pool.imap(draw, range(FIRST_SEED, FIRST_SEED + count)))
    print(f"{count} experiments: CoGiRo, 20 s on six axes, sensors of the paper")
    print(f"{'':40}" + "".join(f"{name:>9}" for name in BODY_PARAMETERS) + "   pooled")
    bounds = np.sqrt(np.mean([b**2 for _, b in drawn], axis=0))
    row("attainable 1-sigma [kg], [mm], [kg m^2]", bounds * UNITS, None)
    for method in METHODS:
        errors = np.array([d[method][0] for d, _ in drawn])
        covariances = np.array([d[method][1] for d, _ in drawn])
        z = errors / np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
        chi = [
            error @ np.linalg.solve(covariance, error)
            for error, covariance in zip(errors, covariances, strict=True)
        ]
        rmse = np.sqrt(np.mean(errors**2, axis=0))
        row(f"{method}: rmse", rmse * UNITS, None)
        row("  rmse over attainable", rmse / bounds, float(np.sqrt(np.mean((rmse / bounds) ** 2))))
        row("  mean error in sigmas", z.mean(axis=0), None)
        row("  rms error in sigmas", np.sqrt(np.mean(z**2, axis=0)), float(np.sqrt(np.mean(z**2))))
        row(
            "  95 % intervals cover [%]",
            100 * np.mean(np.abs(z) < 1.96, axis=0),
            float(100 * np.mean(np.abs(z) < 1.96)),
        )
        print(
            f"  chi-square of the ten per degree of freedom {np.mean(chi) / 10:.3f}, largest"
            f" {np.max(chi):.1f}"
        )
        groups = {"centre of gravity": slice(1, 4), "moments": slice(4, 7), "inertia": slice(4, 10)}
        two_step = np.array([d["two-step"][0] for d, _ in drawn])
        print(
            "  rmse over that of two-step: "
            + ", ".join(
                f"{name}"
                f" {np.sqrt(np.mean(errors[:, own] ** 2) / np.mean(two_step[:, own] ** 2)):.3f}"
                for name, own in groups.items()
            )
        )
        accepted = sum(d[method][2] for d, _ in drawn)
        print(
            f"  accepted {accepted} of {count}, a body {sum(bool(d[method][3]) for d, _ in drawn)}"
            f" of {count}"
        )


def row(what: str, values: Array, pooled: float | None) -> None:
    print(
        f"{what:40}"
        + "".join(f"{v:9.3f}" for v in values)
        + (f"{pooled:9.3f}" if pooled is not None else ""),
        flush=True,
    )


if __name__ == "__main__":
    main(
        int(sys.argv[1]) if len(sys.argv) > 1 else 200, int(sys.argv[2]) if len(sys.argv) > 2 else 2
    )
