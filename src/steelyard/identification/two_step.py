"""The procedure of the paper: Eq. (6) for mass and centre of gravity, then Eq. (8) for the inertia, by ordinary least squares.

Faithful to [Tempel2017]_ with the corrections of errata.md: straight massless cables behind pulleys, acceleration from the IMU or
from the tracker (Table I), every run alone, the median over the runs (Table III). Two extensions keep both steps linear: a wrench
sensor in place of the cables brings its constant offsets as further unknowns, and poses at rest give the mass from the forces and
the centre of gravity from the torque balance n = h x s, since Eq. (6) is silent about it at rest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.dynamics import platform_regressor
from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.identification.estimate import Estimate, judge
from steelyard.identification.linear import LinearFit, block_covariance, solve
from steelyard.identification.preparation import Acceleration, Samples, choose_sources, prepare
from steelyard.inertia import BODY_PARAMETERS, point_inertia, six
from steelyard.instruments.equations import means, predict, terms_behind
from steelyard.motion.state import State

_UNTOLD = 0.5
"""A parameter whose 1-sigma exceeds this part of its plausible size is not told by the data."""
_BLOCK_SPACINGS = 10.0
"""Length of a block of correlated residuals, in knot spacings of the filter."""
_LEAST_BLOCKS = 10
_BODY_SIZE_ON_SENSOR = 0.3
"""Plausible radius of a body on a wrench sensor [m]; a platform on cables shows its own."""

Combine = Literal["median", "pooled"]


@dataclass(frozen=True)
class TwoStep:
    """The paper's estimator and its settings."""

    acceleration: Acceleration | None = None
    """Where a_P comes from: ``imu`` or ``tracker`` (Table I's a_LT); None: the IMU where there is one."""
    combine: Combine = "median"
    """How runs in motion are brought together: the median of their estimates, or all samples in one fit."""

    name = "two-step"

    def __call__(self, experiment: Experiment, progress: Callable[[str, float], None] | None = None) -> Estimate:
        """Estimate.

        Raises:
            InputError: A run lacks what the method needs.
        """
        runs = []
        for i, run in enumerate(experiment.runs):
            if progress:
                progress(f"two-step: {run.name}", i / len(experiment.runs))
            runs.append(prepare(experiment, run, acceleration=self.acceleration, straight=True))
        estimate = estimate_two_step(runs, _size(experiment), self.combine)
        estimate = replace(estimate, notes=(*estimate.notes, *_not_in_sigma(experiment, self.acceleration)))
        details = dict(estimate.details)
        offset = details.pop("offset", None)
        forces = {experiment.force_instrument(run) for run in experiment.runs}
        name = forces.pop() if len(forces) == 1 else None
        calibration = {name: _reading_offset(experiment, name, **offset)} if offset and name else {}
        return replace(estimate, calibration=calibration, details=details)


def _reading_offset(experiment: Experiment, name: str, value: Array, covariance: Array) -> dict[str, Any]:
    """Offset of a wrench sensor in its own axes and sign, from that of the wrench on the platform."""
    instrument, robot = experiment.instruments[name], experiment.robot
    known = means(instrument, robot.m)
    # The equation is linear: its readings of zero and of unit wrenches are all there is to know.
    wrenches = np.vstack([np.zeros(6), np.eye(6), value])
    nothing = State(**dict.fromkeys((f.name for f in fields(State)), None))
    read = predict(instrument, robot, replace(nothing, wrench=wrenches), known)
    readings = np.hstack([read["force"], read["torque"]])
    matrix = (readings[1:7] - readings[0]).T
    found = np.concatenate([known["offset.force"], known["offset.torque"]]) + readings[7] - readings[0]
    deviation = np.sqrt(np.diag(matrix @ covariance @ matrix.T))
    return {
        "offset": {
            "force": {"value": found[:3], "standard_deviation": deviation[:3]},
            "torque": {"value": found[3:], "standard_deviation": deviation[3:]},
        }
    }


