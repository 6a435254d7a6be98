"""From a posterior to an estimate: what the data do not tell struck out, the rest judged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.digits import SHORT_LABELS
from steelyard.dynamics import wrench_about
from steelyard.estimates.estimate import Estimate, judge
from steelyard.identification.methods.from_posterior.unstated import (
    disturbances,
    found_errors,
    notes_on_jitter,
    notes_on_unstated,
)
from steelyard.identification.methods.from_posterior.unweighed import found_geometry, up_to_mass
from steelyard.identification.model.calibration_parameters import as_tree
from steelyard.identification.solve.posterior import Posterior
from steelyard.identification.verdict.assessment import reasons
from steelyard.identification.verdict.directed_tests import directed_tests
from steelyard.identification.verdict.information_shares import (
    label_mask,
    priors_share,
    variance_shares,
)
from steelyard.identification.verdict.known_values import known_values
from steelyard.identification.verdict.settings import VERDICT, VerdictSettings
from steelyard.identification.verdict.vibrations import vibrations
from steelyard.inertia import BODY_PARAMETERS, Inertia

_ENLARGED_BECAUSE = {
    "noise": "residuals of forces and motion are larger than the noise",
    "blocks": "residuals are correlated in time beyond white noise",
    "runs": "the runs scatter more than noise explains",
}
"""By the names of :attr:`Solution.inflation`."""


def finished(
    found: Posterior,
    method: str,
    *,
    value: Array | None = None,
    covariance: Array | None = None,
    further: Sequence[str] = (),
    details: Mapping[str, Any] | None = None,
    notes: Sequence[str] = (),
    settings: VerdictSettings = VERDICT,
) -> Estimate:
    """The estimate of a posterior: what the data do not tell struck out, the rest judged.

    Args:
        found: What it stands on.
        method: Its name.
        value: The ten body parameters, where they are not those of the posterior, shape (10,).
        covariance: Theirs, shape (10, 10).
        further: Reasons against it that the posterior does not know.
        details: How it was made, beyond what all share.
        notes: What a reader should know, beyond what all share.
        settings: Levels of the verdict.
    """
    solution, calibration_parameters = found.solution, found.calibration.calibration_parameters
    value = Inertia.from_parameters(found.parameters).body_parameters if value is None else value
    covariance = found.body_covariance if covariance is None else covariance
    # What is written is symmetric to the last bit, however it was computed.
    covariance = (covariance + covariance.T) / 2
    # What did not arrive has no numbers.
    known = found.identifiable & found.fit.converged
    value = np.where(known, value, np.nan)
    covariance = np.where(np.outer(known, known), covariance, np.nan)
    tests, shaken = directed_tests(found, settings), vibrations(found, settings)
    verdict = judge(
        value,
        reasons=[*further, *reasons(found, tests, settings, shaken)],
        by_prior=[bool(p) for p in label_mask(found)],
    )
    disturbed, errors = disturbances(found), found_errors(found)
    estimate = Estimate(
        method=method,
        geometry=found_geometry(found),
        value=value,
        covariance=covariance,
        verdict=verdict,
        calibration=as_tree(
            found.experiment, calibration_parameters, found.calibration.values, found.deviations
        ),
        residuals=_residuals(found),
        details={
            "noise_ratio": float(np.sqrt(max(solution.ratio, 0.0))),
            "covariance_enlarged_by": dict(solution.inflation),
            "share_of_priors": dict(zip(BODY_PARAMETERS, priors_share(found), strict=True)),
            "uncertainty_budget": {
                name: dict(zip(BODY_PARAMETERS, share, strict=True))
                for name, share in variance_shares(found).items()
            },
            "known": {each.name: {**asdict(each), "z": each.z} for each in known_values(found)},
            "filter": {s.run: {"knot_spacing": s.spacing} for s in found.samples if not s.static},
            "samples": {s.run: len(s) for s in found.samples},
            "independent_samples": {run: each.freedom for run, each in found.equations.items()},
            "directed_tests": {
                "count": len(tests),
                "largest": [
                    {
                        "name": t.name,
                        "z": t.z,
                        "size": t.size,
                        "sigma": t.sigma,
                        "unit": t.unit,
                    }
                    for t in tests[:5]
                ],
            },
            **({"moves_within": True} if _moves_within(found) else {}),
            "disturbances": disturbed,
            "jitter": dict(found.fit.state.jitters),
            "found_errors": errors,
            **(details or {}),
            **_of_fit(found),
        },
        notes=(
            *found.notes,
            *_notes(found),
            *notes_on_unstated(disturbed, errors),
            *notes_on_jitter(found),
            *map(str, shaken.values()),
            *_of_weights(found),
            *notes,
            *_left_out(found),
        ),
    )
    return up_to_mass(found.of_its_runs, estimate)


def _residuals(found: Posterior) -> dict[str, Any]:
    """Root mean square of the balance per axis, and of each motion instrument in units of its
    noise.
    """
    left = [found.unexplained(s) for s in found.samples if s.run not in found.held_out]
    residual = wrench_about(np.concatenate(left), found.experiment.origin)
    rms = np.sqrt(np.mean(residual**2, axis=0))
    motion: dict[str, dict[str, float]] = {}
    for (name, quantity), ratio in found.motion_ratios.items():
        motion.setdefault(name, {})[quantity] = ratio
    return {"force": rms[:3], "torque": rms[3:], "in_units_of_noise": motion}


def _of_weights(found: Posterior) -> list[str]:
    """Dead weights that it rests on, in words."""
    weighed = found.calibration.calibration_parameters.weighed
    return [] if weighed is None else [*map(str, weighed.tables), *map(str, weighed.wrong)]


def _notes(found: Posterior) -> list[str]:
    """What is not identifiable, and why the 1-sigma was enlarged, in words."""
    notes = []
    lacking = np.array(SHORT_LABELS)[~found.identifiable]
    if len(lacking):
        notes.append(f"not identifiable from these data: {', '.join(lacking)} ({_motion(found)})")
    for name, factor in found.solution.inflation.items():
        notes.append(f"1-sigma enlarged by {np.sqrt(factor):.2f}: {_ENLARGED_BECAUSE[name]}")
    return notes


def _moves_within(found: Posterior) -> bool:
    """Whether something moved in the load while the platform moved."""
    runs = (run.name for run in found.experiment.runs if found.carries(run.name))
    return any(map(found.experiment.moves_within, runs))


def _motion(found: Posterior) -> str:
    """How the platform moved, in words: what an inertia that is not identifiable lacks."""
    if _moves_within(found):
        return "something moves in it: its motion tells its mass alone"
    moving = [s for s in found.samples if not s.static]
    if not moving:
        return (
            "poses at rest say nothing about the inertia, and each says where the centre of gravity"
            " is only across gravity"
        )
    rates = np.sqrt(np.mean(np.concatenate([s.alpha**2 for s in moving]), axis=0))
    return (
        "angular acceleration about x, y, z was "
        + ", ".join(f"{r:.2g}" for r in rates)
        + " rad/s^2 rms"
    )


def _of_fit(found: Posterior) -> dict[str, Any]:
    """How the fit was made: knots, noise as stated and as found, steps, what was left out."""
    fit = found.fit
    motion = {
        segment.run: {
            "knot_spacing": float(segment.knots[6] - segment.knots[5]),
            "smoothness": dict(segment.smoothness or {}),
        }
        for segment in fit.state.segments
        if not segment.static
    }
    first, means = fit.first_sigmas, _means_of(found)
    noise: dict[str, dict[str, Any]] = {}
    for (name, quantity), count in fit.tally.count.items():
        factor = fit.state.factors.get((name, quantity), 1.0)
        # Of single samples, wherever means of them were looked at.
        sample = first[name, quantity] * float(np.sqrt(means.get(name, 1)))
        noise.setdefault(name, {})[quantity] = {
            "stated": sample if (name, quantity) in fit.stated else None,
            "used": sample * factor,
            "found": sample * factor * float(np.sqrt(fit.ratios.get((name, quantity), 1.0))),
            "numbers": count,
            "far": fit.tally.far.get((name, quantity), 0),
        }
    return {
        "motion": motion,
        "noise": noise,
        "solver": {"converged": fit.converged, "steps": fit.turns},
        "left_out": {
            "contacts": {
                run: [list(each) for each in contacts] for run, contacts in found.contacts.items()
            },
            "single_readings": dict(found.spikes),
        },
        "over_attainable": {
            name: float(ours / best)
            for name, ours, best in zip(
                BODY_PARAMETERS,
                np.sqrt(np.diag(found.body_covariance)),
                found.bound.standard_deviation,
                strict=True,
            )
        },
    }


def _left_out(found: Posterior) -> list[str]:
    """What was left out of the forces, or counts little, in words."""
    notes = [
        f"{count} of {found.fit.tally.count.get(source, 0.0) + count:.0f} numbers of"
        f" {source[0]}, {source[1].replace('_', ' ')}, stand far from the motion, beyond what noise"
        " makes, as damaged files and glitches do: they count as at the limit of noise"
        for source, count in found.fit.tally.far.items()
        if found.fit.tally.is_beyond_noise(source)
    ]
    for run, contacts in found.contacts.items():
        when = ", ".join(f"{start:.2f} to {end:.2f} s" for start, end in contacts)
        notes.append(
            f"run '{run}': something else than the body pulled or pushed from {when}: left out"
        )
    for run, count in found.spikes.items():
        notes.append(
            f"run '{run}': {count} force readings stand alone against all others: left out"
        )
    return notes


def _means_of(found: Posterior) -> dict[str, int]:
    """Instrument -> samples that each of the readings is the mean of, in the last run that has
    it.
    """
    runs = found.experiment.runs
    return {name: stream.mean_of for run in runs for name, stream in run.streams.items()}
