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
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.digits import SHORT_LABELS
from steelyard.dynamics import platform_regressor
from steelyard.errors import InputError
from steelyard.estimates.estimate import Estimate, plausible_radius
from steelyard.experiment.model import Experiment
from steelyard.experiment.unread import is_unread, unread_runs
from steelyard.identification.methods.body_fit import BodyFit, finish, from_two_steps, median, merge
from steelyard.identification.methods.linear import LinearFit, block_sums, covariance_of, solve
from steelyard.identification.methods.settings import TWO_STEP, TwoStepSettings
from steelyard.identification.model.sources import Acceleration, choose_sources
from steelyard.identification.samples.preparation import Samples, prepare
from steelyard.identification.solve.posterior import Posterior
from steelyard.instruments.equations import means, predict, terms_behind
from steelyard.motion.state import State

_ROWS = 20_000
"""Samples whose regressor is held at once."""

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
            f"it does not use the dead weights on {each.of} ({len(each)} rows of '{each.instrument}')"
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
    at_rest = _poses(static, size, settings) if static else None
    groups = (
        {"all runs pooled": moving}
        if combine == "pooled" and moving
        else {run.run: [run] for run in moving}
    )
    alone = {name: _motion(group, size, None, settings) for name, group in groups.items()}
    # The inertia about the centre of gravity is had with the best centre of gravity there is.
    informed = (
        [_motion(group, size, at_rest, settings) for group in groups.values()]
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
                "alpha_rms": _rms(run.alpha),
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


# The unknowns of both steps, in one vector of 16; the offsets stay zero where they are known.
_INVERSE_MASS = np.arange(1)
_COG = np.arange(1, 4)
_FORCE_OFFSET = np.arange(4, 7)  # divided by the mass
_MOMENTS = np.arange(7, 13)  # about the platform origin
_TORQUE_OFFSET = np.arange(13, 16)
_UNKNOWNS = 16
"""Of both steps together."""


class _Unknown(NamedTuple):
    """A group of unknowns of one step."""

    place: NDArray[np.intp]
    """Where they stand among the 16, shape (k,)."""
    columns: Array
    """Of the regressor, shape (n, 3, k)."""
    scale: float
    """Their plausible size."""
    noise: Array
    """Mean square that noise alone leaves in each column, shape (k,)."""


@dataclass(frozen=True, eq=False)
class _LinearStep:
    """A linear step, its solution placed among the 16."""

    fit: LinearFit
    place: NDArray[np.intp]
    regressor: Array
    value: Array
    """Shape (16,)."""
    unknown: Array
    """Square root of the covariance of what it cannot tell, shape (16, k)."""
    known_otherwise: NDArray[np.intp]
    """Unknowns whose value does not come from this step."""

    def influence(self, block: int) -> Array:
        """Influence of blocks of samples on the 16, shape (b, 16)."""
        sums = block_sums(self.fit.influence, block)
        placed = np.zeros((len(sums), _UNKNOWNS))
        placed[:, self.place] = sums
        placed[:, self.known_otherwise] = 0.0
        return placed

    def following(self, h_columns: Array) -> Array:
        """How its solution moves when ``h_columns @ h`` is taken off its target, shape (16, 3)."""
        moved = np.zeros((_UNKNOWNS, 3))
        moved[self.place] = -self.fit.normal_inverse @ np.einsum(
            "ndp,ndh->ph", self.regressor, h_columns
        )
        return moved


def _step(target: Array, *groups: _Unknown, settings: TwoStepSettings) -> _LinearStep:
    """One linear step over groups of unknowns, solved in units of their plausible sizes."""
    columns = [g.columns for g in groups]
    regressor = columns[0] if len(columns) == 1 else np.concatenate(columns, axis=2)
    place = np.concatenate([g.place for g in groups])
    scale = np.concatenate([np.full(len(g.place), g.scale) for g in groups])
    noise = np.concatenate([g.noise for g in groups])
    fit = solve(regressor, target, scale, noise, settings)
    value, unknown = np.zeros(_UNKNOWNS), np.zeros((_UNKNOWNS, fit.unknown.shape[1]))
    value[place], unknown[place] = fit.value, scale[:, None] * fit.unknown
    if _INVERSE_MASS[0] in place and value[0] == 0:
        value[0] = scale[place == 0][0]  # not told at all: any mass but an infinite one
    return _LinearStep(fit, place, regressor, value, unknown, np.arange(0))


def _free(place: NDArray[np.intp], n: int, scale: float) -> _Unknown:
    """A constant offset of a force or a torque."""
    return _Unknown(place, np.broadcast_to(np.eye(3), (n, 3, 3)), scale, np.zeros(3))


class _Equations(NamedTuple):
    """Both halves of the equations over the samples of all runs."""

    specific_force: Array
    """Shape (n, 3)."""
    force_of_cog: Array
    """Columns of h in the force, shape (n, 3, 3)."""
    torque_of_cog: Array
    """Columns of h in the torque, shape (n, 3, 3)."""
    torque_of_moments: Array
    """Columns of J_P in the torque, shape (n, 3, 6)."""
    force: Array
    torque: Array
    offset: bool
    """Whether the wrench has a free offset."""


def _equations(runs: Sequence[Samples]) -> _Equations:
    """Both halves of the equations over the samples of all runs."""
    parts: list[tuple[Array, Array, Array, Array]] = []
    for run in runs:
        for start in range(0, len(run), _ROWS):
            rows = slice(start, start + _ROWS)
            Y = platform_regressor(run.specific_force[rows], run.omega[rows], run.alpha[rows])
            parts.append(
                (
                    Y[:, :3, 0].copy(),
                    Y[:, :3, 1:4].copy(),
                    Y[:, 3:, 1:4].copy(),
                    Y[:, 3:, 4:].copy(),
                )
            )
    wrench = np.concatenate([run.wrench for run in runs])
    force_samples, in_force, in_torque, moments = (
        np.concatenate(group) for group in zip(*parts, strict=True)
    )
    offset = any(run.free_offset for run in runs)
    return _Equations(
        force_samples, in_force, in_torque, moments, wrench[:, :3], wrench[:, 3:], offset
    )


def _forces(e: _Equations, settings: TwoStepSettings) -> list[_Unknown]:
    """Unknowns of Eq. (6) without the centre of gravity: -F (1/m) + b/m = -s."""
    force_samples = _rms(e.specific_force)
    inverse_mass = force_samples / max(_rms(e.force), settings.least_force)
    groups = [_Unknown(_INVERSE_MASS, -e.force[:, :, None], inverse_mass, np.zeros(1))]
    return [*groups, _free(_FORCE_OFFSET, len(e.force), force_samples)] if e.offset else groups


def _torque_offset(e: _Equations) -> list[_Unknown]:
    return [_free(_TORQUE_OFFSET, len(e.torque), _rms(e.torque) + 1e-12)] if e.offset else []


def _motion(
    runs: Sequence[Samples], size: float, at_rest: BodyFit | None, settings: TwoStepSettings
) -> BodyFit:
    """Eq. (6), then Eq. (8), over the samples of one or more runs in motion."""
    e = _equations(runs)
    alpha_noise = float(np.sqrt(np.mean([run.alpha_noise**2 for run in runs])))

    # Step one, Eq. (6): -F (1/m) [+ b/m] + ([w']x + [w]x[w]x) c = -s.
    cog = _Unknown(_COG, e.force_of_cog, size, np.full(3, 2 * alpha_noise**2))
    one = _step(-e.specific_force, cog, *_forces(e, settings), settings=settings)
    one = _with_better_cog(one, runs, at_rest)

    # Step two, Eq. (8): J_P from n - h x s, with h of step one; J_C follows by Eq. (7).
    mass, c = 1 / one.value[0], one.value[_COG]
    moments = _Unknown(
        _MOMENTS, e.torque_of_moments, mass * size**2, alpha_noise**2 * np.array([1, 1, 1, 2, 2, 2])
    )
    torque = e.torque - e.torque_of_cog @ (mass * c)
    two = _step(torque, moments, *_torque_offset(e), settings=settings)

    # How step two follows step one, through h = c / (1/m).
    by_first = np.zeros((3, _UNKNOWNS))
    by_first[:, _INVERSE_MASS[0]], by_first[:, _COG] = -c * mass**2, mass * np.eye(3)
    passed_on = two.following(e.torque_of_cog) @ by_first
    return _joined(one, two, passed_on, _block(runs, settings))


def _poses(runs: Sequence[Samples], size: float, settings: TwoStepSettings) -> BodyFit:
    """Mass from the forces and centre of gravity from the torque balance of poses at rest."""
    e = _equations(runs)
    one = _step(-e.specific_force, *_forces(e, settings), settings=settings)
    mass = 1 / one.value[0]
    # n = h x s with h = m c, for c.
    cog = _Unknown(_COG, e.torque_of_cog * mass, size, np.zeros(3))
    two = _step(e.torque, cog, *_torque_offset(e), settings=settings)
    # The torque balance gives h; c = h (1/m) moves with the mass.
    passed_on = np.zeros((_UNKNOWNS, _UNKNOWNS))
    passed_on[_COG, _INVERSE_MASS[0]] = two.value[_COG] * mass
    # Nothing turns: of the inertia these data say nothing at all.
    nothing = np.zeros((_UNKNOWNS, len(_MOMENTS)))
    nothing[_MOMENTS] = 100 * mass * size**2 * np.eye(len(_MOMENTS))
    return _joined(one, replace(two, unknown=np.hstack([two.unknown, nothing])), passed_on, 1)


def _joined(one: _LinearStep, two: _LinearStep, passed_on: Array, block: int) -> BodyFit:
    """Both steps as one system of estimating equations: the second passes on the errors of the
    first.
    """
    follow = np.eye(_UNKNOWNS) + passed_on
    unknown = np.hstack([follow @ one.unknown, two.unknown])
    covariance = (
        covariance_of(one.influence(block) @ follow.T + two.influence(block)) + unknown @ unknown.T
    )
    # Residual of Eq. (6) as a force.
    residual = [one.fit.residual / one.value[0], two.fit.residual]
    return from_two_steps(
        one.value + two.value,
        covariance,
        residual=np.concatenate([np.sqrt(np.mean(r**2, axis=0)) for r in residual]),
        condition=(one.fit.condition, two.fit.condition),
    )


def _with_better_cog(
    one: _LinearStep, runs: Sequence[Samples], at_rest: BodyFit | None
) -> _LinearStep:
    """Result of Eq. (6) with what else is uncertain in it, and with the centre of gravity of poses
    at rest where that is better.

    The place of the accelerometer is uncertain, and Eq. (6) tells the centre of gravity from that
    place.
    """
    place = np.zeros((_UNKNOWNS, 3))
    place[_COG] = max(run.position_sigma for run in runs) * np.eye(3)
    unknown = np.hstack([one.unknown, place])
    if at_rest is None:
        return replace(one, unknown=unknown)
    own = np.sqrt(
        np.sum(unknown[_COG] ** 2, axis=1) + np.sum(one.influence(1)[:, _COG] ** 2, axis=0)
    )
    sigma = np.sqrt(np.diag(at_rest.covariance))[_COG]
    better = _COG[sigma < own]
    value = one.value.copy()
    value[better], unknown[better] = at_rest.value[better], 0.0
    extra = np.zeros((_UNKNOWNS, _UNKNOWNS))
    extra[better, better] = np.sqrt(np.diag(at_rest.covariance))[better]
    return replace(one, value=value, unknown=np.hstack([unknown, extra]), known_otherwise=better)


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


def _block(runs: Sequence[Samples], settings: TwoStepSettings) -> int:
    """Samples over which residuals may be correlated."""
    n = sum(len(run) for run in runs)
    step = float(np.median(np.concatenate([np.diff(run.time) for run in runs])))
    spacing = max(run.spacing for run in runs)
    correlated = max(1.0, settings.block_spacings * spacing / max(step, 1e-9))
    return int(min(correlated, max(1, n // settings.least_blocks)))


def _rms(vectors: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))