def _not_in_sigma(experiment: Experiment, acceleration: Acceleration | None) -> list[str]:
    """What the method neither estimates nor counts: a small 1-sigma must not be taken for a small error."""
    robot = experiment.robot.with_straight_cables()
    errors: dict[str, None] = {}
    for run in experiment.runs:
        sources = choose_sources(experiment, run, acceleration)
        forces = [(sources.force, quantity) for quantity in run.streams[sources.force].values]
        # These two are dealt with: the first is in the 1-sigma, the second is one of the unknowns.
        place = sources.specific_force or (sources.position if sources.omega else None)
        on_wrench = experiment.instruments[sources.force].kind == "wrench"
        for name, quantity in [*forces, *sources.used()]:
            for term in terms_behind(experiment.instruments[name], quantity, robot):
                dealt_with = ((name, quantity) == place and term.key in {"position", "target"}) or (
                    on_wrench and (term.key.startswith("offset") or term.key == "accelerometer_bias")
                )
                if not dealt_with and (term.deviation is None or term.deviation.any()):
                    errors[f"{name}.{term.key}"] = None
            if not run.static and experiment.delay(run, name).sigma != 0.0:
                errors[f"{name}.delay"] = None
    if experiment.robot.cable.linear_density:
        errors["the weight of the cables"] = None
    return [f"its 1-sigma comes from the residuals; it does not contain {', '.join(errors)}"] if errors else []


def _size(experiment: Experiment) -> float:
    return experiment.robot.size if experiment.robot.m else _BODY_SIZE_ON_SENSOR


@dataclass(frozen=True, eq=False)
class _Partial:
    """Body parameters of one fit before untold ones are struck out; huge sigmas where nothing is known."""

    value: Array
    """Shape (10,)."""
    covariance: Array
    """Shape (10, 10)."""
    offset: tuple[Array, Array] | None
    """Constant offset of the wrench and its covariance, shapes (6,) and (6, 6)."""
    residual: Array
    """Root mean square of force and torque [N], [N m], shape (6,)."""
    condition: tuple[float, float]


def estimate_two_step(runs: Sequence[Samples], size: float, combine: Combine = "median") -> Estimate:
    """The two steps over prepared runs.

    Args:
        runs: Moving and static ones, at least one.
        size: Plausible radius of the body [m]: what is not known better than half of it is not known.
        combine: See :class:`TwoStep`.
    """
    moving = [run for run in runs if not run.static]
    static = [run for run in runs if run.static]
    if not runs:
        raise InputError("expected at least one run, found none; add recordings")
    at_rest = _poses(static, size) if static else None
    groups = {"all runs pooled": moving} if combine == "pooled" and moving else {run.run: [run] for run in moving}
    alone = {name: _motion(group, size, None) for name, group in groups.items()}
    # The inertia about the centre of gravity is had with the best centre of gravity there is.
    informed = [_motion(group, size, at_rest) for group in groups.values()] if at_rest else list(alone.values())
    combined = _merge(_median(list(alone.values()), size), _median(informed, size), at_rest)
    fits = dict(alone)
    if at_rest is not None:
        fits["static poses"] = at_rest
    estimates = {name: _finish(fit, size) for name, fit in fits.items()}
    whole = _finish(combined, size)
    notes = [note for run in runs for note in run.notes] + _untold_notes(whole, moving, static)
    details: dict[str, Any] = {
        "combine": combine if len(moving) > 1 else "single run",
        "samples": {run.run: len(run) for run in runs},
        "filter": {
            run.run: {"knot_spacing": run.spacing, "alpha_noise": run.alpha_noise, "alpha_rms": _rms(run.alpha)}
            for run in moving
        },
    }
    if combined.offset is not None:
        details["offset"] = {"value": combined.offset[0], "covariance": combined.offset[1]}
    return replace(whole, runs=estimates if len(estimates) > 1 else {}, notes=tuple(notes), details=details)


# The two steps


