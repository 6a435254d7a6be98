"""Eq. (6) and Eq. (8) of [Tempel2017]_, and the balance of poses at rest, as linear steps over
samples, and what the second passes on of the errors of the first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.dynamics import platform_regressor
from steelyard.identification.methods.linear import LinearFit, block_sums, covariance_of, solve
from steelyard.identification.methods.settings import TwoStepSettings
from steelyard.identification.methods.two_step.body_fit import BodyFit, from_two_steps
from steelyard.identification.samples.prepared import Samples

_ROWS = 20_000
"""Samples whose regressor is held at once."""

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
    force_samples = root_mean_square(e.specific_force)
    inverse_mass = force_samples / max(root_mean_square(e.force), settings.least_force)
    groups = [_Unknown(_INVERSE_MASS, -e.force[:, :, None], inverse_mass, np.zeros(1))]
    return [*groups, _free(_FORCE_OFFSET, len(e.force), force_samples)] if e.offset else groups


def _torque_offset(e: _Equations) -> list[_Unknown]:
    return (
        [_free(_TORQUE_OFFSET, len(e.torque), root_mean_square(e.torque) + 1e-12)]
        if e.offset
        else []
    )


def fit_of_motion(
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


def fit_of_poses(runs: Sequence[Samples], size: float, settings: TwoStepSettings) -> BodyFit:
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


def _block(runs: Sequence[Samples], settings: TwoStepSettings) -> int:
    """Samples over which residuals may be correlated."""
    n = sum(len(run) for run in runs)
    step = float(np.median(np.concatenate([np.diff(run.time) for run in runs])))
    spacing = max(run.spacing for run in runs)
    correlated = max(1.0, settings.block_spacings * spacing / max(step, 1e-9))
    return int(min(correlated, max(1, n // settings.least_blocks)))


def root_mean_square(vectors: Array) -> float:
    """Of the lengths of vectors, shape (n, 3)."""
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))
