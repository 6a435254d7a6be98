"""The procedure of the paper: Eq. (6) for mass and centre of gravity, then Eq. (8) for the inertia,
by ordinary least squares.

Faithful to [Tempel2017]_ with the corrections of errata.md: straight massless cables behind
pulleys, acceleration from the IMU or from the tracker (Table I), every run alone, the median over
the runs (Table III). Two extensions keep both steps linear: a wrench sensor in place of the cables
brings its constant offsets as further unknowns, and poses at rest give the mass from the forces and
the centre of gravity from the torque balance n = h x s, since Eq. (6) is silent about it at rest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, Literal

import numpy as np

from steelyard.arrays import Array
from steelyard.digits import SHORT_LABELS
from steelyard.errors import InputError
from steelyard.estimates.estimate import Estimate, plausible_radius
from steelyard.experiment.model import Experiment
from steelyard.experiment.unread import is_unread, unread_runs
from steelyard.identification.methods.settings import TWO_STEP, TwoStepSettings
from steelyard.identification.methods.two_step.body_fit import finish, median, merge
from steelyard.identification.methods.two_step.steps import (
    fit_of_motion,
    fit_of_poses,
    root_mean_square,
)
from steelyard.identification.model.sources import Acceleration, choose_sources
from steelyard.identification.samples.preparation import prepare
from steelyard.identification.samples.prepared import Samples
from steelyard.identification.solve.posterior import Posterior
from steelyard.instruments.equations import means, predict, terms_behind
from steelyard.motion.state import State

Combine = Literal["median", "pooled"]


@dataclass(frozen=True)
class TwoStep:
    """The paper's estimator and its settings."""

    acceleration: Acceleration | None = None
    """Where a_P comes from: ``imu`` or ``tracker`` (Table I's a_LT); None: the IMU where there is
    one."""
    combine: Combine = "median"
    """How runs in motion are brought together: the median of their estimates, or all samples in one
    fit."""
    settings: TwoStepSettings = TWO_STEP
    """Thresholds of filter and fit."""

    name: ClassVar[str] = "two-step"
    fit: ClassVar[None] = None

    def lack(self, experiment: Experiment) -> str:
        """What the method needs and the experiment has not, in words; empty where all is there."""
        return "it needs the force of every cable, found none" if is_unread(experiment) else ""

    @property
    def is_baseline(self) -> bool:
        """Whether it may fail beside better methods; not where one of its settings is asked for."""
        return self.acceleration is None

    def drawn(self, posterior: Posterior) -> Estimate:
        """The two steps draw from samples, not from a posterior."""
        return self(posterior.experiment)

    def __call__(
        self, experiment: Experiment, progress: Callable[[str, float], None] | None = None
    ) -> Estimate:
        """Estimate.

        Raises:
            InputError: A run lacks what the method needs.
        """
        unread = unread_runs(experiment)
        weighed = tuple(run for run in experiment.runs if run.name not in unread)
        experiment = replace(experiment, runs=weighed)
        runs = []
        for i, run in enumerate(experiment.runs):
            if progress:
                progress(f"two-step: {run.name}", i / len(experiment.runs))
            samples = prepare(
                experiment,
                run,
                acceleration=self.acceleration,
                straight=True,
                settings=self.settings.preparation,
            )
            runs.append(samples)
        size = plausible_radius(experiment.robot)
        estimate = estimate_two_step(runs, size, self.combine, settings=self.settings)
        notes = [*estimate.notes, *_not_in_sigma(experiment, self.acceleration)]
        if unread:
            notes.append(f"runs that read no forces are left out: {', '.join(unread)}")
        estimate = replace(estimate, notes=tuple(notes))
        details = dict(estimate.details)
        offset = details.pop("offset", None)
        forces = {experiment.force_instrument(run) for run in experiment.runs}
        name = forces.pop() if len(forces) == 1 else None
        calibration = {name: _reading_offset(experiment, name, **offset)} if offset and name else {}
        return replace(estimate, calibration=calibration, details=details)


def _reading_offset(
    experiment: Experiment, name: str, value: Array, covariance: Array
) -> dict[str, Any]:
    """Offset of a wrench sensor in its own axes and sign, from that of the wrench on the
    platform.
    """
    instrument, robot = experiment.instruments[name], experiment.robot
    known = means(instrument, robot.m)
    # The equation is linear: its readings of zero and of unit wrenches are all there is to know.
    wrenches = np.vstack([np.zeros(6), np.eye(6), value])
    nothing = State(**dict.fromkeys((f.name for f in fields(State)), None))
    read = predict(instrument, robot, replace(nothing, wrench=wrenches), known)
    readings = np.hstack([read["force"], read["torque"]])
    matrix = (readings[1:7] - readings[0]).T
    found = (
        np.concatenate([known["offset.force"], known["offset.torque"]]) + readings[7] - readings[0]
    )
    deviation = np.sqrt(np.diag(matrix @ covariance @ matrix.T))
    return {
        "offset": {
            "force": {"value": found[:3], "standard_deviation": deviation[:3]},
            "torque": {"value": found[3:], "standard_deviation": deviation[3:]},
        }
    }