def _motion(runs: Sequence[Samples], size: float, at_rest: _Partial | None) -> _Partial:
    """Eq. (6), then Eq. (8), over the samples of one or more runs in motion."""
    offset = any(run.free_offset for run in runs)
    Y = np.concatenate([platform_regressor(run.specific_force, run.omega, run.alpha) for run in runs])
    wrench = np.concatenate([run.wrench for run in runs])
    block = _block(runs)
    force, torque = wrench[:, :3], wrench[:, 3:]

    # Step one, Eq. (6): -F (1/m) [+ b (1/m)] + ([w']x + [w]x[w]x) c = -s.
    columns = [-force[:, :, None], Y[:, :3, 1:4]]
    inverse_mass = _inverse_mass(force, Y[:, :3, 0])
    scale = [inverse_mass, size, size, size]
    alpha_noise = np.sqrt(np.mean([run.alpha_noise**2 for run in runs]))
    noise = [0.0, *[2 * alpha_noise**2] * 3]
    if offset:
        columns.append(_constant(len(wrench)))
        scale += [inverse_mass * _rms(force)] * 3
        noise += [0.0] * 3
    one = solve(np.concatenate(columns, axis=2), -Y[:, :3, 0], np.array(scale), np.array(noise))
    k1, k1_influence, k1_unknown = _first_step(one, np.array(scale), at_rest, runs, size)

    # Step two, Eq. (8): J_P from n - h x s, with h of step one; J_C follows by Eq. (7).
    mass = 1 / k1[0]
    h_columns = Y[:, 3:, 1:4]
    columns = [Y[:, 3:, 4:]]
    moment = mass * size**2
    scale = [moment] * 6
    noise = [alpha_noise**2 * share for share in (1, 1, 1, 2, 2, 2)]
    if offset:
        columns.append(_constant(len(wrench)))
        scale += [_rms(torque) + 1e-12] * 3
        noise += [0.0] * 3
    two = solve(
        np.concatenate(columns, axis=2), torque - h_columns @ (mass * k1[1:4]), np.array(scale), np.array(noise)
    )
    # How step two follows step one: h = c / (1/m).
    dh = np.column_stack([-k1[1:4] * mass**2, mass * np.eye(3)])
    passed_on = -two.pseudo_inverse @ (h_columns @ dh).reshape(-1, 4)

    joint = np.concatenate([k1, two.value])
    influence = np.hstack([k1_influence, two.influence + k1_influence[:, :4] @ passed_on.T])
    unknown_two = np.array(scale)[:, None] * two.unknown
    unknown = np.block(
        [
            [k1_unknown, np.zeros((len(k1), unknown_two.shape[1]))],
            [passed_on @ k1_unknown[:4], unknown_two],
        ]
    )
    covariance = block_covariance(influence, block) + unknown @ unknown.T
    return _as_body(joint, covariance, offset, _force_residual(one, k1), two.residual, (one.condition, two.condition))


def _first_step(
    one: LinearFit, scale: Array, at_rest: _Partial | None, runs: Sequence[Samples], size: float
) -> tuple[Array, Array, Array]:
    """Result of Eq. (6) for use in step two: value, influence, and square root of what else is uncertain in it.

    The place of the accelerometer is uncertain, and Eq. (6) tells the centre of gravity from that place. Where the motion alone
    does not tell the centre of gravity but poses at rest do, theirs is taken.
    """
    value, influence = one.value.copy(), one.influence
    unknown = scale[:, None] * one.unknown
    place = max(run.position_sigma for run in runs)
    shift = np.zeros((len(value), 3))
    shift[1:4] = place * np.eye(3)
    unknown = np.hstack([unknown, shift])
    own = np.sqrt(np.sum(unknown[1:4] ** 2, axis=1) + np.sum(influence[:, 1:4] ** 2, axis=0))
    if at_rest is not None:
        sigma = np.sqrt(np.diag(at_rest.covariance)[1:4])
        better = np.flatnonzero(sigma < own)
        influence = influence.copy()
        for axis in better:
            value[1 + axis] = at_rest.value[1 + axis]
            influence[:, 1 + axis] = 0.0
            unknown[1 + axis] = 0.0
        extra = np.zeros((len(value), len(better)))
        extra[1 + better, np.arange(len(better))] = sigma[better]
        unknown = np.hstack([unknown, extra])
    return value, influence, unknown


def _poses(runs: Sequence[Samples], size: float) -> _Partial:
    """Mass from the forces and centre of gravity from the torque balance of poses at rest."""
    offset = any(run.free_offset for run in runs)
    Y = np.concatenate([platform_regressor(run.specific_force, run.omega, run.alpha) for run in runs])
    wrench = np.concatenate([run.wrench for run in runs])
    force, torque = wrench[:, :3], wrench[:, 3:]
    inverse_mass = _inverse_mass(force, Y[:, :3, 0])
    columns, scale = [-force[:, :, None]], [inverse_mass]
    if offset:
        columns.append(_constant(len(wrench)))
        scale += [inverse_mass * _rms(force)] * 3
    one = solve(np.concatenate(columns, axis=2), -Y[:, :3, 0], np.array(scale), np.zeros(len(scale)))
    mass = 1 / one.value[0] if one.value[0] else np.inf
    # n = h x s, with h = m c.
    columns, scale_two = [Y[:, 3:, 1:4] * mass], [size] * 3
    if offset:
        columns.append(_constant(len(wrench)))
        scale_two += [_rms(torque) + 1e-12] * 3
    two = solve(np.concatenate(columns, axis=2), torque, np.array(scale_two), np.zeros(len(scale_two)))
    # The torque balance gives h; c = h / m moves with the mass.
    p = len(scale)
    order = [0, *range(p, p + 3)] + ([1, 2, 3] if offset else [])
    joint = np.concatenate([one.value, two.value])
    passed_on = np.zeros((len(scale_two), p))
    passed_on[:3, 0] = two.value[:3] * mass
    influence = np.hstack([one.influence, two.influence + one.influence @ passed_on.T])
    unknown_one, unknown_two = np.array(scale)[:, None] * one.unknown, np.array(scale_two)[:, None] * two.unknown
    unknown = np.block(
        [
            [unknown_one, np.zeros((p, unknown_two.shape[1]))],
            [passed_on @ unknown_one, unknown_two],
        ]
    )
    covariance = block_covariance(influence, 1) + unknown @ unknown.T
    # Nothing turns: of the inertia these data say nothing at all.
    moment = mass * size**2
    first = order
    last = list(range(p + 3, p + len(scale_two)))
    full = np.zeros((len(first) + 6 + len(last),))
    select = [*range(len(first)), *range(len(first) + 6, len(full))]
    full[select] = joint[[*first, *last]]
    matrix = np.zeros((len(full), len(full)))
    matrix[np.ix_(select, select)] = covariance[np.ix_([*first, *last], [*first, *last])]
    inside = range(len(first), len(first) + 6)
    matrix[inside, inside] = (100 * moment) ** 2
    return _as_body(full, matrix, offset, _force_residual(one, one.value), two.residual, (one.condition, two.condition))


def _as_body(
    joint: Array,
    covariance: Array,
    offset: bool,
    force_residual: Array,
    torque_residual: Array,
    condition: tuple[float, float],
) -> _Partial:
    """From (1/m, c[, b/m]) and (J_P[, b_n]) to mass, centre of gravity and inertia about it."""
    k = 7 if offset else 4

    def body(x: Array) -> Array:
        mass, c = 1 / x[0], x[1:4]
        six_moments = x[k : k + 6] - six(point_inertia(mass, c))
        offsets = [x[4:7] * mass, x[k + 6 : k + 9]] if offset else []
        return np.concatenate([[mass], c, six_moments, *offsets])

    jacobian = np.column_stack([body(joint + 1e-200j * e).imag / 1e-200 for e in np.eye(len(joint))])
    value, covariance = body(joint), jacobian @ covariance @ jacobian.T
    residual = np.sqrt(np.mean(np.hstack([force_residual, torque_residual]) ** 2, axis=0))
    offsets = (value[10:], covariance[10:, 10:]) if offset else None
    return _Partial(value[:10], covariance[:10, :10], offsets, residual, condition)


# Several runs


def _median(fits: Sequence[_Partial], size: float) -> _Partial | None:
    """Median of the estimates of single runs, each parameter over the runs that tell it (Table III).

    Its covariance is that of a median of independent estimates, (pi / 2) / R of their mean, and is enlarged where the runs scatter
    more than they should.
    """
    if len(fits) < 2:
        return fits[0] if fits else None
    values = np.array([f.value for f in fits])
    covariances = np.array([f.covariance for f in fits])
    told = np.array([_told(f, size) for f in fits])
    value, deviation = np.empty(10), np.empty(10)
    for j in range(10):
        use = told[:, j] if told[:, j].any() else np.ones(len(fits), dtype=bool)
        count = int(use.sum())
        value[j] = np.median(values[use, j])
        factor = (np.pi / 2 if count > 2 else 1.0) / count
        within = np.mean(covariances[use, j, j])
        between = np.var(values[use, j], ddof=1) if count > 1 else 0.0
        deviation[j] = np.sqrt(factor * max(within, between)) if told[:, j].any() else np.sqrt(within)
    mean = covariances.mean(axis=0)
    spread = np.sqrt(np.diag(mean))
    correlation = mean / np.outer(spread, spread)
    offsets = [f.offset for f in fits if f.offset is not None]
    offset = None
    if offsets:
        offset = (
            np.median([o[0] for o in offsets], axis=0),
            np.mean([o[1] for o in offsets], axis=0) / len(offsets),
        )
    residual = np.sqrt(np.mean([f.residual**2 for f in fits], axis=0))
    condition = tuple(max(f.condition[i] for f in fits) for i in (0, 1))
    return _Partial(value, correlation * np.outer(deviation, deviation), offset, residual, (condition[0], condition[1]))