def _not_in_sigma(experiment: Experiment, acceleration: Acceleration | None) -> list[str]:
    """What the method neither estimates nor counts: a small 1-sigma must not be taken for a small
    error.
    """
    robot = experiment.robot.with_straight_cables()
    errors: dict[str, None] = {}
    for run in experiment.runs:
        sources = choose_sources(experiment, run, acceleration)
        forces = [(sources.force, quantity) for quantity in run.streams[sources.force].values]
        # These two are dealt with: the first is in the 1-sigma, the second is one of the unknowns.
        place = sources.specific_force or (sources.position if sources.omega else None)
        on_wrench = experiment.instruments[sources.force].measured_force == "wrench"
        for name, quantity in [*forces, *sources.used()]:
            for term in terms_behind(experiment.instruments[name], quantity, robot):
                dealt_with = ((name, quantity) == place and term.key in {"position", "target"}) or (
                    on_wrench
                    and (term.key.startswith("offset") or term.key == "accelerometer_bias")
                )
                if not dealt_with and (term.deviation is None or term.deviation.any()):
                    errors[f"{name}.{term.key}"] = None
            if not run.static and experiment.delay(run, name).sigma != 0.0:
                errors[f"{name}.delay"] = None
    for name, uncertainty in experiment.uncertainty.items():
        if uncertainty and (experiment.robot.m or name == "gravity"):
            errors[f"uncertainty.{name}"] = None
    if experiment.robot.cable.linear_density:
        errors["the weight of the cables"] = None
    notes = (
        [f"its 1-sigma comes from the residuals; it does not contain {', '.join(errors)}"]
        if errors
        else []
    )
    if experiment.known:
        notes.append(f"it does not use what is known beforehand ({', '.join(experiment.known)})")
    for each in experiment.weights:
        notes.append(
            f"it does not use the dead weights on {each.of} ({len(each)} rows of"
            f" '{each.instrument}')"
        )
    return notes


def estimate_two_step(
    runs: Sequence[Samples],
    size: float,
    combine: Combine = "median",
    *,
    settings: TwoStepSettings = TWO_STEP,
) -> Estimate:
    """The two steps over prepared runs.

    Args:
        runs: Moving and static ones, at least one.
        size: Plausible radius of the body [m]: what is not known better than half of it is not
            known.
        combine: See :class:`TwoStep`.
        settings: Thresholds of the fit.
    """
    moving = [run for run in runs if not run.static]
    static = [run for run in runs if run.static]
    if not runs:
        raise InputError("expected at least one run, found none; add recordings")
    at_rest = fit_of_poses(static, size, settings) if static else None
    groups = (
        {"all runs pooled": moving}
        if combine == "pooled" and moving
        else {run.run: [run] for run in moving}
    )
    alone = {name: fit_of_motion(group, size, None, settings) for name, group in groups.items()}
    # The inertia about the centre of gravity is had with the best centre of gravity there is.
    informed = (
        [fit_of_motion(group, size, at_rest, settings) for group in groups.values()]
        if at_rest
        else list(alone.values())
    )
    combined = merge(median(list(alone.values()), size), median(informed, size), at_rest)
    fits = {**alone, **({"static poses": at_rest} if at_rest else {})}
    whole = finish(combined, size, TwoStep.name)
    details: dict[str, Any] = {
        "combine": combine if len(moving) > 1 else "single run",
        "samples": {run.run: len(run) for run in runs},
        "filter": {
            run.run: {
                "knot_spacing": run.spacing,
                "alpha_noise": run.alpha_noise,
                "alpha_rms": root_mean_square(run.alpha),
            }
            for run in moving
        },
    }
    if any(run.free_offset for run in runs):
        details["offset"] = {"value": combined.offset, "covariance": combined.offset_covariance}
    return replace(
        whole,
        runs=(
            {name: finish(fit, size, TwoStep.name) for name, fit in fits.items()}
            if len(fits) > 1
            else {}
        ),
        notes=(*(note for run in runs for note in run.notes), *_untold_notes(whole, moving)),
        details=details,
    )


def _untold_notes(estimate: Estimate, moving: Sequence[Samples]) -> list[str]:
    """Which of the ten are not identifiable, and why, in words."""
    untold = [name for name, v in zip(SHORT_LABELS, estimate.value, strict=True) if np.isnan(v)]
    if not untold:
        return []
    if moving:
        rates = np.sqrt(np.mean(np.concatenate([run.alpha**2 for run in moving]), axis=0))
        why = (
            "angular acceleration about x, y, z was "
            + ", ".join(f"{r:.2g}" for r in rates)
            + " rad/s^2 rms"
        )
    else:
        why = (
            "poses at rest say nothing about the inertia, and each says where the centre of gravity"
            " is only across gravity"
        )
    return [f"not identifiable from these data: {', '.join(untold)} ({why})"]