def _merge(alone: _Partial | None, informed: _Partial | None, at_rest: _Partial | None) -> _Partial:
    """Motion and poses at rest are two measurements: mass and centre of gravity from the one that knows each better.

    Args:
        alone: From the runs in motion without the poses.
        informed: From the runs in motion with the centre of gravity of the poses where that is better; gives the inertia.
        at_rest: From the poses.
    """
    if alone is None or informed is None:
        assert at_rest is not None
        return at_rest
    if at_rest is None:
        return alone
    first = np.arange(10) < 4
    resting = first & (np.diag(at_rest.covariance) < np.diag(alone.covariance))
    value = np.where(resting, at_rest.value, np.where(first, alone.value, informed.value))
    covariance = np.zeros((10, 10))
    for part, fit in ((resting, at_rest), (first & ~resting, alone), (~first, informed)):
        block = np.ix_(part, part)
        covariance[block] = fit.covariance[block]
    return replace(informed, value=value, covariance=covariance, offset=at_rest.offset or informed.offset)


# What is told


def _plausible(value: Array, size: float) -> Array:
    """Plausible size of each of the ten body parameters."""
    moment = abs(value[0]) * size**2
    return np.array([abs(value[0]), size, size, size, *[moment] * 6])


def _told(fit: _Partial, size: float) -> NDArray[np.bool_]:
    told: NDArray[np.bool_] = np.sqrt(np.diag(fit.covariance)) < _UNTOLD * _plausible(fit.value, size)
    return told


def _finish(fit: _Partial, size: float) -> Estimate:
    """Strike out what the data do not tell, and judge the rest."""
    told = _told(fit, size)
    value = np.where(told, fit.value, np.nan)
    covariance = np.where(told[:, None] & told[None, :], fit.covariance, np.nan)
    return Estimate(
        method="two-step",
        value=value,
        covariance=covariance,
        verdict=judge(value),
        residuals={"force": fit.residual[:3], "torque": fit.residual[3:]},
        details={"condition": list(fit.condition)},
    )


def _untold_notes(estimate: Estimate, moving: Sequence[Samples], static: Sequence[Samples]) -> list[str]:
    untold = [name for name, v in zip(BODY_PARAMETERS, estimate.value, strict=True) if np.isnan(v)]
    if not untold:
        return []
    if not moving:
        why = (
            "poses at rest say nothing about the inertia"
            if set(untold) <= set(BODY_PARAMETERS[4:])
            else (
                "poses at rest say nothing about the inertia, and these about the centre of gravity only across gravity"
            )
        )
    else:
        rates = np.sqrt(np.mean(np.concatenate([run.alpha**2 for run in moving]), axis=0))
        why = "angular acceleration about x, y, z was " + ", ".join(f"{r:.2g}" for r in rates) + " rad/s^2 rms"
    return [f"not told by these data: {', '.join(untold)} ({why})"]


# Small things


def _block(runs: Sequence[Samples]) -> int:
    """Samples over which residuals may be correlated."""
    n = sum(len(run) for run in runs)
    steps = [np.median(np.diff(run.time)) for run in runs if len(run) > 1]
    step = float(np.median(steps)) if steps else 1.0
    spacing = max(run.spacing for run in runs)
    return int(min(max(1.0, _BLOCK_SPACINGS * spacing / max(step, 1e-9)), max(1, n // _LEAST_BLOCKS)))


def _constant(n: int) -> Array:
    return np.broadcast_to(np.eye(3), (n, 3, 3))


def _inverse_mass(force: Array, specific_force: Array) -> float:
    """A first value, for scale only."""
    return _rms(specific_force) / max(_rms(force), 1e-12)


def _force_residual(one: LinearFit, k1: Array) -> Array:
    """Residual of Eq. (6) as a force [N]."""
    return np.asarray(one.residual / k1[0])


def _rms(vectors: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))
